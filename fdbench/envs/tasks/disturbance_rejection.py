"""Hold the motion that the machine would make without its disturbance."""

from collections.abc import Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from fdbench.envs._machine import Machines
from fdbench.envs.tasks._squared import PerLane, SquaredDeviation, per_unit
from fdbench.envs.tasks._task import rewarded_columns
from fdbench.scenario import Scenario
from fdbench.simulate.system import System


@final
class DisturbanceRejection(SquaredDeviation):
    r"""Minus the squared deviation from the undisturbed response.

    .. math:: r_k = -\sum_i (y^0_{i,k} - y_{i,k})^2

    with the reading :math:`y_i` of the column that ``environment.reward`` names and what the same machine would read,
    :math:`y^0_i`, with zero actions, without process forces and without noise. What the servo loses on the reference
    costs nothing. Unit: :math:`\mu m^2` for positions, :math:`(mm/s)^2` for velocities, else that of the column
    squared. The best mean is minus the variance of the noise.

    Validity: scenarios with an effect that is a disturbance, among what is real and not modelled.

    Source: Åström, Murray, Feedback Systems (2008), section 11.1, for the response to a load disturbance as a transfer
    of its own beside that to the reference.

    Examples
    --------
    A velocity 2 mm/s beside the undisturbed one costs 4 (mm/s)^2.

    >>> from fdbench.envs.drive_env import DriveEnv
    >>> env = DriveEnv("ShakerConstant-v0", task="disturbance_rejection")
    >>> observation, info = env.reset(seed=0)
    >>> factor, undisturbed, place = env.interface.task.targets[0]
    >>> row = [0.0] * place + [undisturbed[700] + 0.002]
    >>> env.interface.task.reward(700, row, [0.0])
    -4.0
    """

    unit = "um^2, (mm/s)^2, or that of the column squared"

    def __init__(self, machines: Machines, system: System, n_lanes: int | None) -> None:
        super().__init__(machines, system, n_lanes)
        self._columns = list(rewarded_columns(machines.scenario, system))
        self._known: Scenario | None = None

    @classmethod
    def unfit(cls, scenario: Scenario, system: System) -> str | None:
        rewarded_columns(scenario, system)
        if any(effect.disturbance for effect in scenario.reality.effects):
            return None
        return "none of the effects in reality is a disturbance"

    def start(self, machines: Sequence[Scenario], lanes: NDArray[np.intp]) -> None:
        if self.machines.drawn and self.n_lanes is not None:
            self._start_lanes(machines, lanes)
        elif machines[0] is not self._known:
            self._known = machines[0]
            response = self._response(machines[0])
            self.targets = [
                self.target(column, values, per_unit(column))
                for column, values in zip(self._columns, response.T, strict=True)
            ]

    def _start_lanes(self, machines: Sequence[Scenario], lanes: NDArray[np.intp]) -> None:
        """Give each lane the response of its machine."""
        if not self.targets:
            n, n_lanes = self.system.n_samples, self.system.n_lanes
            places = [(column, self.system.columns.index(column)) for column in self._columns]
            self.targets = [(per_unit(column), PerLane(n, n_lanes), place) for column, place in places]
        for machine, lane in zip(machines, lanes, strict=True):
            for (_, series, _), values in zip(self.targets, self._response(machine).T, strict=True):
                series.values[:, lane] = values

    def _response(self, machine: Scenario) -> Any:
        """Return the undisturbed readings, (n_samples, n_columns)."""
        system = self.machines.undisturbed(machine)
        system.start([0])
        places = [system.columns.index(column) for column in self._columns]
        return system.advance(system.n_samples)[:, places, 0]
