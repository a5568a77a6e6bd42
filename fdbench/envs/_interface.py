"""What scalar and vector environment share: the scenario, its machines and task, its spaces, and what is refused."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.error import InvalidAction
from gymnasium.spaces import Box

from fdbench.envs._machine import Machines
from fdbench.envs.tasks._task import Task, rewarded_columns, task_for
from fdbench.errors import SpecError, did_you_mean
from fdbench.scenario import Scenario, load_scenario
from fdbench.simulate.system import FloatArray, System

# Noise and errors of the encoders carry a reading past a limit of the plant before the episode ends.
OBSERVATION_MARGIN = 2.0
DEFAULT_TASK = "tracking"


@dataclass(frozen=True, eq=False)
class Rewarded:
    """A measured column, its place in a row of the system, and its reference (n_samples,)."""

    name: str
    place: int
    reference: FloatArray


class Interface:
    """One scenario and its system, seen through Gymnasium.

    Parameters
    ----------
    scenario : str, path or Scenario
        Id, TOML file, or the scenario itself.
    task : str
        What is rewarded; a file of `fdbench.envs.tasks`.
    n_lanes : int or None
        Lanes side by side; None for one environment.

    Raises
    ------
    SpecError
        If the scenario is measured, has no table ``[environment]``, rewards a column without a reference, draws its
        command, or if the task does not fit it.
    """

    def __init__(self, scenario: str | Path | Scenario, task: str = DEFAULT_TASK, n_lanes: int | None = None) -> None:
        self.scenario = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
        environment = self.scenario.environment
        if self.scenario.measured is not None or environment is None:
            reason = "it has no table [environment]" if environment is None else "it is measured"
            raise SpecError(f"{self.scenario.id}: no environment can be made of this scenario; {reason}.")
        self.machines = Machines(self.scenario)
        self.n_lanes = n_lanes
        system = self.machines.system(self.scenario, n_lanes or 1)
        self._task = task_for(task, self.scenario, system)
        self.action_scale = environment.action_scale
        self.period_s = self.scenario.setup.timing.sampling_time_s
        # Commanded columns that the system does not log itself come first.
        self._ahead = [name for name in system.commanded if name not in system.columns]
        self.columns: tuple[str, ...] = (*self._ahead, *system.columns)
        high = OBSERVATION_MARGIN * np.array([system.limits[name] for name in self.columns])
        self.observation_space = Box(-high, high, dtype=np.float64)
        self.action_space = Box(-1.0, 1.0, (len(system.action_names),), dtype=np.float32)
        self.use(system)

    def use(self, system: System) -> None:
        """Take another system of the scenario, such as another machine."""
        self.system = system
        self.task: Task = self._task(self.machines, system, self.n_lanes)
        self.commanded = np.column_stack([system.commanded[name] for name in self._ahead]) if self._ahead else None

    @property
    def rewarded(self) -> tuple[Rewarded, ...]:
        """The measured columns that the scenario's environment names, each with its reference."""
        system = self.system
        return tuple(
            Rewarded(column, system.columns.index(column), system.commanded[reference])
            for column, reference in rewarded_columns(self.scenario, system).items()
        )

    def at_rest(self) -> FloatArray:
        """Return a new observation of the drive before its first sample."""
        ahead = [] if self.commanded is None else [self.commanded[0]]
        return np.concatenate([*ahead, self.system.at_rest])


def next_seed(generator: np.random.Generator) -> int:
    """Return the seed of an episode that was reset without one."""
    return int(generator.integers(2**31))


def check_options(options: Mapping[str, Any] | None, allowed: tuple[str, ...] = ()) -> None:
    """Raise a SpecError at the first option of a reset that has no meaning."""
    for name in options or ():
        if name not in allowed:
            raise SpecError(f"reset: unknown option '{name}'.{did_you_mean(name, allowed)}")


def checked_action(scenario: str, action: Any, shape: tuple[int, ...] | None) -> FloatArray:
    """Return an action as an array of float64, or say what is wrong with it.

    Raises
    ------
    InvalidAction
        If it is no array of real numbers of this shape within [-1, 1].
    """
    wanted = f"an array of shape {shape} and dtype float32 within [-1, 1] is expected"
    if not isinstance(action, np.ndarray):
        raise InvalidAction(f"{scenario}: action: {wanted}, found {type(action).__name__} {_short(action)}.")
    if action.dtype.kind not in "fiu":
        raise InvalidAction(f"{scenario}: action: {wanted}, found the dtype {action.dtype}.")
    if action.shape != shape:
        raise InvalidAction(f"{scenario}: action: {wanted}, found the shape {action.shape}.")
    if not np.abs(action).max() <= 1.0:
        outside = float(action[~(np.abs(action) <= 1.0)][0])
        raise InvalidAction(f"{scenario}: action: {wanted}, found {outside:g}, which is outside.")
    return np.asarray(action, dtype=np.float64)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
