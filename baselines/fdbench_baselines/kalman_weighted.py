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


def root(covariance: FloatArray) -> FloatArray:
    """Return S with S S^T a covariance, which may be singular; eigenvalues that rounding took below zero are zero."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)), dtype=np.float64)


def alternate(net: Network, sweeps: int, ridge: float) -> Design:
    r"""Return gains and weights by turns: each the best for the other's covariance of the last sweep.

    .. math::
        P^1 = (I \; \tilde K) \Phi (I \; \tilde K)^T, \quad
        \Phi = \begin{pmatrix} I \\ -\tilde H \end{pmatrix} P^- \begin{pmatrix} I \\ -\tilde H \end{pmatrix}^T
             + \begin{pmatrix} 0 & 0 \\ 0 & R \end{pmatrix}, \quad P^+ = W P^1 W^T

    P is that of the errors of all nodes side by side; all of them feel the same process noise. K_i is the Kalman gain
    for the block of node i; the weights of node i, which add up to I, are the best unbiased ones for the neighbours'
    differences to it, with a ridge, as nodes may know the same.

    Nodes that hear each other differ by their readings alone, so the covariance of their differences has few ranks, and
    a ridge is lost beside what the nodes do not know yet. Hence covariances are kept as square roots S S^T: the
    differences D S = U s V^T of node i have the weights :math:`S_i V \, \mathrm{diag}(s / (s^2 + ridge)) \, U^T`.
    """
    nodes, n = net.C.shape
    eye = np.eye(nodes * n)
    block = [slice(i * n, (i + 1) * n) for i in range(nodes)]
    others = [[j for j in range(nodes) if j != i and net.heard[i, j]] for i in range(nodes)]
    A, noise = np.kron(np.eye(nodes), net.A), np.tile(root(net.Q), (nodes, 1))
    before = np.tile(root(net.P), (nodes, 1))
    H, K, W = np.zeros((nodes, nodes * n)), np.zeros((nodes * n, nodes)), eye.copy()
    for i in range(nodes):
        H[i, block[i]] = net.C[i]
    for _ in range(sweeps):
        for i, c in enumerate(net.C):
            seen = c @ before[block[i]]
            K[block[i], i] = before[block[i]] @ seen / (seen @ seen + net.R[i])
        rest = eye - K @ H
        S = np.hstack((rest @ before, K * np.sqrt(net.R)))
        for i in range(nodes):
            if others[i]:
                difference = np.vstack([eye[block[j]] - eye[block[i]] for j in others[i]])
                U, s, V = np.linalg.svd(difference @ S, full_matrices=False)
                weights = (S[block[i]] @ V.T * (s / (s**2 + ridge))) @ U.T
                W[block[i]] = eye[block[i]] - weights @ difference
        S = W @ S
        _, triangle = np.linalg.qr(np.hstack((A @ S, noise)).T)
        before = triangle.T
    return Design(W @ rest @ A, W @ K, S @ S.T)


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

    Examples
    --------
    A constant force on a spindle and a drive, read without noise for 0.2 s.

    >>> from fdbench_baselines._example import example_network
    >>> filtered = KalmanWeighted(sweeps=200, ridge=1e-3).fit(*example_network(force_N=10.0))
    >>> round(float(filtered.disturbance_N[-1]), 3)
    10.0
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
