"""What the side that holds the truth calls an estimator, its limits, and what comes back of it."""

import ast
import glob
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from fdbench.catalogue import PACKAGE
from fdbench.errors import PluginError
from fdbench.estimator import Estimate
from fdbench.files import parsed

# What a folder of results holds, which is nobody's weights whatever the name of the plug-in.
WRITTEN = {f"{name}.parquet" for name in ("scores", "parameters")} | {
    f"{name}.json" for name in ("run", "seal", "made_for", "made_of")
}
WRITTEN_FOLDERS = ("runs", "records", "estimates")


@dataclass(frozen=True, kw_only=True)
class WorkerLimits:
    """How long one fit may take, and how much memory a worker may have."""

    time_s: float = 300.0
    memory_MB: float = 4096.0


def own_files(file: Path) -> tuple[Path, ...]:
    """Return a plug-in file and what is its own in its folder.

    That is what begins with its name and a dot, such as weights, and the modules that it imports, directly or not. An
    estimator may read what is here: a link, which may lead to the results, what a run has written, and this package are
    none of its own. Of a plug-in file that is a link, folder and name are those of what it leads to.
    """
    real = file.resolve()
    named = [path for path in sorted(real.parent.glob(f"{glob.escape(real.stem)}.*")) if not _is_of_a_run(path)]
    found, waiting = dict.fromkeys([file, real, *filter(_is_plain, named)]), [real]
    while waiting:
        for name in sorted(_imported(waiting.pop()) - {PACKAGE.name}):
            package = sorted((real.parent / name).rglob("*.py"))
            new = [path for path in (real.parent / f"{name}.py", *package) if _is_plain(path) and path not in found]
            found |= dict.fromkeys(new)
            waiting += new
    return tuple(found)


def _is_of_a_run(path: Path) -> bool:
    """Return whether a file is one that runs write, such as parameters.parquet, which holds the truth."""
    return path.name in WRITTEN or any(
        above.name in WRITTEN_FOLDERS and (above.parent / "run.json").is_file() for above in path.parents
    )


def _is_plain(path: Path) -> bool:
    return path.is_file() and not path.is_symlink() and PACKAGE not in path.parents


def _imported(file: Path) -> set[str]:
    """Return the names before the first dot of what a file imports; nothing where it cannot be read as Python."""
    nodes = list(ast.walk(parsed(file)))
    names = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    names += [node.module for node in nodes if isinstance(node, ast.ImportFrom) and node.module and not node.level]
    return {name.split(".")[0] for name in names}


@dataclass(frozen=True, kw_only=True)
class Source:
    """Where an estimator is.

    Attributes
    ----------
    name : str
    own : tuple of Path
        Its file with those that it reads, or the folders of the package that it is in; errors are located in these.
    digest : str
        Of its code; a worker that has imported another one is not used any more.
    file : Path or None
        Its file, where it has no package.
    """

    name: str
    own: tuple[Path, ...]
    digest: str
    file: Path | None = None


class Misbehaved(PluginError):
    """An estimator failed, crashed or went beyond a limit.

    Attributes
    ----------
    traceback : str
        The calls that led there, as far as they are known.
    """

    def __init__(self, message: str, traceback: str = "") -> None:
        super().__init__(message)
        self.traceback = traceback


@dataclass(frozen=True, kw_only=True)
class Declaration:
    """What a plug-in's class says of itself.

    Attributes
    ----------
    kind : str
        Of its registry.
    made_for : tuple of str or None
    expected_failures : mapping of str to str
    has_docstring, has_example, is_online : bool
        Whether it has a docstring of its own, an example in it, and whether it is an OnlineEstimator.
    places : mapping of str to str
        File and line where its methods begin, by name.
    """

    kind: str
    made_for: tuple[str, ...] | None
    expected_failures: Mapping[str, str]
    has_docstring: bool
    has_example: bool
    is_online: bool
    places: Mapping[str, str]


@dataclass(frozen=True, kw_only=True, eq=False)
class FitResult:
    """What came back from a fit: nothing but numbers, whose names and shapes are still to be checked.

    Attributes
    ----------
    estimate : Estimate
    seconds : float
        Measured here.
    peak_memory_MB : float or None
        As the system says; None where it does not tell (other than Linux), and where this process fitted.
    """

    estimate: Estimate
    seconds: float
    peak_memory_MB: float | None
