"""Two folders of results held against each other: which rows are worse by more than chance and by more than matters."""

import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fdbench.benchmark.job import SPEED
from fdbench.benchmark.leaderboard import check_mergeable
from fdbench.benchmark.oracle import NAME as ORACLE
from fdbench.benchmark.selection import NULL
from fdbench.benchmark.statistics import LEVEL, ROUNDING, SMALLEST_REACH, loss
from fdbench.benchmark.store import OK, PROVENANCE, SKIPPED
from fdbench.errors import FdbenchError
from fdbench.metrics import Metric, metrics
from fdbench.regression import FloatArray

if TYPE_CHECKING:
    import pandas as pd
    from scipy.stats._stats_py import TtestResult

LOSS, GAIN, EVEN, NEW, MISSING, NOT_JUDGED = VERDICTS = ("loss", "gain", "even", "new", "missing", "not judged")

# Seeds below which their spread says nothing: a change on the same records is then judged by its size alone.
FEWEST_PAIRS = 3
# Relative difference of the reference rows up to which two records are the same but for rounding.
SAME_RECORD = 1e-6
NAMED = 10


class ComparedMetric(NamedTuple):
    """A row of a comparison."""

    scenario: str
    estimator: str
    metric: str


class MetricValue(NamedTuple):
    """A metric of one run."""

    status: str
    value: float
    unit: str
    message: str


Classes = Mapping[str, type[Metric]]
Samples = Mapping[ComparedMetric, Mapping[int, MetricValue]]


@dataclass(frozen=True, kw_only=True)
class ComparedRow:
    """What has become of a metric of an estimator on a scenario.

    Attributes
    ----------
    scenario, estimator, metric, unit : str
    verdict : str
        One of ``VERDICTS``.
    reason : str
        What is not seen in the numbers.
    base, new : float or None
        Means over the ``seeds`` compared.
    limit : float or None
        Increase of the loss beyond which it matters.
    p_value : float or None
        Probability, corrected for the number of rows, that chance alone moves the mean so far in this direction.
    seeds : int
        Seeds in ``new``.
    paired : bool
        Whether both sides have the same records.
    """

    scenario: str
    estimator: str
    metric: str
    unit: str
    verdict: str
    reason: str = ""
    base: float | None = None
    new: float | None = None
    limit: float | None = None
    p_value: float | None = None
    seeds: int = 0
    paired: bool = False


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """All rows, and where the two sides come from.

    Attributes
    ----------
    rows : tuple of ComparedRow
    other_records : tuple of str
        Scenarios of which the same seed now gives another record: the simulation has changed.
    base, new : mapping of str to str
        Provenance of each side.
    """

    rows: tuple[ComparedRow, ...]
    other_records: tuple[str, ...]
    base: Mapping[str, str]
    new: Mapping[str, str]

    def of(self, *verdicts: str) -> list[ComparedRow]:
        """Return the rows of some verdicts."""
        return [row for row in self.rows if row.verdict in verdicts]

    @property
    def compared(self) -> int:
        """Number of rows that were judged."""
        return len(self.of(LOSS, GAIN, EVEN))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Change:
    """How far the mean loss has moved, and how likely chance alone moves it so far up or down."""

    row: ComparedRow
    increase: float
    p_worse: float
    p_better: float
    has_moved: bool
    is_speed: bool


