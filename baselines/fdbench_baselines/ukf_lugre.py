"""Unscented Kalman filter with a LuGre bristle: force, friction and parameters of a drive, from past readings alone."""

from typing import Any, ClassVar, final

import numpy as np

from fdbench.effects.coulomb_friction import CoulombFriction
from fdbench.effects.lugre_friction import LugreFriction
from fdbench.errors import SpecError
from fdbench.estimator import BatchEstimator, Context, Estimate, FloatArray
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import Record
from fdbench_baselines._found_drive import simulated_target
from fdbench_baselines._friction_motion import (
    FEED,
    LOOP,
    Driven,
    DriveSheet,
    declined,
    driven,
    frictions,
    parameters_with_covariance,
    sheet,
)
from fdbench_baselines._slip import below_half
from fdbench_baselines._unscented_drive import (
    MEAN,
    OWN,
    SHAPE,
    SLIP,
    VELOCITY,
    WALK,
    WAVES,
    DriveNoise,
    Numbers,
    Signals,
    run_unscented,
)
from fdbench_baselines.joint_kalman import SLIP as SLIPPED
from fdbench_baselines.joint_kalman import SLIP_PER_ROOT_S

PARAMETERS = 5
READING = (1.0, 0.05)  # of a position's noise, and of what a velocity changes by without a cause
WALK_PER_ROOT_S, WAVE, MEMORY_S = 0.3, 0.15, 2.0
SHORTEST_MEMORY_S, LONGEST_MEMORY_S = 0.5, 300.0
STEPS, EVALUATIONS = (-1.5, -1.5, 1.0, 1.0), 30


