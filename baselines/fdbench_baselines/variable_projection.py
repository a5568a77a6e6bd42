"""Output error of slot milling under run-out, by variable projection."""

import dataclasses
from typing import ClassVar, NamedTuple, final

import numpy as np
from numba import njit

from fdbench.compilation import kept
from fdbench.errors import SpecError
from fdbench.estimator import BatchEstimator, Context, Estimate, FloatArray
from fdbench.plants.slot_milling import MM_PER_M, SlotMilling
from fdbench.record import Record
from fdbench_baselines._slip import below_half, slipped_period
from fdbench_baselines.frequency_least_squares import jacobian
from fdbench_baselines.least_squares import factorise

TOLERANCE = 1e-12
WIDEST = 1.5  # logarithm by which a process may be off its data sheet


class Shape(NamedTuple):
    """Logarithms of what the columns depend on nonlinearly: damping and natural frequency, and that of the run-out.

    All are 0 at the data sheet's process and at the period that the record shows.
    """

    damping: float
    natural_frequency: float
    runout_frequency: float


@final
class VariableProjection(BatchEstimator):
    r"""Simulation of the nominal process beside the run-out, fitted to the force itself rather than to its equation.

    .. math::
        F_k = K\, x_k(\zeta, \omega_n) + h_k^T a + \sum_{j=1}^H (c_j \cos j \varphi_k + s_j \sin j \varphi_k) + e_k,
        \qquad \ddot x + 2 \zeta \omega_n \dot x + \omega_n^2 x = \omega_n^2 w + 2 \zeta \omega_n \dot w, \quad
        w = f^\alpha

    The force is linear in the steady force K (N at 1 mm/s), the unknown state a at the first settled sample with its
    two free responses h, and the run-out's amplitudes; these are projected out,

    .. math:: \hat\theta = \arg\min_\theta |(I - X(\theta) X(\theta)^+) F|^2, \qquad
              \theta = (\log \zeta, \log \omega_n, \log f_r)

    so that three numbers are searched for. The equation of `least_squares` has the reading's noise and the run-out in
    its regressors, and is biased by both; here the noise e is that of the dynamometer, white, and what is simulated
    comes from the feedrate alone. ``parameters`` are those of the held-input model of the found process, with the
    covariance :math:`s^2 (J^T J)^{-1}` through their Jacobian; ``output`` is the fitted force, ``disturbance_N`` the
    run-out.

    Told: structure and exponents of the process, the operating point, the nominal period, which may slip by 1.5 %. Not
    told: how far anything may be from the data sheet. The feedrate is a cubic spline through its samples. About 20 ms a
    record of 512 samples, no memory beyond its columns.

    Parameters
    ----------
    harmonics : int
        H of the nominal period, where one is known; at least 0, and no more than lie below half of the sampling
        frequency.

    Raises
    ------
    SpecError
        If ``harmonics`` is out of bounds, the record does not identify the process, or the search ends off by more than
        a factor of 4.5.

    Validity
    --------
    The structure must be right: another exponent, or an actuator between command and feedrate, is taken for another
    gain and damping. A run-out whose harmonic is one of the feedrate's cannot be told from the process. Noise of the
    feedrate reading biases as it would any simulation from a measured input.

    References
    ----------
    Golub and Pereyra, The differentiation of pseudo-inverses and nonlinear least squares problems whose variables
    separate, SIAM J. Numerical Analysis 10 (1973), 413-432; Ljung, System Identification, 2nd ed. 1999, section 4.2
    for the output-error structure; Turkay and Ulsoy (1988), eq. (8), for the process.

    Examples
    --------
    Five waves and no noise: the parameters are those of the data sheet.

    >>> from fdbench_baselines._example import example_milling
    >>> context, record = example_milling()
    >>> found = VariableProjection().fit(context, record).parameters
    >>> all(abs(found[name] / value - 1.0) < 1e-5 for name, value in context.nominal.items())
    True
    """

    made_for: ClassVar[tuple[str, ...] | None] = ("arx",)

    def __init__(self, harmonics: int = 2) -> None:
        if not isinstance(harmonics, int) or harmonics < 0:
            raise SpecError(f"variable_projection: harmonics = {harmonics!r} must be an integer of at least 0.")
        self.harmonics = harmonics

    def skip(self, context: Context) -> str | None:
        """Decline plants that are no slot milling."""
        return None if isinstance(context.plant, SlotMilling) else "the plant is no slot milling"

    def fit(self, context: Context, record: Record) -> Estimate:
        """Search for the process alone, then for process and run-out."""
        plant, model = context.plant, context.linear_model
        if not isinstance(plant, SlotMilling):
            raise SpecError(f"variable_projection: {self.skip(context)}.")
        problem = Problem(plant, record)
        at = problem.solved(Shape(0.0, 0.0, 0.0))
        if context.disturbance_period_s is not None and self.harmonics > 0:
            time_s = problem.time_s
            left = problem.force - problem.fitted(at)
            problem.harmonics = below_half(time_s, context.disturbance_period_s, self.harmonics)
            problem.period_s = slipped_period(time_s, left, context.disturbance_period_s, problem.harmonics)
            at = problem.solved(at)
        columns = problem.columns(at)
        weights = problem.weights(columns)
        left = problem.force - columns @ weights
        slopes = jacobian(lambda shape: problem.columns(Shape(*shape)) @ weights, np.array(at))
        used = slopes if problem.harmonics > 0 else slopes[:, :2]
        J = np.hstack((columns[:, :1] * weights[0], used, columns[:, 1:]))
        _, s, vt, scale = factorise(
            J, ("gain", *Shape._fields[: used.shape[1]], *("nuisance",) * (columns.shape[1] - 1))
        )
        variance = float(left @ left) / (len(left) - J.shape[1])
        root = (vt.T / s / scale[:, None])[:3]
        names = tuple(context.nominal)

        def parameters(point: FloatArray) -> FloatArray:
            found = process(plant, float(point[0]), Shape(float(point[1]), float(point[2]), 0.0))
            values = found.linear_model(model.name).nominal_parameters(context.sampling_time_s)
            return np.array([values[name] for name in names])

        point = np.array([np.log(weights[0] / plant.force_at_1_mm_per_s_N), at.damping, at.natural_frequency])
        slope = jacobian(parameters, point) @ root
        rows = slice(-len(context.regression(record).target), None)
        wave = columns[:, 3:] @ weights[3:]
        return Estimate(
            parameters=dict(zip(names, parameters(point).tolist(), strict=True)),
            covariance=variance * slope @ slope.T,
            disturbance_N=wave[rows],
            output=(columns @ weights - plant.steady_force_N)[rows],
            output_variance=np.full(len(wave[rows]), variance),
        )


