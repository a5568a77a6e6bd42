"""Results in a folder: one small text file for each run, merged into two tables.

=================================================  ====================================================================
``runs/<scenario>/<estimator>/<seed>.json``        one run, written at once and whole
``run.json``                                       what was selected last
``made_for.json``                                  models that estimators are made for, by digest
``scores.parquet``                                 a row per scenario, estimator, seed and metric
``parameters.parquet``                             a row per scenario, estimator, seed and parameter
``records/<scenario>/<seed>.parquet``              the record of the first seed, and of every seed on request
``estimates/<scenario>/<estimator>/<seed>.parquet``  the estimates on it; that of ``oracle`` is the truth
=================================================  ====================================================================
"""

import fcntl
import json
import os
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fdbench.documents import LARGEST_JSON, json_value, parquet_table, read_file
from fdbench.errors import FdbenchError, SpecError, did_you_mean, printable
from fdbench.estimator import Estimate
from fdbench.files import replaced, write_text
from fdbench.reading import read_record
from fdbench.record import Record
from fdbench.regression import FloatArray, Regression
from fdbench.sandbox.claims import SERIES
from fdbench.specification import convert, read

if TYPE_CHECKING:
    import pandas as pd

OK, FAILED, DIVERGED, SKIPPED = STATUSES = ("ok", "failed", "diverged", "skipped")

# What a result is a function of, besides the seed: it is reused as long as these stay as they were. The nonce is
# empty where seeds are public.
DIGESTS = ("scenario_digest", "estimator_digest", "code_digest", "nonce")

PROVENANCE = (
    *(*DIGESTS, "fdbench_version", "commit", "python", "numpy", "numba", "machine", "run_id", "utc"),
    *("time_limit_s", "memory_limit_MB", "confinement"),
)

KEYS = {"scenario": "string", "estimator": "string", "seed": "int64"}

SCORE_COLUMNS = {
    **KEYS,
    "plant": "string",
    "metric": "string",
    "value": "float64",
    "unit": "string",
    "status": "string",
    "message": "string",
    "seconds": "float64",
    "peak_memory_MB": "float64",
    **dict.fromkeys(PROVENANCE, "string"),
}

PARAMETER_COLUMNS = {
    **KEYS,
    "parameter": "string",
    "estimate": "float64",
    "standard_error": "float64",
    "truth": "float64",
}


LARGEST = 1e100  # beyond it numbers can be neither drawn nor averaged

_SEED = re.compile(r"(0|[1-9][0-9]{0,17}|[1-4][0-9]{18})\Z")
_MADE_FOR = Mapping[str, tuple[str, ...] | None]


class RunKey(NamedTuple):
    """One run: an estimator on the record of one scenario and seed."""

    scenario: str
    estimator: str
    seed: int


@dataclass(frozen=True, kw_only=True)
class Score:
    """One metric of a run; ``value`` is None unless ``status`` is ok."""

    metric: str
    unit: str
    value: float | None = None
    status: str = OK
    message: str = ""


@dataclass(frozen=True, kw_only=True)
class ParameterValue:
    """One parameter of a run; None for what is not known."""

    parameter: str
    estimate: float | None
    standard_error: float | None
    truth: float | None


@dataclass(frozen=True, kw_only=True)
class KeptRun:
    """All that is kept of one run.

    Attributes
    ----------
    scenario, estimator : str
    seed : int
    plant : str
        Kind of the scenario's plant.
    status : str
        ok, failed, diverged or skipped; failed too if the estimate is sound but a metric failed on it.
    message : str
        Reason, in one line, unless ok.
    seconds : float or None
        Time of ``fit``.
    peak_memory_MB : float or None
        Largest resident memory of the worker during ``fit``, as the system says; None of the oracle.
    provenance : mapping of str to str
        The columns ``PROVENANCE``, and ``estimator_file``: the path of an estimator that is not installed.
    scores, parameters : tuples
    traceback : str
        Calls that led to a failure of the estimator, as far as they are known.
    """

    scenario: str
    estimator: str
    seed: int
    plant: str
    status: str
    message: str
    seconds: float | None
    peak_memory_MB: float | None = None
    provenance: Mapping[str, str]
    scores: tuple[Score, ...] = ()
    parameters: tuple[ParameterValue, ...] = ()
    traceback: str = ""

    @property
    def key(self) -> RunKey:
        """Scenario, estimator and seed."""
        return RunKey(self.scenario, self.estimator, self.seed)


