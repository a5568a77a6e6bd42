"""Distributed information filter of a sensor network (DIF): nodes add up what their neighbours' readings say."""

from typing import Literal, final

from fdbench_baselines._kalman_filter import FloatArray
from fdbench_baselines._kalman_kernels import run_nodes
from fdbench_baselines._sensor_fusion import FusionFilter, Network


@final
class KalmanDistributed(FusionFilter):
    r"""Each node filters its own reading and those of its neighbours.

    .. math::
        x_i^+ = P_i^+ \left[ (P_i^-)^{-1} x_i^- + \sum_{j \in N_i} H_j^T R_j^{-1} z_j \right], \quad
        (P_i^+)^{-1} = (P_i^-)^{-1} + \sum_{j \in N_i} H_j^T R_j^{-1} H_j

    with i itself in N_i. Where every node hears every other, each is the central filter.

    Parameters
    ----------
    q_N2_per_s, initial_force_N, node
        See `FusionFilter`.
    form : {"gain", "information"}
        The same by a gain for each reading, which inverts no covariance, or as written.

    References
    ----------
    Rao, Durrant-Whyte, Fully decentralised algorithm for multisensor Kalman filtering, IEE Proc. D 138 (1991); Salehi,
    thesis, 2013, eqs. (5.22) to (5.27), where the first sum has the index of the node in place of its neighbour.

    Examples
    --------
    A constant force on a spindle and a drive, read without noise for 0.2 s.

    >>> from fdbench_baselines._example import example_network
    >>> round(float(KalmanDistributed().fit(*example_network(force_N=10.0)).disturbance_N[-1]), 6)
    10.0
    """

    def __init__(
        self,
        q_N2_per_s: float = 1e5,
        initial_force_N: float = 100.0,
        node: int | None = None,
        form: Literal["gain", "information"] = "gain",
    ) -> None:
        super().__init__(q_N2_per_s, initial_force_N, node)
        self.require(form in ("gain", "information"), f"form = {form!r} must be gain or information")
        self.form = form

    def claims(self, net: Network, y: FloatArray) -> tuple[FloatArray, FloatArray | None]:
        """Return the force of each node and its variance."""
        forces, variances = run_nodes(net.size, *net[:6], True if self.form == "information" else None, 0.0, 0, y)
        return forces, variances
