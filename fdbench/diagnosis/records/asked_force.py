"""Force that a controller asks for: what it makes of its own readings, beside the force that was logged."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fdbench.diagnosis.records.low_pass import low_passed
from fdbench.diagnosis.records.runs import DEFLECTION, FORCE, POSITION, RecordedRun
from fdbench.diagnosis.settings import PLAUSIBLE
from fdbench.plants.feed_drive import Cascade, FeedDrive
from fdbench.record import FloatArray


@dataclass(frozen=True, kw_only=True)
class ForceScales:
    """How many times what a controller asks for on the logged readings the logged force is.

    No model of the machine is needed for that, so that neither friction nor mass stands in for a wrong unit.

    Attributes
    ----------
    found : tuple of float
        `force_scale` of the runs that tell it.
    most : float
        Factor up to which nothing is told: a speed that is half a sampling time early or late is a part of the force
        that accelerates.
    """

    found: tuple[float, ...] = ()
    most: float = math.inf

    @classmethod
    def of(cls, runs: Sequence[RecordedRun], drive: FeedDrive, loops: int = 1) -> "ForceScales":
        """Return those of runs as read, by the nominal controller, which acts so often between two samples."""
        controller = drive.controller
        if not isinstance(controller, Cascade):
            return cls()
        found = tuple(scale for run in runs if (scale := force_scale(run, controller, loops)) is not None)
        untold = 0.5 * max(run.period_s for run in runs) * controller.velocity_gain_N_s_per_m / drive.mass_kg
        return cls(found=found, most=PLAUSIBLE.other_scale + untold)

    @property
    def tell_the_unit(self) -> bool:
        """Whether the force of some runs is what their controller asks for, and of no run another one."""
        return bool(self.found) and 1.0 / self.most < min(self.found) and max(self.found) < self.most

    def warnings(self) -> list[str]:
        """Return a warning where the logged force is another one in every run."""
        if not self.found or (1.0 / self.most < max(self.found) and min(self.found) < self.most):
            return []
        scale = math.sqrt(min(self.found) * max(self.found))
        return [
            f"{FORCE} is {scale:.3g} times what the model's controller asks for on the logged readings, in every "
            "record. Either its unit is off by that (torque constant, peak or root mean square, percent of what), "
            f"which gain = {1.0 / scale:.4g} in the mapping would mend, or the velocity loop's gains are, or the "
            "controller has what the model lacks, such as a filter of the command."
        ]


def force_scale(run: RecordedRun, controller: Cascade, loops: int = 1) -> float | None:
    r"""Return how many times what its controller asks for the force of a run is; None where that is not the same shape.

    .. math:: F = k F_a + c_0 + c_1 t + c_2 x + c_3 v

    is fitted below ``PLAUSIBLE.asked_Hz``, with the force F_a of `asked_force`; a clock or a zero that is a little off
    is in the other terms.
    """
    beside = _asked_and_logged(run, controller, loops)
    if beside is None:
        return None
    own, rest = beside
    spread = math.sqrt(float(own @ own) * float(rest @ rest))
    if spread == 0.0 or float(own @ rest) < PLAUSIBLE.same_shape * spread:
        return None
    return float(own @ rest) / float(own @ own)


def law_misfit(run: RecordedRun, controller: Cascade, loops: int = 1) -> float | None:
    """Return the mean square of what the logged force is beside what a controller asks for, in N²; see `force_scale`.

    None where that cannot be told.
    """
    beside = _asked_and_logged(run, controller, loops)
    return None if beside is None else float(np.mean(np.square(beside[1] - beside[0])))


def _asked_and_logged(run: RecordedRun, controller: Cascade, loops: int) -> tuple[FloatArray, FloatArray] | None:
    """Return the force that is asked for and the logged one, both low-passed and without what is fitted beside."""
    force, asked = run.channels[FORCE], asked_force(run, controller, loops)
    limited = np.abs(force).max() > PLAUSIBLE.greatest_force * controller.force_limit_N
    if asked is None or limited or PLAUSIBLE.asked_Hz * run.period_s > 0.4:
        return None
    position = run.channels[POSITION]
    columns = [asked, np.ones(len(force)), np.arange(len(force)) * run.period_s, position, np.gradient(position)]
    low = low_passed(np.array([force, *columns]), PLAUSIBLE.asked_Hz, run.period_s)
    inner = slice(len(force) // 20, -(len(force) // 20) or None)
    measured, design = low[0, inner], low[1:, inner].T
    others = design[:, 1:]
    own, rest = (
        values - others @ np.linalg.lstsq(others, values, rcond=None)[0] for values in (design[:, 0], measured)
    )
    return own, rest


def asked_force(run: RecordedRun, controller: Cascade, loops: int = 1) -> FloatArray | None:
    """Return the force (n,) that a controller asks for on the readings of a run, in N.

    None where it reads what is not there. The integral of the law of `fdbench.plants.feed_drive.Cascade` begins at 0.
    A controller that acts several times between two samples takes its speed over a part of that time.
    """
    position = run.channels[POSITION]
    own_side = controller.velocity_feedback in (None, controller.feedback)
    if not own_side and DEFLECTION not in run.channels:
        return None
    further = 0.0 if own_side else run.channels[DEFLECTION] * (1.0 if controller.uses_table else -1.0)
    speed = _differenced(position + further, controller.difference_span / loops) / run.period_s
    command, rate, acceleration = run.reference.T
    wanted = controller.velocity_feedforward * (rate - controller.velocity_reference_delay_s * acceleration)
    error = wanted + controller.position_gain_per_s * (command - position) - speed
    integral = run.period_s * np.cumsum(error)
    return np.asarray(
        controller.velocity_gain_N_s_per_m * error
        + controller.integral_gain_N_per_m * integral
        + controller.acceleration_feedforward_kg * acceleration
    )


def _differenced(position: FloatArray, span: float) -> FloatArray:
    """Return by how much a position moves in a sample, as its mean over the last ``span`` samples has it."""
    central = np.gradient(position)
    backward = np.diff(position, prepend=position[:1])
    return np.asarray(central + span * (backward - central))
