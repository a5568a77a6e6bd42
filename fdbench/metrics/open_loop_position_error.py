"""How far an axis with the parameters found strays from the measured one under the measured force alone."""

from collections.abc import Mapping
from typing import final

import numpy as np

from fdbench.metrics._metric import Metric, Outcome
from fdbench.plants._inverse_dynamics import NAMES_OF
from fdbench.plants.feed_drive import FeedDrive, LinearMotor, OpenLoop
from fdbench.record import FloatArray
from fdbench.simulate.system import Sampled, Setup, Timing
from fdbench.statistics import rms

PARAMETERS = NAMES_OF["inverse_dynamics"]
LEVELS = ("known_effects", "force_offset")  # what the nominal effects are calibrated as
SUBSTEPS = 10
FAR = 1e3  # m and m/s: only a drive that runs away gets there


@final
class OpenLoopPositionError(Metric):
    r"""Root mean square error of the position, simulated from rest under the measured force, in mm.

    .. math:: M \ddot x + F_v \dot x + F_c \tanh(\dot x / v_0) + F_0 = F, \qquad 10^3\, \mathrm{rms}(x - x_m)

    with the claimed mass M, kg, viscous friction :math:`F_v`, N s/m, Coulomb friction :math:`F_c`, N, and offset
    :math:`F_0`, N, under the measured force F, held over a sample, from the measured position :math:`x_m` at rest;
    :math:`v_0` is that of the nominal model. No feedback holds the axis: a tenth of a newton adds up.

    Validity: EMPS is scored so, in millimetres, by nonlinearbenchmark.org, on the record of the fit and on a second
    one; here on the first. Published for it: 6.74 mm by least squares, 2.76 mm by a fit to this very error.

    No ranking rests on it: nobody knows parameters that have no error.

    ``worst`` is what a drive that runs away, or one without mass or friction, counts for.

    Source: Janot, Gautier, Brunot (2019), Data Set and Reference Models of EMPS, simulation in open loop.

    Examples
    --------
    An axis of 1 kg that rests under no force, and is said to be pushed by 2 N: after 1 s it would be 1 m away.

    >>> from fdbench.scenario import load_scenario
    >>> found = dict(zip(PARAMETERS, (1.0, 1e-9, 1e-9, -2.0)))
    >>> position_m = open_loop_position_m(load_scenario("EMPS-v0").plant, np.zeros(101), 0.0, 0.01, found)
    >>> round(float(position_m[-1]), 3)
    1.0
    """

    unit = "mm"
    worst = 1000.0
    track = "output"

    def skip(self, outcome: Outcome) -> str | None:
        validation = outcome.scenario.validation
        if validation is None or not validation.open_loop:
            return "the scenario is not scored in open loop"
        drive = outcome.scenario.plant
        if not isinstance(drive, FeedDrive) or sorted(one.calibrates for one in drive.effects) != sorted(LEVELS):
            return "the nominal model is not a drive with Coulomb friction and an offset"
        missing = [name for name in PARAMETERS if name not in outcome.estimate.parameters]
        return f"the estimate claims no {missing[0]}" if missing else None

    def score(self, outcome: Outcome) -> float:
        record, drive, claimed = outcome.record, outcome.scenario.plant, outcome.estimate.parameters
        if not isinstance(drive, FeedDrive):
            raise TypeError(f"{outcome.scenario.id}: a feed drive is scored in open loop, found a {drive.name}.")
        if min(claimed[name] for name in PARAMETERS[:3]) <= 0.0:
            return self.worst
        force, measured = drive.motor_force(record), record["motor_position_m"]
        position = open_loop_position_m(drive, force, float(measured[0]), record.sampling_time_s, claimed)
        return min(self.worst, 1e3 * rms(position - measured))


def open_loop_position_m(
    drive: FeedDrive, force_N: FloatArray, start_m: float, sampling_time_s: float, parameters: Mapping[str, float]
) -> FloatArray:
    """Return the position (n,) from rest under a force (n,); the farthest that is simulated where it runs away.

    Of the drive, whose nominal effects are a Coulomb friction and an offset, their forms are taken.
    """
    mass_kg, viscous, coulomb_N, offset_N = (parameters[name] for name in PARAMETERS)
    levels = dict(zip(LEVELS, (coulomb_N, offset_N), strict=True))
    axis = FeedDrive(
        travel_m=FAR,
        velocity_limit_m_per_s=FAR,
        motor=LinearMotor(mass_kg=mass_kg, viscous_friction_N_s_per_m=viscous),
        # With 1 kg fed forward, what is commanded as an acceleration is the force.
        controller=OpenLoop(acceleration_feedforward_kg=1.0, force_limit_N=1e6),
        effects=tuple(one.changed(**{one.amplitude: levels[one.calibrates]}) for one in drive.effects),
    )
    n = len(force_N)
    reference = np.column_stack((np.full(n, start_m), np.zeros(n), force_N))
    timing = Timing(sampling_time_s=sampling_time_s, duration_s=n * sampling_time_s, substeps=SUBSTEPS)
    system = axis.system(Setup(timing=timing, motion=Sampled(reference)))
    system.start([0])
    position = system.advance(system.n_samples)[:, system.columns.index("motor_position_m"), 0]
    return np.where(np.isfinite(position), position, FAR)
