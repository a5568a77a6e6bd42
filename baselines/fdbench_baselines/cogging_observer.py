"""Cogging observer: a force that repeats with the position, whose amplitudes wander, beside a velocity loop."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar, NamedTuple, final

import numpy as np

from fdbench.effects.cogging import Cogging
from fdbench.errors import PluginError, SpecError
from fdbench.estimator import BatchEstimator, Context, Estimate, FloatArray
from fdbench.plants._velocity_loop import VelocityLoopModel
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import Record
from fdbench_baselines._disturbance_gain import disturbance_gain
from fdbench_baselines._found_drive import found_drive
from fdbench_baselines._locally_periodic_force import posterior
from fdbench_baselines._mixed_estimation import mixed
from fdbench_baselines._position_waves import (
    FEWEST_PITCHES,
    DrivenWay,
    WaveRows,
    confirmed_pitch,
    found_pitch,
    harmonics_within,
    wave_columns,
    way_of,
)
from fdbench_baselines._robust import robust_residual
from fdbench_baselines._straight_friction import straight
from fdbench_baselines._wandering_amplitudes import innovations_found, wandering
from fdbench_baselines.least_squares import factorise
from fdbench_baselines.output_error import commanded

LOOP = "velocity_loop"
LARGEST_N = next(item.high for item in Cogging.parameters() if item.name == Cogging.amplitude)


class Wave(NamedTuple):
    """A found wave: pitch, amplitudes of cosine and sine of each harmonic (2 H,) in units of the target."""

    pitch_m: float
    amplitudes: FloatArray


@final
class CoggingObserver(BatchEstimator):
    r"""Disturbance over position as a Fourier series in a Kalman smoother, with the drive's parameters.

    .. math::
        y_k = z_k^T \beta + g\, d_k + e_k, \quad
        d_k = \sum_{h=1}^H \Big( a_{h,k} \cos \frac{2 \pi h x_k}{p} + b_{h,k} \sin \frac{2 \pi h x_k}{p} \Big), \qquad
        a_h^+ = a_h + \eta, \; b_h^+ = b_h + \eta'

    with velocity y (m/s), rows z and parameters :math:`\beta` of the velocity loop, disturbance gain g, force against
    motion d (N), position x in the middle of the row and pitch p (m), white e. Columns are means over the row's way.
    As the force is a column of its own, feedback does not put it into :math:`\beta`, as it does in least squares, which
    take a slow force for a drive that hardly follows its command.

    The position is the sum of the measured velocity, so that nothing else is read and its origin does not matter. The
    pitch is the likeliest within 1.5 % of the told one. Where none is told it is sought over position: each wavenumber
    at which every row is less than a quarter of a pitch and the way has three; the best multiple of what stands out
    most (`_position_waves`). Nothing is claimed of a force where no wave is likelier than chance, or where the two
    halves of the way have different ones; then the parameters are those of weighted least squares.

    The Kalman filter gives the restricted likelihood, :math:`\beta` integrated out, and the smoother the force
    (`_state_space_gp`). An amplitude begins as large as the wave that least squares finds; how far all of them wander
    is likeliest, by a bounded search. Rows off the straight line of the nominal friction count as missing, those beyond
    four deviations less. ``parameters`` are those of generalised least squares of the innovations and of the sheet;
    ``disturbance_N`` is smoothed, in the mass that both make likeliest (`_disturbance_gain`), with the variance that
    noise, wandering, parameters and mass leave. ``output`` is :math:`z^T \hat\beta + g \hat d`. A free run is
    the nominal drive, turned to the parameters and over the wave with amplitudes that fit the whole record, simulated:
    a row's equation has one direction of friction for a row in which the drive turns back. It begins where the record
    began.

    Told: pitch (within 1.5 %) or nothing of the force; the sheet with its covariance. A pass over n rows costs
    O(n H (H + p)), 2 ms for n = 4000 and H = 4, and the likelihood takes some 13 of them; the search of a pitch that is
    not told costs 50 us for each of at most 10^4 wavenumbers. The memory is 70 n H bytes, 2 MB at most at once.

    Parameters
    ----------
    harmonics : int
        H, at least 1; those with fewer than two rows in a wave where the drive is fastest are left out.
    false_alarm : float
        Probability by which white noise alone passes for a wave; between 0 and 1.

    Raises
    ------
    SpecError
        If an argument is out of bounds, the record does not identify every parameter, or the told pitch is longer than
        a third of the way or shorter than two rows.

    Validity
    --------
    A force that depends on time or direction as well is none of it: a shaker's, or the friction of a reversal. Where
    one speed is held all over, place and time are the same, and what is found may be either; of 40 records of shakers
    whose period was withheld one was claimed, at the way of a period at the speed that both halves share. Friction that
    the sheet lacks, at the same places each time, may pass for a wave. Amplitudes that differ by more than 70 % between
    the halves are taken for no wave; what differs from magnet to magnet is followed only as far as amplitudes wander
    with time. Most of the force's variance is often that of the mass, one number for a whole record, so that either
    nearly all of a record is within its intervals or little. On a compliant axis the motor is not where the velocity is
    read.

    References
    ----------
    Ahn, Chen and Dou, State-periodic adaptive compensation of cogging and Coulomb friction in permanent-magnet linear
    motors, IEEE Trans. Magnetics 41 (2005), 90-98, for cogging as a disturbance over position; Harvey, Forecasting,
    Structural Time Series Models and the Kalman Filter, 1989, section 2.3, here over position; Lomb, Astrophysics and
    Space Science 39 (1976), 447-462, for the search. That both halves must share the wave is ours.

    Examples
    --------
    A drive on its data sheet over magnets of 20 mm, whose force of up to 5 N is found without being told of.

    >>> from fdbench_baselines._example import example_cogging
    >>> context, record = example_cogging(cogging_N=5.0, pitch_m=0.02)
    >>> estimator = CoggingObserver()
    >>> found = estimator.fit(context, record)
    >>> {name: round(value, 3) for name, value in found.parameters.items()}
    {'beta_1': 0.5, 'beta_2': 0.5}
    >>> round(float(np.abs(found.disturbance_N).max()), 1), round(estimator.pitch_m, 4)
    (5.0, 0.02)
    >>> CoggingObserver().fit(*example_cogging(cogging_N=0.0)).disturbance_N is None
    True
    """

    made_for: ClassVar[tuple[str, ...] | None] = (LOOP,)

    def __init__(self, harmonics: int = 4, false_alarm: float = 1e-3) -> None:
        if not isinstance(harmonics, int) or harmonics < 1:
            raise SpecError(f"cogging_observer: harmonics = {harmonics!r} must be an integer of at least 1.")
        if not 0.0 < false_alarm < 1.0:
            raise SpecError(f"cogging_observer: false_alarm = {false_alarm!r} must be between 0 and 1.")
        self.harmonics, self.false_alarm = harmonics, false_alarm
        self._wave: Wave | None = None

    @property
    def pitch_m(self) -> float | None:
        """Pitch that the last record has, m; None where it has none."""
        return None if self._wave is None else self._wave.pitch_m

    def skip(self, context: Context) -> str | None:
        """Skip where the model is no velocity loop, and where the disturbance has a period in time."""
        if context.model != LOOP or not isinstance(context.plant, FeedDrive):
            return "the model is no velocity loop of a feed drive"
        if context.disturbance_pitch_m is None and context.disturbance_period_s is not None:
            return "the disturbance has a period in time and no pitch"
        return None

    def fit(self, context: Context, record: Record) -> Estimate:
        """Find the pitch, the amplitudes' wandering by likelihood, parameters and force by a smoother."""
        reason = self.skip(context)
        if reason is not None:
            raise SpecError(f"cogging_observer: {reason}.")
        regression = context.regression(record)
        Z, y, step_s = regression.regressors, regression.target, regression.sampling_time_s
        trusted = straight(context, Z)
        factorise(Z[trusted], regression.names)
        way = way_of(regression)
        pitch_m = self._pitch(context, WaveRows(Z, y, trusted.astype(np.float64)), way)
        count = 0 if pitch_m is None else harmonics_within(way, pitch_m, self.harmonics)
        columns = np.empty((len(y), 0)) if pitch_m is None else wave_columns(way, pitch_m, count)
        loud = np.full(len(y), np.inf)
        loud[trusted] = robust_residual(np.hstack((Z, columns))[trusted], y[trusted])[1]
        process = wandering(columns, Z, y, loud)
        beta, covariance = mixed(context, regression, innovations_found(process, regression))
        found = posterior(process, y - Z @ beta, Z, covariance, step_s, False)
        noise = np.where(trusted, process.s2, np.mean(found.left[~trusted] ** 2) if not trusted.all() else 0.0)
        amplitudes = np.asarray(np.linalg.lstsq(columns, found.force, rcond=None)[0])
        self._wave = None if pitch_m is None else Wave(pitch_m, amplitudes)
        estimate = Estimate(
            parameters=dict(zip(regression.names, beta.tolist(), strict=True)),
            covariance=covariance,
            output=y - found.left,
            output_variance=found.variance + noise,
        )
        if pitch_m is None:
            return estimate
        gain, deviation = disturbance_gain(context, regression, beta)
        force = found.force / gain
        return Estimate(
            **vars(estimate)
            | {"disturbance_N": force, "disturbance_variance_N2": found.variance / gain**2 + (deviation * force) ** 2}
        )

    def predict(self, context: Context, estimate: Estimate, command: Record) -> FloatArray | None:
        """Return the velocity of the drive as it was found, over its wave, simulated."""
        if self._wave is None:
            return super().predict(context, estimate, command)
        if not estimate.parameters:
            raise PluginError("cogging_observer: the estimate of fit(context, record) is expected, with parameters.")
        drive = with_wave(context, estimate.parameters, self._wave)
        return context.regression(drive.respond(commanded(command))).target

    def _pitch(self, context: Context, rows: WaveRows, way: DrivenWay) -> float | None:
        told_m = context.disturbance_pitch_m
        if told_m is None:
            return found_pitch(rows, way, self.harmonics, self.false_alarm)
        if told_m * FEWEST_PITCHES > way.reach_m or harmonics_within(way, told_m, 1) == 0:
            raise SpecError(
                f"cogging_observer: a pitch of {told_m:g} m on a way of {way.reach_m:g} m with up to "
                f"{np.abs(way.moved_m).max():g} m a row: {FEWEST_PITCHES:g} pitches on the way and two rows in a pitch "
                "are needed. Is it in metres, and are the velocities in m/s?"
            )
        return confirmed_pitch(rows, way, told_m, self.harmonics, self.false_alarm)


def with_wave(context: Context, parameters: Mapping[str, float], wave: Wave) -> FeedDrive:
    """Return the drive as it was found, over magnets; mass and forces are those of the nominal gain."""
    model, step_s = context.linear_model, context.sampling_time_s
    if not isinstance(model, VelocityLoopModel):
        raise SpecError(f"the model of {context.model} is no velocity loop.")
    physical = dict(model.physical_parameters(parameters, step_s))
    per_N = parameters["beta_1"] / model.gain_N_s_per_m
    physical["offset_N"] = 0.5 * (parameters.get("beta_3", 0.0) - parameters.get("beta_4", 0.0)) / per_N
    drive = found_drive(context, physical)
    pairs = (wave.amplitudes.reshape(-1, 2) / per_N).tolist()
    cogging: list[Cogging] = []
    for h, (a, b) in enumerate(pairs, 1):
        parts = max(1, math.ceil(math.hypot(a, b) / LARGEST_N))  # one effect has no more
        force_N = math.hypot(a, b) / parts
        cogging += parts * [Cogging(cogging_force_N=force_N, pitch_m=wave.pitch_m / h, phase_rad=math.atan2(-a, -b))]
    return replace(drive, effects=(*drive.effects, *cogging))
