"""Friction columns of a velocity loop's model that follow the nominal curve, where the model has a dead band."""

from functools import lru_cache

import numpy as np

from fdbench.effects import Effect, Port
from fdbench.estimator import Context, FloatArray
from fdbench.plants import Plant
from fdbench.plants._friction_curve import friction_line, steady_force
from fdbench_baselines._drive_least_squares import LOOP

SLOWEST, SPEEDS = 1e-4, 200  # of the velocity limit, and how many are tabulated


def curved(context: Context, Z: FloatArray) -> FloatArray:
    r"""Return the regressors (n, p) with friction as large as the nominal curve has it at each row's velocity.

    .. math:: -s^+ \to -\max(0, \phi(v)), \quad s^- \to \max(0, -\phi(v)), \qquad \phi = (F(v) - B v - F_0) / F_c

    with the line :math:`B v + F_c \operatorname{sign} v + F_0` that the curve F is at speed. Below 1 mm/s the model has
    no friction, and what it misses there would be taken for force. Unchanged where friction has memory, which no
    curve tells.

    >>> from fdbench.scenario import load_scenario
    >>> context = load_scenario("ShakerConstant-v2").context()
    >>> curved(context, np.array([[0.0, 0.0005, 0.0, 0.0], [0.0, -0.05, 0.0, 1.0]]))[:, 2:].round(3).tolist()
    [[-0.462, 0.0], [-0.0, 1.0]]
    """
    table = friction_shares(context.plant) if context.model == LOOP and Z.shape[1] == 4 else None
    if table is None:
        return Z
    share = np.interp(Z[:, 1], *table)
    return np.column_stack((Z[:, :2], -np.maximum(share, 0.0), np.maximum(-share, 0.0)))


@lru_cache(maxsize=16)
def friction_shares(plant: Plant) -> tuple[FloatArray, FloatArray] | None:
    """Return velocities and phi at them; None where friction has states or no Coulomb part."""
    effects: tuple[Effect, ...] = getattr(plant, "effects", ())
    sources = tuple(e for e in effects if e.port in (Port.MOTOR_FORCE, Port.TABLE_FORCE) and not e.disturbance)
    limit: float | None = getattr(plant, "velocity_limit_m_per_s", None)
    if limit is None or any(source.states for source in sources):
        return None
    line = friction_line(sources, limit, 0.0)
    if line.coulomb_N <= 0.0:
        return None
    speeds = limit * np.geomspace(SLOWEST, 1.0, SPEEDS)
    velocity = np.concatenate((-speeds[::-1], [0.0], speeds))
    force = np.array([sum(steady_force(source, float(v)) for source in sources) for v in velocity])
    return velocity, (force - line.viscous_N_s_per_m * velocity - line.offset_N) / line.coulomb_N