def compare(
    base: "pd.DataFrame", new: "pd.DataFrame", *, allow_missing: bool = False, gate_speed: bool = False
) -> Comparison:
    r"""Judge every metric of every estimator on every scenario that two tables of score rows have.

    A row is a loss if a run that was good is so no more, or if its mean `loss` over the seeds has grown both

    - by more than matters: more than ``practical_limit`` times the larger of the mean of ``base`` and a millionth of
      the loss of null, and more than ``practical_change`` of the metric, and
    - by more than chance: one-sided t test with :math:`p \le 0.05` after Holm's correction for the number of rows that
      have changed. Where both sides have the same records the differences are tested, seed by seed, else the two
      samples (Welch).

    An estimator that has not changed has the same values on the same records, so none of its rows can be a loss
    there. The t test is taken because it can decide on three seeds: no exact test of three differences has p below
    1/8. With one or two common seeds, a loss must be seen on each of them. A gain is the same the other way round. A
    failed run on other seeds has the metric's worst value.

    Speed is not judged, unless ``gate_speed``.

    Raises
    ------
    FdbenchError
        If a scenario is not the same in both, if rows are missing in ``new`` and not allowed to be, if nothing can be
        compared, or if ``gate_speed`` and the two were not measured in one run on one machine.

    References
    ----------
    B. L. Welch, Biometrika 34, 1947; S. Holm, Scandinavian Journal of Statistics 6, 1979.
    """
    for table in (base, new):
        check_mergeable(table)
    _check_scenarios(base, new)
    if gate_speed:
        _check_one_run(base, new)
    old, now = _samples(base), _samples(new)
    missing = [key for key, samples in old.items() if key not in now and not _all_skipped(samples)]
    if missing and not allow_missing:
        raise FdbenchError(f"NEW lacks {_names(missing)} of BASE. Run them too, or say --allow-missing.")
    common = sorted(old.keys() & now.keys())
    classes = {name: metrics.get(name) for name in {key.metric for key in common}}
    other = _other_records(old, now, classes)
    found = [change for key in common if (change := _change(key, old, now, classes, other)) is not None]
    rows = [
        *_decided([change for change in found if isinstance(change, _Change)], gate_speed),
        *(row for row in found if isinstance(row, ComparedRow)),
        *(_row(key, old[key], MISSING) for key in sorted(missing)),
        *(_row(key, now[key], NEW) for key in sorted(now.keys() - old.keys()) if not _all_skipped(now[key])),
    ]
    result = Comparison(
        rows=tuple(sorted(rows, key=lambda row: (VERDICTS.index(row.verdict), row.scenario, row.estimator))),
        other_records=tuple(sorted(other)),
        base=_provenance(base),
        new=_provenance(new),
    )
    if not result.compared:
        raise FdbenchError(
            "BASE and NEW: 0 rows can be compared: no estimator has values on the same scenario in both, with the same "
            "seeds or at least two on each side."
        )
    return result


# ---- whether the two sides can be compared ----


def _check_scenarios(old: "pd.DataFrame", now: "pd.DataFrame") -> None:
    digests = [table.groupby("scenario")["scenario_digest"].first() for table in (old, now)]
    both = digests[0].index.intersection(digests[1].index)
    different = [str(name) for name in both if digests[0][name] != digests[1][name]]
    if different:
        raise FdbenchError(
            f"scenarios {', '.join(different)}: BASE and NEW have different files under this id (digest), which must "
            "not be compared. Run both sides with the same scenario files; a released one is never changed."
        )


def _check_one_run(old: "pd.DataFrame", now: "pd.DataFrame") -> None:
    for column in ("run_id", "machine"):
        values = sorted({*old[column], *now[column]})
        if len(values) > 1:
            raise FdbenchError(
                f"speed: rows of different {column} ({', '.join(values[:3])}), whose times must not be judged. Measure "
                "both sides one after the other on one machine, with the same text in FDBENCH_RUN_ID."
            )


def _samples(scores: "pd.DataFrame") -> dict[ComparedMetric, dict[int, MetricValue]]:
    """Return the samples of each row by seed; a scenario that could not be run at all is left out."""
    columns = [*ComparedMetric._fields, "seed", *MetricValue._fields]
    runnable = scores[(scores["status"] != SKIPPED).groupby(scores["scenario"]).transform("any")]
    found: dict[ComparedMetric, dict[int, MetricValue]] = {}
    for scenario, estimator, metric, seed, *sample in runnable[columns].itertuples(index=False, name=None):
        found.setdefault(ComparedMetric(scenario, estimator, metric), {})[seed] = MetricValue(*sample)
    return found


