"""``run`` and ``compare`` as functions."""

import shutil
import tempfile
import weakref
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

from fdbench.api._table import frame
from fdbench.benchmark import compare as comparison
from fdbench.benchmark import compare_text
from fdbench.benchmark.run import MEMORY_LIMIT_MB, TIME_LIMIT_S, Progress, Summary
from fdbench.benchmark.run import run as run_benchmark
from fdbench.benchmark.selection import select
from fdbench.benchmark.statistics import rankings, standings
from fdbench.benchmark.store import Store
from fdbench.benchmark.suite import SEEDS, Suite, in_suite
from fdbench.checks.plugin_files import add_effects, distinct
from fdbench.cluster import processors
from fdbench.errors import SpecError, UnknownName
from fdbench.report import cards
from fdbench.report._plotly import ranking_figure
from fdbench.report.written import write_results

if TYPE_CHECKING:
    import pandas as pd
    import plotly.graph_objects as go


@dataclass(frozen=True, eq=False)
class RunResult:
    """Scores of estimators on scenarios; a notebook shows the rankings.

    Attributes
    ----------
    folder : Path
        Of the results; what no ``output`` was given for is deleted with this object.
    summary : Summary
        What was run, and what was kept from before.
    written : tuple of str
        Files that were written anew, ``leaderboard.md`` and ``report.html``.
    unchanged : tuple of str
        Those of them that were left as they were.
    """

    folder: Path
    summary: Summary
    written: tuple[str, ...] = ()
    unchanged: tuple[str, ...] = ()

    def scores(self) -> "pd.DataFrame":
        """Return a row for each scenario, estimator, seed and metric that was asked for."""
        return Store(self.folder).scores(self.summary.keys)

    def parameters(self) -> "pd.DataFrame":
        """Return a row for each estimated parameter of the folder, with its standard error and truth."""
        return Store(self.folder).parameters()

    @property
    def tracks(self) -> list[tuple[str, str]]:
        """Track and kind of plant of each ranking."""
        return rankings(self.scores())

    def ranking(self, track: str, plant: str | None = None) -> "pd.DataFrame":
        """Return the ranking of a track, best first, with the 95 % interval of each score.

        Parameters
        ----------
        track : str
            ``"parameters"``, ``"disturbance"`` or ``"output"``.
        plant : str, optional
            Kind of plant; without, that of all kinds one after the other, as each is a ranking of its own.
        """
        rows = [
            {"plant": kind, **own, **own["score"]}
            for kind in self._plants(track, plant)
            for own in map(asdict, standings(self.scores(), track, kind))
        ]
        columns = ("plant", "rank", "estimator", "value", "low", "high", "scenarios", "of_scenarios", "failures")
        found = frame(columns, ([row[name] for name in columns] for row in rows))
        return found.rename(columns={"value": "score"}).astype({"rank": "Int64"})

    def figure(self, track: str, plant: str | None = None) -> "go.Figure":
        """Return the scores of a track with their intervals; ``plant`` is needed where there are several kinds."""
        plants = self._plants(track, plant)
        if len(plants) > 1:
            raise SpecError(f"track '{track}' has a ranking for each of {', '.join(plants)}: say which plant.")
        return ranking_figure(standings(self.scores(), track, plants[0]))

    def _plants(self, track: str, plant: str | None) -> list[str]:
        known = self.tracks
        found = [kind for name, kind in known if name == track and plant in (None, kind)]
        if not found:
            words = " ".join(filter(None, (track, plant)))
            raise UnknownName(f"no ranking '{words}'; there is {', '.join(map(' '.join, known)) or 'none'}.")
        return found

    def _repr_html_(self) -> str:
        return cards.ranking_card(self.scores())


