"""Linear state space of the nominal machine and neurons in feedback, which learn what the data sheet gets wrong."""

from collections.abc import Callable
from typing import NamedTuple, final

import numpy as np

from fdbench.estimator import Context, FloatArray
from fdbench.plants._servo_stage import StagePlant
from fdbench_baselines._network_estimator import NetworkEstimator
from fdbench_baselines._nominal_runs import LOOP
from fdbench_baselines._recurrent_kernels import feedback_backward, feedback_forward

MEMORIES = (4.0, 16.0)  # time constants in rows, where the nominal equation has no state


class FeedbackNetwork(NamedTuple):
    """A linear system with as many neurons in feedback, and the form of its poles; see `NeuralStateSpace`.

    Attributes
    ----------
    decays, tangents : (pairs,) arrays
        Poles to start from: their size is 1 / (1 + decay), the tangent that of half their angle.
    neurons : int
    """

    decays: FloatArray
    tangents: FloatArray
    neurons: int

    def start(self, n_inputs: int, rng: np.random.Generator) -> FloatArray:
        """Return the poles, random weights of the neurons, and no effect of inputs or neurons."""
        pairs = len(self.decays)
        width, driven = n_inputs + 1 + 2 * pairs, n_inputs + 1 + self.neurons
        poles, idle = np.repeat([1.0, 0.0], pairs), np.zeros(2 * pairs * driven)
        inner = rng.standard_normal(self.neurons * width) / np.sqrt(width)
        return np.concatenate((poles, idle, inner, np.zeros(driven)))

    def run(self, theta: FloatArray, inputs: FloatArray) -> FloatArray:
        """Return the outputs of a free run."""
        return self.run_and_slopes(theta, inputs)[0]

    def run_and_slopes(
        self, theta: FloatArray, inputs: FloatArray
    ) -> tuple[FloatArray, Callable[[FloatArray], FloatArray]]:
        """Return the outputs, and what makes of a cost's derivatives by them its gradient."""
        form = len(self.decays), self.neurons, self.decays, self.tangents
        outputs, x, w = feedback_forward(theta, *form, inputs)
        return outputs, lambda slopes: np.asarray(feedback_backward(theta, *form, inputs, x, w, slopes))


