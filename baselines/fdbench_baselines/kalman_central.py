"""Central Kalman filter of a sensor network (CKF): one processor takes in every reading."""

from typing import final

import numpy as np

from fdbench_baselines._kalman_filter import FloatArray
from fdbench_baselines._kalman_kernels import run_nodes
from fdbench_baselines._sensor_fusion import FusionFilter, Network


@final
class KalmanCentral(FusionFilter):
    r"""Kalman filter with the readings of all nodes, the best that any network can do.

    .. math::
        K = P^- H^T (H P^- H^T + R)^{-1}, \quad x^+ = x^- + K (z - H x^-), \quad
        P^+ = (I - K H) P^- (I - K H)^T + K R K^T

    reading by reading, as their noises are independent. Links do not matter, and there is one claim, of the processor.
    The parameters are those of every `FusionFilter`.

    References
    ----------
    Salehi, thesis, 2013, eqs. (5.1) to (5.6); the covariance here in the form of Joseph.

    Examples
    --------
    A constant force on a spindle and a drive, read without noise for 0.2 s.

    >>> from fdbench_baselines._example import example_network
    >>> round(float(KalmanCentral().fit(*example_network(force_N=10.0)).disturbance_N[-1]), 6)
    10.0
    """

    def claims(self, net: Network, y: FloatArray) -> tuple[FloatArray, FloatArray | None]:
        """Return the force of the processor and its variance, (n_rows, 1)."""
        everything = np.ones((1, len(net.C)), dtype=np.bool_)
        forces, variances = run_nodes(net.size, *net[:5], everything, None, 0.0, 0, y)
        return forces, variances