def run(
    scenarios: str | Path | Sequence[str | Path] = "quick",
    estimators: str | Path | Sequence[str | Path] | None = None,
    seeds: int | None = None,
    output: str | Path | None = None,
    *,
    effects: Sequence[str | Path] = (),
    jobs: int | None = None,
    scheduler: str = "",
    report: bool = True,
    sealed: bool = False,
    nonce: str = "",
    first_seed: int = 0,
    keep_estimates: bool = False,
    time_limit_s: float = TIME_LIMIT_S,
    memory_limit_MB: float = MEMORY_LIMIT_MB,
    progress: Callable[[Progress], None] | None = None,
) -> RunResult:
    """Run estimators on scenarios, score and rank them.

    Parameters
    ----------
    scenarios : str, path, or sequence of them
        A suite (``"quick"``, ``"full"``, ``"published"``), or ids and TOML files.
    estimators : str, path, sequence of them, or None
        Registered names and Python files; None: all that are installed. ``null`` and ``oracle`` are added.
    seeds : int, optional
        Number of seeds; those of the suite, or 3.
    output : path, optional
        Folder of the results, in which what is finished and still applies is not run again, and ``leaderboard.md`` and
        ``report.html`` are written; without, a folder that goes with the result.
    effects : sequence of paths
        Python files of further effects, for scenarios.
    jobs : int, optional
        Processes; one for each core.
    scheduler : str
        Address of a Dask scheduler, whose workers do the work in place of processes here.
    report : bool
        Whether ``report.html`` is written to ``output``.
    sealed, nonce, first_seed, keep_estimates, time_limit_s, memory_limit_MB, progress
        As in `fdbench.benchmark.run.run`.

    Raises
    ------
    FdbenchError
        If something cannot be loaded or a number is out of bounds.
    """
    suite = next((item for item in Suite if item == scenarios), None)
    ids = in_suite(suite) if suite else _names(scenarios)
    add_effects(effects)
    names = None if estimators is None else [*select(distinct(_names(estimators)))]
    folder = Path(tempfile.mkdtemp(prefix="fdbench-") if output is None else output)
    summary = run_benchmark(
        ids,
        names,
        SEEDS[suite or Suite.QUICK] if seeds is None else seeds,
        folder,
        sealed=sealed,
        nonce=nonce,
        first_seed=first_seed,
        jobs=jobs or (1 if scheduler else processors()),
        scheduler=scheduler,
        keep_estimates=keep_estimates,
        time_limit_s=time_limit_s,
        memory_limit_MB=memory_limit_MB,
        progress=progress,
    )
    if output is not None:
        return RunResult(folder, summary, *write_results(folder, report))
    result = RunResult(folder, summary)
    weakref.finalize(result, shutil.rmtree, folder, ignore_errors=True)
    return result


def _names(given: str | Path | Sequence[str | Path]) -> list[str | Path]:
    return [given] if isinstance(given, str | Path) else [*given]


@dataclass(frozen=True, eq=False)
class ComparisonResult:
    """Two runs held against each other; a notebook shows what has changed, ``print`` the outcome in one line.

    Attributes
    ----------
    comparison : Comparison
        All rows, and where the two sides come from.
    """

    comparison: comparison.Comparison

    @property
    def has_loss(self) -> bool:
        """Whether something is worse by more than chance and by more than matters."""
        return bool(self.comparison.of(comparison.LOSS))

    def rows(self, *verdicts: str) -> "pd.DataFrame":
        """Return a row for each scenario, estimator and metric, of some verdicts (``"loss"``, ``"gain"``) or of all."""
        unknown = sorted(set(verdicts) - set(comparison.VERDICTS))
        if unknown:
            raise UnknownName(f"verdict '{unknown[0]}': one of {', '.join(comparison.VERDICTS)} is expected.")
        columns = [item.name for item in fields(comparison.ComparedRow)]
        rows = self.comparison.of(*(verdicts or comparison.VERDICTS))
        return frame(columns, ([getattr(row, name) for name in columns] for row in rows))

    def __str__(self) -> str:
        return compare_text.summary(self.comparison)

    def _repr_html_(self) -> str:
        return cards.comparison_card(self.comparison)


def compare(
    before: str | Path | RunResult,
    after: str | Path | RunResult,
    *,
    allow_missing: bool = False,
    gate_speed: bool = False,
) -> ComparisonResult:
    """Compare two runs: a loss is worse by more than chance and by more than matters.

    Parameters
    ----------
    before, after : folder of results, or RunResult
        Of a folder all is compared, of a RunResult what it was asked for.
    allow_missing : bool
        Accept that ``after`` lacks rows of ``before``.
    gate_speed : bool
        Judge times too.

    Raises
    ------
    FdbenchError
        If the two cannot be compared; see `fdbench.benchmark.compare.compare`.
    """
    tables = [side.scores() if isinstance(side, RunResult) else Store(side).scores() for side in (before, after)]
    return ComparisonResult(comparison.compare(*tables, allow_missing=allow_missing, gate_speed=gate_speed))
