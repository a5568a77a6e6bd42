"""Shared checks of environments, beyond Gymnasium's own, which step once: bits, seeds, lanes and the record."""

import copy
import pickle
import random
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import repeat
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils.env_checker import check_env as gymnasium_check
from gymnasium.vector import VectorEnv

from fdbench.checks._report import run_checks
from fdbench.envs import register_all
from fdbench.errors import PluginError
from fdbench.scenario import Scenario
from fdbench.simulate.system import Noise

STEPS = 200
LONGEST = 8_000  # samples of a record that are compared
MANY_LANES = {70: (0, 1, 63, 64, 69), 3: (0, 1, 2)}  # number of lanes, and those that are compared
Env = gymnasium.Env[Any, Any]
Step = tuple[Any, ...]  # observation, reward, terminated, truncated, info


@dataclass(frozen=True)
class Subject:
    """An environment as its checks need it: new instances without wrappers, and lanes side by side."""

    name: str
    make: Callable[[], Env]
    make_vector: Callable[[int], VectorEnv[Any, Any, Any]] | None
    scenario: Scenario | None

    def channels(self) -> tuple[str, ...]:
        """Return the names of an observation's columns."""
        env = self.make()
        return tuple(getattr(env, "columns", [f"column {n}" for n in range(np.prod(env.observation_space.shape or 1))]))


def subject(env: str | Env) -> Subject:
    """Return what the checks need of an environment, given by its id or itself."""
    register_all()
    made: Env = gymnasium.make(env).unwrapped if isinstance(env, str) else env.unwrapped
    spec = made.spec
    scenario = getattr(made, "scenario", None)
    if spec is None:
        return Subject(type(made).__name__, lambda: copy.deepcopy(made), None, scenario)

    def make_vector(num_envs: int) -> VectorEnv[Any, Any, Any]:
        return gymnasium.make_vec(spec, num_envs=num_envs, vectorization_mode="vector_entry_point")

    def make() -> Env:
        return gymnasium.make(spec).unwrapped

    return Subject(spec.id, make, make_vector if spec.vector_entry_point else None, scenario)


def actions_of(env: Env, n: int, seed: int = 0) -> list[Any]:
    """Return ``n`` random actions."""
    space = copy.deepcopy(env.action_space)
    space.seed(seed)
    return [space.sample() for _ in range(n)]


def run(env: Env, seed: int | None, actions: Sequence[Any]) -> list[Step]:
    """Return the reset, with an empty reward and ends, and the steps until the episode ends."""
    observation, info = env.reset(seed=seed)
    return [(observation, 0.0, False, False, info), *go_on(env, actions)]


def go_on(env: Env, actions: Sequence[Any]) -> list[Step]:
    """Return further steps until the episode ends."""
    steps: list[Step] = []
    for action in actions:
        steps.append(env.step(action))
        if steps[-1][2] or steps[-1][3]:
            break
    return steps


def lane(steps: Sequence[Step], index: int) -> list[Step]:
    """Return the steps of one lane of a vector environment."""

    def pick(value: Any) -> Any:
        if isinstance(value, dict):
            return {name: pick(item) for name, item in value.items() if not name.startswith("_")}
        return value[index]

    return [tuple(pick(part) for part in step) for step in steps]


def run_lanes(envs: VectorEnv[Any, Any, Any], actions: Sequence[Any]) -> list[Step]:
    """Return the steps of all lanes until one of them ends."""
    steps: list[Step] = []
    for action in actions:
        steps.append(envs.step(action))
        if np.any(steps[-1][2]) or np.any(steps[-1][3]):
            break
    return steps


def same(found: Sequence[Step], expected: Sequence[Step], channels: Sequence[str], what: str) -> None:
    """Raise a PluginError at the first step and channel in which two runs differ in a bit."""
    for k, (a, b) in enumerate(zip(found, expected, strict=False)):
        x, y = np.ravel(a[0]), np.ravel(b[0])
        parts = [
            *zip(channels, x, y, strict=True),
            *zip(("reward", "terminated", "truncated"), a[1:4], b[1:4], strict=True),
        ]
        parts += [("time_s", a[4].get("time_s"), b[4].get("time_s"))]
        truth = a[4].get("truth", {}), b[4].get("truth", {})
        parts += [(f"truth of {name}", truth[0].get(name), truth[1].get(name)) for name in {**truth[0], **truth[1]}]
        for name, value, wanted in parts:
            if not (value == wanted or (value != value and wanted != wanted)):
                raise PluginError(f"{what}: step {k}: {name} is {value!r} in place of {wanted!r}.")
    if len(found) != len(expected):
        raise PluginError(f"{what}: the episode ends after {len(found)} steps in place of {len(expected)}.")


def follows_gymnasium(s: Subject) -> None:
    """Gymnasium's own check passes without a warning."""
    env = s.make()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            gymnasium_check(env, skip_render_check=env.spec is None)
    except (AssertionError, TypeError, ValueError, Warning, gymnasium.error.Error) as error:
        raise PluginError(f"gymnasium.utils.env_checker.check_env: {error}") from error


