"""Cogging observer: a force that repeats with the position, whose amplitudes wander, beside a velocity loop."""

import math
from typing import ClassVar, NamedTuple, final

import numpy as np

from fdbench.errors import PluginError, SpecError
from fdbench.estimator import BatchEstimator, Context, Estimate, FloatArray, Regression
from fdbench.plants._velocity_loop import DEAD_BAND_M_PER_S
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import Record
from fdbench_baselines._disturbance_gain import disturbance_gain
from fdbench_baselines._locally_periodic_states import (
    Amplitudes,
    LikeliestProcess,
    NoisyRows,
    filtered,
    posterior,
    restricted,
)
from fdbench_baselines._mixed_estimation import Found, mixed
from fdbench_baselines._position_waves import (
    FEWEST_PITCHES,
    Rows,
    Way,
    confirmed_pitch,
    found_pitch,
    harmonics_within,
    wave_columns,
    way_of,
)
from fdbench_baselines._robust import robust_residual
from fdbench_baselines._state_space_gp import Transition
from fdbench_baselines._straight_friction import straight
from fdbench_baselines.least_squares import factorise

LOOP = "velocity_loop"
WANDERED = (-6.0, 1.0)  # decades of the variance that an amplitude gains over a record, of its own
CLOSE = 0.1  # of a decade


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
    noise, wandering, parameters and mass leave. ``output`` is :math:`z^T \hat\beta + g \hat d`. The free run has the
    wave too, with amplitudes that fit the whole record; it begins where the record began.

    Told: pitch (within 1.5 %) or nothing of the force; the sheet with its covariance. The pass over the rows costs O(n
    (p + 2 H)^2), 6 ms for n = 4000 and H = 4, 15 of them for the likelihood; the search of a pitch that is not told 50
    us for a wavenumber. Memory is 8 n (p + 6 H) bytes, 1 MB.

    Parameters
    ----------
    harmonics : int
        H, at least 1; those with fewer than two rows in a wave where the drive is fastest are left out.
    false_alarm : float
        Probability by which white noise alone passes for a wave; between 0 and 1.

    Raises
    ------
    SpecError
        If an argument is out of bounds, the record does not identify every parameter, or the told pitch is longer than a
        third of the way or shorter than two rows.

    Validity
    --------
    A force that depends on time or direction as well is none of it: a shaker's, or the friction of a reversal. At one
    speed all over, position and time are the same, and what is found may be either. Cogging that differs from magnet to
    magnet is followed only as far as the amplitudes wander. A spectrum over place and back: the pitch's error times the
    reach must be a small part of a pitch. Of a drive on a compliant screw x is not where the motor is.

    References
    ----------
    Altintas, Verl, Brecher, Uriarte, Pritschow, Machine tool feed drives, CIRP Annals 60 (2011), 779-796, section 4
    (cogging); Harvey, Forecasting, Structural Time Series Models and the Kalman Filter, 1989, section 2.3, here with the
    position for the time; Lomb, Least-squares frequency analysis of unequally spaced data, Astrophysics and Space
    Science 39 (1976), 447-462, for the search. That both halves must share the wave is ours.

    Examples
    --------
    A drive on its data sheet over magnets of 20 mm, whose force of 10 N is found without being told of.

    >>> from fdbench_baselines._example import example_cogging
    >>> context, record = example_cogging(cogging_N=10.0, pitch_m=0.02)
    >>> estimator = CoggingObserver()
    >>> found = estimator.fit(context, record)
    >>> {name: round(value, 3) for name, value in found.parameters.items()}
    {'beta_1': 0.5, 'beta_2': 0.5}
    >>> round(float(np.sqrt(2.0 * np.mean(found.disturbance_N**2))), 1), round(estimator.pitch_m, 4)
    (10.0, 0.02)
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
        pitch_m = self._pitch(context, Rows(Z, y, trusted.astype(np.float64)), way)
        count = 0 if pitch_m is None else harmonics_within(way, pitch_m, self.harmonics)
        columns = np.empty((len(y), 0)) if pitch_m is None else wave_columns(way, pitch_m, count)
        loud = np.full(len(y), np.inf)
        loud[trusted] = robust_residual(np.hstack((Z, columns))[trusted], y[trusted])[1]
        process = wandering(columns, Z, y, loud)
        beta, covariance = mixed(context, regression, innovations_found(process, regression))
        found = posterior(process, y - Z @ beta, Z, covariance, step_s, False)
        noise = np.where(trusted, process.s2, np.mean(found.left[~trusted] ** 2) if not trusted.all() else 0.0)
        self._wave = None if pitch_m is None else Wave(pitch_m, np.linalg.lstsq(columns, found.force, rcond=None)[0])
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
        """Return the velocity that a command makes of parameters and wave."""
        if self._wave is None:
            return super().predict(context, estimate, command)
        if not estimate.parameters:
            raise PluginError("cogging_observer: the estimate of fit(context, record) is expected, with parameters.")
        return free_run(estimate.parameters, self._wave, command)

    def _pitch(self, context: Context, rows: Rows, way: Way) -> float | None:
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


