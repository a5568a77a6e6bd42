"""Hyperparameters of a locally periodic force by restricted likelihood."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fdbench.estimator import FloatArray
from fdbench_baselines._robust import loudness
from fdbench_baselines._state_space_gp import (
    Innovations,
    Transition,
    by_components,
    run_filter,
    transition,
)

EVALUATIONS, REFINEMENTS, TOLERANCE = 120, 60, 0.02
# Logarithms: deviations of waves, of the level and of what grows with the feed, over the noise's; lengths in s; width.
START = np.array([1.0, 0.0, 0.0, -1.0, 0.0, 0.0])
LOWEST = np.array([-8.0, -1.0, -1.5, -8.0, -6.0, -8.0])
HIGHEST = np.array([6.0, 7.0, 4.0, 6.0, 7.0, 4.0])
SMALLEST_VARIANCE = 1e-5  # of the noise's; harmonics below are left out
MOST_STARTS, DECISIVE, AWAY_S = 4, 10.0, 0.1


class Amplitudes(NamedTuple):
    """Amplitudes: H (n, d), orders of the harmonics (d,), which grow with the feed, which are of the force; 1 or 2."""

    H: FloatArray
    harmonics: NDArray[np.intp]
    grows: NDArray[np.bool_]
    own: FloatArray
    order: int

    def up_to(self, harmonic: int) -> "Amplitudes":
        """Return the design without the harmonics above."""
        kept = self.harmonics <= harmonic
        H = np.ascontiguousarray(self.H[:, kept])
        return Amplitudes(H, self.harmonics[kept], self.grows[kept], self.own[kept], self.order)


class NoisyRows(NamedTuple):
    """Columns (n, p + 1), target last; variance of each row's noise (n,), inf where missing; where all begins anew."""

    columns: FloatArray
    loud: FloatArray
    fresh: NDArray[np.bool_]


class LikeliestProcess(NamedTuple):
    """What was found: s2 is the variance of the noise in units of the target squared."""

    design: Amplitudes
    motion: Transition
    loud: FloatArray
    fresh: NDArray[np.bool_]
    s2: float
    log_likelihood: float


def designs(angle: FloatArray, harmonics: int, feed: FloatArray | None, owns_level: bool) -> list[Amplitudes]:
    r"""Return the processes that a force may be: Ornstein-Uhlenbeck or Matern amplitudes, or those of a cut.

    Parameters
    ----------
    angle : (n,) array
        :math:`\varphi`.
    harmonics : int
        J; 0 leaves the level alone.
    feed : (n,) array or None
        v_r; amplitudes are then :math:`a \operatorname{sign} v_r + b v_r`, as those of a cut are.
    owns_level : bool
        Whether the level is part of the force, or of what the linear model misses.
    """
    orders = np.append(0, np.repeat(np.arange(1, harmonics + 1), 2)).astype(np.intp)
    turned = angle[:, None] * np.arange(1, harmonics + 1)
    H = np.ones((len(angle), len(orders)))
    H[:, 1::2], H[:, 2::2] = np.cos(turned), np.sin(turned)
    own = np.where(orders == 0, float(owns_level), 1.0)
    if feed is not None:
        speed = (feed / (float(np.sqrt(np.mean(feed**2))) or 1.0))[:, None]
        both = np.hstack((H * np.sign(speed), H * speed))
        grows = np.arange(2 * len(orders)) >= len(orders)
        return [Amplitudes(both, np.tile(orders, 2), grows, np.tile(own, 2), 1)]
    grows = np.zeros(len(orders), dtype=np.bool_)
    return [Amplitudes(H, orders, grows, own, order) for order in ((1, 2) if harmonics else (1,))]


def transitions(design: Amplitudes, step_s: float, place: FloatArray) -> Transition:
    r"""Return F, Q, P of all amplitudes at a point of the search.

    Harmonics share the variance of the waves as in the periodic kernel of width :math:`\sigma_2`, whose Fourier
    coefficients are :math:`q_j^2 \propto I_j(1 / 4 \sigma_2^2)`: Solin and Särkkä (2014), eq. (27).
    """
    from scipy.special import ive

    wave, _, width, level, _, growth = np.exp(2.0 * place)
    weights = ive(np.arange(design.harmonics.max() + 1), 1.0 / width)
    weights *= wave / max(float(weights[1:].sum()), 1e-300)
    weights[0] = level
    scale = (weights[design.harmonics] * np.where(design.grows, growth, 1.0))[:, None, None]
    is_level = (design.harmonics == 0)[:, None, None]
    waves, levels = (transition(design.order, step_s, float(np.exp(place[i]))) for i in (1, 4))
    F, Q, P = (np.where(is_level, there, here) for here, there in zip(waves, levels, strict=True))
    return Transition(np.ascontiguousarray(F), Q * scale, P * scale)