@final
class UkfLugre(BatchEstimator):
    r"""Motion, bristle, parameters and disturbance of a drive in one unscented filter.

    .. math::
        m \dot v = u - B v - \sigma_0 z - \sigma_1 \dot z - F_0 - F, \qquad
        \dot z = v - \frac{\sigma_0 |v|}{G(v)} z, \qquad
        G(v) = F_c + (F_s - F_c) e^{-(v / v_s)^2}, \qquad F = w + \sum_{h=1}^H c_h

    States are position and velocity, the bristle z, the factors of mass, viscous friction, level of friction, offset
    and stiffness of the bristle, a walk w, waves c at the harmonics of the nominal period and their slip; see
    `_unscented_drive`. Parameters begin at the nominal plant and are as uncertain as its sheet says. Bristles are those
    of the sheet; where it knows Coulomb friction alone, typical ones at its level. Without friction there is no
    bristle, and F has a mean that follows the command, as that of a cut.

    The record is taken as it is read, not by filtered rows: the position of the centre of mass of motor and table, or
    in a velocity loop the velocity. The force of the motor is known from the record. An estimate uses the readings up
    to the end of its own sample. The densities of an unknown white force and of the walk, size and memory of the waves
    alone are those of greatest likelihood over the record: fixed beforehand, it would run online.

    ``disturbance_N`` is the sum of the waves; without nominal friction or a period the walk, and the mean, are parts of
    it. ``parameters`` are those of the model at the last sample, with covariance. Of an axis with inverse dynamics a
    free run is the simulation of the drive as found.

    Told: the sheet with its covariance, the period (within 0.5 %), the force limit as a scale. A sample costs 2 N
    passes of the equation and 2 N^3 multiplications for N = 12 + 2 H states: 13 us for H = 4, times 31 with the search;
    the memory is 32 bytes a sample.

    Parameters
    ----------
    harmonics : int
        H, at least 0; in positions those below half of the sampling frequency.
    stiffness_deviation : float
        Deviation of the logarithm of the bristle's stiffness, at least 0. The default is what ``output_error`` leaves
        the shape of a friction.

    Raises
    ------
    SpecError
        If an argument is out of bounds, the scenario is none of a drive whose force is logged, or the filter diverges.

    Validity
    --------
    The force that is logged must be that of the motor. On axes with friction the mean of a cut goes to the friction,
    and the waves of a cut that turn with the feed are found anew after each reversal. It has no more to go by than the
    smoother ``rts_friction``, which knows what follows and is the more exact; where a shaker starts the waves are late.
    Stated variances are too small where the friction is of another shape. Where it turns more gradually than the
    bristle its level comes out too small: on the measured EMPS axis 12 N of 20.4 N, so that the position in open loop
    errs by 110 mm.

    References
    ----------
    Julier and Uhlmann, Unscented filtering and nonlinear estimation, Proc. IEEE 92 (2004), 401-422, eqs. (11), (12);
    Canudas de Wit, Olsson, Astrom, Lischinsky, A new model for control of systems with friction, IEEE Trans. Automatic
    Control 40 (1995), 419-425, eqs. (2) to (4); La Scala, Bitmead and Quinn, IEEE Trans. Signal Processing 44 (1996),
    431-434, for slip as a state.

    Examples
    --------
    The mass is 1.25 times that of the data sheet, so that beta_1 is 0.4, beside a shaker of 5 N.

    >>> from fdbench_baselines._example import example_drive
    >>> found = UkfLugre().fit(*example_drive(mass_ratio=1.25, wave_N=5.0, period_s=0.065))
    >>> {name: round(value, 3) for name, value in found.parameters.items()}
    {'beta_1': 0.4, 'beta_2': 0.6}
    """

    made_for: ClassVar[tuple[str, ...] | None] = ("feed_drive",)

    def __init__(self, harmonics: int = 4, stiffness_deviation: float = 0.2) -> None:
        if not isinstance(harmonics, int) or harmonics < 0:
            raise SpecError(f"ukf_lugre: harmonics = {harmonics!r} must be an integer of at least 0.")
        if not 0.0 <= stiffness_deviation < np.inf:
            raise SpecError(f"ukf_lugre: stiffness_deviation = {stiffness_deviation!r} must be at least 0 and finite.")
        self.harmonics, self.stiffness_deviation = harmonics, stiffness_deviation
        self._shapes: dict[str, float] = {}

    def skip(self, context: Context) -> str | None:
        """Skip where there is no equation of a force on a feed drive."""
        return declined(context)

    def fit(self, context: Context, record: Record) -> Estimate:
        """Find noises by likelihood, then filter."""
        from scipy.optimize import minimize

        plant, reason = context.plant, self.skip(context)
        if reason is not None or not isinstance(plant, FeedDrive):
            raise SpecError(f"ukf_lugre: {reason}.")
        drive, paper = driven(context, record), sheet(context)
        period_s, harmonics = context.disturbance_period_s, self.harmonics if context.disturbance_period_s else 0
        if period_s is not None and context.model != LOOP:
            harmonics = below_half(record["time_s"], period_s, harmonics)
        walks = 1.0 if harmonics == 0 or not paper.has_friction else 0.0
        numbers = self._numbers(context, drive, paper, bristle(plant))
        n = len(drive.force_N)
        follows = harmonics > 0 and FEED in record
        feed = walks * record[FEED] if follows else np.zeros(n)
        signals, rows = signals_of(numbers, drive, feed), np.empty((n, 2))

        def noise(point: FloatArray) -> DriveNoise:
            return noises(numbers, harmonics, point, walks)

        def loss(point: FloatArray) -> float:
            value = -float(run_unscented(numbers, signals, noise(point), rows)[2])
            return value if np.isfinite(value) else 1e300

        first = np.zeros(len(STEPS) if harmonics else 2)
        corners = np.vstack((first, np.diag(STEPS[: len(first)])))
        options: Any = {"initial_simplex": corners, "maxfev": EVALUATIONS, "xatol": 0.05, "fatol": 1.0}
        found = minimize(loss, first, method="Nelder-Mead", options=options)
        x, P, _ = run_unscented(numbers, signals, noise(found.x), rows)
        if not (np.isfinite(rows).all() and np.isfinite(P).all()):
            raise SpecError("ukf_lugre: the filter has diverged. Is the data sheet that of the drive?")
        self._shapes = {
            f"effects.{number}.bristle_stiffness_N_per_m": self.stiffness_deviation * float(x[SHAPE])
            for number, effect in enumerate(plant.effects)
            if isinstance(effect, LugreFriction)
        }
        place = slice(OWN, OWN + 4)
        beta, spread = parameters_with_covariance(context, drive, paper, x[place], P[place, place])
        heavier = paper.rigid(x[place]).mass_kg / paper.mass_kg * paper.force_unit_N
        doubt = float(paper.deviations[0] ** 2 * P[OWN, OWN])
        force, variance = rows[context.regression(record).rows].T
        return Estimate(
            parameters=dict(zip(context.nominal, beta.tolist(), strict=True)),
            covariance=spread,
            disturbance_N=heavier * force,
            disturbance_variance_N2=heavier**2 * (np.maximum(variance, 0.0) + doubt * force**2),
        )

    def predict(self, context: Context, estimate: Estimate, command: Record) -> FloatArray | None:
        """Return the target of an axis as it was found, simulated; in a velocity loop that of the parameters."""
        found = simulated_target(context, estimate, self._shapes, command)
        return super().predict(context, estimate, command) if found is None else found

    def _numbers(self, context: Context, drive: Driven, paper: DriveSheet, friction: LugreFriction | None) -> Numbers:
        place, step_s = int(context.model == LOOP), context.sampling_time_s
        unit = drive.unit if place == 1 else drive.unit / step_s
        level = friction.coulomb_force_N if friction is not None else 0.0
        period_s, deviations = context.disturbance_period_s, paper.deviations.tolist()
        return Numbers(
            place=place,
            velocity_unit=unit,
            kick_per_N=step_s / (paper.mass_kg * unit),
            step_s=step_s,
            angle=0.0 if period_s is None else 2.0 * np.pi * step_s / period_s,
            viscous=paper.linear_N_s_per_m,
            coulomb=level,
            static_share=friction.static_force_N / level - 1.0 if friction is not None else 0.0,
            stribeck=friction.stribeck_velocity_m_per_s if friction is not None else 1.0,
            bend_per_m=friction.bristle_stiffness_N_per_m / level if friction is not None else 0.0,
            damping_s=friction.bristle_damping_N_s_per_m / friction.bristle_stiffness_N_per_m if friction else 0.0,
            offset=paper.offset_N,
            mass=deviations[0],
            thicker=deviations[1] * paper.linear_N_s_per_m,
            level=deviations[2],
            offset_off=deviations[3],
            shape=self.stiffness_deviation,
            force_unit=paper.force_unit_N,
        )


