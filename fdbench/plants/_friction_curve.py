"""The straight line that a rigid model sees in the friction of its effects at speed."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from fdbench.effects import Effect, Port

SETTLING_STEPS, SETTLING_STEP_S = 200, 1e-2
ROUNDING = 1e-12


@dataclass(frozen=True, kw_only=True)
class FrictionLine:
    """F = viscous v + coulomb + offset for v > 0, F = viscous v - coulomb + offset for v < 0."""

    viscous_N_s_per_m: float
    coulomb_N: float
    offset_N: float


def steady_force(effect: Effect, velocity: float) -> float:
    """Return the force of an effect (N) after its internal states have settled at a constant velocity."""
    states = [0.0] * len(effect.states)
    force = 0.0
    for _ in range(SETTLING_STEPS if states else 1):
        force, _slope, *states = type(effect).kernel.py_func(
            0.0, SETTLING_STEP_S, 0.0, velocity, 0.0, *effect.values(), *states
        )
    return force


@lru_cache(maxsize=256)
def friction_line(effects: tuple[Effect, ...], velocity_limit: float, viscous: float) -> FrictionLine:
    """Fit the line through the steady forces at half and full speed in both directions."""
    velocities = np.array([0.5, 1.0, -0.5, -1.0]) * velocity_limit
    forces = np.zeros(4)
    for effect in effects:
        if effect.port in (Port.MOTOR_FORCE, Port.TABLE_FORCE) and not effect.disturbance:
            forces += [steady_force(effect, velocity) for velocity in velocities]
    design = np.column_stack((velocities, np.sign(velocities), np.ones(4)))
    slope, coulomb, offset = np.linalg.lstsq(design, forces, rcond=None)[0]
    largest = float(np.max(np.abs(forces), initial=0.0))
    slope, coulomb, offset = (value if abs(value) > ROUNDING * largest else 0.0 for value in (slope, coulomb, offset))
    return FrictionLine(viscous_N_s_per_m=viscous + slope, coulomb_N=float(coulomb), offset_N=float(offset))
