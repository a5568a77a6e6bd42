"""Rows of a drive's linear model on which its nominal friction is the straight line that the model takes it for."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fdbench.effects import Effect, Port
from fdbench.estimator import Context, FloatArray
from fdbench.plants import Plant
from fdbench.plants._friction_curve import friction_line, steady_force

VELOCITIES = {"velocity_loop": (1,), "inverse_dynamics": (1,), "directional_inverse_dynamics": (1, 3)}
DIRECTIONS = {"inverse_dynamics": (2,), "directional_inverse_dynamics": (2, 4)}
BENT = 1e-3  # of the Coulomb force, by which the curve may be off the line
SLOWEST, SPEEDS = 1e-4, 40  # of the velocity limit, and how many are tried
REVERSING = 0.9  # a filtered sign of the velocity below this is that of a reversal


def straight(context: Context, regressors: FloatArray) -> NDArray[np.bool_]:
    r"""Return which rows (n,) lie on the straight part of the nominal friction: not slow, not within a reversal.

    .. math:: |v| \ge v_0, \qquad |F(v) - B v - F_c \operatorname{sign} v - F_0| \le 10^{-3} F_c
              \;\text{ for all } |v| \ge v_0

    Below :math:`v_0` Stribeck's and presliding friction rule, of which mass and line know nothing. Each row is judged
    by itself, so that a stream can be.

    >>> from fdbench.scenario import load_scenario
    >>> context = load_scenario("BallScrewAxis-v1").context()
    >>> straight(context, np.array([[0.0, 0.05, 1.0, 1.0], [0.0, 0.002, 1.0, 1.0], [0.0, 0.05, 0.5, 1.0]]))
    array([ True, False, False])
    """
    velocity = regressors[:, VELOCITIES[context.model]].sum(axis=1)
    kept = np.abs(velocity) >= straight_from(context.plant)
    if context.model in DIRECTIONS:
        kept &= np.abs(regressors[:, DIRECTIONS[context.model]].sum(axis=1)) >= REVERSING
    return np.asarray(kept)


def force_left(context: Context, regressors: FloatArray, residual: FloatArray) -> FloatArray:
    """Return what is left (n,), 0 where it is rather the friction of a reversal, smeared by the filters of the rows."""
    return np.where(straight(context, regressors), residual, 0.0) if context.model in DIRECTIONS else residual


@lru_cache(maxsize=16)
def straight_from(plant: Plant) -> float:
    """Return the speed (m/s) from which nominal friction is a straight line; 0 where it has no other part."""
    effects: tuple[Effect, ...] = getattr(plant, "effects", ())
    sources = tuple(e for e in effects if e.port in (Port.MOTOR_FORCE, Port.TABLE_FORCE) and not e.disturbance)
    limit: float | None = getattr(plant, "velocity_limit_m_per_s", None)
    if not sources or limit is None:
        return 0.0
    line = friction_line(sources, limit, 0.0)
    speeds = limit * np.geomspace(SLOWEST, 1.0, SPEEDS)
    for place in range(SPEEDS - 1, -1, -1):
        for direction in (1.0, -1.0):
            v = direction * float(speeds[place])
            on_line = line.viscous_N_s_per_m * v + direction * line.coulomb_N + line.offset_N
            if abs(sum(steady_force(source, v) for source in sources) - on_line) > BENT * abs(line.coulomb_N):
                return float(speeds[min(place + 1, SPEEDS - 1)])
    return 0.0
