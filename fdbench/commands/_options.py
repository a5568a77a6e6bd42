"""Options that commands share, and how the files and folders that they name are checked."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from fdbench.catalogue import scenario_ids
from fdbench.errors import FdbenchError, SpecError, did_you_mean
from fdbench.registry import Registry

DEFAULT_OUT = Path("results")

SCENARIO = "scenario"
PLUGINS = ("estimator", "effect", "metric", "plant", "motion", "diagnoser")


def writable(path: Path | None) -> Path | None:
    """Return a file to write; one that cannot be made is refused before anything long is computed for it."""
    if path is None or str(path) == "-":
        return path
    if path.is_dir():
        raise FdbenchError(f"{path}: a folder, where a file to write is expected.")
    if not path.parent.is_dir():
        raise FdbenchError(f"{path}: cannot be written: there is no folder {path.parent}.")
    # A file is written beside its place and moved there, which takes both; a device is written to as it is.
    needed = [path] if path.exists() else []
    needed += [path.parent] if path.is_file() or not path.exists() else []
    if not all(os.access(one, os.W_OK) for one in needed):
        raise FdbenchError(f"{path}: cannot be written: permission denied.")
    return path


def file_to_write(path: Path | None) -> Path | None:
    """Return a file to write, as `writable`; ``-`` is refused where nothing can be printed in place of a file."""
    if str(path) == "-":
        raise FdbenchError("-: the name of a file is expected here.")
    return writable(path)


def names_of(*kinds: str) -> Callable[[str], list[str]]:
    """Return what a shell completes a word from: the names of scenarios and of plug-ins, none of which is imported.

    >>> "krls_t" in names_of("estimator")("kr")
    True
    """

    def names(incomplete: str) -> list[str]:
        found = [name for kind in kinds if kind != SCENARIO for name in Registry(kind, object).names()]
        return sorted({*found, *(scenario_ids() if SCENARIO in kinds else ())})

    return names


def existing(folder: Path, file: str) -> Path:
    """Return a folder of results, or say that there are none in it."""
    if (folder / file).is_file():
        return folder
    if folder.is_file():
        raise SpecError(f"{folder}: a folder of results is expected, found a file.")
    if folder.is_dir():
        raise SpecError(f"{folder}: no {file} in this folder; `fdbench run --out {folder}` writes it.")
    others = [path.parent.name for path in folder.parent.glob(f"*/{file}")] if folder.parent.is_dir() else []
    hint = did_you_mean(folder.name, others) if others else f" `fdbench run --out {folder}` makes it."
    raise SpecError(f"{folder}: no such folder of results.{hint}")


Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]
Effects = Annotated[
    list[str] | None,
    typer.Option(
        "--effect",
        metavar="FILE",
        help="Python file of a further effect, for scenarios and diagnoses; may be repeated.",
    ),
]
Html = Annotated[Path, typer.Option("-o", "--output", callback=file_to_write, help="HTML file to write.")]
TimeLimit = Annotated[
    float, typer.Option(min=0.1, metavar="SECONDS", help="What one fit may take; beyond it, it has failed.")
]
MemoryLimit = Annotated[
    float, typer.Option(min=512.0, metavar="MB", help="What memory an estimator may have; beyond it, as above.")
]
Jobs = Annotated[int | None, typer.Option(min=1, help="Processes; default: one for each core.")]

Scheduler = Annotated[
    str,
    typer.Option(
        metavar="ADDRESS", help="Dask scheduler whose workers do the work, such as tcp://host:8786 (pip install dask)."
    ),
]
