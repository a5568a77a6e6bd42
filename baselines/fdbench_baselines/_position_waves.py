"""Waves over the position of a drive: their columns, and the pitch at which a record has one."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fdbench.estimator import FloatArray, Regression
from fdbench_baselines._slip import LARGEST_SLIP, POINTS_PER_LINE

FEWEST_PITCHES = 3.0  # that a way must hold
FEWEST_ROWS = 4.0  # in the pitch that is crossed fastest, where none is told
MOST_WAVENUMBERS = 10000
MULTIPLES = (1, 2, 3)  # of what stands out most, which may be a harmonic
DECISIVE = 10.0  # of a log likelihood
SHARE = 0.5  # of its own wave, that a half of the way must see in the wave of the other


class DrivenWay(NamedTuple):
    """Where the drive is in the middle of each row, and how far it moves in it; both (n,), in m."""

    middle_m: FloatArray
    moved_m: FloatArray

    @property
    def reach_m(self) -> float:
        """Length of the way, each place counted once."""
        return float(np.ptp(self.middle_m))


class WaveRows(NamedTuple):
    """What a wave is sought in: regressors (n, p), target (n,), roots of the rows' weights (n,), 0 where missing."""

    Z: FloatArray
    y: FloatArray
    weight: FloatArray


def way_of(regression: Regression) -> DrivenWay:
    r"""Return the way of a velocity loop from its first row, by the trapezoidal rule.

    .. math:: x_k = \sum_{l<k} T \bar v_l + \tfrac12 T \bar v_k, \qquad \bar v_k = \tfrac12 (v_k + v_{k+1})
    """
    moved = 0.5 * regression.sampling_time_s * (regression.regressors[:, 1] + regression.target)
    return DrivenWay(np.cumsum(moved) - 0.5 * moved, moved)


def wave_columns(way: DrivenWay, pitch_m: float, harmonics: int) -> FloatArray:
    r"""Return cosine and sine of each harmonic, (n, 2 H), as means over the row.

    .. math:: \operatorname{sinc}(h \Delta_k / p) \cos(2 \pi h x_k / p), \quad
              \operatorname{sinc}(h \Delta_k / p) \sin(2 \pi h x_k / p)

    with :math:`\operatorname{sinc} u = \sin(\pi u) / (\pi u)` and the way :math:`\Delta_k` of the row.

    >>> wave_columns(DrivenWay(np.array([0.0, 0.008]), np.array([0.0, 0.032])), 0.032, 1).round(9) + 0.0
    array([[1., 0.],
           [0., 0.]])
    """
    turns = way.middle_m[:, None] / pitch_m * np.arange(1, harmonics + 1)
    mean = np.sinc(way.moved_m[:, None] / pitch_m * np.arange(1, harmonics + 1))
    pairs = np.stack((mean * np.cos(2.0 * np.pi * turns), mean * np.sin(2.0 * np.pi * turns)), axis=2)
    return pairs.reshape(len(turns), 2 * harmonics)


def harmonics_within(way: DrivenWay, pitch_m: float, harmonics: int) -> int:
    """Return how many of the harmonics have two rows in each wave where the drive is fastest."""
    return min(harmonics, int(0.5 * pitch_m / max(float(np.abs(way.moved_m).max()), 1e-300)))


def found_pitch(rows: WaveRows, way: DrivenWay, harmonics: int, false_alarm: float) -> float | None:
    r"""Return the pitch of the wave that stands out of a record, or None where none does.

    .. math:: G(k) = -\tfrac{n}{2} \log (1 - \rho_k), \quad \max_k G > \log (K / \alpha)

    over K wavenumbers k, an eighth of a line apart, with :math:`\rho_k` the share of :math:`|y - Z \hat\beta|^2` that
    cosine and sine of :math:`2 \pi k x` explain beside Z. In white noise G is exponential, and a false alarm as likely
    as :math:`\alpha`. What stands out may be a harmonic: of its multiples the one whose H waves are decisively likelier
    is the pitch. One that the two halves of the way do not share is none; see `is_shared`.
    """
    fastest = float(np.abs(way.moved_m).max(initial=0.0))
    step = 1.0 / (POINTS_PER_LINE * way.reach_m) if way.reach_m > 0.0 else np.inf
    first, last = FEWEST_PITCHES * POINTS_PER_LINE * step, 1.0 / (FEWEST_ROWS * fastest) if fastest > 0.0 else 0.0
    if not first < last:
        return None
    wavenumbers = np.arange(first, last, step)[:MOST_WAVENUMBERS]
    gains = single_gains(rows, way, wavenumbers)
    best = int(np.argmax(gains))
    if gains[best] < np.log(len(wavenumbers) / false_alarm):
        return None
    found, gain = None, -np.inf
    for multiple in MULTIPLES:
        pitch_m = multiple / float(wavenumbers[best])
        if pitch_m * FEWEST_PITCHES > way.reach_m:
            break
        refined = refined_pitch(rows, way, pitch_m, harmonics, 1.0 / (multiple * way.reach_m))
        now = joint_gain(rows, way, refined, harmonics)
        if now > gain + (0.0 if found is None else DECISIVE):
            found, gain = refined, now
    return found if found is not None and is_shared(rows, way, found, harmonics) else None


def confirmed_pitch(rows: WaveRows, way: DrivenWay, told_m: float, harmonics: int, false_alarm: float) -> float | None:
    """Return the pitch within 1.5 % of the told one, or None where no wave of it stands out."""
    from scipy.stats import chi2

    width = LARGEST_SLIP / told_m
    pitch_m = refined_pitch(rows, way, told_m, harmonics, width)
    tried = 1.0 + 2.0 * POINTS_PER_LINE * width * way.reach_m
    count = 2 * harmonics_within(way, pitch_m, harmonics)
    is_chance = tried * float(chi2.sf(2.0 * joint_gain(rows, way, pitch_m, harmonics), count)) > false_alarm
    return None if is_chance or not is_shared(rows, way, pitch_m, harmonics) else pitch_m


