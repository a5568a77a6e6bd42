"""One drive as a Gymnasium environment."""

from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar, final

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from fdbench.envs._interface import DEFAULT_TASK, Interface, check_options, checked_action, next_seed
from fdbench.envs._picture import AMBER, GREEN, RED, WINDOW_S, Trace, draw, draw_plane
from fdbench.errors import SpecError, did_you_mean
from fdbench.scenario import Scenario
from fdbench.simulate.system import FloatArray
from fdbench.units import split_unit

ActionArray = NDArray[np.float32]


@final
class DriveEnv(gymnasium.Env[FloatArray, ActionArray]):
    r"""A simulated scenario, one sampling time a step.

    ## Description
    The drive follows the scenario's own command under its own controller, with all effects that the scenario names.
    The action deviates from that command, so that zero actions give the published trial: step k returns row k of
    ``scenario.observe(seed)``, bit for bit. As in a numeric control, the reading of a sample is taken before the
    sample's action has moved anything; an action is seen in the readings one step later.

    ## Action Space
    `Box(-1, 1, (n_actions,), float32)`, with one action for each command of ``system.action_names``: two for the XY
    stage, else one.

    | number | action | min | max | 1 means |
    | --- | --- | --- | --- | --- |
    | i | deviation of the command ``system.action_names[i]`` | -1 | 1 | ``environment.action_scale`` of the scenario |

    ## Observation Space
    `Box(-h, h, (n,), float64)` in SI units; the names are in ``columns``, h is twice the limit of the plant for each.
    For a feed drive:

    | observation | bound |
    | --- | --- |
    | ``reference_position_m``, ``motor_position_m``, ``table_position_m`` (elastic axis), ``position_m`` | travel |
    | ``reference_velocity_m_per_s``, ``velocity_m_per_s`` | velocity limit |
    | ``motor_force_N``, ``motor_torque_Nm`` or ``motor_current_A``: command at the motor | force limit |

    ## Rewards
    Those of the task: ``tracking``, unless another one is named, is :math:`-(r_k - y_k)^2` for the column that
    ``environment.reward`` of the scenario names, in its unit squared; the XY stage has the sum over both axes.

    ## Starting State
    At rest at the start of the reference, or as ``[start]`` of the scenario says. The seed of ``reset`` is that of
    every random stream of the episode and, for a scenario that draws its machine or its start, of these; without one,
    seeds are drawn from ``np_random``. The first observation is the drive in that state, without noise.

    ## Episode End
    Terminated when the drive leaves its travel or velocity limit; truncated after the last sample of the scenario, so
    that an episode has a fixed number of steps, ``system.n_samples``. A step beyond the end asks for a reset.

    ## Information
    ``info["truth"]`` holds what only the simulation knows, such as ``disturbance_N`` over the sample; it is there for
    scoring only. ``info["time_s"]`` is the time of the reading, 0 after a reset. True parameters are in
    ``scenario.observe(seed)[1]``.

    ## Arguments
    scenario : str, path or Scenario
        Id, TOML file, or the scenario itself.
    task : str
        What is rewarded; a file of `fdbench.envs.tasks`.
    render_mode : {"rgb_array"}, optional
        A picture of 640 x 360 pixels: drive or path, command at the motor, and the last two seconds.

    ## Version History
    The version of an id is that of its scenario. v0: initial release.

    Examples
    --------
    >>> env = DriveEnv("ShakerControl-v0")
    >>> observation, info = env.reset(seed=0)
    >>> observation, reward, terminated, truncated, info = env.step(np.zeros(1, dtype=np.float32))
    >>> env.columns[0], float(observation[0])
    ('reference_position_m', 0.0)
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 30}  # type: ignore[misc]

    def __init__(
        self, scenario: str | Path | Scenario, render_mode: str | None = None, task: str = DEFAULT_TASK
    ) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise SpecError(f"render_mode: unknown '{render_mode}'.{did_you_mean(render_mode, ['rgb_array'])}")
        self.interface = Interface(scenario, task)
        self.scenario = self.machine = self.interface.scenario
        self.columns = self.interface.columns
        self.observation_space = self.interface.observation_space
        self.action_space = self.interface.action_space
        self.render_mode = render_mode
        self._period_s = self.interface.period_s
        self._history: deque[list[float]] | None = None
        if render_mode is not None:
            self._history = deque(maxlen=max(2, round(WINDOW_S / self._period_s)))
        self._bind()
        self._n_samples = self._sample = self.system.n_samples

    def _bind(self) -> None:
        """Gather what a step needs of the present system."""
        interface, system = self.interface, self.interface.system
        self.system, self._commanded, n = system, interface.commanded, len(system.columns)
        self._truths = tuple((name, n + index) for index, name in enumerate(system.truth_columns))
        diverged = n + system.truth_columns.index("diverged")
        advance_one = system.advance_one if len(system.action_names) == 1 else None
        self._needed = advance_one, interface.action_scale, interface.task.reward, diverged, self._truths

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Put the drive back to its start; see Starting State."""
        super().reset(seed=seed)
        check_options(options)
        seed = next_seed(self.np_random) if seed is None else seed
        interface, machines = self.interface, self.interface.machines
        if machines.drawn:
            self.machine = machines.of(seed)
            interface.use(machines.system(self.machine))
            self._bind()
        self.system.start([seed])
        interface.task.start([self.machine], np.zeros(1, dtype=np.intp))
        self._sample = 0
        if self._history is not None:
            self._history.clear()
        return interface.at_rest(), {"truth": dict.fromkeys(self.system.truth_columns, 0.0), "time_s": 0.0}

    def step(self, action: ActionArray) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        """Advance by one sampling time; see the data sheet of the class."""
        k = self._sample
        if k >= self._n_samples:
            raise ResetNeeded(f"{self.scenario.id}: no episode is running; call reset() before step().")
        advance_one, scale, reward_of, diverged, truths = self._needed
        deviation: Sequence[float]
        if advance_one is not None:
            try:
                (value,) = action.tolist()
                valid = type(value) is float and -1.0 <= value <= 1.0
            except (AttributeError, TypeError, ValueError):
                valid = False
            if not valid:
                (value,) = self._checked(action).tolist()
            deviation = (value * scale,)
            observation, row = advance_one(deviation[0])
        else:
            scaled = self._checked(action) * scale
            deviation, whole = scaled.tolist(), self.system.advance(1, scaled[:, None]).ravel()
            observation, row = whole[: len(self.system.columns)], whole.tolist()
        reward = reward_of(k, row, deviation)
        terminated = row[diverged] > 0.5
        if self._history is not None:
            self._history.append([k, *row])
        if self._commanded is not None:
            observation = np.concatenate((self._commanded[k], observation))
        truth = {}
        for name, place in truths:  # a comprehension would be a call
            truth[name] = row[place]
        info = {"truth": truth, "time_s": k * self._period_s}
        k += 1
        self._sample = self._n_samples if terminated else k
        return observation, reward, terminated, k == self._n_samples, info

    def _checked(self, action: ActionArray) -> FloatArray:
        return checked_action(self.scenario.id, action, self.action_space.shape)

    def render(self) -> NDArray[np.uint8] | None:
        """Return the picture as a (360, 640, 3) array."""
        if self._history is None:
            gymnasium.logger.warn("render() needs render_mode='rgb_array' at construction.")
            return None
        system, rewarded = self.system, self.interface.rewarded
        rest = [0.0, *system.at_rest.tolist(), *(0.0 for _ in self._truths)]
        rows = np.array(self._history or [rest])
        columns = dict(zip((*system.columns, *system.truth_columns), rows.T[1:], strict=True))
        k = rows[:, 0].astype(np.intp)
        title, width = f"{self.scenario.id}   {k[-1] * self._period_s:.3f} s", self._history.maxlen or len(k)
        errors = [Trace(f"error_of_{item.name}", item.reference[k] - columns[item.name], RED) for item in rewarded]
        if len(rewarded) == 2:
            path = np.column_stack([columns[item.name] for item in rewarded])
            whole = np.column_stack([item.reference for item in rewarded])
            return draw_plane(title, (path, whole, int(k[-1])), errors, width)
        shown = "position_m" if "reference_position_m" in system.commanded else rewarded[0].name
        reference = system.commanded[f"reference_{shown}"]
        room = 0.05 * float(np.ptp(reference)) or system.limits[shown]
        span = float(reference.min()) - room, float(reference.max()) + room
        forces = [name for name in system.columns if split_unit(name)[1] in ("N", "Nm", "A")]
        bar = [*forces, system.columns[-1]][0]
        traces = [Trace(bar, columns[bar], AMBER), *errors]
        if "disturbance_N" in columns:
            traces.append(Trace("disturbance_N", columns["disturbance_N"], GREEN))
        return draw(title, (float(columns[shown][-1]), float(reference[k[-1]]), span), traces, width)
