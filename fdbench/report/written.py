"""What a run makes of its results, written anew only where it would change."""

import json
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache, partial
from pathlib import Path

from fdbench.benchmark.leaderboard import leaderboard
from fdbench.benchmark.provenance import PACKAGE, digest
from fdbench.benchmark.seal import FILE
from fdbench.benchmark.store import Store
from fdbench.documents import LARGEST_JSON, json_value, read_file
from fdbench.errors import SpecError
from fdbench.files import replaced, write_text
from fdbench.report.results import write_report
from fdbench.specification import convert
from fdbench.trials.board import board, published

MADE_OF = "made_of.json"
SOURCES = (".py", ".json", ".toml", ".html", ".css", ".js", ".svg")


def write_results(folder: Path, page: bool) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Write the leaderboard and, if asked for, the page of a folder; return the files written and those left."""
    makers = {"leaderboard.md": _write_leaderboard, **({"report.html": write_report} if page else {})}
    own = {name: partial(make, folder) for name, make in makers.items()}
    written = write_changed(folder, own)
    return tuple(written), tuple(name for name in own if name not in written)


def _write_leaderboard(folder: Path, file: Path) -> None:
    write_text(file, leaderboard(Store(folder)) + board(published()))


def write_changed(folder: Path, makers: Mapping[str, Callable[[Path], None]]) -> list[str]:
    """Write those files of a folder of results that would change, and return their names.

    ``made_of.json`` has the digest of what each file was made of, the code included, and of the file as it was left; a
    file that is missing or was edited is written too.

    Parameters
    ----------
    folder : Path
        With ``scores.parquet`` and all that belongs to it.
    makers : mapping of str to callable
        By the name of a file, what writes it.
    """
    sources = _sources(folder)
    known = _known(folder / MADE_OF)
    files = {name: folder / name for name in makers}
    written = [name for name, file in files.items() if not file.is_file() or known.get(name) != _state(sources, file)]
    for name in written:
        with replaced(files[name]) as unfinished:
            makers[name](unfinished)
            known[name] = _state(sources, unfinished)
    if _sources(folder) != sources:  # another run has written to this folder meanwhile
        known = {}
    if written:
        write_text(folder / MADE_OF, json.dumps(known, indent=1) + "\n")
    return written


def _sources(folder: Path) -> str:
    tables = [(folder / name).read_bytes() for name in ("scores.parquet", "parameters.parquet")]
    seal = folder / FILE
    return digest([_code(), *tables, seal.read_bytes() if seal.is_file() else b"", *_kept(folder)])


@lru_cache(maxsize=1)
def _code() -> bytes:
    """Return the digest of the package, data included."""
    files = sorted(path for path in PACKAGE.rglob("*") if path.suffix in SOURCES)
    return digest([path.read_bytes() for path in files]).encode()


def _kept(folder: Path) -> Iterator[bytes]:
    """Yield name, size and time of each record and estimate; reading all of them would take as long as a report."""
    for part in ("records", "estimates"):
        for path in sorted((folder / part).rglob("*.parquet")):
            status = path.stat()
            yield f"{path.relative_to(folder).as_posix()} {status.st_size} {status.st_mtime_ns}".encode()


def _state(sources: str, file: Path) -> str:
    """Return the digest of a file and its sources."""
    return digest([sources.encode(), file.read_bytes()])


def _known(file: Path) -> dict[str, str]:
    """Return the states that were written last; a list that cannot be read only means that all is written anew."""
    try:
        known: dict[str, str] = convert(Mapping[str, str], json_value(read_file(file, LARGEST_JSON)), MADE_OF)
    except (OSError, ValueError, SpecError):
        return {}
    return known
