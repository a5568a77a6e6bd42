"""Distributed Kalman filter with consensus (DKFCF): neighbours draw their estimates together, again and again."""

from typing import final

from fdbench_baselines._kalman_filter import FloatArray
from fdbench_baselines._kalman_kernels import run_nodes
from fdbench_baselines._sensor_fusion import FusionFilter, Network


@final
class KalmanConsensus(FusionFilter):
    r"""The distributed information filter, and after every reading S exchanges between neighbours.

    .. math:: x_i \leftarrow x_i + \gamma \sum_{j \in N_i} (x_j - x_i), \quad 0 < \gamma < 1 / \max_i |N_i \setminus i|

    The covariances stay as they are, so they no longer say how good an estimate is. Exchanges draw all nodes together,
    towards their mean and not towards the best.

    Parameters
    ----------
    q_N2_per_s, initial_force_N, node
        See `FusionFilter`.
    gamma : float
        Weight of a neighbour.
    exchanges : int
        S, at least 0.

    References
    ----------
    Salehi, thesis, 2013, eqs. (5.28) to (5.34), where the sum runs over the node in place of its neighbours, after
    Olfati-Saber, Distributed Kalman filtering and sensor fusion in sensor networks, Lecture Notes in Control and
    Information Sciences 331 (2006).

    Examples
    --------
    A constant force on a spindle and a drive, read without noise for 0.2 s.

    >>> from fdbench_baselines._example import example_network
    >>> round(float(KalmanConsensus().fit(*example_network(force_N=10.0)).disturbance_N[-1]), 6)
    10.0
    """

    def __init__(
        self,
        q_N2_per_s: float = 1e5,
        initial_force_N: float = 100.0,
        node: int | None = None,
        gamma: float = 0.3,
        exchanges: int = 5,
    ) -> None:
        super().__init__(q_N2_per_s, initial_force_N, node)
        self.require(gamma > 0.0, f"gamma = {gamma!r} must be above 0")
        self.require(exchanges >= 0, f"exchanges = {exchanges!r} must be 0 or more")
        self.gamma, self.exchanges = gamma, exchanges

    def claims(self, net: Network, y: FloatArray) -> tuple[FloatArray, FloatArray | None]:
        """Return the force of each node, without variance."""
        degree = int(net.heard.sum(axis=1).max()) - 1
        self.require(self.gamma * degree < 1.0, f"gamma = {self.gamma:g} must be below 1/{degree}, or nodes overshoot")
        forces, _ = run_nodes(net.size, *net[:6], None, self.gamma, self.exchanges, y)
        return forces, None