def signals_of(numbers: Numbers, drive: Driven, feed: FloatArray) -> Signals:
    """Return what the filter takes in, for a feed (n,) that a mean force may follow."""
    apart = np.zeros(len(drive.force_N))
    if numbers.place == 0:
        read = np.diff(drive.reading, append=drive.reading[-1]) / numbers.step_s
        apart = drive.mean_velocity_m_per_s - read
    jolt = np.where(drive.held, (numbers.kick_per_N * numbers.force_unit) ** 2, 0.0)
    size = float(np.sqrt(np.mean(feed**2))) or 1.0
    return Signals(drive.force_N, apart, np.sign(feed), feed / size, drive.reading / drive.unit, drive.held, jolt)


def bristle(plant: FeedDrive) -> LugreFriction | None:
    """Return the sheet's LuGre friction, or one in place of its Coulomb friction; None where it has neither.

    >>> from fdbench.scenario import load_scenario
    >>> found = bristle(load_scenario("ShakerConstant-v1").plant)
    >>> round(found.coulomb_force_N, 3), round(found.bristle_stiffness_N_per_m)
    (0.668, 111333)
    """
    for effect in frictions(plant):
        if isinstance(effect, LugreFriction):
            return effect
    for effect in frictions(plant):
        if isinstance(effect, CoulombFriction):
            return LugreFriction.in_place_of(effect)
    return None


def noises(numbers: Numbers, harmonics: int, point: FloatArray, walk_share: float) -> DriveNoise:
    """Return the noises at logarithms of kick, walk, waves and memory about their starts."""
    kick, walk, wave, memory = np.append(point, np.zeros(4 - len(point))).tolist()
    N, h, reading = WAVES + 2 * harmonics, numbers.step_s, READING[numbers.place] ** 2
    seconds = float(np.clip(MEMORY_S * np.exp(memory), SHORTEST_MEMORY_S, LONGEST_MEMORY_S))
    fresh, start = np.zeros(N), np.zeros(N)
    start[numbers.place], start[VELOCITY] = reading, reading
    start[OWN : OWN + PARAMETERS], start[WALK] = 1.0, 1.0
    fresh[VELOCITY] = np.exp(2.0 * np.clip(kick, -8.0, 10.0))
    fresh[WALK] = WALK_PER_ROOT_S**2 * h * np.exp(2.0 * np.clip(walk, -12.0, 8.0))
    if harmonics:
        start[SLIP], fresh[SLIP] = SLIPPED**2, SLIP_PER_ROOT_S**2 * h
        start[MEAN:WAVES] = walk_share
        start[WAVES:] = WAVE**2 * np.exp(2.0 * np.clip(wave, -10.0, 5.0))
        fresh[WAVES:] = start[WAVES:] * -np.expm1(-2.0 * h / seconds)
    return DriveNoise(reading, fresh, start, float(np.exp(-h / seconds)), walk_share)
