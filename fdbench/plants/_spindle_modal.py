"""Modes that one force excites, and their state-space form."""

from dataclasses import dataclass
from typing import final

import numpy as np

from fdbench.simulate.system import FloatArray
from fdbench.specification import bounded, check_bounds, positive

TWO_PI = 2.0 * np.pi


@final
@dataclass(frozen=True, kw_only=True)
class ComplianceMode:
    r"""One mode of a compliance, :math:`\alpha / (s^2 + 2 \zeta \omega s + \omega^2)`.

    As states it has the displacement and the velocity over omega, both in m:

    .. math::
        \dot x = \begin{pmatrix} 0 & \omega \\ -\omega & -2 \zeta \omega \end{pmatrix} x
                 + \begin{pmatrix} 0 \\ \alpha / \omega \end{pmatrix} F

    Parameters
    ----------
    frequency_Hz : float
        :math:`\omega / 2 \pi`.
    damping_ratio : float
        :math:`\zeta`.
    modal_gain_per_kg : float
        :math:`\alpha`.
    """

    frequency_Hz: float = positive()
    damping_ratio: float = bounded(0.0, 1.0)
    modal_gain_per_kg: float = bounded(-1e9, 1e9)

    def __post_init__(self) -> None:
        check_bounds(self)

    @property
    def angular_frequency_rad_per_s(self) -> float:
        """The frequency in rad/s."""
        return TWO_PI * self.frequency_Hz

    @property
    def compliance_m_per_N(self) -> float:
        """Static compliance."""
        return self.modal_gain_per_kg / self.angular_frequency_rad_per_s**2

    @property
    def pair(self) -> FloatArray:
        """The state matrix and, as third column, the input of the force; (2, 3)."""
        w = self.angular_frequency_rad_per_s
        return np.array([[0.0, w, 0.0], [-w, -2.0 * self.damping_ratio * w, self.modal_gain_per_kg / w]])


def joined(pairs: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the state matrix (2 n, 2 n) and the force input (2 n,) of pairs of states, (n, 2, 3)."""
    n = len(pairs)
    A = np.zeros((2 * n, 2 * n))
    for index, pair in enumerate(pairs):
        A[2 * index : 2 * index + 2, 2 * index : 2 * index + 2] = pair[:, :2]
    return A, pairs[:, :, 2].ravel()
