"""What a task is: a reward for each step of a scenario that other tasks reward otherwise."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from fdbench.envs._machine import Machines
from fdbench.errors import SpecError, did_you_mean
from fdbench.registry import Registry
from fdbench.scenario import Scenario
from fdbench.simulate.system import FloatArray, System

# One environment has floats and lists of them, lanes side by side have arrays: the same lines compute both.
Series = list[float] | FloatArray


class Task(ABC):
    """A reward; file name = name. It reads what the machine does and changes nothing of it.

    Parameters
    ----------
    machines : Machines
        Of the scenario.
    system : System
        What is stepped.
    n_lanes : int or None
        Lanes side by side; None for one environment, whose rewards are floats.

    Class attributes
    ----------------
    unit : str
        Unit of the reward.
    """

    name: ClassVar[str]
    unit: ClassVar[str]

    def __init__(self, machines: Machines, system: System, n_lanes: int | None) -> None:
        self.machines, self.system, self.n_lanes = machines, system, n_lanes

    @classmethod
    @abstractmethod
    def unfit(cls, scenario: Scenario, system: System) -> str | None:
        """Return why the task does not fit a scenario, or None if it does."""

    @abstractmethod
    def reward(self, k: Any, row: Any, action: Any) -> Any:
        """Return the reward of a step: of one environment a float, of lanes an (n_lanes,) array.

        Parameters
        ----------
        k : int or (n_lanes,) array of int
            Sample.
        row : sequence of float or (n_columns + n_truth_columns, n_lanes) array
            What was read at the sample, and what only the simulation knows.
        action : sequence of float or (n_actions, n_lanes) array
            Deviation from the command that is held from the sample on, in the command's unit.
        """

    def start(self, machines: Sequence[Scenario], lanes: NDArray[np.intp]) -> None:  # noqa: B027 - most keep nothing
        """Begin episodes of these machines, one in each of ``lanes``."""

    def series(self, values: FloatArray) -> Series:
        """Return one value for each sample, (n_samples,), in the form that `reward` reads fastest."""
        return values.tolist() if self.n_lanes is None else values


def rewarded_columns(scenario: Scenario, system: System) -> dict[str, str]:
    """Return the measured columns of all axes that the scenario's environment names, each with its reference.

    Raises
    ------
    SpecError
        If what it names is not measured beside its reference.
    """
    found: dict[str, dict[str, str]] = {}
    for reference in system.commanded:
        axis, _, quantity = reference.partition("reference_")
        if quantity and f"{axis}{quantity}" in system.columns:
            found.setdefault(quantity, {})[f"{axis}{quantity}"] = reference
    reward = "" if scenario.environment is None else scenario.environment.reward
    if reward not in found:
        raise SpecError(
            f"{scenario.id}: environment.reward: '{reward}' is not measured beside its reference."
            f"{did_you_mean(reward, found)}"
        )
    return found[reward]


def fitting(scenario: Scenario, system: System) -> dict[str, str | None]:
    """Return why each task does not fit a scenario, or None if it does, by the name of the task."""
    return {name: tasks.get(name).unfit(scenario, system) for name in tasks.names()}


def task_for(name: str, scenario: Scenario, system: System) -> type[Task]:
    """Return the task of a name.

    Raises
    ------
    UnknownName
        If there is none of this name; the message gives the nearest one.
    SpecError
        If it does not fit the scenario; the message gives those that do.
    """
    task = tasks.get(tasks.resolve(name))
    reason = task.unfit(scenario, system)
    if reason is not None:
        reasons: Mapping[str, str | None] = fitting(scenario, system)
        fit = ", ".join(other for other, against in reasons.items() if against is None)
        raise SpecError(f"{scenario.id}: the task '{task.name}' does not fit: {reason}. Tasks that fit: {fit}.")
    return task


tasks: Registry[Task] = Registry("task", Task)  # type: ignore[type-abstract]
