"""Shared checks of motions: what every commanded trajectory must hold, on the first scenario that is moved by it."""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from fdbench.catalogue import scenario_ids
from fdbench.checks._data_sheet import check_data_sheet
from fdbench.checks._report import NotApplicable, run_checks
from fdbench.errors import PluginError
from fdbench.motions import Motion
from fdbench.motions._motion import Reference
from fdbench.scenario import load_scenario

LONGEST = 20_000  # samples
DERIVED = 0.02  # of the largest velocity: error of the mean velocity over a sample


@dataclass(frozen=True, eq=False)
class CheckedMotion:
    """A motion as a scenario has it, with its clock."""

    cls: type[Motion]
    motion: Motion | None
    period_s: float = 1e-3
    n_samples: int = 1000

    def reference(self) -> Reference:
        """Return the commanded motion."""
        if self.motion is None:
            raise NotApplicable("no scenario is moved by it")
        return self.motion.reference(self.period_s, self.n_samples)


def prepare(cls: type[Motion]) -> CheckedMotion:
    """Return the case that the checks run on."""
    for name in scenario_ids():
        scenario = load_scenario(name)
        if scenario.timing is not None and type(scenario.motion) is cls:
            period_s = scenario.timing.sampling_time_s
            n_samples = min(LONGEST, round(scenario.timing.duration_s / period_s))
            return CheckedMotion(cls, scenario.motion, period_s, n_samples)
    return CheckedMotion(cls, None)


def is_frozen(case: CheckedMotion) -> None:
    """Require a final frozen dataclass."""
    frozen = dataclasses.is_dataclass(case.cls) and case.cls.__dataclass_params__.frozen
    if not (frozen and getattr(case.cls, "__final__", False)):
        raise PluginError("the class must be @final and a @dataclass(frozen=True, kw_only=True).")


def is_documented(case: CheckedMotion) -> None:
    """Source and a worked example, which is right, are in the docstring."""
    check_data_sheet(case.cls, (">>> ",))


def is_finite_and_complete(case: CheckedMotion) -> None:
    """Position, velocity and acceleration of each axis in every sample, all finite."""
    found = case.reference()
    if found.shape not in ((case.n_samples, 3), (case.n_samples, 6)):
        raise PluginError(f"reference has the shape {found.shape}, expected {(case.n_samples, 3)} for each axis.")
    if not np.isfinite(found).all():
        raise PluginError(f"reference is not finite at sample {int(np.argmin(np.isfinite(found).all(axis=1)))}.")


def is_the_same_again(case: CheckedMotion) -> None:
    """Nothing is drawn and nothing is remembered."""
    if not np.array_equal(case.reference(), case.reference()):
        raise PluginError("a second call gives another motion.")


def moves_by_its_velocity(case: CheckedMotion) -> None:
    """Positions change by the mean of the velocities at both ends of a sample."""
    found = case.reference()
    for first in range(0, found.shape[1], 3):
        position, velocity = found[:, first], found[:, first + 1]
        missed = np.abs(np.diff(position) / case.period_s - 0.5 * (velocity[1:] + velocity[:-1]))
        if missed.size and missed.max() > DERIVED * np.abs(velocity).max():
            where = int(np.argmax(missed))
            raise PluginError(f"between samples {where} and {where + 1} the velocity is {missed[where]:.3g} m/s off.")


CHECKS: tuple[Callable[[CheckedMotion], None], ...] = (
    is_frozen,
    is_documented,
    is_finite_and_complete,
    is_the_same_again,
    moves_by_its_velocity,
)


def check_motion(cls: type[Motion]) -> list[str]:
    """Run all checks on a motion and return a line for each.

    Raises
    ------
    PluginError
        If a check fails.
    """
    case = prepare(cls)
    return run_checks(cls.name, [(check.__name__, partial(check, case)) for check in CHECKS])
