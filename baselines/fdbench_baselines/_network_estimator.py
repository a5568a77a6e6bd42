"""What networks share that correct the nominal machine's free run: inputs, both folds, the sheet if none helps."""

from abc import abstractmethod
from typing import ClassVar, NamedTuple

import numpy as np

from fdbench.errors import PluginError, SpecError
from fdbench.estimator import BatchEstimator, Context, Estimate, FloatArray
from fdbench.record import Record
from fdbench_baselines._free_run_training import Trainable, Trained, train
from fdbench_baselines._nominal_runs import DRIVES, known, nominal_runs, root_mean_square, unpredictable


class LearntNetwork(NamedTuple):
    """What an axis has learnt: the network, its parameters, and the sizes of error and inputs."""

    network: Trainable
    trained: Trained
    size: float
    scale: FloatArray


class NetworkEstimator(BatchEstimator):
    """A network that learns the error of the nominal machine's free run, axis by axis.

    Parameters
    ----------
    own_name : str
        By which the estimator is registered.
    iterations, seed : int
        Most steps of a training; where its random numbers begin.
    sizes : int
        Further arguments, each at least 1.
    """

    made_for: ClassVar[tuple[str, ...] | None] = ("servo_response", *DRIVES)

    def __init__(self, own_name: str, iterations: int, seed: int, **sizes: int) -> None:
        bounds = {name: (value, 1, 100) for name, value in sizes.items()}
        bounds |= {"iterations": (iterations, 1, 10_000), "seed": (seed, 0, 2**32 - 1)}
        for name, (value, least, most) in bounds.items():
            if not isinstance(value, int) or not least <= value <= most:
                raise SpecError(f"{own_name}: {name} = {value!r} must be an integer from {least} to {most}.")
        self.own_name, self.iterations, self.seed = own_name, iterations, seed
        self._axes: list[LearntNetwork] | None = None

    @abstractmethod
    def network(self, context: Context, axis: int, row_time_s: float) -> Trainable:
        """Return the network of an axis for rows of a time."""

    @property
    def ratios(self) -> list[float]:
        """Withheld error of each axis beside the data sheet's, 0 to 1; 1 says that nothing was learnt."""
        return [axis.trained.ratio for axis in self._learnt()]

    def skip(self, context: Context) -> str | None:
        """Skip where no command makes the nominal model's target."""
        return unpredictable(context)

    def fit(self, context: Context, record: Record) -> Estimate:
        """Learn the error of each axis."""
        runs, axes = nominal_runs(context, record, self.own_name), []
        regression = context.regression(record)
        row_time_s = float(np.median(np.diff(regression.time_s)))
        for axis, (run, target) in enumerate(zip(runs, np.split(regression.target, len(runs)), strict=True)):
            inputs, error = known(context, run), target - run.target
            size, scale = float(root_mean_square(error)), root_mean_square(inputs)
            network = self.network(context, axis, row_time_s)
            start = network.start(inputs.shape[1], np.random.default_rng(self.seed))
            trained = train(network, start, inputs / scale, error / size, self.iterations)
            axes.append(LearntNetwork(network, trained, size, scale))
        self._axes = axes
        return Estimate()

    def predict(self, context: Context, estimate: Estimate, command: Record) -> FloatArray | None:
        """Return the nominal machine's response to a command, and the mean of what the folds' networks add to it."""
        responses = []
        for run, axis in zip(nominal_runs(context, command, self.own_name), self._learnt(), strict=True):
            inputs, response, thetas = known(context, run) / axis.scale, run.target, axis.trained.thetas
            for theta in thetas:
                response = response + axis.size / len(thetas) * axis.network.run(theta, inputs)
            responses.append(response)
        return np.concatenate(responses)

    def _learnt(self) -> list[LearntNetwork]:
        if self._axes is None:
            raise PluginError(f"{self.own_name}: fit(context, record) must come before predict.")
        return self._axes
