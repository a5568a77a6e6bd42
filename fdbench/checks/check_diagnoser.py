"""Shared checks of diagnosers: what every one must hold, on one axis with one effect."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial

import numpy as np

from fdbench.checks._own_record import recorded
from fdbench.checks._report import run_checks
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.effects import effects
from fdbench.errors import PluginError
from fdbench.record import Record
from fdbench.specification import load_toml, read
from fdbench.trials.diagnoser import CaseAnswer, Diagnoser
from fdbench.virtual_axes.cases import AXIS

Records = tuple[Nominal, list[Record], list[Record]]


@lru_cache(maxsize=1)
def given() -> Records:
    """Return a nominal model, and records of its axis with the first effect of the library that is added to it."""
    nominal = read(Nominal, load_toml(AXIS), AXIS.name)
    kind = next(kind for kind in nominal.library if not kind.calibrates)
    fitted, judged = recorded(effects.get(kind.name), nominal)
    return nominal, fitted, judged


@dataclass(frozen=True, eq=False)
class CheckedDiagnoser:
    """A diagnoser, and what it says."""

    cls: type[Diagnoser]

    @cached_property
    def answer(self) -> CaseAnswer:
        """What it says of the axis."""
        return self.cls().diagnose(*given())


def is_made_without_arguments(case: CheckedDiagnoser) -> None:
    """Require a default for every argument of the constructor."""
    case.cls()


def is_documented(case: CheckedDiagnoser) -> None:
    """Require a docstring."""
    if not case.cls.__doc__:
        raise PluginError("the class has no docstring.")


def answers_with_probabilities(case: CheckedDiagnoser) -> None:
    """Require a `CaseAnswer` that names effects of the library alone."""
    if not isinstance(case.answer, CaseAnswer):
        raise PluginError(f"diagnose returns {type(case.answer).__name__}, expected CaseAnswer.")
    strange = sorted(set(case.answer.effects) - set(effects.names()))
    if strange:
        raise PluginError(f"diagnose names {', '.join(strange)}, which is no effect.")


def leaves_records_alone(case: CheckedDiagnoser) -> None:
    """Require the records to be as they were."""
    _, fitted, judged = given()
    before = [{name: np.array(values) for name, values in item.items()} for item in (*fitted, *judged)]
    case.cls().diagnose(*given())
    after = zip(before, (*fitted, *judged), strict=True)
    if any(not np.array_equal(old[name], item[name]) for old, item in after for name in old):
        raise PluginError("it changes a record.")


CHECKS: tuple[Callable[[CheckedDiagnoser], None], ...] = (
    is_made_without_arguments,
    is_documented,
    leaves_records_alone,
    answers_with_probabilities,
)


def check_diagnoser(cls: type[Diagnoser]) -> list[str]:
    """Run all checks on a diagnoser and return a line for each.

    Raises
    ------
    PluginError
        If a check fails.
    """
    case = CheckedDiagnoser(cls)
    return run_checks(cls.name, [(check.__name__, partial(check, case)) for check in CHECKS])
