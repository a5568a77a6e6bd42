"""Structural mode: a mass on a spring that the table carries, such as machine base, column or fixture."""

import math
from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, LinearPart, Port, kernel, parameter
from fdbench.effects._functions import cos, exp, sin

TURN = 2.0 * math.pi
MODES_HZ = (10.0, 14.0, 20.0, 30.0, 42.0, 60.0, 85.0, 120.0, 170.0)


@final
@dataclass(frozen=True, kw_only=True)
class StructuralMode(Effect):
    r"""Appended mode: relative displacement q and absolute velocity p of a mass m at the table are internal states.

    .. math::
        \dot q = p - v, \qquad \dot p = -2 \zeta \omega (p - v) - \omega^2 q, \qquad F = m \dot p,
        \qquad \omega = 2 \pi f

    v: velocity of the table; f, zeta: natural frequency and damping ratio of the mass on a table that stands still. At
    constant v over a substep the mode is advanced exactly, and the force is its mean. Without damping the table stands
    still at f (antiresonance); far below, the mass rides along and adds to the table's.

    Source: Den Hartog (1956), Mechanical Vibrations, the dynamic absorber; Preumont (2018), Vibration Control of Active
    Structures, on antiresonances.

    Examples
    --------
    After one substep at 0.1 m/s an undamped mass of 5 kg has gained 5 kg * 0.1 m/s * (1 - cos(omega h)).

    >>> effect = StructuralMode.typical(moving_mass_kg=5.0, natural_frequency_Hz=100.0, damping_ratio=0.0)
    >>> force, slope, q, p = StructuralMode.kernel(0.0, 1e-3, 0.0, 0.1, 0.0, *effect.values(), 0.0, 0.0)
    >>> round(force * 1e-3, 9), round(0.5 * (1.0 - math.cos(0.2 * math.pi)), 9)
    (0.095491503, 0.095491503)
    """

    port = Port.TABLE_FORCE
    states = ("q", "p")
    amplitude = "moving_mass_kg"
    cause_type = "structure"
    confusable_with = ("axial_compliance", "inertia_mismatch")

    moving_mass_kg: float = parameter("m", low=0.0, high=60.0, typical=6.0)
    natural_frequency_Hz: float = parameter("f", low=1.0, high=2000.0, typical=60.0, grid=MODES_HZ, locate="resonance")
    damping_ratio: float = parameter("zeta", low=0.0, high=0.9, typical=0.03, grid=(0.03,))

    @kernel
    def kernel(t, h, x, v, u, m, f, zeta, q, p):
        omega = TURN * f
        sigma = zeta * omega
        omega_d = omega * math.sqrt(1.0 - zeta * zeta)
        decay = exp(-sigma * h)
        c = decay * cos(omega_d * h)
        s = decay * sin(omega_d * h) / omega_d
        r = p - v
        q_end = q * (c + sigma * s) + r * s
        r_end = r * (c - sigma * s) - q * omega * omega * s
        force = m * ((r_end - r) / h)
        return force, m * ((1.0 - (c - sigma * s)) / h), q_end, v + r_end

    @property
    def carried_mass_kg(self) -> float:
        return self.moving_mass_kg

    def linear_part(self) -> LinearPart:
        omega = TURN * self.natural_frequency_Hz
        damping = 2.0 * self.damping_ratio * omega
        numerator = damping * self.moving_mass_kg, omega**2 * self.moving_mass_kg, 0.0
        return LinearPart(numerator=numerator, denominator=(1.0, damping, omega**2))
