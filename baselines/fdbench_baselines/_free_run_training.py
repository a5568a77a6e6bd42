"""Training of what corrects a free run: by its error over a part of the record, stopped by that over the rest."""

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from fdbench.estimator import FloatArray
from fdbench_baselines._forward_regression import FOLDS, GAIN
from fdbench_baselines._regional_correction import dot

MEMORY = 10  # pairs of steps that tell the curvature
SUFFICIENT, SHORTEST = 1e-4, 1e-6  # of the fall that a slope promises; of a step
PATIENCE = 20
RIDGE = 1e-4  # of squared parameters beside squared errors: what nothing asks for stays as it was


class Trainable(Protocol):
    """A model of outputs (n,) from inputs (n, m), with parameters as one vector."""

    def start(self, n_inputs: int, rng: np.random.Generator) -> FloatArray:
        """Return parameters to start from, whose outputs are zero."""
        ...

    def run(self, theta: FloatArray, inputs: FloatArray) -> FloatArray:
        """Return the outputs of a free run."""
        ...

    def run_and_slopes(
        self, theta: FloatArray, inputs: FloatArray
    ) -> tuple[FloatArray, Callable[[FloatArray], FloatArray]]:
        """Return the outputs, and what makes of a cost's derivatives by them (n,) its gradient."""
        ...


class Trained(NamedTuple):
    """Parameters of each fold's model, none where no model errs less; withheld error beside that without a model."""

    thetas: list[FloatArray]
    ratio: float


def train(model: Trainable, start: FloatArray, inputs: FloatArray, target: FloatArray, iterations: int) -> Trained:
    """Return the models that both folds train, each as it was when its free run erred least where it was not fitted.

    Start, inputs and target are rounded to single precision, so that the last bits of a processor's linear algebra,
    which made them, do not lead the training another way.
    """
    start, inputs, target = (values.astype(np.float32).astype(np.float64) for values in (start, inputs, target))
    n, thetas, with_model, without = len(target), [], 0.0, 0.0
    for first, last in FOLDS:
        weight = np.zeros(n)
        weight[int(first * n) : int(last * n)] = 1.0
        theta, error = stopped_early(model, start, inputs, target, weight, iterations)
        thetas.append(theta)
        with_model += error
        without += mean_square(target, 1.0 - weight)
    ratio = float(np.sqrt(with_model / without)) if without > 0.0 else 1.0
    return Trained(thetas, ratio) if ratio < 1.0 - GAIN else Trained([], 1.0)


def mean_square(error: FloatArray, weight: FloatArray) -> float:
    """Return the weighted mean of squares."""
    return float(dot(weight * error, error)) / float(np.sum(weight))


def stopped_early(
    model: Trainable, start: FloatArray, inputs: FloatArray, target: FloatArray, weight: FloatArray, iterations: int
) -> tuple[FloatArray, float]:
    r"""Return the parameters of the least withheld error on the way of L-BFGS to the least fitted one, and that error.

    .. math:: J(\theta) = \frac{\sum_k w_k (y_k - \hat y_k(\theta))^2}{\sum_k w_k} + 10^{-4} |\theta - \theta_0|^2

    A step is halved until J falls by 1e-4 of what its slope promises; it ends after so many iterations, or after 20
    without a lower withheld error (Nocedal and Wright, Numerical Optimization, 2006, algorithms 7.4 and 3.1).
    """
    scale, withheld = 2.0 / float(np.sum(weight)), 1.0 - weight
    theta = start
    outputs, pull = model.run_and_slopes(theta, inputs)
    cost, gradient = mean_square(target - outputs, weight), pull(scale * weight * (outputs - target))
    best, least, since = theta, mean_square(target - outputs, withheld), 0
    steps: list[tuple[FloatArray, FloatArray, float]] = []
    for _ in range(iterations):
        direction = descent(gradient, steps)
        slope = float(dot(direction, gradient))
        length = 1.0
        while length >= SHORTEST:
            trial = theta + length * direction
            outputs, pull = model.run_and_slopes(trial, inputs)
            found = mean_square(target - outputs, weight) + RIDGE * float(dot(trial - start, trial - start))
            if found <= cost + SUFFICIENT * length * slope:
                break
            length *= 0.5
        else:
            break
        change, before = trial - theta, gradient
        theta, cost, gradient = trial, found, pull(scale * weight * (outputs - target)) + 2.0 * RIDGE * (trial - start)
        curvature = float(dot(change, gradient - before))
        if curvature > 0.0:
            steps = [*steps[1 - MEMORY :], (change, gradient - before, 1.0 / curvature)]
        error, since = mean_square(target - outputs, withheld), since + 1
        if error < least:
            best, least, since = theta, error, 0
        if since >= PATIENCE:
            break
    return best, least


def descent(gradient: FloatArray, steps: list[tuple[FloatArray, FloatArray, float]]) -> FloatArray:
    """Return minus the inverse curvature that the steps tell, times the gradient; without any, a step of at most 0.1.

    >>> descent(np.array([4.0, 1.0]), [(np.array([1.0, 0.0]), np.array([2.0, 0.0]), 0.5)])
    array([-2. , -0.5])
    """
    direction = -gradient
    if not steps:
        size = float(np.sqrt(dot(gradient, gradient)))
        return np.asarray(direction * min(1.0, 0.1 / size)) if size > 0.0 else direction
    shares = []
    for change, turn, inverse in reversed(steps):
        shares.append(inverse * float(dot(change, direction)))
        direction = direction - shares[-1] * turn
    change, turn, inverse = steps[-1]
    direction = direction / (inverse * float(dot(turn, turn)))
    for (change, turn, inverse), share in zip(steps, reversed(shares), strict=True):
        direction = direction + change * (share - inverse * float(dot(turn, direction)))
    return direction
