"""The friction that a simulation with the curves on paper leaves: another curve, of speed, for each direction."""

from typing import NamedTuple

import numpy as np

from fdbench.estimator import FloatArray

NODES = np.array([0.0, 0.1, 0.3, 0.6, 1.0])  # of the fastest speed


class LeftFriction(NamedTuple):
    """Force (N) at the nodes, (2, n_nodes), forward and back, and the speed (m/s) of the last one."""

    force: FloatArray
    fastest: float

    def at(self, velocity: FloatArray) -> FloatArray:
        """Return the force (n,) at velocities (n,), m/s; beyond the last node that of the last node."""
        return np.asarray(hats(velocity, self.fastest) @ self.force.ravel())


def hats(velocity: FloatArray, fastest: float) -> FloatArray:
    """Return the weight of each node, (n, 2 n_nodes), forward first.

    >>> hats(np.array([0.05, -1.0]), 1.0).round(1)
    array([[0.5, 0.5, 0. , 0. , 0. , 0. , 0. , 0. , 0. , 0. ],
           [0. , 0. , 0. , 0. , 0. , 0. , 0. , 0. , 0. , 1. ]])
    """
    speed = np.abs(velocity) / fastest
    weights = np.column_stack([np.interp(speed, NODES, node) for node in np.eye(len(NODES))])
    return np.hstack([weights * (direction * velocity > 0.0)[:, None] for direction in (1.0, -1.0)])


def left_friction(velocity: FloatArray, left: FloatArray, deviation_N: float, variance: float) -> LeftFriction:
    r"""Return the curve that most likely made what is left.

    .. math:: \hat c = \arg\min |r - H(v) c|^2 / \sigma^2 + |c|^2 / s^2

    Parameters
    ----------
    velocity, left : (n,) arrays
        v, m/s, and r, N.
    deviation_N : float
        s, of the force at each node beforehand.
    variance : float
        :math:`\sigma^2`, N^2, for each row as if rows were independent.
    """
    fastest = float(np.max(np.abs(velocity)))
    H = hats(velocity, fastest)
    ridge = variance / deviation_N**2 * np.eye(H.shape[1])
    return LeftFriction(np.linalg.solve(H.T @ H + ridge, H.T @ left).reshape(2, -1), fastest)
