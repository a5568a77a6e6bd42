"""One drive as a Gymnasium environment."""

from collections import deque
from pathlib import Path
from typing import Any, ClassVar, final

import gymnasium
import numpy as np
from gymnasium.error import InvalidAction, ResetNeeded
from numpy.typing import NDArray

from fdbench.envs._interface import check_options, interface, open_scenario
from fdbench.envs._picture import Picture
from fdbench.scenario import Scenario
from fdbench.simulate.system import FloatArray

ActionArray = NDArray[np.float32]


@final
class DriveEnv(gymnasium.Env[FloatArray, ActionArray]):
    def __init__(self, scenario: str | Path | Scenario, render_mode: str | None = None) -> None:
        self.scenario = open_scenario(scenario)
        self.system = self.scenario.system()
        self.render_mode = render_mode
        face = interface(self.scenario, self.system)
        self.observation_space, self.action_space = face.observation_space, face.action_space
        self.columns = face.columns
        self._action_scale = face.action_scale
        self._action = np.zeros(1)
        self._commanded = face.commanded.tolist()
        self._reference, self._measured = face.reference_column, face.measured_column
        self._n_measured = len(self.system.columns)
        self._truths = self.system.truth_columns
        self._diverged = self._n_measured + self._truths.index("diverged")
        self._period = self.scenario.setup.timing.sampling_time_s
        self._n_samples = self.system.n_samples
        self._sample = self._n_samples  # needs a reset

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        super().reset(seed=seed)
        self.system.start([int(self.np_random.integers(2**31)) if seed is None else seed])
        self._sample = 0
        observation = np.concatenate((self._commanded[0], self.system.at_rest))
        return observation, {"truth": dict.fromkeys(self._truths, 0.0), "time_s": 0.0}

    def step(self, action: ActionArray):
        k = self._sample
        if k >= self._n_samples:
            raise ResetNeeded("x")
        value = float(action[0])
        if not -1.0 <= value <= 1.0:
            raise InvalidAction(f"action {value:g} is outside [-1, 1].")
        self._action[0] = value * self._action_scale
        row = self.system.advance(1, self._action).ravel().tolist()
        commanded = self._commanded[k]
        error = commanded[self._reference] - row[self._measured]
        terminated = row[self._diverged] > 0.5
        self._sample = self._n_samples if terminated else k + 1
        n = self._n_measured
        observation = np.array(commanded + row[:n])
        info = {"truth": dict(zip(self._truths, row[n:])), "time_s": k * self._period}
        return observation, -error * error, terminated, k + 1 == self._n_samples, info
