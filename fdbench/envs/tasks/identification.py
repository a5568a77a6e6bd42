"""Identification by moving: the reward is what a step tells of the parameters."""

from collections.abc import Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from fdbench.envs._machine import Machines
from fdbench.envs.tasks._task import Task
from fdbench.errors import SpecError
from fdbench.plants._velocity_loop import DEAD_BAND_M_PER_S, VelocityLoopModel
from fdbench.scenario import Scenario
from fdbench.simulate.system import FloatArray, System

# Relative standard deviation of each parameter where a scenario does not say how far machines differ.
UNDRAWN_DEVIATION = 0.1
_VELOCITY, _REFERENCE = "velocity_m_per_s", "reference_velocity_m_per_s"


@final
class Identification(Task):
    r"""The increase of the logarithm of the determinant of the Fisher information of the plant's parameters.

    .. math::
        r_k = \log\det F_{k+1} - \log\det F_k = \log\left(1 + \frac{\varphi_k^T P_k \varphi_k}{\sigma^2}\right), \quad
        F_{k+1} = F_k + \frac{\varphi_k \varphi_k^T}{\sigma^2}, \quad
        P_{k+1} = P_k - \frac{P_k \varphi_k \varphi_k^T P_k}{\sigma^2 + \varphi_k^T P_k \varphi_k}

    with P the inverse of F, the regressors :math:`\varphi` of `fdbench.plants.VelocityLoop`'s model, in which the
    action is part of the command, and the machine's standard deviation :math:`\sigma` of the equation noise. P begins
    with the covariance that the data sheet leaves open (``Context.covariance``), which may be singular; where the
    scenario draws nothing, with a tenth of each nominal parameter, independent. Unit: nat. The sum over an episode is
    :math:`\log(\det F_n / \det F_0)`, twice the loss of entropy, whatever the order of the steps: D-optimal moving.

    Validity: velocity loops with equation noise, whose regression gains a row with every sample. A disturbance, which
    is no white noise, is not in sigma: the information is that of an estimator that knows it.

    Source: Ljung, System Identification (1999), section 13.3, for the design of inputs by det F; Mehra, Optimal input
    signals for parameter estimation in dynamic systems, IEEE Trans. Automatic Control 19 (1974), 753-768; Golub, Van
    Loan, Matrix Computations (2013), section 2.1.4, for the update of P.

    Examples
    --------
    One parameter, variance 4 before, regressor 1 and unit noise: the information grows from 1/4 to 5/4.

    >>> gain, after = informed([[4.0]], [1.0], 1.0)
    >>> round(float(gain), 6), round(after[0][0], 6)
    (1.609438, 0.8)
    """

    unit = "nat"

    def __init__(self, machines: Machines, system: System, n_lanes: int | None) -> None:
        super().__init__(machines, system, n_lanes)
        scenario = machines.scenario
        model = scenario.linear_model
        if not isinstance(model, VelocityLoopModel):
            raise SpecError(f"{scenario.id}: {self.unfit(scenario, system)}.")
        covariance = scenario.context().covariance
        values = np.array(list(model.nominal_parameters(scenario.setup.timing.sampling_time_s).values()))
        self.prior: FloatArray = np.diag((UNDRAWN_DEVIATION * values) ** 2) if covariance is None else covariance
        self._friction = model.has_friction
        self._velocity, self._reference = (system.columns.index(name) for name in (_VELOCITY, _REFERENCE))
        self._variance: Any = 0.0 if n_lanes is None else np.zeros(n_lanes)
        self._P: list[list[Any]] = [[0.0 if n_lanes is None else np.zeros(n_lanes) for _ in row] for row in self.prior]

    @classmethod
    def unfit(cls, scenario: Scenario, system: System) -> str | None:
        if not isinstance(scenario.linear_model, VelocityLoopModel):
            return f"the regression '{scenario.estimation.model}' does not gain a row with every sample"
        noise = scenario.reality.noise
        if not noise.equation_velocity_m_per_s > 0.0 or noise.velocity_m_per_s > 0.0:
            return "the information is that of equation noise alone, without noise of the velocity's reading"
        return None

    def start(self, machines: Sequence[Scenario], lanes: NDArray[np.intp]) -> None:
        variance = np.array([machine.reality.noise.equation_velocity_m_per_s**2 for machine in machines])
        if self.n_lanes is None:
            self._variance, self._P = float(variance[0]), self.prior.tolist()
            return
        self._variance[lanes] = variance
        for row, prior in zip(self._P, self.prior, strict=True):
            for entry, value in zip(row, prior, strict=True):
                entry[lanes] = value

    def reward(self, k: Any, row: Any, action: Any) -> Any:
        velocity = row[self._velocity]
        regressors = [row[self._reference] + action[0], velocity]
        if self._friction:
            # Times 1.0 for a float of a boolean, be it one or an array of them.
            regressors += [-1.0 * (velocity > DEAD_BAND_M_PER_S), 1.0 * (velocity < -DEAD_BAND_M_PER_S)]
        reward, self._P = informed(self._P, regressors, self._variance)
        return float(reward) if self.n_lanes is None else reward


def informed(P: Sequence[Sequence[Any]], regressors: Sequence[Any], variance: Any) -> tuple[Any, list[list[Any]]]:
    """Return the gain of a row of a regression in nats, and the covariance P after it, both of a float or of lanes."""
    moved = []
    for row in P:
        total = row[0] * regressors[0]
        for entry, regressor in zip(row[1:], regressors[1:], strict=True):
            total = total + entry * regressor
        moved.append(total)
    known = moved[0] * regressors[0]
    for value, regressor in zip(moved[1:], regressors[1:], strict=True):
        known = known + value * regressor
    whole = variance + known
    after = [
        [entry - left * right / whole for entry, right in zip(row, moved, strict=True)]
        for row, left in zip(P, moved, strict=True)
    ]
    return np.log1p(known / variance), after
