"""Guarantees: the axes that cause sets and false alarms rest on, from answers to a trial that was not learned from."""

from collections.abc import Iterable
from pathlib import Path

from fdbench.diagnosis.judge import cause_sets, false_alarms, probability_models
from fdbench.diagnosis.judge.cause_sets import AxesWithOneCause
from fdbench.diagnosis.judge.false_alarms import AxesWithoutCause
from fdbench.errors import SpecError
from fdbench.files import write_text
from fdbench.trials.learn import MANY_KINDS
from fdbench.trials.score import open_trial


def guarantees(folder: Path, answers: Path, key: Path) -> tuple[AxesWithOneCause, AxesWithoutCause]:
    """Return the axes of a trial of tier G with one cause, and those without any, as they were answered.

    Raises
    ------
    SpecError
        If the trial is of another tier, or the probability models were learned from it; and as `open_trial` does.
    """
    trial = open_trial(folder, answers, key)
    tier, nonce = trial.manifest["tier"], trial.key["nonce"]
    if tier != MANY_KINDS:
        raise SpecError(f"{folder}: a trial of tier {tier}; of tier {MANY_KINDS} is expected: others are of one kind.")
    if nonce in probability_models.models().source:
        raise SpecError(f"{folder}: the probability models were learned from this trial; make another one.")
    table = trial.table
    single, empty = table.is_single, table.is_empty
    if not single.any() or not empty.any():
        raise SpecError(f"{folder}: axes with one cause and axes without any are needed; make more cases.")
    of_truth = (table.chances * table.present).sum(axis=1)
    surest = table.chances.max(axis=1)
    return (
        AxesWithOneCause(
            source=f"tier {tier}, {int(single.sum())} axes with one cause, nonce {nonce}",
            truth=tuple(of_truth[single].tolist()),
            unknown=tuple(table.unknown[single].tolist()),
        ),
        AxesWithoutCause(
            source=f"tier {tier}, {int(empty.sum())} axes without a cause, nonce {nonce}",
            surest=tuple(surest[empty].tolist()),
            unknown=tuple(table.unknown[empty].tolist()),
        ),
    )


def write_guarantees(single: AxesWithOneCause, empty: AxesWithoutCause, output: Path) -> None:
    """Write the files that `cause_sets` and `false_alarms` read, each probability to four decimals, in order."""
    _write(output / cause_sets.FILE.name, single.source, truth=single.truth, unknown=single.unknown)
    _write(output / false_alarms.FILE.name, empty.source, surest=empty.surest, unknown=empty.unknown)


def _write(path: Path, source: str, **columns: Iterable[float]) -> None:
    rows = (f"{name} = [{', '.join(f'{value:.4f}' for value in sorted(own))}]" for name, own in columns.items())
    write_text(path, "\n".join([f'source = "{source}"', *rows]) + "\n", folders=True)
