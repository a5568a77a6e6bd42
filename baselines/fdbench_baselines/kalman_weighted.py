"""Distributed Kalman filter with weighted averaging (DKFWA): nodes average their neighbours' estimates once."""

from typing import NamedTuple, final

import numpy as np

from fdbench_baselines._kalman_filter import FloatArray
from fdbench_baselines._kalman_kernels import run_joint
from fdbench_baselines._sensor_fusion import FusionFilter, Network


class Design(NamedTuple):
    """Steady joint filter x <- F x + L y of all nodes, and the covariance of their errors after the exchange."""

    F: FloatArray
    L: FloatArray
    P: FloatArray


def alternate(net: Network, sweeps: int, ridge: float) -> Design:
    r"""Return gains and weights by turns: each the best for the other's covariance of the last sweep.

    .. math::
        P^1 = (I \; \tilde K) \Phi (I \; \tilde K)^T, \quad
        \Phi = \begin{pmatrix} I \\ -\tilde H \end{pmatrix} P^- \begin{pmatrix} I \\ -\tilde H \end{pmatrix}^T
             + \begin{pmatrix} 0 & 0 \\ 0 & R \end{pmatrix}, \quad P^+ = W P^1 W^T

    P is that of the errors of all nodes side by side; all of them feel the same process noise. K_i is the Kalman gain
    for the block of node i; the weights of node i, which add up to I, are the best unbiased ones for the neighbours'
    differences to it, with a ridge, as nodes may know the same.
    """
    nodes, n = net.C.shape
    A, Q = np.kron(np.eye(nodes), net.A), np.kron(np.ones((nodes, nodes)), net.Q)
    before = np.kron(np.ones((nodes, nodes)), net.P)
    eye = np.eye(nodes * n)
    block = [slice(i * n, (i + 1) * n) for i in range(nodes)]
    H, K, W = np.zeros((nodes, nodes * n)), np.zeros((nodes * n, nodes)), eye.copy()
    for i in range(nodes):
        H[i, block[i]] = net.C[i]
    for _ in range(sweeps):
        for i, c in enumerate(net.C):
            c_P = before[block[i], block[i]] @ c
            K[block[i], i] = c_P / (c @ c_P + net.R[i])
        rest = eye - K @ H
        P = rest @ before @ rest.T + K * net.R @ K.T
        for i in range(nodes):
            others = [block[j] for j in range(nodes) if j != i and net.heard[i, j]]
            if others:
                difference = np.vstack([eye[other] - eye[block[i]] for other in others])
                own = P[block[i]] @ difference.T
                joint = difference @ P @ difference.T + ridge * np.eye(len(difference))
                W[block[i]] = eye[block[i]] - np.linalg.solve(joint, own.T).T @ difference
        P = W @ P @ W.T
        before = A @ P @ A.T + Q
        before = 0.5 * (before + before.T)
    return Design(W @ rest @ A, W @ K, P)


@final
class KalmanWeighted(FusionFilter):
    r"""Each node filters its own reading with a fixed gain and averages its neighbours' estimates with fixed weights.

    .. math::
        x_i^1 = x_i^- + K_i (z_i - H_i x_i^-), \qquad x_i^+ = \sum_{j \in N_i} W_{ij} x_j^1, \qquad
        \sum_j W_{ij} = I, \; W_{ij} = 0 \text{ for } j \notin N_i

    Gains and weights are found before the run, for the smallest covariance of all nodes. Only estimates are told, once.

    Parameters
    ----------
    q_N2_per_s, initial_force_N, node
        See `FusionFilter`.
    sweeps : int
        Turns of gains and weights; 600 of them settle at 0.1 ms.
    ridge : float
        Added to the covariance of the differences, in scaled states; above 0.

    Raises
    ------
    SpecError
        If an argument is out of bounds or the joint filter is not stable.

    References
    ----------
    Alriksson, Rantzer, Distributed Kalman filtering using weighted averaging, 17th MTNS (2006); Salehi, thesis, 2013,
    eqs. (5.35) to (5.47), where (5.42) lacks an expectation and (5.43) a transpose.
    """

    def __init__(
        self,
        q_N2_per_s: float = 1e5,
        initial_force_N: float = 100.0,
        node: int | None = None,
        sweeps: int = 600,
        ridge: float = 1e-7,
    ) -> None:
        super().__init__(q_N2_per_s, initial_force_N, node)
        self.require(sweeps >= 1, f"sweeps = {sweeps!r} must be 1 or more")
        self.require(ridge > 0.0, f"ridge = {ridge!r} must be above 0")
        self.sweeps, self.ridge = sweeps, ridge

    def claims(self, net: Network, y: FloatArray) -> tuple[FloatArray, FloatArray | None]:
        """Return the force of each node and its steady variance."""
        design = alternate(net, self.sweeps, self.ridge)
        radius = float(np.abs(np.linalg.eigvals(design.F)).max())
        self.require(radius < 1.0, f"the joint filter is not stable, its spectral radius is {radius:.6f}; raise ridge")
        n = len(net.A)
        forces = run_joint(design.F, design.L, n, y)
        return forces, np.broadcast_to(np.diag(design.P)[n - 1 :: n], forces.shape)