class Problem:
    """The settled force (n,) of a record, and the columns that it is made of at a shape."""

    def __init__(self, plant: SlotMilling, record: Record) -> None:
        from scipy.interpolate import CubicSpline

        first, feedrate, force = plant.settled(record)
        self.plant, self.force = plant, force + plant.steady_force_N
        self.time_s, self.step_s = record["time_s"][first:], record.sampling_time_s
        self.period_s, self.harmonics = np.inf, 0
        fine = CubicSpline(np.arange(len(feedrate)), feedrate)(0.5 * np.arange(2 * len(feedrate) - 1))
        self.load = chip_load(plant, fine)

    def columns(self, shape: Shape) -> FloatArray:
        """Return response to the feedrate, two free responses, then cosine and sine of each harmonic, (n, 3 + 2 H)."""
        c_1, c_2, _, _ = process(self.plant, 0.0, shape).coefficients
        angle = 2.0 * np.pi * np.exp(shape.runout_frequency) / self.period_s * (self.time_s - self.time_s[0])
        waves = [wave(order * angle) for order in range(1, self.harmonics + 1) for wave in (np.cos, np.sin)]
        return np.column_stack((responses(propagators(c_1, c_2, self.step_s), self.load), *waves))

    def weights(self, columns: FloatArray) -> FloatArray:
        """Return the weights of least squares of the columns (m,)."""
        size = np.linalg.norm(columns, axis=0)
        return np.asarray(np.linalg.lstsq(columns / size, self.force, rcond=None)[0] / size)

    def fitted(self, shape: Shape) -> FloatArray:
        """Return the force (n,) that a shape explains best."""
        columns = self.columns(shape)
        return np.asarray(columns @ self.weights(columns))

    def solved(self, start: Shape) -> Shape:
        """Return the shape of least squares near another."""
        from scipy.optimize import least_squares

        free = 3 if self.harmonics > 0 else 2

        def left(point: FloatArray) -> FloatArray:
            return self.force - self.fitted(Shape(*point, *start[len(point) :]))

        found = least_squares(
            left, start[:free], jac="3-point", method="lm", xtol=TOLERANCE, ftol=TOLERANCE, gtol=TOLERANCE
        ).x
        if not np.all(np.abs(found) < WIDEST):
            raise SpecError(
                f"variable_projection: the search went from the data sheet's process to {np.exp(found[:2])} times its "
                "damping and natural frequency. Does the record hold a feedrate that varies, and no other force?"
            )
        return Shape(*found.tolist(), *start[free:])