def filtered(rows: NoisyRows, design: Amplitudes, move: Transition, keep: bool = True) -> Innovations:
    """Return what the filter makes of all columns."""
    size, parts = (0.0,) * design.order, (by_components(part) for part in move)
    return Innovations(*run_filter(size, design.H, design.own, *parts, rows.loud, rows.fresh, rows.columns, keep))


def restricted(rows: NoisyRows, design: Amplitudes, move: Transition) -> tuple[float, float]:
    r"""Return the restricted log likelihood at the scale s^2 that suits best, up to a constant, and s^2.

    .. math::
        \log L = -\tfrac12 \Big( \nu \log s^2 + \sum_k \log S_k + \log |\tilde Z^T \tilde Z| \Big), \quad
        s^2 = \min_\beta |\tilde y - \tilde Z \beta|^2 / \nu

    with the tilde for innovations over the root of their variances S: the parameters are integrated out exactly.

    References
    ----------
    Patterson and Thompson, Biometrika 58 (1971), 545-554; de Jong, The likelihood for a state space model, Biometrika
    75 (1988), 165-169.
    """
    p = rows.columns.shape[1] - 1
    run = filtered(rows, design, move, keep=False)
    seen = run.variances < np.inf
    if not (np.isfinite(run.errors).all() and (run.variances > 0.0).all()):
        return -np.inf, np.nan
    S = run.variances[seen]
    triangle = np.abs(np.diag(np.linalg.qr(run.errors[seen] / np.sqrt(S)[:, None], mode="r")))
    degrees = len(S) - p
    s2 = float(triangle[p] ** 2 / degrees)
    with np.errstate(divide="ignore"):
        value = -0.5 * (degrees * np.log(s2) + np.sum(np.log(S))) - np.sum(np.log(triangle[:p]))
    return float(value), s2


def likeliest_process(
    left: FloatArray,
    Z: FloatArray,
    step_s: float,
    candidates: list[Amplitudes],
    trusted: NDArray[np.bool_],
    is_sudden: bool,
) -> LikeliestProcess:
    """Return the likeliest of some processes with its hyperparameters, those by the simplex of Nelder and Mead.

    Rows that are not trusted count as missing, those beyond four deviations less. Where forces are ``sudden``, as when
    a shaker is switched on, all begins anew at each row where that makes the record decisively likelier, outliers found
    anew with the start: a row that stands out alone, as one of a reversal does in a quiet record, is no start.
    """
    n = len(left)
    size = np.sqrt(np.mean(Z**2, axis=0))
    unit = float(np.sqrt(np.mean(left[trusted] ** 2))) or 1.0
    columns = np.ascontiguousarray(np.column_stack((Z[:, size > 0.0] / size[size > 0.0], left / unit)))
    found: list[LikeliestProcess] = []
    start = START
    for design in candidates:
        plain = NoisyRows(columns, np.where(trusted, 1.0, np.inf), np.zeros(n, dtype=np.bool_))
        place, _ = _climb(plain, design, step_s, start, EVALUATIONS)
        variances = transitions(design, step_s, place).P[:, 0, 0]
        design = design.up_to(max(1, int(design.harmonics[variances > SMALLEST_VARIANCE].max(initial=0))))
        rows = _with_outliers(plain, design, transitions(design, step_s, place))
        place, value = _climb(rows, design, step_s, place, REFINEMENTS)
        for _ in range(MOST_STARTS if is_sudden else 0):
            tried = _with_start(rows, design, transitions(design, step_s, place), step_s)
            there, _ = _climb(tried, design, step_s, place, REFINEMENTS)
            tried = _with_outliers(plain._replace(fresh=tried.fresh), design, transitions(design, step_s, there))
            there, then = _climb(tried, design, step_s, there, REFINEMENTS)
            if then < value + DECISIVE:
                break
            rows, place, value = tried, there, then
        move = transitions(design, step_s, place)
        s2 = restricted(rows, design, move)[1] * unit**2
        found.append(LikeliestProcess(design, move, rows.loud, rows.fresh, s2, value))
        start = place
    return max(found, key=lambda process: process.log_likelihood)