def repeats_under_a_seed(s: Subject) -> None:
    """Two instances with the same seed and actions give the same bits in many steps."""
    actions = actions_of(s.make(), STEPS)
    same(run(s.make(), 7, actions), run(s.make(), 7, actions), s.channels(), "a second run with the same seed")


def depends_on_the_seed(s: Subject) -> None:
    """Another seed gives another noise, if the scenario has any."""
    if s.scenario is None or s.scenario.reality.noise == Noise():
        return
    actions = actions_of(s.make(), STEPS)
    first, second = run(s.make(), 1, actions), run(s.make(), 2, actions)
    if all(np.array_equal(a[0], b[0]) for a, b in zip(first, second, strict=False)):
        raise PluginError(f"the scenario has noise, but seeds 1 and 2 give the same {len(first)} observations.")


def forgets_on_reset(s: Subject) -> None:
    """One instance, reset with seeds A, B and A again, gives the first run again."""
    env = s.make()
    actions = actions_of(env, STEPS)
    first = run(env, 1, actions)
    run(env, 2, actions[: STEPS // 3])
    same(run(env, 1, actions), first, s.channels(), "after another episode, the same seed")


def goes_on_without_a_seed(s: Subject) -> None:
    """Without a seed, resets go on with a sequence that the last seed determines."""
    actions = actions_of(s.make(), STEPS // 4)
    one, two = s.make(), s.make()
    for env in (one, two):
        run(env, 5, actions)
    for _ in range(2):
        same(run(one, None, actions), run(two, None, actions), s.channels(), "a reset without seed after seed 5")


def keeps_instances_apart(s: Subject) -> None:
    """Two instances stepped in turn give what each gives alone."""
    one, two = s.make(), s.make()
    actions = actions_of(one, STEPS)
    alone = run(s.make(), 1, actions), run(s.make(), 2, actions)
    first, second = run(one, 1, []), run(two, 2, [])
    for action in actions[: min(len(alone[0]), len(alone[1])) - 1]:
        first.append(one.step(action))
        second.append(two.step(action))
    for found, expected in ((first, alone[0]), (second, alone[1])):
        same(found, expected[: len(found)], s.channels(), "beside another instance")


def can_be_copied(s: Subject) -> None:
    """In the middle of an episode, a pickled and a deep copy go on like the original."""
    env = s.make()
    actions = actions_of(env, STEPS)
    run(env, 3, actions[: STEPS // 2])
    try:
        pickled, deep = pickle.loads(pickle.dumps(env)), copy.deepcopy(env)
    except Exception as error:
        raise PluginError(f"an environment in the middle of an episode cannot be copied: {error!r}.") from error
    rest = go_on(env, actions[STEPS // 2 :])
    same(go_on(pickled, actions[STEPS // 2 :]), rest, s.channels(), "a pickled copy")
    same(go_on(deep, actions[STEPS // 2 :]), rest, s.channels(), "a deep copy")


def leaves_global_random_state(s: Subject) -> None:
    """Neither NumPy's nor Python's global random numbers are used."""

    def state() -> bytes:
        return pickle.dumps((np.random.get_state(), random.getstate()))  # noqa: NPY002 - it must stay as it is

    before = state()
    env = s.make()
    run(env, 4, actions_of(env, 20))
    if state() != before:
        raise PluginError("the global random state has changed; draw from generators of your own.")


def stays_in_its_space(s: Subject) -> None:
    """Observations lie in their space and all parts of a step have their types, at any actions."""
    env = s.make()
    space, channels = env.observation_space, s.channels()
    extremes = [list(repeat(bound, STEPS)) for bound in (env.action_space.low, env.action_space.high)]  # type: ignore[attr-defined]
    for actions in (actions_of(env, STEPS), *extremes):
        for k, (observation, reward, terminated, truncated, info) in enumerate(run(env, 0, actions)):
            if observation.dtype != space.dtype or observation.shape != space.shape:
                raise PluginError(f"step {k}: observation of {observation.dtype}, {space.dtype} is declared.")
            outside = ~((observation >= space.low) & (observation <= space.high))  # type: ignore[attr-defined]
            if outside.any():
                n = int(np.argmax(outside))
                raise PluginError(f"step {k}: {channels[n]} = {observation[n]:g} is outside the observation space.")
            kinds = type(reward), type(terminated), type(truncated), type(info)
            if kinds != (float, bool, bool, dict) or not np.isfinite(reward):
                raise PluginError(
                    f"step {k}: reward {reward!r}, terminated {terminated!r}, truncated {truncated!r}: a finite float "
                    "and two booleans are expected, and a dictionary as information."
                )


def zero_action_is_the_record(s: Subject) -> None:
    """Zero actions give the published record and truth, bit for bit, and end with it if it is not very long."""
    if s.scenario is None:
        return
    env, channels = s.make(), s.channels()
    record, truth = s.scenario.observe(11)
    n_samples = len(record["time_s"])
    n = min(n_samples, LONGEST)
    steps = run(env, 11, [np.zeros(env.action_space.shape, env.action_space.dtype)] * n)[1:]
    if len(steps) != n or steps[-1][2] or steps[-1][3] != (n == n_samples):
        raise PluginError(
            f"after {len(steps)} steps terminated, truncated = {steps[-1][2:4]}; {n_samples} are expected."
        )
    seen = dict(zip(channels, np.array([step[0] for step in steps]).T, strict=True))
    seen["time_s"] = np.array([step[4]["time_s"] for step in steps])
    expected = {name: record[name] for name in (*channels, "time_s")}
    if truth.disturbance_N is not None:
        seen["disturbance_N"] = np.array([step[4]["truth"]["disturbance_N"] for step in steps])
        expected["disturbance_N"] = truth.disturbance_N
    for name, values in expected.items():
        if not np.array_equal(seen[name], values[:n]):
            k = int(np.argmax(seen[name] != values[:n]))
            raise PluginError(f"step {k}: {name} is {seen[name][k]!r}; the record has {values[k]!r}.")
    if n < n_samples:
        return
    try:
        env.step(env.action_space.sample())
    except gymnasium.error.ResetNeeded:
        return
    raise PluginError(f"a step after the end of the episode, step {n_samples}, was accepted.")


def every_action_is_seen(s: Subject) -> None:
    """Each action alone changes what is observed, and no two of them in the same way."""
    space: Any = s.make().action_space
    alone = np.diag(np.ravel(space.high)).reshape(-1, *space.shape).astype(space.dtype)
    zero = np.zeros(space.shape, space.dtype)
    runs = [[step[0] for step in run(s.make(), 0, [action] * STEPS)] for action in (zero, *alone)]
    for n, second in enumerate(runs):
        for m, first in enumerate(runs[:n]):
            if all(np.array_equal(a, b) for a, b in zip(first, second, strict=False)):
                other = f"action {m - 1}" if m else "no action"
                raise PluginError(f"action {n - 1} gives the same observations as {other} in {STEPS} steps.")


def lanes_equal_single_runs(s: Subject) -> None:
    """Lane i of a vector environment equals the environment with seed + i, bit for bit."""
    for n, compared in MANY_LANES.items():
        if s.make_vector is None:
            return
        envs = s.make_vector(n)
        actions = actions_of(envs, STEPS + 100)  # type: ignore[arg-type]
        observation, info = envs.reset(seed=20)
        empty = np.zeros(n), np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
        steps = [(observation, *empty, info), *run_lanes(envs, actions)]
        for index in compared:
            single = run(s.make(), 20 + index, [action[index] for action in actions[: len(steps) - 1]])
            same(lane(steps, index), single, s.channels(), f"lane {index} of {n}")


def resets_by_mask(s: Subject) -> None:
    """By mask, lanes are reset with their seeds, or without, and the others left as they are."""
    for n, compared in MANY_LANES.items():
        if s.make_vector is None:
            return
        envs, again, other = s.make_vector(n), compared[-1], compared[0]
        actions = actions_of(envs, STEPS)  # type: ignore[arg-type]
        mask = np.arange(n) == again
        envs.reset(seed=20)
        first = run_lanes(envs, actions[:40])
        seeds: Any = [900 + i for i in range(n)]
        observation, _ = envs.reset(seed=seeds, options={"reset_mask": mask})
        second = run_lanes(envs, actions[40:])
        envs.reset(options={"reset_mask": mask})
        third = run_lanes(envs, actions[:40])
        if not np.array_equal(observation[other], first[-1][0][other]):
            raise PluginError(f"lane {other} of {n}: a reset of lane {again} changed its observation.")
        kept = [action[other] for action in (*actions[: len(first)], *actions[40 : 40 + len(second)])]
        single = run(s.make(), 20 + other, kept)[1:]
        same(lane([*first, *second], other), single, s.channels(), f"lane {other} of {n}, beside a reset lane")
        env = s.make()
        single = run(env, 900 + again, [action[again] for action in actions[40 : 40 + len(second)]])[1:]
        same(lane(second, again), single, s.channels(), f"lane {again} of {n}, reset by mask")
        single = run(env, None, [action[again] for action in actions[: len(third)]])[1:]
        same(lane(third, again), single, s.channels(), f"lane {again} of {n}, reset by mask without seed")


CHECKS: tuple[Callable[[Subject], None], ...] = (
    follows_gymnasium,
    repeats_under_a_seed,
    depends_on_the_seed,
    forgets_on_reset,
    goes_on_without_a_seed,
    keeps_instances_apart,
    can_be_copied,
    leaves_global_random_state,
    stays_in_its_space,
    zero_action_is_the_record,
    every_action_is_seen,
    lanes_equal_single_runs,
    resets_by_mask,
)


def check_env(env_id_or_env: str | Env) -> list[str]:
    """Run all checks on an environment and return a line for each.

    Raises
    ------
    PluginError
        If a check fails; the message names channel and step.
    """
    checked = subject(env_id_or_env)
    return run_checks(checked.name, [(check.__name__, partial(check, checked)) for check in CHECKS])