def process(plant: SlotMilling, gain: float, shape: Shape) -> SlotMilling:
    """Return a process whose force, damping and natural frequency are e to the power of these times the plant's."""
    return dataclasses.replace(
        plant,
        specific_cutting_force_N=plant.specific_cutting_force_N * float(np.exp(gain)),
        damping_ratio=plant.damping_ratio * float(np.exp(shape.damping)),
        natural_frequency_rad_per_s=plant.natural_frequency_rad_per_s * float(np.exp(shape.natural_frequency)),
    )


def chip_load(plant: SlotMilling, deviation: FloatArray) -> FloatArray:
    """Return w (n,), 1 at 1 mm/s, for deviations from the operating feedrate, m/s; linear where the process is."""
    about, alpha = MM_PER_M * plant.operating_feedrate_m_per_s, plant.feedrate_exponent
    if plant.linearised:
        return np.asarray(about**alpha + alpha * about ** (alpha - 1.0) * MM_PER_M * deviation)
    return np.asarray(np.maximum(about + MM_PER_M * deviation, 0.0) ** alpha)


def propagators(c_1: float, c_2: float, step_s: float) -> FloatArray:
    r"""Return (2, 5): the exact flow of the process over a step, and weights of w at its start, middle and end.

    .. math:: \dot x_1 = -c_1 x_1 + x_2 + c_1 w, \quad \dot x_2 = -c_2 x_1 + c_2 w

    with a parabola through the three values of w.

    >>> propagators(1.0, 1.0, 1e-9).sum(axis=1).round(6)  # a short step changes nothing
    array([1., 1.])
    """
    from scipy.linalg import expm

    generator = np.zeros((5, 5))
    generator[0, :3], generator[1, [0, 2]] = [-c_1, 1.0, c_1], [-c_2, c_2]
    generator[2, 3] = generator[3, 4] = 1.0
    flow = expm(generator * step_s)[:2]
    slope, bend = flow[:, 3] / step_s, 4.0 * flow[:, 4] / step_s**2
    return np.column_stack((flow[:, :2], flow[:, 2] - 3.0 * slope + bend, 4.0 * slope - 2.0 * bend, bend - slope))


@kept
@njit(error_model="numpy")
def responses(flow: FloatArray, load: FloatArray) -> FloatArray:
    """Return x_1 for a load (2 n - 1,) from zero, then from each of the states 1 without load, (n, 3)."""
    n = (load.size + 1) // 2
    out = np.zeros((n, 3))
    a, b, c, d, e, f = 0.0, 0.0, 1.0, 0.0, 0.0, 1.0
    for k in range(n):
        out[k, 0], out[k, 1], out[k, 2] = a, c, e
        if k + 1 < n:
            w, middle, end = load[2 * k], load[2 * k + 1], load[2 * k + 2]
            driven = flow[0, 2] * w + flow[0, 3] * middle + flow[0, 4] * end
            turned = flow[1, 2] * w + flow[1, 3] * middle + flow[1, 4] * end
            a, b = flow[0, 0] * a + flow[0, 1] * b + driven, flow[1, 0] * a + flow[1, 1] * b + turned
            c, d = flow[0, 0] * c + flow[0, 1] * d, flow[1, 0] * c + flow[1, 1] * d
            e, f = flow[0, 0] * e + flow[0, 1] * f, flow[1, 0] * e + flow[1, 1] * f
    return out