@dataclass(frozen=True, kw_only=True, eq=False)
class Kept:
    """An estimate with what it was made for.

    Attributes
    ----------
    time_s, target : (n_rows,) arrays
        Rows of the regression.
    target_name : str
    estimate : Estimate
    """

    time_s: FloatArray
    target: FloatArray
    target_name: str
    estimate: Estimate


@dataclass(frozen=True, kw_only=True)
class _Claimed:
    """What the metadata of a kept estimate say."""

    target_name: str
    parameters: Mapping[str, float]
    covariance: tuple[tuple[float, ...], ...] | None


class Store:
    """The results in one folder.

    Parameters
    ----------
    folder : path
        Made when something is written.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)

    # ---- runs ----

    def run_file(self, key: RunKey) -> Path:
        """Return where a run lies."""
        return self.folder / "runs" / key.scenario / key.estimator / f"{key.seed}.json"

    def write_run(self, run: KeptRun) -> None:
        """Write a run; a reader, or a later start after an interruption, sees all of it or nothing."""
        document = {**asdict(run), "provenance": dict(run.provenance)}
        _write(self.run_file(run.key), json.dumps(document, indent=1, allow_nan=False) + "\n")

    def read_run(self, key: RunKey) -> KeptRun | None:
        """Return a run, or None if there is none."""
        path = self.run_file(key)
        if not path.is_file():
            return None
        try:
            run = read(KeptRun, json_value(read_file(path, LARGEST_JSON)), "run")
            if run.key != key or not {run.status, *(score.status for score in run.scores)} <= {*STATUSES}:
                raise ValueError("it is another one")
            return run
        except (OSError, ValueError, SpecError) as error:
            raise FdbenchError(f"{path}: not a run that this version can read ({error}). Run it again.") from error

    def run_keys(self) -> list[RunKey]:
        """Return all runs that lie in the folder."""
        files = self.folder.glob("runs/*/*/*.json")
        return [
            RunKey(file.parent.parent.name, file.parent.name, int(file.stem))
            for file in files
            if _SEED.match(file.stem)
        ]

    def is_finished(self, key: RunKey, digests: Mapping[str, str], keep: bool, skips_hold: bool) -> bool:
        """Return whether a run need not be repeated: nothing has changed, and it was good and what is to be kept is.

        With ``skips_hold`` a skipped run need not be repeated either.
        """
        try:
            run = self.read_run(key)
        except FdbenchError:
            return False
        if run is None or any(run.provenance.get(name) != digests[name] for name in DIGESTS):
            return False
        if run.status != OK:
            return run.status == SKIPPED and skips_hold
        return not keep or (self.estimate_file(key).is_file() and self.record_file(key.scenario, key.seed).is_file())

    # ---- the selection and its tables ----

    def write_selection(self, selection: Mapping[str, Any]) -> None:
        """Write what a run is about to do to ``run.json``."""
        _write(self.folder / "run.json", json.dumps(selection, indent=1) + "\n")

    def write_made_for(self, known: Mapping[str, Sequence[str] | None]) -> None:
        """Write, by digest, the models that estimators are made for to ``made_for.json``."""
        _write(self.folder / "made_for.json", json.dumps(known, indent=1) + "\n")

    def made_for(self) -> dict[str, tuple[str, ...] | None]:
        """Return what ``made_for.json`` says; nothing where it cannot be read, so that estimators are asked again."""
        try:
            found = json_value(read_file(self.folder / "made_for.json", LARGEST_JSON))
            known: dict[str, tuple[str, ...] | None] = convert(_MADE_FOR, found, "made_for.json")
        except (OSError, ValueError, SpecError):
            return {}
        return known

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Keep other processes from the tables, so that of two that write into one folder the last has all runs."""
        folder = os.open(self.folder, os.O_RDONLY)
        try:
            fcntl.flock(folder, fcntl.LOCK_EX)
            yield
        finally:
            os.close(folder)

    def merge(self, keys: Collection[RunKey]) -> dict[RunKey, str]:
        """Write the two tables from the runs of ``keys``; return the status of each."""
        runs = []
        for key in sorted(keys, key=lambda key: (key.scenario, key.seed, key.estimator)):
            run = self.read_run(key)
            if run is None:
                raise FdbenchError(f"{self.run_file(key)}: this run is missing. Run it again.")
            runs.append(run)
        _write_table(self.folder / "scores.parquet", list(_score_rows(runs)), SCORE_COLUMNS)
        _write_table(self.folder / "parameters.parquet", list(_parameter_rows(runs)), PARAMETER_COLUMNS)
        return {run.key: run.status for run in runs}

    def scores(self, keys: Collection[RunKey] | None = None) -> "pd.DataFrame":
        """Return ``scores.parquet``, or its rows of some runs; the columns are ``SCORE_COLUMNS``."""
        table = self._table("scores.parquet", SCORE_COLUMNS)
        if table.empty or not table["status"].isin(STATUSES).all():
            raise FdbenchError(f"{self.folder / 'scores.parquet'}: no rows, or of unknown status. Run them all again.")
        if keys is None:
            return table
        return table[[run in keys for run in zip(*(table[name] for name in KEYS), strict=True)]]

    def parameters(self) -> "pd.DataFrame":
        """Return ``parameters.parquet``; its columns are ``PARAMETER_COLUMNS``."""
        return self._table("parameters.parquet", PARAMETER_COLUMNS)

    def _table(self, name: str, columns: Mapping[str, str]) -> "pd.DataFrame":
        path = self.folder / name
        if not path.is_file():
            raise FdbenchError(f"{self.folder}: no {name} here. 'fdbench run --out {self.folder}' writes it.")
        try:
            table: pd.DataFrame = parquet_table(path).to_pandas(ignore_metadata=True)
        except (OSError, ValueError) as error:
            raise FdbenchError(f"{path}: cannot be read: {error}.") from error
        for column, kind in columns.items():
            if column not in table:
                raise FdbenchError(f"{path}: column {column} is missing.{did_you_mean(column, table.columns)}")
            values = table[column]
            if not (all(isinstance(value, str) for value in values) if kind == "string" else values.dtype == kind):
                raise FdbenchError(f"{path}: column {column} holds other values than {kind}. Run them all again.")
            if column in PROVENANCE and any(printable(value) != value for value in values.unique()):
                raise FdbenchError(f"{path}: column {column} cannot be printed. Run them all again.")
            if kind == "float64" and (values.abs() > LARGEST).any():
                raise FdbenchError(f"{path}: column {column} holds values beyond {LARGEST:g}. Run them all again.")
        return table

    # ---- records and estimates ----

    def record_file(self, scenario: str, seed: int) -> Path:
        """Return where the record of a scenario and seed lies, if it is kept."""
        return self.folder / "records" / scenario / f"{seed}.parquet"

    def estimate_file(self, key: RunKey) -> Path:
        """Return where the estimate of a run lies, if it is kept."""
        return self.folder / "estimates" / key.scenario / key.estimator / f"{key.seed}.parquet"

    def write_record(self, scenario: str, seed: int, record: Record) -> None:
        """Keep a record."""
        with replaced(self.record_file(scenario, seed), folders=True) as partial:
            record.to_parquet(partial)

    def read_record(self, scenario: str, seed: int = 0) -> Record:
        """Return a kept record."""
        return read_record(self.record_file(scenario, seed))

    def write_estimate(self, key: RunKey, regression: Regression, estimate: Estimate) -> None:
        """Keep an estimate: its series as columns, parameters and covariance as metadata ``fdbench``."""
        import pyarrow
        from pyarrow import parquet

        columns = {"time_s": regression.time_s, "target": regression.target}
        columns |= {name: getattr(estimate, name) for name in SERIES if getattr(estimate, name) is not None}
        covariance = estimate.covariance
        metadata = {
            "target_name": regression.target_name,
            "parameters": {name: float(value) for name, value in estimate.parameters.items()},
            "covariance": None if covariance is None else np.asarray(covariance, dtype=np.float64).tolist(),
        }
        arrays = {name: np.asarray(values, dtype=np.float64) for name, values in columns.items()}
        table = pyarrow.table(arrays).replace_schema_metadata({"fdbench": json.dumps(metadata)})
        with replaced(self.estimate_file(key), folders=True) as partial:
            parquet.write_table(table, partial, write_page_checksum=True)

    def read_estimate(self, key: RunKey) -> Kept | None:
        """Return a kept estimate, or None if there is none, as after a failure."""
        path = self.estimate_file(key)
        if not path.is_file():
            return None
        try:
            table = parquet_table(path)
            about = read(_Claimed, json_value((table.schema.metadata or {}).get(b"fdbench", b"")), "metadata")
            columns = {name: _series(name, table[name]) for name in table.column_names}
            p = len(about.parameters)
            if about.covariance is not None and {len(row) for row in (about.covariance, *about.covariance)} != {p}:
                raise ValueError(f"the covariance of {p} parameters has another shape")
            if not {"time_s", "target"} <= columns.keys() <= {"time_s", "target", *SERIES}:
                raise ValueError(f"columns {', '.join(columns)}")
            return Kept(
                time_s=columns.pop("time_s"),
                target=columns.pop("target"),
                target_name=about.target_name,
                estimate=Estimate(
                    parameters=about.parameters,
                    covariance=None if about.covariance is None else np.array(about.covariance).reshape(p, p),
                    **columns,
                ),
            )
        except (OSError, ValueError, SpecError) as error:
            raise FdbenchError(f"{path}: not an estimate ({error}). Remove it, and run it again.") from error

    def forget_estimate(self, key: RunKey) -> None:
        """Remove the estimate of an earlier run, so that a failure does not leave it."""
        self.estimate_file(key).unlink(missing_ok=True)


