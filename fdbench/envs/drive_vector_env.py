"""Many drives side by side as a Gymnasium vector environment."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, final

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils.seeding import np_random
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from fdbench.envs._interface import DEFAULT_TASK, Interface, check_options, checked_action, next_seed
from fdbench.envs._machine import put
from fdbench.errors import SpecError
from fdbench.scenario import Scenario
from fdbench.simulate.system import FloatArray

ActionArray = NDArray[np.float32]
BoolArray = NDArray[np.bool_]
Step = tuple[FloatArray, FloatArray, BoolArray, BoolArray, dict[str, Any]]


@final
class DriveVectorEnv(VectorEnv[FloatArray, ActionArray, NDArray[Any]]):
    """``num_envs`` lanes of one scenario; see `DriveEnv`, which each lane equals bit for bit.

    ## Seeds
    ``reset(seed=s)`` gives lane i the seed s + i; a sequence gives each lane its own. Without a seed, each lane goes on
    with the seeds that `DriveEnv` would draw.

    ## Episode End
    ``AutoresetMode.DISABLED``: lanes that are terminated or truncated are reset by
    ``reset(options={"reset_mask": terminated | truncated})``, which leaves the others as they are; a step before that
    is an error.

    ## Information
    Arrays of one value for each lane, with Gymnasium's masks ``_name`` of the lanes that they hold for.

    ## Arguments
    scenario : str, path or Scenario
        Of one that draws its machines or where they begin, every lane has a machine of its own: any feed drive, and a
        servo stage of which only the start is drawn.
    num_envs : int
    task : str
        What is rewarded; a file of `fdbench.envs.tasks`.

    ## Version History
    The version of an id is that of its scenario. v0: initial release.

    Examples
    --------
    >>> envs = DriveVectorEnv("ShakerControl-v0", num_envs=3)
    >>> observations, infos = envs.reset(seed=0)
    >>> observations, rewards, terminated, truncated, infos = envs.step(np.zeros((3, 1), dtype=np.float32))
    >>> rewards.shape, observations.shape == (3, len(envs.columns))
    ((3,), True)
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": AutoresetMode.DISABLED}  # noqa: RUF012

    def __init__(self, scenario: str | Path | Scenario, num_envs: int = 1, task: str = DEFAULT_TASK) -> None:
        if num_envs < 1:
            raise SpecError(f"num_envs: {num_envs} is too few; at least 1 is needed.")
        self.interface = Interface(scenario, task, num_envs)
        self.scenario, self.system = self.interface.scenario, self.interface.system
        self._lanes = self.interface.machines.lanes(self.system) if self.interface.machines.drawn else None
        self.columns = self.interface.columns
        self.num_envs = num_envs
        self.single_observation_space = self.interface.observation_space
        self.single_action_space = self.interface.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._roots: list[int | None] = [None] * num_envs
        self._drawing: dict[int, np.random.Generator] = {}
        n_actions = len(self.system.action_names)
        self._action = np.zeros(num_envs if n_actions == 1 else (n_actions, num_envs))
        self._all = np.ones(num_envs, dtype=np.bool_)
        self._over = self._all.copy()
        self._sample = np.zeros(num_envs, dtype=np.intp)
        self._together = True  # whether all lanes are at the same sample
        self._observations = np.tile(self.interface.at_rest(), (num_envs, 1))

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Put all lanes, or those of ``options["reset_mask"]``, back to rest."""
        check_options(options, ("reset_mask",))
        mask = self._mask((options or {}).get("reset_mask", self._all))
        super().reset(seed=seed if isinstance(seed, int) else None)
        lanes = np.flatnonzero(mask)
        seeds = self._seeds(seed, lanes.tolist())
        machines = self.interface.machines
        drawn = [machines.of(lane_seed) for lane_seed in seeds]
        self._observations = self._observations.copy()
        self._observations[lanes] = self.interface.at_rest()
        if self._lanes is not None:
            for lane, machine in zip(lanes.tolist(), drawn, strict=True):
                one = machines.lanes(machines.system(machine))
                put(self._lanes, lane, one)
                self._observations[lane] = one.at_rest
        self.system.start(seeds, None if mask.all() else lanes)
        self.interface.task.start(drawn, lanes)
        self._sample[lanes] = 0
        self._together = bool((self._sample == self._sample[0]).all())
        self._over = self._over & ~mask
        truth = {name: np.zeros(self.num_envs) for name in self.system.truth_columns}
        return self._observations, self._infos(truth, np.zeros(self.num_envs), mask)

    def step(self, actions: ActionArray) -> Step:
        """Advance all lanes by one sampling time; see the data sheet of `DriveEnv`."""
        if np.count_nonzero(self._over):  # faster than any()
            raise ResetNeeded(f"{self.scenario.id}: lanes {np.flatnonzero(self._over).tolist()[:8]} need a reset.")
        given = checked_action(self.scenario.id, actions, self.action_space.shape).T.reshape(self._action.shape)
        np.multiply(given, self.interface.action_scale, out=self._action)
        rows = self.system.advance(1, self._action)[0]
        k = int(self._sample[0]) if self._together else self._sample.copy()
        self._sample += 1
        n = len(self.system.columns)
        # Lanes stay innermost in memory: to turn 1024 of them takes 7 us.
        observations = rows[:n].T
        if self.interface.commanded is not None:
            ahead = self.interface.commanded[k].reshape(-1, len(self.columns) - n)
            observations = np.vstack((np.broadcast_to(ahead, (self.num_envs, ahead.shape[1])).T, rows[:n])).T
        self._observations = observations
        truth = dict(zip(self.system.truth_columns, rows[n:], strict=True))
        rewards = self.interface.task.reward(k, rows, self._action.reshape(-1, self.num_envs))
        terminated = truth["diverged"] > 0.5
        truncated = self._sample == self.system.n_samples
        self._over = terminated | truncated
        time_s = np.full(self.num_envs, k * self.interface.period_s)
        return observations, rewards, terminated, truncated, self._infos(truth, time_s, self._all)

    def _infos(self, truth: dict[str, FloatArray], time_s: FloatArray, mask: BoolArray) -> dict[str, Any]:
        masks = {f"_{name}": mask for name in truth}
        return {"truth": truth | masks, "_truth": mask, "time_s": time_s, "_time_s": mask}

    def _mask(self, mask: Any) -> BoolArray:
        found: BoolArray = np.asarray(mask)
        if found.dtype != np.bool_ or found.shape != (self.num_envs,) or not found.any():
            raise SpecError(f"reset_mask: {self.num_envs} booleans, at least one of them true, are expected.")
        return found

    def _seeds(self, seed: int | Sequence[int | None] | None, lanes: list[int]) -> list[int]:
        """Return the seeds of the lanes to be reset, as scalar environments would have them."""
        if seed is None or isinstance(seed, int):
            given = [None if seed is None else seed + lane for lane in range(self.num_envs)]
        else:
            given = list(seed)
        if len(given) != self.num_envs:
            raise SpecError(f"seed: {self.num_envs} are expected, one for each lane, found {len(given)}.")
        return [self._seed(lane, given[lane]) for lane in lanes]

    def _seed(self, lane: int, given: int | None) -> int:
        if given is not None:
            self._roots[lane] = given
            self._drawing.pop(lane, None)
            return given
        if lane not in self._drawing:
            self._drawing[lane] = np_random(self._roots[lane])[0]
        return next_seed(self._drawing[lane])
