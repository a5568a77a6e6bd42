"""Parallel information filter of a sensor network (PIF): nodes filter alone, one processor combines their estimates."""

from typing import Literal, final

import numpy as np

from fdbench_baselines._kalman_filter import FloatArray
from fdbench_baselines._kalman_kernels import run_parallel
from fdbench_baselines._sensor_fusion import FusionFilter, Network


@final
class KalmanParallel(FusionFilter):
    r"""Local filters, each with its own reading only, and a processor that adds up their information.

    .. math::
        P^{-1} = (P^-)^{-1} + \sum_i \left[ (P_i^+)^{-1} - (P_i^-)^{-1} \right], \quad
        x = P \left[ (P^-)^{-1} x^- + \sum_i \left( (P_i^+)^{-1} x_i^+ - (P_i^-)^{-1} x_i^- \right) \right]

    What the nodes knew before their readings is common and counts once: so the result is the central filter's.
    There is one claim, of the processor, so ``node`` is 1 or none.

    Parameters
    ----------
    q_N2_per_s, initial_force_N, node
        See `FusionFilter`.
    form : {"exact", "printed", "sum"}
        As above; or :math:`P^{-1} = \sum_i w_i (P_i^+)^{-1}`, :math:`x = P \sum_i w_i (P_i^+)^{-1} x_i^+` with
        :math:`w_i` as 1 over the trace of :math:`P_i^+`, each variance in units of that at the start, which is
        covariance intersection and not optimal; or with :math:`w_i = 1`, which counts the common knowledge once for
        each node and is wrong.

    References
    ----------
    Speyer, Computation and transmission requirements for a decentralized linear-quadratic-Gaussian control problem,
    IEEE Trans. Automatic Control 24 (1979); Salehi, thesis, 2013, eqs. (5.13) to (5.18), which lack the state
    update and the weights.

    Examples
    --------
    A constant force on a spindle and a drive, read without noise for 0.2 s.

    >>> from fdbench_baselines._example import example_network
    >>> round(float(KalmanParallel().fit(*example_network(force_N=10.0)).disturbance_N[-1]), 6)
    10.0
    """

    def __init__(
        self,
        q_N2_per_s: float = 1e5,
        initial_force_N: float = 100.0,
        node: int | None = None,
        form: Literal["exact", "printed", "sum"] = "exact",
    ) -> None:
        super().__init__(q_N2_per_s, initial_force_N, node)
        self.require(form in ("exact", "printed", "sum"), f"form = {form!r} must be exact, printed or sum")
        self.form = form

    def claims(self, net: Network, y: FloatArray) -> tuple[FloatArray, FloatArray | None]:
        """Return the force of the processor and, in the exact form, its variance, (n_rows, 1)."""
        exact, printed = self.form == "exact", self.form == "printed"
        forces, variances = run_parallel(net.size, *net[:5], 1.0 / np.diag(net.P), exact, printed, y)
        return forces, variances if exact else None
