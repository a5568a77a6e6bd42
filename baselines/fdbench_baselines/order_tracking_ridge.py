"""Force on a spindle by order tracking: a measured frequency response, smoothed over frequency and speed by ridge."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import RecordError, SpecError
from fdbench.estimator import BatchEstimator, Context, Estimate
from fdbench.plants.spindle_testbed import SpindleTestbed
from fdbench.record import Record
from fdbench.simulate.spectra import lines as spectral_lines
from fdbench_baselines._kernel_ridge import ComplexArray, FloatArray, Smoother, smoother

# Singular value, relative to the largest: an order above the band hardly shows in it.
SMALLEST = 1e-4
PASSES = 4
# Where the search for the kernel's widths starts: about a resonance's width, and a part of the highest speed.
START_HZ, START_SHARE = 4.0, 0.3


@final
class OrderTrackingRidge(BatchEstimator):
    r"""Size and angle of a pulse that repeats in each revolution, from the orders of the vibration.

    .. math:: F_m = A \, c_m e^{j m \theta_0}, \quad
              (v_m - \beta q_m) e^{-j m \theta_0} = A \, c_m H(m \Omega, \Omega) + u_m(\Omega) + \varepsilon

    At order m of the spindle's speed :math:`\Omega` (rad/s): F force, N; v vibration a, m/s^2; q that of
    :math:`a |a|`, m^2/s^4. The shape c of the pulse (:math:`c_1 = 1`), the frequency response H (1/kg), the vibration
    u without force (m/s^2) and :math:`\beta` (s^2/m) are learnt from segments whose force was measured; A (N) and the
    angle :math:`\theta_0` (rad) of each segment at its trigger, which may be anywhere, are all that is left to find:

    1. Least squares of a segment's lines on :math:`e^{j m \Omega t}` gives its orders.
    2. c and the training segments' A, :math:`\theta_0` alternate, a few times.
    3. A line over A at each order of each learnt speed has the slope :math:`c_m H` and the intercept :math:`u_m`.
    4. :math:`H / \omega^2` over frequency and speed, and each :math:`u_m` over speed, are smoothed and interpolated by
       kernel ridge regression with a Gaussian kernel, whose widths and ridge have the largest marginal likelihood.
    5. A withheld segment gets the A and :math:`\theta_0` of least squares over its orders.

    The inverse of H is thus never regressed on lines that other speeds excite: at a new speed only H and u are
    interpolated, at frequencies that other orders of other speeds have met.

    Speeds are those of the plant's plan; its table ``machine`` is not looked at. Valid for a force whose shape over the
    revolution is everywhere the same, for constant speed, and for a record of the whole plan.

    Parameters
    ----------
    harmonics : int
        Orders of the vibration that are used, at least 1.

    Raises
    ------
    SpecError
        If ``harmonics`` is below 1 or the plant is no spindle testbed.
    RecordError
        If the record is not that of the plan, or fewer than three speeds have three measured segments of forces that
        differ.

    References
    ----------
    Qu and Vogl (2021), Estimating dynamic cutting forces of machine tools from measured vibrations using sparse
    regression with nonlinear function basis, sections 4.2 and 6, which ask for an L2 regulariser and physics; Fyfe and
    Munck (1997), Mech. Syst. Signal Process. 11, for order tracking; Rasmussen and Williams (2006), Gaussian Processes
    for Machine Learning, section 2.2 and eq. 5.8, for the ridge. The combination is ours.

    Examples
    --------
    At the speed that is withheld, 14 Hz, five orders of 100, 200 and 300 N are below 80 Hz; at the trigger they add up.

    >>> from fdbench_baselines._example import example_testbed
    >>> OrderTrackingRidge().fit(*example_testbed()).disturbance_N[::100].round().tolist()
    [500.0, 1000.0, 1500.0]
    """

    made_for: ClassVar[tuple[str, ...] | None] = ("inverse_frequency_response",)

    def __init__(self, harmonics: int = 15) -> None:
        if harmonics < 1:
            raise SpecError(f"harmonics: {harmonics}; at least 1 is needed.")
        self.harmonics = harmonics

    def skip(self, context: Context) -> str | None:
        """Skip where speeds are unknown."""
        return None if isinstance(context.plant, SpindleTestbed) else "the plant has no plan of speeds"

    def fit(self, context: Context, record: Record) -> Estimate:
        """Learn shape, response and unbalance; then find size and angle of each withheld pulse."""
        if not isinstance(context.plant, SpindleTestbed):
            raise SpecError(f"{context.model}: {self.skip(context)}.")
        tracked = track(context.plant, record)
        shape = learn_shape(tracked)
        response, unbalance, curvature = learn_response(tracked, shape, self.harmonics)
        spectra = context.plant.spectra(record)
        estimated = np.zeros_like(spectra.targets)
        for speed in tracked:
            withheld = ~speed.training
            n = min(len(unbalance), len(speed.frequencies_Hz))
            if not withheld.any():
                continue
            at = np.column_stack((speed.frequencies_Hz[:n], np.full(n, speed.share)))
            gain = shape[:n] * response(at) * at[:, 0] ** 2
            offset = np.array([smooth(at[:1, 1:])[0] for smooth in unbalance[:n]])
            orders = (speed.vibration - curvature * speed.squared)[withheld, :n]
            size, angle = locate(orders, gain, offset)
            force = size[:, None] * shape * np.exp(1j * np.outer(angle, np.arange(1, len(shape) + 1)))
            for part, rows, number in zip(parts(force), speed.segments[withheld], speed.places[withheld], strict=True):
                estimated[rows] = speed.basis[number] @ part
        return Estimate(disturbance_N=spectra.signals(estimated[~spectra.training]).ravel())


@dataclass(frozen=True, kw_only=True, eq=False)
class Speed:
    """Segments of one speed: force, vibration a and a |a| at each order, and what turns orders into lines.

    Attributes
    ----------
    share : float
        Of the highest speed.
    frequencies_Hz : (n_orders,) array
    segments, places : (n,) arrays of int
        Number of the segment in the record, and in its condition.
    training : (n,) array of bool
    force, vibration, squared : (n, n_orders) arrays
    basis : (n_places, 2 n_lines, 2 n_all_orders) array
    """

    share: float
    frequencies_Hz: FloatArray
    segments: NDArray[np.intp]
    places: NDArray[np.intp]
    training: NDArray[np.bool_]
    force: ComplexArray
    vibration: ComplexArray
    squared: ComplexArray
    basis: FloatArray


def track(plant: SpindleTestbed, record: Record) -> list[Speed]:
    """Return the orders of all segments, speed by speed."""
    plan, spectra = plant.plan(record.sampling_time_s), plant.spectra(record)
    shape = len(plan.speeds_rad_per_s), len(plan.levels_N), plan.segments_per_condition
    if len(spectra.training) != np.prod(shape):
        raise RecordError(
            f"{record.source}: {len(spectra.training)} segments; the plan, which knows their speeds, has "
            f"{np.prod(shape)}."
        )
    vibration = spectra.signals(spectra.features)
    squared = spectral_lines(vibration * np.abs(vibration), plan.n_lines)
    length_s = plan.samples_per_segment * record.sampling_time_s
    band_Hz, rotations_Hz = plan.n_lines / length_s, plan.speeds_rad_per_s / (2.0 * np.pi)
    n_all = int(band_Hz / rotations_Hz[0])
    places = np.tile(np.arange(shape[2]), shape[1])
    tracked = []
    for rotation_Hz, segments in zip(rotations_Hz, np.arange(np.prod(shape)).reshape(shape[0], -1), strict=True):
        n = int(band_Hz / rotation_Hz)
        basis = np.array(
            [lines_of_orders(rotation_Hz, n_all, plan.n_lines, length_s, k * length_s) for k in range(shape[2])]
        )
        # One order above the band leaks into it and is fitted, but not used.
        columns = np.r_[: min(n + 1, n_all), n_all : n_all + min(n + 1, n_all)]
        inverses = np.linalg.pinv(basis[:, :, columns], SMALLEST)[places]
        force, orders, squares = (
            np.einsum("sol,sl->so", inverses, rows[segments]) for rows in (spectra.targets, spectra.features, squared)
        )
        tracked.append(
            Speed(
                share=float(rotation_Hz / rotations_Hz[-1]),
                frequencies_Hz=rotation_Hz * np.arange(1, n + 1),
                segments=segments,
                places=places,
                training=spectra.training[segments],
                force=amplitudes(force)[:, :n],
                vibration=amplitudes(orders)[:, :n],
                squared=amplitudes(squares)[:, :n],
                basis=basis,
            )
        )
    return tracked


def lines_of_orders(rotation_Hz: float, n_orders: int, n_lines: int, length_s: float, start_s: float) -> FloatArray:
    """Return the lines (2 n_lines, 2 n_orders) of Re(a exp(2 pi j m f t)) from ``start_s`` on, for parts of a.

    >>> lines_of_orders(2.0, 1, 2, 0.5, 0.0).round(12) + 0.0
    array([[1., 0.],
           [0., 0.],
           [0., 1.],
           [0., 0.]])
    """
    orders = rotation_Hz * np.arange(1, n_orders + 1)
    lines_Hz = np.arange(1, n_lines + 1)[:, None] / length_s

    def mean(frequency_Hz: FloatArray) -> ComplexArray:
        return np.asarray(np.exp(1j * np.pi * frequency_Hz * length_s) * np.sinc(frequency_Hz * length_s))

    turned = np.exp(2j * np.pi * orders * start_s)
    ahead, back = mean(orders - lines_Hz) * turned, mean(-orders - lines_Hz) * turned.conj()
    complex_lines = np.hstack((ahead + back, 1j * (ahead - back)))
    return np.vstack((complex_lines.real, complex_lines.imag))


def amplitudes(rows: FloatArray) -> ComplexArray:
    """Return complex amplitudes (n, m) of rows (n, 2 m) with the real parts first."""
    n = rows.shape[1] // 2
    return np.asarray(rows[:, :n] + 1j * rows[:, n:])


def parts(orders: ComplexArray) -> FloatArray:
    """Return the rows whose `amplitudes` these are."""
    return np.hstack((orders.real, orders.imag))


def locate(orders: ComplexArray, gain: ComplexArray, offset: ComplexArray) -> tuple[FloatArray, FloatArray]:
    r"""Return sizes A >= 0 and angles of least squares of :math:`v_m e^{-j m \theta} = A g_m + u_m`, for rows of v.

    The best A is known for each angle; the angle is the best of a grid, moved to the top of a parabola.

    >>> m = np.arange(1, 6)
    >>> size, angle = locate(np.exp(0.3j * m) * (2.0 / m + 0.1)[None, :], 1.0 / m + 0j, np.full(5, 0.1 + 0j))
    >>> np.round([size[0], angle[0]], 2)
    array([2. , 0.3])
    """
    m = np.arange(1, orders.shape[1] + 1)
    power, constant = float(np.sum(np.abs(gain) ** 2)), float(np.sum((offset * gain.conj()).real))
    n = 64 * len(m)
    grid = 2.0 * np.pi / n * np.arange(n)
    turns = np.exp(-1j * np.outer(m, grid))
    sizes = np.maximum(((orders * gain.conj()) @ turns).real - constant, 0.0) / power
    gained = 2.0 * ((orders * offset.conj()) @ turns).real + sizes**2 * power
    rows, best = np.arange(len(orders)), np.argmax(gained, axis=1)
    left, top, right = (gained[rows, (best + k) % n] for k in (-1, 0, 1))
    curvature = 2.0 * top - left - right
    shift = np.divide(0.5 * (right - left), curvature, out=np.zeros_like(top), where=curvature > 0.0)
    angle = grid[best] + shift * (2.0 * np.pi / n)
    turned = orders * np.exp(-1j * np.outer(angle, m))
    return np.maximum((turned @ gain.conj()).real - constant, 0.0) / power, angle


def learn_shape(tracked: list[Speed]) -> ComplexArray:
    """Return c of the measured forces, with c_1 = 1; orders beyond the band of all learnt speeds are zero."""
    learnt = [speed for speed in tracked if speed.training.any()]
    n = len(tracked[0].frequencies_Hz)
    shape = np.ones(1, dtype=np.complex128)
    for _ in range(PASSES):
        total, weight = np.zeros(n, dtype=np.complex128), np.zeros(n)
        for speed in learnt:
            force = speed.force[speed.training]
            known = min(len(shape), force.shape[1])
            size, angle = locate(force[:, :known], shape[:known], np.zeros(known, dtype=np.complex128))
            m = np.arange(1, force.shape[1] + 1)
            total[: len(m)] += size @ (force * np.exp(-1j * np.outer(angle, m)))
            weight[: len(m)] += np.sum(size**2)
        shape = np.divide(total, weight, out=np.zeros_like(total), where=weight > 0.0)
        shape *= np.exp(-1j * np.angle(shape[0]) * np.arange(1, n + 1)) / np.abs(shape[0])
    return shape


def learn_response(tracked: list[Speed], shape: ComplexArray, harmonics: int) -> tuple[Smoother, list[Smoother], float]:
    """Return H / f^2 over frequency and share of speed, each u_m over the share, and beta."""
    fits = []
    for speed in tracked:
        training = speed.training
        if not training.any():
            continue
        n = min(harmonics, len(speed.frequencies_Hz))
        all_orders = speed.force.shape[1]
        zero = np.zeros(all_orders, dtype=np.complex128)
        size, angle = locate(speed.force[training], shape[:all_orders], zero)
        if np.count_nonzero(training) < 3 or np.ptp(size) <= 0.1 * np.max(size):
            continue
        turn = np.exp(-1j * np.outer(angle, np.arange(1, n + 1)))
        line = np.column_stack((size, np.ones_like(size)))
        inverse = np.linalg.pinv(line)
        fits.append((speed, n, line, inverse, *(y[training, :n] * turn for y in (speed.vibration, speed.squared))))
    if len(fits) < 3:
        raise RecordError(
            f"{len(fits)} speeds have three measured segments of forces that differ; at least 3 are needed."
        )
    along = [(v - line @ (inverse @ v), q - line @ (inverse @ q)) for _, _, line, inverse, v, q in fits]
    curvature = float(
        sum(np.sum((q.conj() * v).real) for v, q in along) / sum(np.sum(np.abs(q) ** 2) for _, q in along)
    )
    at, response, unbalance, spreads = [], [], [], []
    for speed, n, _, inverse, v, q in fits:
        slope, intercept = inverse @ (v - curvature * q)
        variance = np.sum(inverse**2, axis=1)
        gain = shape[:n] * speed.frequencies_Hz[:n] ** 2
        at.append(np.column_stack((np.arange(n), speed.frequencies_Hz[:n], np.full(n, speed.share))))
        response.append(slope / gain)
        unbalance.append(intercept)
        spreads.append(np.column_stack((variance[0] / np.abs(gain) ** 2, np.full(n, variance[1]))))
    points, offset, spread = np.vstack(at), np.concatenate(unbalance), np.vstack(spreads)
    smooth = smoother(points[:, 1:], np.concatenate(response), spread[:, 0], np.array([START_HZ, START_SHARE]))
    own = [points[:, 0] == m for m in range(max(n for _, n, *_ in fits))]
    start = np.array([START_SHARE])
    return smooth, [smoother(points[rows, 2:], offset[rows], spread[rows, 1], start) for rows in own], curvature
