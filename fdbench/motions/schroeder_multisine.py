"""Schroeder-phased multisine: a flat band of harmonics with a low peak, about a mean velocity."""

from dataclasses import dataclass
from typing import final

import numpy as np

from fdbench.motions._motion import Motion, Reference
from fdbench.specification import bounded, nonnegative, positive


@final
@dataclass(frozen=True, kw_only=True)
class SchroederMultisine(Motion):
    r"""Commanded velocity with equal power in each harmonic.

    .. math::
        v(t) = \bar v + s \sum_{k=1}^{N} \sqrt{p_k / 2}\, \cos(k \omega_0 t + \theta_k), \quad p_k = 1/N, \qquad
        \theta_k = \theta_1 - 2 \pi \sum_{j=1}^{k-1} \sum_{l=1}^{j} p_l = \theta_1 - \pi k (k - 1) / N

    v-bar: mean velocity; s: scale; N: number of harmonics; omega_0: fundamental; p_k: share of the power. The
    deviation's root mean square is s/2. The reference is the exact signal at any sampling time; position and
    acceleration are its integral, which starts at zero, and its derivative.

    Source: Schroeder (1970), IEEE Transactions on Information Theory 16; Turkay and Ulsoy (1988), eqs. (10) and (11),
    which do not state s.

    Examples
    --------
    One harmonic of 2 rad/s is a cosine of amplitude s/sqrt(2); over half a period it goes from peak to peak.

    >>> one = dict(harmonics=1, fundamental_rad_per_s=2.0, first_phase_rad=0.0)
    >>> motion = SchroederMultisine(mean_velocity_m_per_s=3.0, scale_m_per_s=2.0**0.5, **one)
    >>> motion.reference(np.pi / 2, 2)[:, 1].round(9).tolist()
    [4.0, 2.0]
    """

    mean_velocity_m_per_s: float = bounded(-100.0, 100.0)
    scale_m_per_s: float = nonnegative()
    harmonics: int = bounded(1, 1000)
    fundamental_rad_per_s: float = positive()
    first_phase_rad: float = bounded(-2.0 * np.pi, 2.0 * np.pi)

    def reference(self, period_s: float, n_samples: int) -> Reference:
        """Return the (n_samples, 3) reference."""
        k = np.arange(1, self.harmonics + 1)
        theta = self.first_phase_rad - np.pi * (k * (k - 1) % (2 * self.harmonics)) / self.harmonics
        omega = k * self.fundamental_rad_per_s
        amplitude = self.scale_m_per_s * np.sqrt(0.5 / self.harmonics)
        time_s = np.arange(n_samples, dtype=np.float64) * period_s
        phase = np.outer(time_s, omega) + theta
        sine, cosine = np.sin(phase), np.cos(phase)
        position = self.mean_velocity_m_per_s * time_s + amplitude * ((sine - np.sin(theta)) / omega).sum(axis=1)
        velocity = self.mean_velocity_m_per_s + amplitude * cosine.sum(axis=1)
        acceleration = -amplitude * (sine * omega).sum(axis=1)
        return np.column_stack((position, velocity, acceleration))
