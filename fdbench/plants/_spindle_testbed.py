"""Spindle testbed as it is simulated: pulses of force on a rotating tool holder, and the housing's vibration."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fdbench.errors import SpecError
from fdbench.plants._spectra import lines, signals
from fdbench.plants._spindle_plan import Plan, Withheld
from fdbench.simulate.random import stream
from fdbench.simulate.system import FloatArray, Setup, System
from fdbench.specification import bounded, check_bounds, nonnegative, positive

TWO_PI = 2.0 * np.pi
FULL_WIDTH = 2.355  # at half maximum, in standard deviations of a Gaussian


@final
@dataclass(frozen=True, kw_only=True)
class Mode:
    r"""Mode of the housing, softened and damped by the speed.

    .. math:: f = f_0 (1 + \Delta_f \Omega/\Omega_{max}), \quad \zeta = \zeta_0 (1 + \Delta_\zeta \Omega/\Omega_{max})
    """

    frequency_Hz: float = positive()
    damping_ratio: float = positive()
    mass_kg: float = positive()
    frequency_change: float = bounded(-0.99, 10.0)
    damping_change: float = bounded(-0.99, 10.0)

    def __post_init__(self) -> None:
        check_bounds(self)


@final
@dataclass(frozen=True, kw_only=True)
class Unbalance:
    r"""Vibration without force, :math:`a (\Omega/\Omega_{max})^p \cos(o \theta + \varphi)`."""

    order: float = positive()
    acceleration_m_per_s2: float = nonnegative()
    speed_exponent: float = nonnegative()
    phase_rad: float = bounded(-TWO_PI, TWO_PI)

    def __post_init__(self) -> None:
        check_bounds(self)


@final
@dataclass(frozen=True, kw_only=True)
class Machine:
    r"""Force and vibration at a constant speed.

    .. math::
        F(t) = A \sum_{m=1}^{M} c_m \cos m\theta, \quad c_m = \sigma \sqrt{2/\pi}\, e^{-(m \sigma)^2 / 2}, \quad
        \theta = \Omega t + \theta_0

    a Gaussian pulse of height A and standard deviation :math:`\sigma` rad in each revolution, without its mean. With
    the modes' accelerance :math:`H = \sum_i -\omega^2 / m_i (\omega_i^2 - \omega^2 + 2 j \zeta_i \omega_i \omega)`,

    .. math::
        a_1 = \left( A \sum_m \mathrm{Re}\, c_m H(m \Omega) e^{j m \theta} + \textrm{unbalance} \right)
              (1 + d \cos(o_c \theta + \varphi_c)), \quad a = a_1 (1 + |a_1| / a_{nl})

    Parameters
    ----------
    pulse_width_rad : float
        Full width of the pulse at half its height.
    harmonics : int
        Largest M.
    highest_frequency_Hz : float
        Largest frequency of a harmonic.
    modes, unbalance : tuple
    cage_depth, cage_order : float
        d and o_c, modulation by the bearing's cage; its phase differs from condition to condition.
    nonlinear_acceleration_m_per_s2 : float
        a_nl, acceleration at which the nonlinear part is as large as the linear one.
    angle_jitter_rad, force_deviation : float
        Standard deviations over the conditions: of theta_0, where the trigger starts, and of A relative to its level.
    """

    pulse_width_rad: float = positive()
    harmonics: int = bounded(1, 10000)
    highest_frequency_Hz: float = positive()
    modes: tuple[Mode, ...]
    unbalance: tuple[Unbalance, ...] = ()
    cage_depth: float = bounded(0.0, 1.0)
    cage_order: float = positive()
    nonlinear_acceleration_m_per_s2: float = positive()
    angle_jitter_rad: float = nonnegative()
    force_deviation: float = bounded(0.0, 0.2)

    def __post_init__(self) -> None:
        check_bounds(self)

    def pulse(self, frequency_Hz: float) -> FloatArray:
        """Return c_1 ... c_M of a pulse of unit height at a rotation frequency."""
        n = max(1, min(self.harmonics, int(self.highest_frequency_Hz / frequency_Hz)))
        sigma = self.pulse_width_rad / FULL_WIDTH
        m = np.arange(1.0, n + 1.0)
        c: FloatArray = sigma * math.sqrt(2.0 / np.pi) * np.exp(-0.5 * (m * sigma) ** 2)
        return c

    def accelerance(self, omega: FloatArray, share: float) -> NDArray[np.complex128]:
        """Return H at angular frequencies (n,), 1/kg, at a share of the highest speed."""
        total = np.zeros(len(omega), dtype=np.complex128)
        for mode in self.modes:
            natural = TWO_PI * mode.frequency_Hz * (1.0 + mode.frequency_change * share)
            damping = mode.damping_ratio * (1.0 + mode.damping_change * share)
            total -= omega**2 / (mode.mass_kg * (natural**2 - omega**2 + 2j * damping * natural * omega))
        return total

    def condition(
        self, speed: float, share: float, level: float, angle: float, cage_angle: float, step_s: float, n: int
    ) -> FloatArray:
        """Return force (N) and acceleration (m/s^2) of one operating condition, (2, n), free of noise."""
        c = level * self.pulse(speed / TWO_PI)
        m = np.arange(1.0, len(c) + 1.0)
        turned = c * np.exp(1j * m * angle)
        force, acceleration = harmonic_sums(
            np.stack((turned, turned * self.accelerance(m * speed, share))), speed * step_s, n
        )
        theta = angle + speed * step_s * np.arange(n)
        for part in self.unbalance:
            size = part.acceleration_m_per_s2 * share**part.speed_exponent
            acceleration += size * np.cos(part.order * theta + part.phase_rad)
        acceleration *= 1.0 + self.cage_depth * np.cos(self.cage_order * theta + cage_angle)
        acceleration *= 1.0 + np.abs(acceleration) / self.nonlinear_acceleration_m_per_s2
        return np.stack((force, acceleration))


def harmonic_sums(coefficients: NDArray[np.complex128], step: float, n: int) -> FloatArray:
    """Return the real parts of sum_m c_m exp(j m step k) for k = 0 ... n - 1 and each row (n_rows, M) of c.

    k = i B + j splits every exponential into a factor of i and one of j, so that 2 sqrt(n) M are needed, not n M.

    >>> np.round(harmonic_sums(np.array([[1.0, 2.0 + 0.0j]]), np.pi / 2, 4), 12)
    array([[ 3., -2.,  1., -2.]])
    """
    block = math.isqrt(n - 1) + 1
    m = np.arange(1, coefficients.shape[1] + 1)
    coarse = coefficients[:, None, :] * np.exp(1j * (step * block) * np.outer(np.arange(block), m))
    fine = np.exp(1j * step * np.outer(m, np.arange(block)))
    sums = np.zeros((len(coefficients), block, block))
    # A product of matrices, but with the same bits for any number of threads.
    add_products(coarse.real.copy(), coarse.imag.copy(), fine.real.copy(), fine.imag.copy(), sums)
    return np.ascontiguousarray(sums.reshape(len(coefficients), -1)[:, :n])


@njit(cache=True, error_model="numpy")
def add_products(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray, out: FloatArray) -> None:
    """Add a c - b d to ``out``, (n_rows, n, n), for a and b (n_rows, n, M), c and d (M, n)."""
    for row in range(out.shape[0]):
        for i in range(out.shape[1]):
            for m in range(c.shape[0]):
                x, y = a[row, i, m], b[row, i, m]
                for j in range(out.shape[2]):
                    out[row, i, j] += x * c[m, j] - y * d[m, j]


class _Lane:
    """One run through the plan: its random numbers, its place, and the condition that it is in."""

    def __init__(self, machine: Machine, plan: Plan, withheld: Withheld, seed: int) -> None:
        n = plan.shape[0] * plan.shape[1]
        self.withheld = withheld.mask(plan, stream(seed, "withheld_segments")).reshape(n, -1)
        self.force_factor = 1.0 + machine.force_deviation * stream(seed, "force_level").standard_normal(n)
        self.angle = machine.angle_jitter_rad * stream(seed, "trigger_angle").standard_normal(n)
        self.cage_angle = stream(seed, "cage_angle").uniform(0.0, TWO_PI, n)
        self.noise = stream(seed, "force_noise"), stream(seed, "acceleration_noise")
        self.place = 0
        self.rows = np.empty((0, 0))
        self.diverged = False


class SpindleTestbedSystem(System):
    """Lanes of one testbed that go through the plan, condition by condition.

    An action is read at the first sample of a condition, when the gap of the magnets is set, and holds for all of it.
    Signals are acquired every substep; what is logged is each segment's part within the plan's lines, so that the
    logged samples have exactly the spectrum of the acquired ones.

    Parameters
    ----------
    machine : Machine
    plan : Plan
    withheld : Withheld
    limits : pair of float
        Ranges of the force sensor, N, and of the accelerometer, m/s^2.
    setup : Setup
    n_lanes : int
    """

    action_name = "force_level_N"
    columns = ("acceleration_m_per_s2", "force_N", "training_sample")
    truth_columns = ("disturbance_N", "diverged")

    def __init__(
        self,
        machine: Machine,
        plan: Plan,
        withheld: Withheld,
        limits: tuple[float, float],
        setup: Setup,
        n_lanes: int = 1,
    ) -> None:
        timing = setup.timing
        self.n_lanes, self.n_samples = n_lanes, timing.n_samples
        self.commanded = {
            "spindle_speed_rad_per_s": np.repeat(
                plan.speeds_rad_per_s, len(plan.levels_N) * plan.samples_per_condition
            ),
            "reference_acceleration_m_per_s2": np.zeros(self.n_samples),
        }
        self.limits = {
            "spindle_speed_rad_per_s": float(np.max(plan.speeds_rad_per_s)),
            "reference_acceleration_m_per_s2": limits[1],
            "acceleration_m_per_s2": limits[1],
            "force_N": limits[0],
            "training_sample": 1.0,
        }
        self.at_rest = np.zeros(len(self.columns))
        self._machine, self._plan, self._withheld = machine, plan, withheld
        self._step_s = timing.sampling_time_s / timing.substeps
        self._acquired = plan.samples_per_segment * timing.substeps
        self._noise = np.array([setup.noise.force_N, setup.noise.acceleration_m_per_s2])
        self._lanes: dict[int, _Lane] = {}

    def start(self, seeds: Sequence[int], lanes: NDArray[np.intp] | None = None) -> None:
        """Put lanes back to the first condition and draw their random numbers; see `System.start`."""
        chosen = np.arange(self.n_lanes) if lanes is None else lanes
        if len(seeds) != len(chosen):
            raise SpecError(f"seeds: {len(chosen)} are expected, one for each lane, found {len(seeds)}.")
        for lane, seed in zip(chosen.tolist(), seeds, strict=True):
            self._lanes[lane] = _Lane(self._machine, self._plan, self._withheld, seed)

    def advance(self, n_samples: int, action: FloatArray | None = None) -> FloatArray:
        """Advance all lanes; see `System.advance`."""
        out = np.empty((n_samples, len(self.columns) + len(self.truth_columns), self.n_lanes))
        length = self._plan.samples_per_condition
        for number in range(self.n_lanes):
            if number not in self._lanes:
                raise SpecError("advance: the lanes have not been started.")
            lane = self._lanes[number]
            if lane.place + n_samples > self.n_samples:
                raise SpecError(f"advance: the episode ends after {self.n_samples} samples; start the lanes again.")
            deviation = 0.0 if action is None else float(action[number])
            done = 0
            while done < n_samples:
                condition, first = divmod(lane.place, length)
                if first == 0:
                    lane.rows = self._condition(lane, condition, deviation)
                taken = min(length - first, n_samples - done)
                out[done : done + taken, :, number] = lane.rows[first : first + taken]
                lane.place += taken
                done += taken
                lane.diverged = bool(lane.rows[first + taken - 1, -1])
        return out

    def _condition(self, lane: _Lane, number: int, deviation: float) -> FloatArray:
        """Return all rows of one condition, (samples_per_condition, n_columns + n_truth_columns)."""
        plan, machine = self._plan, self._machine
        speed_number, level_number = divmod(number, len(plan.levels_N))
        speed = float(plan.speeds_rad_per_s[speed_number])
        level = float(plan.levels_N[level_number]) + deviation
        acquired = machine.condition(
            speed,
            speed / float(np.max(plan.speeds_rad_per_s)),
            level * float(lane.force_factor[number]),
            float(lane.angle[number]),
            float(lane.cage_angle[number]),
            self._step_s,
            plan.segments_per_condition * self._acquired,
        )
        clean = lines(acquired.reshape(2, plan.segments_per_condition, self._acquired), plan.n_lines)
        # White noise of deviation s in each of N samples has s sqrt(2/N) in each part of each line.
        share = self._noise * math.sqrt(2.0 / plan.samples_per_segment)
        noise = np.stack([generator.standard_normal(clean.shape[1:]) for generator in lane.noise])
        truth = signals(clean[0], plan.samples_per_segment)
        force, acceleration = signals(clean + share[:, None, None] * noise, plan.samples_per_segment)
        acceleration = acceleration.ravel()
        measured = np.repeat(~lane.withheld[number], plan.samples_per_segment)
        outside = (np.abs(acceleration) > self.limits["acceleration_m_per_s2"]) | (
            not 0.0 <= level <= self.limits["force_N"]
        )
        rows = np.empty((plan.samples_per_condition, len(self.columns) + len(self.truth_columns)))
        rows[:, 0] = acceleration
        rows[:, 1] = np.where(measured, force.ravel(), 0.0)
        rows[:, 2] = measured
        rows[:, 3] = truth.ravel()
        rows[:, 4] = np.logical_or.accumulate(outside) | lane.diverged
        return rows

    @property
    def diverged(self) -> NDArray[np.bool_]:
        """Which lanes asked for a force level, or had a vibration, outside the ranges of the sensors."""
        flags = [number in self._lanes and self._lanes[number].diverged for number in range(self.n_lanes)]
        return np.array(flags, dtype=np.bool_)
