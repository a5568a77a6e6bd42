"""The friction that no parameter of a rigid model stands for: a curve of speed for each direction, beside its line."""

from typing import NamedTuple

import numpy as np

from fdbench.estimator import FloatArray

NODES = np.array([0.0, 0.1, 0.3, 0.6, 1.0])  # of the fastest speed


class LeftFriction(NamedTuple):
    r"""Columns :math:`H(v) - L(v) K` with hats H, lines :math:`L = (v, \operatorname{sign} v, 1)`, K = L^+ H.

    In the motion that they are made for the columns hold nothing that viscous, Coulomb and constant force could.

    Attributes
    ----------
    fastest_m_per_s : float
        Speed of the last node, beyond which hats stay as they are.
    line : (3, 2 n_nodes) array
        K.

    >>> velocity = np.sin(np.linspace(0.0, 6.0, 200))
    >>> columns = left_friction(velocity).columns(velocity)
    >>> bool(np.abs(columns.T @ lines(velocity)).max() < 1e-9)
    True
    """

    fastest_m_per_s: float
    line: FloatArray

    def columns(self, velocity: FloatArray) -> FloatArray:
        """Return the columns (n, 2 n_nodes) at velocities (n,), m/s."""
        return np.asarray(hats(velocity, self.fastest_m_per_s) - lines(velocity) @ self.line)


def left_friction(velocity: FloatArray) -> LeftFriction:
    """Return the columns that belong to a motion of velocities (n,), m/s."""
    fastest = float(np.max(np.abs(velocity)))
    return LeftFriction(fastest, np.linalg.pinv(lines(velocity)) @ hats(velocity, fastest))


def lines(velocity: FloatArray) -> FloatArray:
    """Return L (n, 3)."""
    return np.column_stack((velocity, np.sign(velocity), np.ones(len(velocity))))


def hats(velocity: FloatArray, fastest: float) -> FloatArray:
    """Return the weight of each node (n, 2 n_nodes), forward first.

    >>> hats(np.array([0.05, -1.0]), 1.0).round(1)
    array([[0.5, 0.5, 0. , 0. , 0. , 0. , 0. , 0. , 0. , 0. ],
           [0. , 0. , 0. , 0. , 0. , 0. , 0. , 0. , 0. , 1. ]])
    """
    speed = np.abs(velocity) / fastest
    weights = np.column_stack([np.interp(speed, NODES, node) for node in np.eye(len(NODES))])
    return np.hstack([weights * (direction * velocity > 0.0)[:, None] for direction in (1.0, -1.0)])
