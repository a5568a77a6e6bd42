"""Shaker force: a sinusoid of constant or sweeping amplitude that starts and stops."""

import math
from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, Port, kernel, parameter
from fdbench.effects._functions import cos, sin

PI, TURN = math.pi, 2.0 * math.pi


@final
@dataclass(frozen=True, kw_only=True)
class ShakerForce(Effect):
    r"""Electrodynamic shaker mounted on the table.

    .. math::
        F(t) = A\, e(t) \cos(2 \pi (f t + \tfrac12 r t^2) + \varphi), \quad t_0 < t < t_1, \qquad
        e(t) = 1 - d + d \sin\frac{\pi (t - t_0)}{t_1 - t_0}

    The frequency drifts at the rate r, 0 for a steady one. The sweep depth d is 0 for constant amplitude and 1 for an
    amplitude that rises from zero and falls back.

    Source: McPherson (2024), case study 1 (55 Hz, constant and sweeping amplitude).

    Examples
    --------
    >>> effect = ShakerForce.typical(force_amplitude_N=10.0, frequency_Hz=50.0, start_s=0.0, stop_s=1.0)
    >>> force, slope = ShakerForce.kernel(0.02, 1e-4, 0.0, 0.0, 0.0, *effect.values())
    >>> round(force, 9), ShakerForce.kernel(2.0, 1e-4, 0.0, 0.0, 0.0, *effect.values())
    (10.0, (0.0, 0.0))
    """

    port = Port.TABLE_FORCE
    amplitude = "force_amplitude_N"
    confusable_with = ("periodic_force",)
    same_signal_as = "periodic_force"
    disturbance = True

    force_amplitude_N: float = parameter("A", low=0.0, high=5000.0, typical=20.0)
    frequency_Hz: float = parameter("f", low=0.1, high=2000.0, typical=55.0, locate="line")
    start_s: float = parameter("t_0", low=0.0, high=1e6, typical=0.0)
    stop_s: float = parameter("t_1", low=0.0, high=1e6, typical=1e6)
    sweep_depth: float = parameter("d", low=0.0, high=1.0, typical=0.0)
    phase_rad: float = parameter("phi", low=-TURN, high=TURN, typical=0.0, default=0.0, phase=True)
    frequency_drift_Hz_per_s: float = parameter("r", low=-10.0, high=10.0, typical=0.0, default=0.0)

    @kernel
    def kernel(t, h, x, v, u, A, f, t_0, t_1, d, phi, r):
        running = t_0 < t < t_1
        phase = (t - t_0) / (t_1 - t_0) if running else 0.0
        envelope = 1.0 - d + d * sin(PI * phase)
        turns = f * t + 0.5 * r * t * t
        force = A * envelope * cos(TURN * (turns - math.floor(turns)) + phi)
        return (force if running else 0.0), 0.0
