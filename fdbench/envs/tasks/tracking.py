"""Follow the reference: minus the squared error of what the scenario's environment names."""

from typing import final

from fdbench.envs._machine import Machines
from fdbench.envs.tasks._squared import SquaredDeviation
from fdbench.envs.tasks._task import rewarded_columns
from fdbench.scenario import Scenario
from fdbench.simulate.system import System


@final
class Tracking(SquaredDeviation):
    r"""Minus the squared servo error, in SI units; the task of an environment that names none.

    .. math:: r_k = -\sum_i (y^{ref}_{i,k} - y_{i,k})^2

    with the reading :math:`y_i` of the column that ``environment.reward`` of the scenario names, over all axes that
    have it. Unit: that of the column, squared (:math:`m^2` for positions): small numbers, to be scaled before
    learning. Noise of the reading lowers the mean by its variance.

    Source: Altintas, Manufacturing Automation (2012), chapter 5, for the servo (following) error.

    Examples
    --------
    A velocity 2 mm/s beside its reference costs 4e-6 (m/s)^2.

    >>> from fdbench.envs.drive_env import DriveEnv
    >>> env = DriveEnv("ShakerControl-v0")
    >>> row = dict.fromkeys(env.system.columns, 0.0)
    >>> row |= {"reference_velocity_m_per_s": 0.01, "velocity_m_per_s": 0.012}
    >>> round(env.interface.task.reward(400, list(row.values()), [0.0]), 12)
    -4e-06
    """

    unit = "of the column, squared"

    def __init__(self, machines: Machines, system: System, n_lanes: int | None) -> None:
        super().__init__(machines, system, n_lanes)
        self.follow(rewarded_columns(machines.scenario, system), 1.0)

    @classmethod
    def unfit(cls, scenario: Scenario, system: System) -> str | None:
        rewarded_columns(scenario, system)
        return None
