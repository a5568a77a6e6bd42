"""The largest substep at which the integrator resolves the springs that effects bring with them."""

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise

from fdbench.effects import Effect, Port
from fdbench.errors import SpecError
from fdbench.units import time_text

PROBE_STEP_S, PROBE_VELOCITY_M_PER_S = 1e-7, 1e-6
PROBE_SPACING_M, PROBE_COUNT = 1e-5, 400


@lru_cache(maxsize=1024)
def stiffness(effect: Effect) -> float:
    """Return the largest stiffness (N/m) with which a force effect answers a small displacement.

    A hidden state is probed by one short step at a small velocity, a force that depends on position by differences
    along 4 mm.
    """
    kernel, values = type(effect).kernel.py_func, effect.values()
    states = [0.0] * len(effect.states)

    def force(position: float, velocity: float, states: list[float]) -> tuple[float, list[float]]:
        result = kernel(0.0, PROBE_STEP_S, position, velocity, 0.0, *values, *states)
        return float(result[0]), list(result[2:])

    at_rest, _ = force(0.0, 0.0, states)
    _, moved = force(0.0, PROBE_VELOCITY_M_PER_S, states)
    hidden = abs(force(0.0, 0.0, moved)[0] - at_rest) / (PROBE_STEP_S * PROBE_VELOCITY_M_PER_S) if states else 0.0
    along = [force(index * PROBE_SPACING_M, 0.0, states)[0] for index in range(PROBE_COUNT)]
    return hidden + max(abs(b - a) for a, b in pairwise(along)) / PROBE_SPACING_M


def needed_substeps(effects: Sequence[Effect], mass_of: dict[Port, float], period_s: float) -> int:
    """Return how many substeps a sampling time needs at least for `check_substep` to pass."""
    needed = 1
    for port, mass in mass_of.items():
        total = sum(stiffness(effect) for effect in effects if effect.port is port)
        needed = max(needed, math.ceil(period_s * math.sqrt(total / mass)))
    return needed


def check_substep(effects: Sequence[Effect], mass_of: dict[Port, float], period_s: float, substeps: int) -> None:
    """Raise a SpecError where a substep is longer than 1/omega of the stiffest effect spring against its mass.

    The integrator stays bounded beyond that, but no longer follows the motion.
    """
    h = period_s / substeps
    for port, mass in mass_of.items():
        total = sum(stiffness(effect) for effect in effects if effect.port is port)
        largest = math.sqrt(mass / total) if total > 0.0 else math.inf
        if h > largest:
            raise SpecError(
                f"timing.substeps: {substeps} substeps of {time_text(h)} are too coarse for {total:.3g} N/m of effect "
                f"stiffness against {mass:.3g} kg; the largest stable substep is {time_text(largest)}, so at least "
                f"{math.ceil(period_s / largest)} substeps are needed."
            )
