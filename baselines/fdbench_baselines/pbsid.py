"""Predictor-based subspace identification: a long autoregression tells the states, and these a model of few."""

import itertools
import math
from typing import ClassVar, NamedTuple, final

import numpy as np

from fdbench.errors import PluginError, SpecError
from fdbench.estimator import BatchEstimator, Context, Estimate, FloatArray
from fdbench.plants._servo_stage import StagePlant
from fdbench.plants.slot_milling import SlotMilling
from fdbench.record import Record

SHORTEST = 10  # past that is tried; the longer ones are octaves of it
BETTER = 0.03  # by which more states have to lower the error of a free run
RESOLVED = float(np.finfo(np.float64).eps)


class InnovationsModel(NamedTuple):
    """Model x' = A x + B u + K e, y = C x + D u + e with A (n, n) and B, C, K (n,)."""

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: float
    K: FloatArray


class LearntAxis(NamedTuple):
    """What was learnt of an axis: a model, of what the data sheet's response leaves or of the position itself.

    Without a model it is the data sheet's response alone.
    """

    model: InnovationsModel | None
    beside_sheet: bool


@final
class Pbsid(BatchEstimator):
    r"""Predictor-based subspace identification (PBSID), which a feedback in the record does not bias.

    .. math::
        x_{k+1} = A x_k + B u_k + K e_k, \quad y_k = C x_k + D u_k + e_k, \qquad
        y_k = D u_k + \sum_{i=1}^p (\eta_i y_{k-i} + \beta_i u_{k-i}) + e_k

    Where :math:`\tilde A^p \approx 0` with :math:`\tilde A = A - K C`, the coefficients of the long autoregression
    (VARX) are :math:`\eta_i = C \tilde A^{i-1} K` and :math:`\beta_i = C \tilde A^{i-1} (B - K D)`. Least squares gives
    them; rows of them, each shifted by one lag more and filled up with zeros, are the observability matrix times the
    states once the past is known. A singular value decomposition finds a basis, of which the n heaviest states are
    kept, and two more least squares give the model:

    .. math::
        \Gamma x_k = \begin{pmatrix} \eta_1 & \beta_1 & \eta_2 & \beta_2 & \ldots \\
            \eta_2 & \beta_2 & \eta_3 & \beta_3 & \ldots \\ & & \ddots \end{pmatrix}
            (y_{k-1}, u_{k-1}, y_{k-2}, u_{k-2}, \ldots)^T, \quad
        (x_k, u_k) \to y_k: C, D, e_k, \quad (x_k, u_k, e_k) \to x_{k+1}: A, B, K

    u (N,) is the commanded position, m, or the feedrate, m/s; y (N,) the position, m, or the force, N; each is scaled
    by its size. A motion excites few frequencies, so that the autoregression is one of principal components, from the
    triangle of a QR decomposition. Their number r, and p of 10, 20, 40 and 80 samples, have the least
    :math:`N \log |e|^2 + r \log N` (Bayesian information criterion).

    On a stage, axis by axis: models of the position, and of what the nominal response leaves of it, of no more states
    than the data sheet's machine has. A free run over the record decides; more states have to lower its error by 3 %.
    ``predict`` is a free run from rest, ``output`` the position a sample ahead.

    In slot milling, n = 2, and 4 where something runs out: a mode that nothing feeds. Two poles :math:`s_i`, with
    :math:`z_i = e^{s_i T}`, are the process, those whose :math:`c_1, c_2` are nearest the data sheet's. The power law
    is taken off the feedrate, which is smooth or held; w and v being eigenvectors of A on the left and right,

    .. math::
        r_i = C v_i w_i^T B \, \frac{s_i^2 T}{(z_i - 1)^2} \;\; \text{or, held,} \;\;
        r_i = C v_i w_i^T B \, \frac{s_i}{z_i - 1}, \qquad c_4 s + c_3 = r_1 (s - s_2) + r_2 (s - s_1)

    with c in 1/s, 1/s^2, N/(m s) and N/m, from which the ``parameters`` follow.

    Told: on a stage the nominal response and its number of states; in slot milling the operating point, the power law,
    that the process has two poles, and whether something runs out, but not at which period. How far anything may be
    off is not told. A row costs 35 to 70 us on a stage, free runs included, and 20 us in slot milling; the memory is
    that of 2 p + 2 columns as long as the record, held twice, 20 MB for 6000 samples.

    Parameters
    ----------
    longest_past : int
        Most samples p, at least 10; no more than a quarter of the record is tried.

    Raises
    ------
    SpecError
        If ``longest_past`` is out of bounds, the plant is neither stage nor slot milling, or the record is too short,
        holds no input, or no process that decays.
    PluginError
        If a prediction is asked for before a fit.

    Validity
    --------
    Modes are found where the motion excites them, as short moves do; a slow spiral tells little more than a gain and a
    lag. The model is linear: friction, drag and a bent stiffness are the floor of its free runs. Noise of the output
    alone makes A~ as slow as A, which few samples p do not hold: slot milling is known less well than by simulation
    (`variable_projection`), and of a few waves in a short record the poles are found, but the gain may be off by a
    third. Modes that move with speed, as on the spindle testbed, need a model that moves with it, and a spindle read by
    its displacement alone has no recorded input. No covariance is claimed.

    References
    ----------
    Chiuso, The role of vector autoregressive modeling in predictor-based subspace identification, Automatica 43
    (2007), 1034-1048; van der Veen, van Wingerden, Bergamasco, Lovera and Verhaegen, Closed-loop subspace
    identification methods: an overview, IET Control Theory and Applications 7 (2013), 1339-1358. Principal components,
    free runs that decide, the response below and the way to the process are ours.

    Examples
    --------
    Five waves and no noise: damping and natural frequency of the data sheet, 0.5 and 20 rad/s.

    >>> from fdbench_baselines._example import example_milling
    >>> context, record = example_milling()
    >>> found = Pbsid().fit(context, record).parameters
    >>> physical = context.linear_model.physical_parameters(found, context.sampling_time_s)
    >>> round(physical["c_1"] / (2.0 * physical["c_2"] ** 0.5), 2), round(physical["c_2"] ** 0.5, 1)
    (0.5, 20.0)
    """

    made_for: ClassVar[tuple[str, ...] | None] = ("servo_response", "arx")

    def __init__(self, longest_past: int = 80) -> None:
        if not isinstance(longest_past, int) or longest_past < SHORTEST:
            raise SpecError(f"pbsid: longest_past = {longest_past!r} must be an integer of at least {SHORTEST}.")
        self.longest_past = longest_past
        self._axes: list[LearntAxis] | None = None

    def skip(self, context: Context) -> str | None:
        """Skip where no recorded input excites modes that stay where they are."""
        if isinstance(context.plant, (StagePlant, SlotMilling)):
            return None
        return "the plant is neither a servo stage nor slot milling: no recorded input excites modes that stay"

    def fit(self, context: Context, record: Record) -> Estimate:
        """Identify the process of slot milling, or each axis of a stage."""
        plant = context.plant
        if isinstance(plant, SlotMilling):
            return self._process(context, plant, record)
        if not isinstance(plant, StagePlant):
            raise SpecError(f"pbsid: {self.skip(context)}.")
        prefixes, target = plant.axes(), context.regression(record).target
        positions, sheets = (np.split(all_axes, len(prefixes)) for all_axes in (target, plant.nominal_response(record)))
        self._axes, outputs = [], []
        for (prefix, response), y, sheet in zip(prefixes.items(), positions, sheets, strict=True):
            u = record[f"{prefix}reference_position_m"]
            axis = self._axis(u, y, sheet, len(response.B))
            below = sheet if axis.beside_sheet else np.zeros(len(y))
            outputs.append(sheet if axis.model is None else below + ahead(axis.model, u, y - below))
            self._axes.append(axis)
        return Estimate(output=np.concatenate(outputs))

    def predict(self, context: Context, estimate: Estimate, command: Record) -> FloatArray | None:
        """Return the positions that the models of the axes make of a command, from rest; none in slot milling."""
        plant = context.plant
        if not isinstance(plant, StagePlant):
            return None
        if self._axes is None:
            raise PluginError("pbsid: fit(context, record) must come before predict.")
        runs = np.split(plant.nominal_response(command), len(self._axes))
        for number, (prefix, (model, beside_sheet)) in enumerate(zip(plant.axes(), self._axes, strict=True)):
            if model is not None:
                run = free_run(model, command[f"{prefix}reference_position_m"])
                runs[number] = runs[number] + run if beside_sheet else run
        return np.concatenate(runs)

    def _axis(self, u: FloatArray, y: FloatArray, sheet: FloatArray, most: int) -> LearntAxis:
        """Return the model of an axis, of at most so many states, that errs least in a free run."""
        best, error = LearntAxis(None, True), root_mean_square(y - sheet)
        below = {True: sheet, False: np.zeros(len(y))}
        if error <= math.sqrt(RESOLVED) * root_mean_square(y):
            return best
        states = {beside: states_of(u, y - own, self.longest_past) for beside, own in below.items()}
        for n, (beside, own) in itertools.product(range(1, most + 1), below.items()):
            model = model_of(states[beside], u, y - own, n)
            if model is None or np.max(np.abs(np.linalg.eigvals(model.A))) >= 1.0:
                continue
            left = root_mean_square(y - own - free_run(model, u))
            if left < (1.0 - BETTER) * error:
                best, error = LearntAxis(model, beside), left
        return best

    def _process(self, context: Context, plant: SlotMilling, record: Record) -> Estimate:
        """Return the parameters of the process."""
        (_, deviation, y), T = plant.settled(record), context.sampling_time_s
        u, y = chip_load(plant, deviation), (y - y.mean())[1:-1]
        n = 2 if context.disturbance_period_s is None else 4
        model = model_of(states_of(u, y, self.longest_past), u, y, n)
        found = None if model is None else process_of(model, plant, T)
        if found is None:
            raise SpecError(f"pbsid: among {n} poles of the record no two are those of a process that decays.")
        return Estimate(parameters=plant.discretised(context.model, found[1], found[0], T))


