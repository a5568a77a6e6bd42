"""What scalar and vector environment share: the scenario, its spaces, and which columns are seen and rewarded."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.spaces import Box

from fdbench.errors import SpecError, did_you_mean
from fdbench.scenario import Scenario, load_scenario
from fdbench.simulate.system import FloatArray, System

# Noise and errors of the encoders carry a reading past a limit of the plant before the episode ends.
OBSERVATION_MARGIN = 2.0


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
    n_lanes : int

    Raises
    ------
    SpecError
        If the scenario is measured, has no table ``[environment]``, or rewards a column without a reference.
    """

    def __init__(self, scenario: str | Path | Scenario, n_lanes: int) -> None:
        self.scenario = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
        environment = self.scenario.environment
        if self.scenario.measured is not None or environment is None:
            reason = "it has no table [environment]" if environment is None else "it is measured"
            raise SpecError(f"{self.scenario.id}: no environment can be made of this scenario; {reason}.")
        system: System = self.scenario.system(n_lanes)
        self.system = system
        self.action_scale = environment.action_scale
        self.period_s = self.scenario.setup.timing.sampling_time_s
        # Commanded columns that the system does not log itself come first.
        ahead = [name for name in system.commanded if name not in system.columns]
        self.columns: tuple[str, ...] = (*ahead, *system.columns)
        self.commanded = np.column_stack([system.commanded[name] for name in ahead]) if ahead else None
        self.rewarded = self._rewarded(environment.reward)
        high = OBSERVATION_MARGIN * np.array([system.limits[name] for name in self.columns])
        self.observation_space = Box(-high, high, dtype=np.float64)
        self.action_space = Box(-1.0, 1.0, (len(system.action_names),), dtype=np.float32)

    def _rewarded(self, reward: str) -> tuple[Rewarded, ...]:
        """Return the measured columns of all axes that ``reward`` names, each with its reference."""
        columns, found = self.system.columns, dict[str, list[Rewarded]]()
        for name, reference in self.system.commanded.items():
            axis, _, quantity = name.partition("reference_")
            measured = f"{axis}{quantity}"
            if quantity and measured in columns:
                found.setdefault(quantity, []).append(Rewarded(measured, columns.index(measured), reference))
        if reward not in found:
            raise SpecError(
                f"{self.scenario.id}: environment.reward: '{reward}' is not measured beside its reference."
                f"{did_you_mean(reward, found)}"
            )
        return tuple(found[reward])

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
