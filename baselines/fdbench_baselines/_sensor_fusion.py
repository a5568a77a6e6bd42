"""What Kalman filters in a network of sensors share: the model in scaled states and the recursion of the nodes.

Every node knows the whole plant, with the force as last state, and reads one output; see Salehi (2013), section 5.2.
"""

from abc import abstractmethod
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import SpecError
from fdbench.estimator import BatchEstimator, Context, Estimate
from fdbench.plants import NetworkPlant
from fdbench.record import Record
from fdbench_baselines._kalman_filter import FloatArray, observer, steady_covariance


class Network(NamedTuple):
    """The plant in states scaled to their standard deviations in the central filter, and who hears whom.

    Attributes
    ----------
    A, C, Q, R, P : (n, n), (n_nodes, n), (n, n), (n_nodes,), (n, n) arrays
        As in `fdbench_baselines._kalman_filter.Observer`.
    heard : (n_nodes, n_nodes) array of bool
        Whether node i hears node j; true on the diagonal.
    scale : (n,) array
        SI values of the states at 1.
    """

    A: FloatArray
    C: FloatArray
    Q: FloatArray
    R: FloatArray
    P: FloatArray
    heard: NDArray[np.bool_]
    scale: FloatArray

    @property
    def size(self) -> tuple[int, ...]:
        """A tuple of as many zeros as there are states, for the compiled recursions."""
        return (0,) * len(self.A)


def network(plant: NetworkPlant, sampling_time_s: float, q_N2_per_s: float, initial_force_N: float) -> Network:
    """Return the network; the scaling keeps covariances of m, m/s and N far from singular."""
    model = observer(plant.state_space(sampling_time_s), sampling_time_s, q_N2_per_s, initial_force_N, True)
    scale = np.sqrt(np.diag(steady_covariance(model)))
    both = np.outer(scale, scale)
    return Network(
        A=model.A / scale[:, None] * scale,
        C=model.C * scale,
        Q=model.Q / both,
        R=model.R,
        P=model.P / both,
        heard=plant.neighbours(),
        scale=scale,
    )


class FusionFilter(BatchEstimator):
    """A filter of a sensor network; a subclass gives the forces that its nodes claim.

    ``disturbance_N`` is the mean over the nodes, or the claim of one. The mean of several has no variance, as how their
    errors are correlated is not known to them.

    Parameters
    ----------
    q_N2_per_s : float
        Density of the force's random walk, N^2/s; above 0.
    initial_force_N : float
        Standard deviation of the force at the start, N; above 0.
    node : int, optional
        Node, from 1, that the claim is of.
    """

    made_for: ClassVar[tuple[str, ...] | None] = ("sensor_network",)

    def __init__(self, q_N2_per_s: float = 1e5, initial_force_N: float = 100.0, node: int | None = None) -> None:
        self.require(0.0 < q_N2_per_s < np.inf, f"q_N2_per_s = {q_N2_per_s!r} must be above 0 and finite")
        self.require(
            0.0 < initial_force_N < np.inf, f"initial_force_N = {initial_force_N!r} must be above 0 and finite"
        )
        self.require(node is None or node >= 1, f"node = {node!r} must be 1 or more")
        self.q_N2_per_s, self.initial_force_N, self.node = q_N2_per_s, initial_force_N, node

    @classmethod
    def require(cls, allowed: bool | np.bool, message: str) -> None:
        """Raise a SpecError in the name of the filter's file unless ``allowed``."""
        if not allowed:
            raise cls.error(message)

    @classmethod
    def error(cls, message: str) -> SpecError:
        """Return an error in the name of the filter's file."""
        return SpecError(f"{cls.__module__.rsplit('.', 1)[-1]}: {message}.")

    def skip(self, context: Context) -> str | None:
        """Skip where the plant is no sensor network, or one with inputs."""
        if not isinstance(context.plant, NetworkPlant):
            return "the plant is no network of sensors"
        if context.plant.state_space(context.sampling_time_s).inputs:
            return "the plant has inputs, which the filters of a network do not know"
        return None

    def fit(self, context: Context, record: Record) -> Estimate:
        """Run over a whole record."""
        plant, readings, reason = context.plant, context.regression(record).readings, self.skip(context)
        if not isinstance(plant, NetworkPlant) or readings is None or reason is not None:
            raise self.error(reason or "the regression has no readings")
        net = network(plant, context.sampling_time_s, self.q_N2_per_s, self.initial_force_N)
        forces, variances = self.claims(net, np.ascontiguousarray(readings))
        nodes = forces.shape[1]
        if self.node is None and nodes > 1:
            return Estimate(disturbance_N=net.scale[-1] * forces.mean(axis=1))
        chosen = (self.node or 1) - 1
        self.require(chosen < nodes, f"node = {self.node} is too large; the filter has {nodes}")
        return Estimate(
            disturbance_N=net.scale[-1] * forces[:, chosen],
            disturbance_variance_N2=None if variances is None else net.scale[-1] ** 2 * variances[:, chosen],
        )

    @abstractmethod
    def claims(self, net: Network, y: FloatArray) -> tuple[FloatArray, FloatArray | None]:
        """Return the force that each node claims and its variance, (n_rows, n_nodes), in units of the last state."""