def single_gains(rows: WaveRows, way: DrivenWay, wavenumbers: FloatArray) -> FloatArray:
    """Return G of a wave of one harmonic at each of some equally spaced wavenumbers; see `found_pitch`."""
    basis, left, n = _projected(rows)
    both = np.column_stack((basis, left)).T
    square, total = float(rows.weight @ rows.weight), float(left @ left)
    # The pointer of a place turns by the same angle from each wavenumber to the next.
    pointer = np.exp(2j * np.pi * wavenumbers[0] * way.middle_m) * rows.weight
    turn = np.exp(2j * np.pi * (wavenumbers[1] - wavenumbers[0]) * way.middle_m) if len(wavenumbers) > 1 else 1.0
    gains = np.zeros(len(wavenumbers))
    for i in range(len(wavenumbers)):
        seen, double = both @ pointer, complex(pointer @ pointer)
        own = 0.5 * np.array([[square + double.real, double.imag], [double.imag, square - double.real]])
        shared = np.column_stack((seen[:-1].real, seen[:-1].imag))
        across = np.array([seen[-1].real, seen[-1].imag])
        explained = float(across @ np.linalg.lstsq(own - shared.T @ shared, across, rcond=1e-9)[0])
        gains[i] = _gain(explained / total, n) if total > 0.0 else 0.0
        pointer = pointer * turn
    return gains


def refined_pitch(rows: WaveRows, way: DrivenWay, pitch_m: float, harmonics: int, width_per_m: float) -> float:
    """Return the pitch of largest joint gain whose wavenumber is within some width of that of another one."""
    from scipy.optimize import minimize_scalar

    def loss(wavenumber: float) -> float:
        return -joint_gain(rows, way, 1.0 / wavenumber, harmonics)

    points = 1 + 2 * int(np.ceil(0.5 * POINTS_PER_LINE * width_per_m * way.reach_m * harmonics))
    grid = 1.0 / pitch_m + np.linspace(-width_per_m, width_per_m, points)
    best = float(grid[int(np.argmin([loss(float(wavenumber)) for wavenumber in grid]))])
    apart = float(grid[1] - grid[0])
    found = minimize_scalar(
        loss, bounds=(best - apart, best + apart), method="bounded", options={"xatol": 1e-3 * apart}
    )
    return float(1.0 / found.x)


def joint_gain(rows: WaveRows, way: DrivenWay, pitch_m: float, harmonics: int) -> float:
    """Return the gain in log likelihood that all harmonics of a pitch bring together."""
    basis, left, n = _projected(rows)
    count = harmonics_within(way, pitch_m, harmonics)
    total = float(left @ left)
    if count == 0 or total == 0.0:
        return 0.0
    waves = wave_columns(way, pitch_m, count) * rows.weight[:, None]
    waves = waves - basis @ (basis.T @ waves)
    explained = float(left @ (waves @ np.linalg.lstsq(waves, left, rcond=None)[0]))
    return _gain(explained / total, n)


def is_shared(rows: WaveRows, way: DrivenWay, pitch_m: float, harmonics: int) -> bool:
    r"""Return whether the wave of either half of the way explains the other half at least half as well as its own.

    .. math:: 2 b_i^T \theta_j - \theta_j^T A_i \theta_j \ge \tfrac12 \, b_i^T \theta_i, \quad \theta_i = A_i^{-1} b_i

    A wave of time at one speed, or a force that wanders, has another one in each half.
    """
    driven = np.cumsum(np.abs(way.moved_m))
    count = harmonics_within(way, pitch_m, harmonics)
    if count == 0:
        return False
    waves = wave_columns(way, pitch_m, count)
    parts = []
    for half in (driven <= 0.5 * driven[-1], driven > 0.5 * driven[-1]):
        basis, left, _ = _projected(WaveRows(rows.Z[half], rows.y[half], rows.weight[half]))
        seen = waves[half] * rows.weight[half, None]
        seen = seen - basis @ (basis.T @ seen)
        parts.append((seen, left, np.linalg.lstsq(seen, left, rcond=None)[0]))
    for (seen, left, own), (_, _, other) in (parts, parts[::-1]):
        foreign = seen @ other
        if float(2.0 * left @ foreign - foreign @ foreign) < SHARE * float(left @ (seen @ own)):
            return False
    return True


def _projected(rows: WaveRows) -> tuple[FloatArray, FloatArray, int]:
    """Return a basis of the weighted regressors, what they leave of the target, and how many rows count."""
    basis = _basis(rows.Z * rows.weight[:, None])
    y = rows.y * rows.weight
    left = y - basis @ (basis.T @ y)
    # What is left of an exact record is rounding, whose waves are those of the processor.
    is_exact = float(np.linalg.norm(left)) <= len(y) * np.finfo(np.float64).eps * float(np.linalg.norm(y))
    return basis, np.zeros(len(y)) if is_exact else left, int(np.count_nonzero(rows.weight))


def _basis(columns: FloatArray) -> FloatArray:
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    kept: NDArray[np.bool_] = s > len(columns) * np.finfo(np.float64).eps * s.max(initial=0.0)
    return np.asarray(u[:, kept])


def _gain(share: float, n: int) -> float:
    return -0.5 * n * float(np.log1p(-min(max(share, 0.0), 1.0 - 1e-15)))
