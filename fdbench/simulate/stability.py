"""What keeps a simulation stable: substeps that resolve the springs of effects, and a control loop that is stable."""

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fdbench.effects import Effect, Port
from fdbench.errors import SpecError, UnstableLoop
from fdbench.record import FloatArray
from fdbench.units import time_text

PROBE_STEP_S, PROBE_VELOCITY_M_PER_S = 1e-7, 1e-6
PROBE_SPACING_M, PROBE_COUNT = 1e-5, 400
STABLE = 1.0 + 1e-6  # an integrator's pole at 1, found with rounding errors; slower growth does not show in a record
FACTORS = np.geomspace(1.0, 1e4, 400)  # gains that are tried for a margin


@lru_cache(maxsize=1024)
def stiffness(effect: Effect) -> float:
    """Return the largest stiffness (N/m) with which a force effect answers a small displacement.

    A internal state is probed by one short step at a small velocity, a force that depends on position by differences
    along 4 mm.
    """
    kernel, values = type(effect).kernel.py_func, effect.values()
    states = [0.0] * len(effect.states)

    def force(position: float, velocity: float, states: list[float]) -> tuple[float, list[float]]:
        result = kernel(0.0, PROBE_STEP_S, position, velocity, 0.0, *values, *states)
        return float(result[0]), list(result[2:])

    at_rest, _ = force(0.0, 0.0, states)
    _, moved = force(0.0, PROBE_VELOCITY_M_PER_S, states)
    internal = abs(force(0.0, 0.0, moved)[0] - at_rest) / (PROBE_STEP_S * PROBE_VELOCITY_M_PER_S) if states else 0.0
    along = [force(index * PROBE_SPACING_M, 0.0, states)[0] for index in range(PROBE_COUNT)]
    return internal + max(abs(b - a) for a, b in pairwise(along)) / PROBE_SPACING_M


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


def spectral_radius(A: FloatArray) -> float:
    """Return the largest magnitude of an eigenvalue of a matrix (n, n); inf where it is not finite."""
    return math.inf if not np.isfinite(A).all() else float(np.abs(np.linalg.eigvals(A)).max())


def is_stable(A: FloatArray) -> bool:
    """Return whether x_{k+1} = A x_k stays bounded."""
    return spectral_radius(A) <= STABLE


def gain_margin(A: FloatArray, B: FloatArray, C: FloatArray) -> float:
    r"""Return the gain nearest to 1 by which a sampled loop changes between stable and unstable; inf if none does.

    .. math:: x_{k+1} = (A - \kappa\, b\, c)\, x_k

    is tried at gains :math:`\kappa` of up to 10^4 and bisected; for an unstable loop gains below 1 come first.
    Unlike a crossing of the phase it is found at half the sampling rate too. Source: Astrom, Wittenmark (1997),
    Computer-Controlled Systems, section 3.3.

    Parameters
    ----------
    A, B, C : (n, n), (n,), (n,) arrays
        The open loop, without direct feedthrough; its feedback is negative.

    Examples
    --------
    L = 0.8 / (z - 0.9) has its pole at -1 with the gain (1 + 0.9) / 0.8.

    >>> gain_margin(np.array([[0.9]]), np.array([0.8]), np.array([1.0]))
    2.375
    """

    def stable(gain: float) -> bool:
        return is_stable(A - gain * np.outer(B, C))

    at_one = stable(1.0)
    for inward in (False, True) if at_one else (True, False):
        last = 1.0
        for gain in (1.0 / FACTORS if inward else FACTORS)[1:]:
            if stable(float(gain)) != at_one:
                low, high = last, float(gain)
                while abs(high - low) > 1e-9 * high:
                    middle = math.sqrt(low * high)
                    low, high = (middle, high) if stable(middle) == at_one else (low, middle)
                return high
            last = float(gain)
    return math.inf


def check_finite(name: str, *matrices: NDArray[np.inexact]) -> None:
    """Raise a SpecError that begins with a name where a matrix of a machine holds what is no finite number."""
    if not all(np.isfinite(matrix).all() for matrix in matrices):
        raise SpecError(f"{name}: the values of this machine are too large or too small to compute with.")


def check_loop(A: FloatArray, B: FloatArray, C: FloatArray, period_s: float) -> None:
    """Raise an UnstableLoop where the control loop A - B C of a nominal plant is unstable; it says by how much.

    Parameters
    ----------
    A, B, C : (n, n), (n,), (n,) arrays
        The loop, broken at the motor's force, without direct feedthrough; its feedback is negative.
    period_s : float
        Sampling time.
    """
    closed = A - np.outer(B, C)
    check_finite("plant", closed)
    if is_stable(closed):
        return
    poles = np.linalg.eigvals(closed)
    worst = poles[np.abs(poles).argmax()]
    radius, frequency_Hz = float(np.abs(worst)), abs(float(np.angle(worst))) / (2.0 * math.pi * period_s)
    margin = gain_margin(A, B, C)
    known = margin < math.inf
    mend = f"With all gains times {margin:.3g} it is just stable" if known else "No gain makes it stable"
    raise UnstableLoop(
        f"plant.controller: the loop is unstable at a sampling time of {time_text(period_s)}: spectral radius "
        f"{radius:.4g}, of a pole at {frequency_Hz:.3g} Hz. {mend}"
        f"{f' (gain margin {20.0 * math.log10(margin):.3g} dB)' if known else ''}; `fdbench show` draws it."
    )