def _all_skipped(samples: Mapping[int, MetricValue]) -> bool:
    return all(sample.status == SKIPPED for sample in samples.values())


def _other_records(old: Samples, now: Samples, classes: Classes) -> set[str]:
    """Return the scenarios where null or oracle, whose values follow from the record, differ for the same seed."""
    other = set()
    for key in old.keys() & now.keys():
        if key.estimator in (NULL, ORACLE) and classes[key.metric].track != SPEED:
            for seed in old[key].keys() & now[key].keys():
                a, b = old[key][seed], now[key][seed]
                if a.status == b.status == OK and not math.isclose(a.value, b.value, rel_tol=SAME_RECORD, abs_tol=1e-9):
                    other.add(key.scenario)
    return other


# ---- one row ----


def _row(key: ComparedMetric, samples: Mapping[int, MetricValue], verdict: str, reason: str = "") -> ComparedRow:
    return ComparedRow(**key._asdict(), unit=next(iter(samples.values())).unit, verdict=verdict, reason=reason)


def _change(
    key: ComparedMetric, old: Samples, now: Samples, classes: Classes, other_records: set[str]
) -> _Change | ComparedRow | None:
    """Return what is to be decided, or a row where nothing is, or None where both sides skip."""
    before, after = old[key], now[key]
    common = before.keys() & after.keys()
    metric = classes[key.metric]
    paired = bool(common) and key.scenario not in other_records and metric.track != SPEED
    if paired:
        before, after = ({seed: side[seed] for seed in sorted(common)} for side in (before, after))
    fallen = [seed for seed, sample in after.items() if sample.status != OK]
    if not any(sample.status == OK for sample in before.values()):
        return _was_bad(key, before, after)
    lost = [seed for seed in fallen if before[seed].status == OK] if paired else fallen
    if lost and (paired or len(lost) == len(after)):
        sample = after[lost[0]]
        return _row(key, after, LOSS, f"{sample.status} with seed {', '.join(map(str, lost))}: {sample.message}")
    if paired:
        good = [seed for seed in after if before[seed].status == after[seed].status == OK]
        before, after = ({seed: side[seed] for seed in good} for side in (before, after))
    a, b = _values(metric, before), _values(metric, after)
    if not paired and min(len(a), len(b)) < 2:
        return _row(key, after, NOT_JUDGED, "one seed, and another record")
    null = old.get(key._replace(estimator=NULL), {})
    return _measured(_row(key, after, EVEN), metric, a, b, _values(metric, null), paired)


def _was_bad(
    key: ComparedMetric, before: Mapping[int, MetricValue], after: Mapping[int, MetricValue]
) -> ComparedRow | None:
    """Return the row of an estimator that had no value before."""
    if _all_skipped(before):
        return None if _all_skipped(after) else _row(key, after, NEW, "was skipped")
    status = next(iter(before.values())).status
    if any(sample.status == OK for sample in after.values()):
        return _row(key, after, GAIN, f"was {status}")
    return _row(key, after, NOT_JUDGED, f"was {status} before")


def _values(metric: type[Metric], samples: Mapping[int, MetricValue]) -> FloatArray:
    """Return values, that of a run without one being the metric's worst; what was skipped is left out."""
    return np.array([s.value if s.status == OK else metric.worst for s in samples.values() if s.status != SKIPPED])


def _measured(
    row: ComparedRow, metric: type[Metric], a: FloatArray, b: FloatArray, null: FloatArray, paired: bool
) -> _Change:
    old, new = (np.array([loss(metric, float(value)) for value in values]) for values in (a, b))
    reach = SMALLEST_REACH * float(np.mean([loss(metric, float(value)) for value in null])) if null.size else 0.0
    at_mean = metric.ideal + (-1.0 if metric.bigger_is_better else 1.0) * float(old.mean())
    scale = max(abs(at_mean), reach)
    limit = max(metric.practical_limit * scale, metric.practical_change, ROUNDING * scale)
    moves = new - old if paired else np.append(old, new) - old[0]
    p_worse, p_better = paired_p_values(new - old) if paired else unpaired_p_values(old, new)
    return _Change(
        row=replace(row, base=float(a.mean()), new=float(b.mean()), limit=limit, seeds=len(b), paired=paired),
        increase=float(new.mean() - old.mean()),
        p_worse=p_worse,
        p_better=p_better,
        has_moved=bool(np.abs(moves).max() > ROUNDING * scale),
        is_speed=metric.track == SPEED,
    )