def _series(name: str, column: Any) -> FloatArray:
    """Return a column of an estimate; a variance may be infinite."""
    values: FloatArray = column.to_numpy()
    if values.dtype != np.float64 or np.isnan(values).any() or ("variance" not in name and np.isinf(values).any()):
        raise ValueError(f"column {name} holds other values than numbers")
    return values


def _score_rows(runs: Sequence[KeptRun]) -> Iterator[dict[str, Any]]:
    for run in runs:
        provenance = {name: run.provenance.get(name, "") for name in PROVENANCE}
        for score in run.scores:
            costs = {"seconds": run.seconds, "peak_memory_MB": run.peak_memory_MB}
            yield {**run.key._asdict(), "plant": run.plant, **vars(score), **costs, **provenance}


def _parameter_rows(runs: Sequence[KeptRun]) -> Iterator[dict[str, Any]]:
    for run in runs:
        for value in run.parameters:
            yield {**run.key._asdict(), **vars(value)}


def _write_table(path: Path, rows: list[dict[str, Any]], columns: Mapping[str, str]) -> None:
    import pyarrow
    from pyarrow import parquet

    schema = pyarrow.schema([(name, pyarrow.type_for_alias(kind)) for name, kind in columns.items()])
    with replaced(path, folders=True) as partial:
        parquet.write_table(pyarrow.Table.from_pylist(rows, schema=schema), partial, write_page_checksum=True)


def _write(path: Path, text: str) -> None:
    write_text(path, text, folders=True)
