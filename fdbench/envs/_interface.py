"""What scalar and vector environment share: the scenario, its spaces and the columns of its reward."""

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


@dataclass(frozen=True, kw_only=True)
class Interface:
    """One scenario seen through Gymnasium.

    Attributes
    ----------
    commanded : (n_samples, n_commanded) array
        First columns of each observation; those that are measured follow.
    columns : tuple of str
        Names of the columns of an observation.
    reference_column, measured_column : int
        Columns of ``commanded`` and of the system whose difference the reward squares.
    action_scale : float
        Deviation from the command at action 1.
    """

    observation_space: Box
    action_space: Box
    commanded: FloatArray
    columns: tuple[str, ...]
    reference_column: int
    measured_column: int
    action_scale: float


def open_scenario(scenario: str | Path | Scenario) -> Scenario:
    """Return a simulated scenario with a table ``[environment]``, given by id, path or itself.

    Raises
    ------
    SpecError
        If the scenario is measured, or does not say what an action means.
    """
    opened = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
    if opened.measured is not None:
        raise SpecError(f"{opened.id}: a measured scenario is no environment; there is nothing to act on.")
    if opened.environment is None:
        raise SpecError(f"{opened.id}: missing table [environment], which gives action_scale and reward.")
    return opened


def interface(scenario: Scenario, system: System) -> Interface:
    """Return spaces and columns of the environment of ``scenario``."""
    environment = scenario.environment
    if environment is None:
        raise SpecError(f"{scenario.id}: missing table [environment].")
    measured, reference = environment.reward, f"reference_{environment.reward}"
    if measured not in system.columns or reference not in system.commanded:
        allowed = [name for name in system.columns if f"reference_{name}" in system.commanded]
        raise SpecError(
            f"{scenario.id}: environment.reward: '{measured}' is not measured beside a reference of its own."
            f"{did_you_mean(measured, allowed)}"
        )
    columns = (*system.commanded, *system.columns)
    high = OBSERVATION_MARGIN * np.array([system.limits[name] for name in columns])
    return Interface(
        observation_space=Box(-high, high, dtype=np.float64),
        action_space=Box(-1.0, 1.0, (1,), dtype=np.float32),
        commanded=np.column_stack(list(system.commanded.values())),
        columns=columns,
        reference_column=list(system.commanded).index(reference),
        measured_column=system.columns.index(measured),
        action_scale=environment.action_scale,
    )


def check_options(options: Mapping[str, Any] | None, allowed: tuple[str, ...] = ()) -> None:
    """Raise a SpecError at the first option of a reset that has no meaning."""
    for name in options or ():
        if name not in allowed:
            raise SpecError(f"reset: unknown option '{name}'.{did_you_mean(name, allowed)}")