def wandering(columns: FloatArray, Z: FloatArray, y: FloatArray, loud: FloatArray) -> LikeliestProcess:
    """Return the process of amplitudes (n, 2 H) that wander as far as is likeliest; one without noise if H is 0."""
    from scipy.optimize import minimize_scalar

    n, d = columns.shape
    harmonics = np.repeat(np.arange(1, d // 2 + 1), 2).astype(np.intp)
    H = np.ascontiguousarray(columns)
    design = Amplitudes(H, harmonics, np.zeros(d, dtype=np.bool_), np.ones(d), 1)
    weight = np.where(loud < np.inf, 1.0 / np.sqrt(loud), 0.0)[:, None]
    size = np.sqrt(np.mean((Z * weight) ** 2, axis=0))
    size[size == 0.0] = 1.0
    both = np.hstack((Z / size, columns))
    theta = np.linalg.lstsq(both * weight, y * weight[:, 0], rcond=None)[0]
    left = (y - both @ theta) * weight[:, 0]
    unit = float(np.sqrt(np.mean(left**2))) or 1.0
    amplitudes = theta[Z.shape[1] :].reshape(-1, 2) / unit
    variances = np.repeat(0.5 * np.sum(amplitudes**2, axis=1), 2)[:, None, None]
    rows = NoisyRows(np.column_stack((Z / size, y / unit)), loud, np.zeros(n, dtype=np.bool_))

    def motion(decades: float) -> Transition:
        return Transition(np.ones((d, 1, 1)), variances * (10.0**decades / n), variances)

    def loss(decades: float) -> float:
        value = restricted(rows, design, motion(decades))[0]
        return -value if np.isfinite(value) else 1e300

    decades = WANDERED[0]
    if d > 0:
        decades = float(minimize_scalar(loss, bounds=WANDERED, method="bounded", options={"xatol": CLOSE}).x)
    value, s2 = restricted(rows, design, motion(decades))
    return LikeliestProcess(design, motion(decades), loud, rows.fresh, s2 * unit**2, value)


def innovations_found(process: LikeliestProcess, regression: Regression) -> Found:
    """Return the parameters of least squares of the whitened innovations, and their covariance."""
    columns = np.column_stack((regression.regressors, regression.target))
    run = filtered(NoisyRows(columns, process.loud, process.fresh), process.design, process.motion, keep=False)
    seen = run.variances < np.inf
    white = run.errors[seen] / np.sqrt(run.variances[seen])[:, None]
    u, s, vt, scale = factorise(white[:, :-1], regression.names)
    root = vt.T / s / scale[:, None]
    return Found(root @ (u.T @ white[:, -1]), process.s2 * root @ root.T)


def free_run(parameters: dict[str, float], wave: Wave, command: Record) -> FloatArray:
    """Return the velocity v_1 ... v_{n-1} (n - 1,) from rest under the wave, which begins at the place 0."""
    reference, step_s = command["reference_velocity_m_per_s"], command.sampling_time_s
    beta_1, beta_2 = parameters["beta_1"], parameters["beta_2"]
    beta_3, beta_4 = parameters.get("beta_3", 0.0), parameters.get("beta_4", 0.0)
    pairs = wave.amplitudes.reshape(-1, 2).tolist()
    velocity, place = np.zeros(len(reference)), 0.0
    for k in range(len(reference) - 1):
        now = float(velocity[k])
        friction = beta_3 if now > DEAD_BAND_M_PER_S else -beta_4 if now < -DEAD_BAND_M_PER_S else 0.0
        angle = 2.0 * math.pi * (place + 0.5 * step_s * now) / wave.pitch_m
        force = sum(a * math.cos(h * angle) + b * math.sin(h * angle) for h, (a, b) in enumerate(pairs, 1))
        velocity[k + 1] = beta_1 * reference[k] + beta_2 * now - friction + force
        place += 0.5 * step_s * (now + float(velocity[k + 1]))
    return velocity[1:]
