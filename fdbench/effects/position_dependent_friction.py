"""Position-dependent friction: guideway, wiper or nut run harder at some places."""

import math
from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, Port, kernel, parameter
from fdbench.effects._functions import sin, tanh

TURN = 2.0 * math.pi


@final
@dataclass(frozen=True, kw_only=True)
class PositionDependentFriction(Effect):
    r"""Coulomb friction that swings about its mean along the travel, the same in both directions.

    .. math:: F(x, v) = a \sin(2 \pi x / L + \varphi) \tanh(v / v_0)

    x: position of the table. Validity: a below the nominal Coulomb force, or the guideway would push.

    Source: Armstrong-Helouvry (1991), Control of Machines with Friction; one harmonic is our choice.

    Examples
    --------
    A quarter of the period from the origin, moving backwards.

    >>> effect = PositionDependentFriction.typical(friction_amplitude_N=20.0, period_m=0.1, phase_rad=0.0)
    >>> PositionDependentFriction.kernel(0.0, 1e-4, 0.025, -0.1, 0.0, *effect.values())
    (-20.0, 200.0)
    """

    port = Port.TABLE_FORCE
    amplitude = "friction_amplitude_N"
    cause_type = "friction_over_position"
    everywhere = True
    confusable_with = ("stribeck_friction", "friction_drift")

    friction_amplitude_N: float = parameter("a", low=0.0, high=1000.0, typical=24.0)
    period_m: float = parameter("L", low=5e-3, high=5.0, typical=0.1, locate="wavelength")
    phase_rad: float = parameter("phi", low=-TURN, high=TURN, typical=0.0, phase=True)
    transition_velocity_m_per_s: float = parameter("v_0", low=1e-4, high=0.05, typical=1e-3)

    @kernel
    def kernel(t, h, x, v, u, a, L, phi, v_0):
        level = a * sin(TURN * (x / L) + phi)
        force = level * tanh(v / v_0)
        slope = force / v if abs(v) > 1e-9 * v_0 else level / v_0
        return force, max(slope, 0.0)