def _climb(
    rows: NoisyRows, design: Amplitudes, step_s: float, start: FloatArray, evaluations: int
) -> tuple[FloatArray, float]:
    """Return the likeliest place and its value."""
    from scipy.optimize import minimize

    waves = int(design.harmonics.max())
    free = np.array([waves > 0, waves > 0, waves > 1, True, True, design.grows.any()])

    def place(point: FloatArray) -> FloatArray:
        full = start.copy()
        full[free] = np.clip(point, LOWEST[free], HIGHEST[free])
        return full

    def loss(point: FloatArray) -> float:
        value = restricted(rows, design, transitions(design, step_s, place(point)))[0]
        return -value if np.isfinite(value) else 1e300

    corners = start[free] + np.vstack((np.zeros(free.sum()), np.eye(int(free.sum()))))
    options: Any = {"initial_simplex": corners, "maxfev": evaluations, "xatol": TOLERANCE, "fatol": TOLERANCE}
    found = minimize(loss, start[free], method="Nelder-Mead", options=options)
    return place(found.x), -float(found.fun)


def _with_start(rows: NoisyRows, design: Amplitudes, move: Transition, step_s: float) -> NoisyRows:
    """Return the rows with one more start, where it makes them likeliest."""
    n, far = len(rows.loud), max(1, round(AWAY_S / step_s))
    first = min(far, n - 1)
    fresh = rows.fresh.copy()
    fresh[first + int(np.argmax(start_values(rows, design, move)[first : max(n - far, first + 1)]))] = True
    return rows._replace(fresh=fresh)


def start_values(rows: NoisyRows, design: Amplitudes, move: Transition) -> FloatArray:
    r"""Return the restricted log likelihood (n,) with one more start at each row, as `restricted` has it at one.

    A start at row k splits the innovations: those before it are as without it, and the rows from k on are as likely
    forwards as backwards, where the process has the transition :math:`P F^T P^{-1} = F^T`, as P is a multiple of the
    unit matrix. So two runs of the filter, one in each direction, give the sums for all k at once.
    """
    count, p = len(rows.loud), rows.columns.shape[1] - 1
    F = np.ascontiguousarray(move.F.transpose(0, 2, 1))
    back = Transition(F, move.P - F @ move.P @ move.F, move.P)
    starts = np.zeros(count, dtype=np.bool_)
    starts[count - np.flatnonzero(rows.fresh[1:]) - 1] = True
    columns, loud, H = (np.ascontiguousarray(part[::-1]) for part in (rows.columns, rows.loud, design.H))
    before = _running_sums(filtered(rows, design, move, keep=False))
    after = _running_sums(filtered(NoisyRows(columns, loud, starts), design._replace(H=H), back, keep=False))
    products, logs = (ahead[:-1] + behind[:0:-1] for ahead, behind in zip(before, after, strict=True))
    degrees = int(np.sum(np.isfinite(rows.loud))) - p
    whole, parameters = (np.linalg.slogdet(products[:, :size, :size]) for size in (p + 1, p))
    values = -0.5 * (degrees * (whole[1] - parameters[1] - np.log(degrees)) + logs + parameters[1])
    return np.where((whole[0] > 0.0) & (parameters[0] > 0.0) & np.isfinite(values), values, -np.inf)


def _running_sums(run: Innovations) -> tuple[FloatArray, FloatArray]:
    """Return products of innovations over their variance, and its logarithms, summed over the first 0 ... n rows."""
    seen = run.variances < np.inf
    S = np.where(seen, run.variances, 1.0)
    white = np.where(seen[:, None], run.errors / np.sqrt(S)[:, None], 0.0)
    products = np.cumsum(white[:, :, None] * white[:, None, :], axis=0)
    return np.pad(products, ((1, 0), (0, 0), (0, 0))), np.append(0.0, np.cumsum(np.log(S)))


def _with_outliers(rows: NoisyRows, design: Amplitudes, move: Transition) -> NoisyRows:
    """Return the rows with those that stand out made louder."""
    run = filtered(rows, design, move, keep=False)
    seen = run.variances < np.inf
    white = run.errors[seen] / np.sqrt(run.variances[seen])[:, None]
    theta = np.linalg.lstsq(white[:, :-1], white[:, -1], rcond=None)[0]
    loud = rows.loud.copy()
    loud[seen] *= loudness(white[:, -1] - white[:, :-1] @ theta)
    return rows._replace(loud=loud)