# ---- chance ----


def paired_p_values(differences: FloatArray) -> tuple[float, float]:
    """Return the one-sided p-values of a mean difference above and below 0.

    Below `FEWEST_PAIRS` they are 0 where all differences have the sign, else 1.

    >>> paired_p_values(np.array([0.1]))
    (0.0, 1.0)
    """
    if len(differences) < FEWEST_PAIRS:
        return float(not (differences > 0.0).all()), float(not (differences < 0.0).all())
    from scipy.stats import ttest_1samp

    return _one_sided(lambda: ttest_1samp(differences, 0.0), float(differences.mean()))


def unpaired_p_values(old: FloatArray, new: FloatArray) -> tuple[float, float]:
    """Return the one-sided p-values of Welch's test that the mean has grown, and that it has shrunk.

    >>> unpaired_p_values(np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 3.0]))
    (0.5, 0.5)
    """
    from scipy.stats import ttest_ind

    return _one_sided(lambda: ttest_ind(new, old, equal_var=False), float(new.mean() - old.mean()))


def _one_sided(test: Callable[[], "TtestResult"], mean: float) -> tuple[float, float]:
    """Return the p-values of a mean above and below 0 from a test of both; without any spread 0 or 1."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", RuntimeWarning)  # values that hardly differ
        half = 0.5 * float(test().pvalue)
    if math.isnan(half):
        return float(mean <= 0.0), float(mean >= 0.0)
    return (half, 1.0 - half) if mean > 0.0 else (1.0 - half, half)


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p-values corrected for their number; each may be held against the level as if it were alone.

    >>> holm([0.01, 0.5, 0.02])
    [0.03, 0.5, 0.04]
    """
    corrected, highest = [0.0] * len(p_values), 0.0
    for rank, index in enumerate(sorted(range(len(p_values)), key=lambda i: p_values[i])):
        highest = max(highest, min(1.0, (len(p_values) - rank) * p_values[index]))
        corrected[index] = highest
    return corrected


def _decided(changes: Sequence[_Change], gate_speed: bool) -> Iterator[ComparedRow]:
    """Yield the rows with their verdicts; those that have not moved are no part of the number to correct for."""
    moved = [change for change in changes if change.has_moved and (gate_speed or not change.is_speed)]
    worse, better = holm([change.p_worse for change in moved]), holm([change.p_better for change in moved])
    p_values = dict(zip(moved, zip(worse, better, strict=True), strict=True))
    for change in changes:
        if change.is_speed and not gate_speed:
            yield replace(change.row, verdict=NOT_JUDGED, reason="speed")
            continue
        p = p_values.get(change, (1.0, 1.0))[int(change.increase < 0.0)]
        decided = p <= 1.0 - LEVEL and abs(change.increase) > (change.row.limit or 0.0)
        verdict = EVEN if not decided else LOSS if change.increase > 0.0 else GAIN
        yield replace(change.row, verdict=verdict, p_value=p)


def _names(keys: Sequence[ComparedMetric]) -> str:
    """Return the number of rows and the first of their names, one for each scenario and estimator."""
    pairs = sorted({f"{key.scenario} {key.estimator}" for key in keys})
    more = f" and {len(pairs) - NAMED} more" if len(pairs) > NAMED else ""
    return f"{len(keys)} rows ({', '.join(pairs[:NAMED])}{more})"


def _provenance(scores: "pd.DataFrame") -> dict[str, str]:
    digests = ("scenario_digest", "estimator_digest")
    return {name: ", ".join(sorted(set(scores[name]))) for name in PROVENANCE if name not in (*digests, "utc")}