@final
class NeuralStateSpace(NetworkEstimator):
    r"""State space in linear fractional form: the data sheet's linear machine, and a layer of neurons in feedback.

    .. math::
        x_{k+1} &= A x_k + G (B u_k + b_x + B_w w_k), \qquad w_k = \tanh(C_z x_k + D_{zu} u_k + b) \\
        y_k &= \hat y_k + s \, (C x_k + D u_k + d + D_w w_k)

    :math:`\hat y` (m, m/s or N) is the nominal machine's response to the command and holds the sheet's own states; x
    are what they are off by, at rest 0, and by superposition move with the sheet's poles: on a servo stage those of its
    servo, in a velocity loop :math:`\beta_2`. Inverse dynamics have no state: there two pairs forget in 4 and in 16
    rows. Each pair of states has a block of A with a pole of size :math:`1 / (1 + 10^{-4} + \delta \rho^2)` and angle
    :math:`2 \arctan(t + \delta \tau)`; :math:`\rho = 1`, :math:`\tau = 0` at the start, learnt too. C reads the
    first state of a pair, and G is 1 less the size of the sheet's pole. s is the size of the error; inputs u, each in
    units of its size, are what the machine's equation multiplies on its own run: on a drive commanded and own velocity
    or acceleration, velocity and direction; on a servo stage the response, with its first and second change from row to
    row. Nothing measured is an input. The usual W of tanh(W z + b) is within :math:`C_z` and :math:`D_{zu}`. At the
    start B, :math:`B_w`, D, :math:`D_w`, :math:`b_x` and d are 0: the data sheet.

    The mean square error, in units of s, of the free run from the record's start and 0.0001 times the squared distance
    of all parameters from the start are lowered by L-BFGS, the gradient by backpropagation through all of the time, on
    two folds: 30 % of the record are withheld at its end and at its start. Each fold keeps the parameters of the least
    withheld error on the way, and stops 20 steps after; a prediction is the mean of both. Unless the withheld errors
    together are lower by 3 % than the sheet's, nothing is learnt, which ``ratios`` tells.

    All poles are within the unit circle by their form, and w within -1 and 1, so that no free run diverges whatever the
    weights are; it may still go round in a bounded cycle. Nothing is clipped.

    Neurons, steps and the factor of 0.0001 are those of the least mean logarithm of the free run's error on seeds 101
    to 103 of six simulated scenarios (a servo stage's staircase and spiral, a ball screw, a shaker, two linear motors),
    out of 4, 8 and 16 neurons, 50, 100 and 200 steps and factors of 0.0001, 0.001 and 0.01. No measured record was
    among them.

    Told: the data sheet. Claims nothing but the free run. With n rows, m inputs, q neurons and p pairs it has 2 p + (2
    p + 1) (m + 1 + q) + q (m + 1 + 2 p) parameters, 85 for m = 4 and p = 2. A step of the training costs O(n (2 p + q)
    (m + q)), 0.3 us a row: 0.2 s for a record of 4000 rows on one core. A free run costs 0.15 us a row; the memory is 8
    n (2 p + q) bytes, 0.4 MB.

    Parameters
    ----------
    neurons : int
        q, 1 to 100.
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
    machine's and is missing in air. A speed or place that the record lacks is extrapolated by straight lines, of the
    error and within the neurons; the withheld parts cannot tell how far that holds, as they are of the same motion. The
    minimum is a local one. Of a network in feedback no equilibrium is guaranteed, only bounds.

    References
    ----------
    Suykens, De Moor and Vandewalle, Nonlinear system identification using neural state space models, International
    Journal of Control 62 (1995), 129-152; Schoukens and Toth, On the initialization of nonlinear LFR model
    identification with the best linear approximation, IFAC-PapersOnLine 53 (2020), 310-315; Bemporad, An L-BFGS-B
    approach for linear and nonlinear system identification, IEEE Trans. Automatic Control, 2025, for the
    training. That the linear part is the sheet's, the form of its poles, and folds are ours.

    Examples
    --------
    The mass is 1.25 times that of the data sheet: an error of v that follows from the command.

    >>> from fdbench_baselines._example import example_drive
    >>> context, record = example_drive(mass_ratio=1.25)
    >>> estimator = NeuralStateSpace()
    >>> error = estimator.predict(context, estimator.fit(context, record), record) - record["velocity_m_per_s"][1:]
    >>> bool(np.abs(error).max() < 1e-3)
    True
    """

    def __init__(self, neurons: int = 4, iterations: int = 200, seed: int = 0) -> None:
        super().__init__("neural_state_space", iterations, seed, neurons=neurons)
        self.neurons = neurons

    def network(self, context: Context, axis: int, row_time_s: float) -> FeedbackNetwork:
        """Return the neurons about the sheet's poles."""
        if isinstance(context.plant, StagePlant):
            s = np.linalg.eigvals(list(context.plant.axes().values())[axis].A)
            poles = np.exp(row_time_s * s[s.imag >= 0.0])
        elif context.model == LOOP:
            poles = np.array([context.nominal["beta_2"]])
        else:
            poles = np.exp(-1.0 / np.array(MEMORIES))
        # In single precision, as all that a training starts from: the last bits are each processor's own.
        decays, tangents = (
            (1.0 / np.abs(poles) - 1.0).astype(np.float32),
            np.tan(np.angle(poles) / 2.0).astype(np.float32),
        )
        order = np.argsort(decays, kind="stable")
        return FeedbackNetwork(decays[order].astype(float), tangents[order].astype(float), self.neurons)
