"""Gated recurrent units that learn what the data sheet's machine gets wrong, by backpropagation through time."""

from collections.abc import Callable
from typing import NamedTuple, final

import numpy as np

from fdbench.estimator import Context, FloatArray
from fdbench_baselines._network_estimator import NetworkEstimator
from fdbench_baselines._recurrent_kernels import gated_backward, gated_forward


class GatedNetwork(NamedTuple):
    """A layer of gated recurrent units and a straight line beside it; see `GatedRecurrentUnit`."""

    units: int

    def start(self, n_inputs: int, rng: np.random.Generator) -> FloatArray:
        """Return random weights of the units, and outputs of zero."""
        width = n_inputs + 1 + self.units
        inner = rng.standard_normal(3 * self.units * width) / np.sqrt(width)
        return np.append(inner, np.zeros(width))

    def run(self, theta: FloatArray, inputs: FloatArray) -> FloatArray:
        """Return the outputs of a free run."""
        return self.run_and_slopes(theta, inputs)[0]

    def run_and_slopes(
        self, theta: FloatArray, inputs: FloatArray
    ) -> tuple[FloatArray, Callable[[FloatArray], FloatArray]]:
        """Return the outputs, and what makes of a cost's derivatives by them its gradient."""
        outputs, states = gated_forward(theta, self.units, inputs)
        return outputs, lambda slopes: np.asarray(gated_backward(theta, self.units, inputs, states, slopes))


@final
class GatedRecurrentUnit(NetworkEstimator):
    r"""Gated recurrent units (GRU) fed with a free run of the nominal machine, which tell what that run gets wrong.

    .. math::
        z_k &= \sigma(W_z u_k + R_z h_k + b_z), \qquad r_k = \sigma(W_r u_k + R_r h_k + b_r) \\
        g_k &= \tanh(W_g u_k + b_g + r_k \circ R_g h_k), \qquad h_{k+1} = z_k \circ h_k + (1 - z_k) \circ g_k \\
        y_k &= \hat y_k + s \, (c^T h_{k+1} + d^T u_k + d_0), \qquad \sigma(x) = (1 + \tanh(x / 2)) / 2

    with the nominal machine's response :math:`\hat y` to the command (m, m/s or N), the states h of the units, at rest
    0, and as inputs u, each in units of its size, what the machine's equation multiplies on that run: on a drive
    commanded and own velocity or acceleration, velocity and direction; on a servo stage the response, with its first
    and second change from row to row. s is the size of the error. Nothing measured is an input, so that training and
    free run see the same. At the start c, d and :math:`d_0` are 0: the data sheet.

    The mean square error, in units of s, of the free run from the record's start and 0.0001 times the squared distance
    of all parameters from the start are lowered by L-BFGS, the gradient by backpropagation through all of the time, on
    two folds: 30 % of the record are withheld at its end and at its start. Each fold keeps the parameters of the least
    withheld error on the way, and stops 20 steps after; a prediction is the mean of both. Unless the withheld errors
    together are lower by 3 % than the sheet's, nothing is learnt, which ``ratios`` tells.

    h stays within -1 and 1 whatever the weights are, so that no free run diverges: what is added is at most
    :math:`s (|c|_1 + |d^T u_k + d_0|)`. Nothing is clipped.

    Units, steps and the factor of 0.0001 are those of the least mean logarithm of the free run's error on seeds 101 to
    103 of six simulated scenarios (a servo stage's staircase and spiral, a ball screw, a shaker, two linear motors),
    out of 4, 8 and 16 units, 30, 60 and 100 steps and factors of 0.0001, 0.001 and 0.01. No measured record was among
    them.

    Told: the data sheet. Claims nothing but the free run. With n rows, m inputs and H units it has 3 H (m + 1 + H) + H
    + m + 1 parameters, 117 for m = 4. A step of the training costs O(n H (m + H)), 0.7 us a row: 0.4 s for a record of
    4000 rows on one core. A free run costs 0.4 us a row; the memory is 40 n H bytes, 1.3 MB.

    Parameters
    ----------
    units : int
        H, 1 to 100.
    iterations : int
        Most steps of L-BFGS in a fold, at least 1.
    seed : int
        Of the weights to start from, at least 0. The same seed gives the same weights on any processor: all is summed
        in a fixed order, with a tanh of our own, from inputs in single precision.

    Raises
    ------
    SpecError
        If an argument is out of bounds, or the nominal model has no free run.
    PluginError
        If predict comes before fit.

    Validity
    --------
    A process force is no part of it: what goes with the feed, as a mean cutting force does, is learnt as if it were the
    machine's and is missing in air. A speed or place that the record lacks is extrapolated by a straight line and units
    that saturate; the withheld parts cannot tell how far that holds, as they are of the same motion. The minimum is a
    local one: another seed gives another network, which is no better understood than this one.

    References
    ----------
    Cho et al., Learning phrase representations using RNN encoder-decoder, EMNLP 2014, eqs. (5) to (8), with the reset
    after the product, as in later libraries; Werbos, Backpropagation through time, Proceedings of the IEEE 78 (1990),
    1550-1560; Nocedal and Wright, Numerical Optimization, 2006, algorithm 7.4. The nominal run as input, folds and the
    straight line beside the units are ours.

    Examples
    --------
    The mass is 1.25 times that of the data sheet: an error of v that follows from the command.

    >>> from fdbench_baselines._example import example_drive
    >>> context, record = example_drive(mass_ratio=1.25)
    >>> estimator = GatedRecurrentUnit()
    >>> error = estimator.predict(context, estimator.fit(context, record), record) - record["velocity_m_per_s"][1:]
    >>> bool(np.abs(error).max() < 2e-3)
    True
    """

    def __init__(self, units: int = 4, iterations: int = 100, seed: int = 0) -> None:
        super().__init__("gated_recurrent_unit", iterations, seed, units=units)
        self.units = units

    def network(self, context: Context, axis: int, row_time_s: float) -> GatedNetwork:
        """Return the units."""
        return GatedNetwork(self.units)
