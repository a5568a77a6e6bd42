"""Force and vibration of a spindle testbed at a constant speed, free of noise."""

import math
from dataclasses import dataclass
from typing import final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fdbench.compilation import kept
from fdbench.specification import bounded, check_bounds, nonnegative, positive

FloatArray = NDArray[np.float64]

TWO_PI = 2.0 * np.pi
FULL_WIDTH = 2.355  # at half maximum, in standard deviations of a Gaussian


@final
@dataclass(frozen=True, kw_only=True)
class HousingMode:
    r"""HousingMode of the housing, softened and damped by the speed.

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
class SpindleTestbedMachine:
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
    modes: tuple[HousingMode, ...]
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


@kept
@njit(error_model="numpy")
def add_products(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray, out: FloatArray) -> None:
    """Add a c - b d to ``out``, (n_rows, n, n), for a and b (n_rows, n, M), c and d (M, n)."""
    for row in range(out.shape[0]):
        for i in range(out.shape[1]):
            for m in range(c.shape[0]):
                x, y = a[row, i, m], b[row, i, m]
                for j in range(out.shape[2]):
                    out[row, i, j] += x * c[m, j] - y * d[m, j]