def root_mean_square(signal: FloatArray) -> float:
    """Return the size of a signal."""
    return float(np.sqrt(np.mean(signal**2)))


def chip_load(plant: SlotMilling, deviation: FloatArray) -> FloatArray:
    """Return what the force follows linearly, about its mean, m/s, (n - 2,), for a feedrate about the nominal one (n,).

    Its slope at the nominal feedrate is 1. A feedrate that is not held is smooth.
    """
    about, alpha = plant.operating_feedrate_m_per_s, plant.feedrate_exponent
    bent = about / alpha * (np.maximum(1.0 + deviation / about, 0.0) ** alpha - 1.0)
    load = deviation if plant.linearised else bent
    # Straight lines through the samples of a wave are too flat by a twelfth of its second difference.
    flat = 0.0 if plant.hold_input else np.diff(load, 2) / 12.0
    return np.asarray((load - load.mean())[1:-1] - flat)


def solved(columns: FloatArray, target: FloatArray) -> FloatArray:
    """Return the least squares of columns (N, m) for targets (N, k), (m, k); 0 for a column of zeros."""
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    return np.asarray(np.linalg.lstsq(columns / size, target, rcond=None)[0] / size[:, None])


def states_of(u: FloatArray, y: FloatArray, longest: int) -> FloatArray:
    """Return states (N, n) of the last N samples, in order of what they weigh in the outputs to come.

    >>> u = np.random.default_rng(0).standard_normal(400)
    >>> y = np.zeros(400)
    >>> for k in range(399):
    ...     y[k + 1] = 0.5 * y[k] + 2.0 * u[k]
    >>> model = model_of(states_of(u, y, 20), u, y, 1)
    >>> round(model.A.item(), 6), round((model.B * model.C).item(), 6), round(abs(model.D), 6)
    (0.5, 2.0, 0.0)
    """
    longest = min(longest, len(y) // 4)
    size_u, size_y = root_mean_square(u), root_mean_square(y)
    if longest < SHORTEST or size_u == 0.0 or size_y == 0.0:
        raise SpecError(f"pbsid: {len(y)} samples; at least {4 * SHORTEST} are needed, of an input and an output.")
    pairs = np.column_stack((y / size_y, u / size_u))
    lagged = [pairs[longest - lag : len(y) - lag] for lag in range(1, longest + 1)]
    columns = np.column_stack((pairs[longest:, 1], *lagged, pairs[longest:, 0]))
    N, R = len(columns), np.asarray(np.linalg.qr(columns, mode="r"))
    whole, least, markov = float(R[:, -1] @ R[:, -1]), math.inf, np.empty((0, 2))
    for p in (SHORTEST * 2**octave for octave in range(longest) if SHORTEST * 2**octave <= longest):
        m = 2 * p + 1
        left, s, right = np.linalg.svd(R[:m, :m])
        shares = left.T @ R[:m, -1]
        errors = np.maximum(whole - np.cumsum(shares**2), RESOLVED * whole)
        criterion = np.where(s > N * RESOLVED * s[0], N * np.log(errors) + np.arange(1, m + 1) * math.log(N), math.inf)
        r = int(np.argmin(criterion)) + 1
        if criterion[r - 1] < least:
            least, markov = float(criterion[r - 1]), (right[:r].T @ (shares[:r] / s[:r]))[1:].reshape(p, 2)
    p = len(markov)
    shifted = np.zeros((p, p, 2))
    for lag in range(p):
        shifted[lag, : p - lag] = markov[lag:]
    rows = shifted.reshape(p, 2 * p)
    basis = np.linalg.svd(R[:, 1 : 2 * p + 1] @ rows.T, full_matrices=False)[2]
    return np.asarray(columns[:, 1 : 2 * p + 1] @ (basis @ rows).T)


def model_of(states: FloatArray, u: FloatArray, y: FloatArray, n: int) -> InnovationsModel | None:
    """Return the model of the n heaviest states, or None where there are fewer."""
    x, u, y = states[:, :n], u[-len(states) :], y[-len(states) :]
    size = np.linalg.norm(x, axis=0)
    if x.shape[1] < n or size[-1] <= len(x) * RESOLVED * size[0]:
        return None
    known = np.column_stack((x, u))
    output = solved(known, y[:, None])
    e = y[:, None] - known @ output
    state = solved(np.hstack((known, e))[:-1], x[1:])
    return InnovationsModel(A=state[:n].T, B=state[n], C=output[:n, 0], D=float(output[n, 0]), K=state[n + 1])


def free_run(model: InnovationsModel, u: FloatArray) -> FloatArray:
    """Return the output (N,) of an input alone, from rest at its first value."""
    return np.asarray(driven(model.A, np.outer(u, model.B), at_rest(model, u)) @ model.C + model.D * u)


def ahead(model: InnovationsModel, u: FloatArray, y: FloatArray) -> FloatArray:
    """Return each output (N,) as those before it foretell it; a free run where such a forecast would grow."""
    A = model.A - np.outer(model.K, model.C)
    if np.max(np.abs(np.linalg.eigvals(A))) >= 1.0:
        return free_run(model, u)
    inputs = np.outer(u, model.B - model.K * model.D) + np.outer(y, model.K)
    return np.asarray(driven(A, inputs, at_rest(model, u)) @ model.C + model.D * u)


def at_rest(model: InnovationsModel, u: FloatArray) -> FloatArray:
    """Return the state (n,) after the first input has been held for long."""
    return np.asarray(np.linalg.solve(np.eye(len(model.B)) - model.A, model.B * u[0]))


def driven(A: FloatArray, inputs: FloatArray, x: FloatArray) -> FloatArray:
    """Return the states (N, n) from x (n,) on, under inputs (N, n)."""
    states = np.empty_like(inputs)
    for k, each in enumerate(inputs):
        states[k] = x
        x = A @ x + each
    return states


def process_of(model: InnovationsModel, plant: SlotMilling, T: float) -> tuple[FloatArray, FloatArray] | None:
    """Return (c_2, c_1) and (c_3, c_4) of the two poles that are nearest the plant's, or None where none decay."""
    z, right = np.linalg.eig(model.A.astype(np.complex128))
    s = np.log(np.where(z == 0.0, RESOLVED, z)) / T
    held = s / (z - 1.0)
    r = (model.C @ right) * np.linalg.solve(right, model.B) * (held if plant.hold_input else held**2 * T)
    nearest, found = math.inf, None
    for i, j in itertools.combinations(range(len(s)), 2):
        c_1, c_2 = -(s[i] + s[j]), s[i] * s[j]
        if c_1.real <= 0.0 or c_2.real <= 0.0 or abs(c_1.imag) > 1e-6 * c_1.real:
            continue
        distance = math.hypot(*np.log([c_1.real / plant.coefficients[0], c_2.real / plant.coefficients[1]]))
        if distance < nearest:
            c_3, c_4 = -(r[i] * s[j] + r[j] * s[i]), r[i] + r[j]
            nearest, found = distance, (np.array([c_2.real, c_1.real]), np.array([c_3.real, c_4.real]))
    return found
