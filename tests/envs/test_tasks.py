"""Tasks reward what they say, drawn machines are those of the records, and wrong actions are told apart."""

import dataclasses
import importlib.util
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import InvalidAction

from fdbench.checks import check_env
from fdbench.checks.check_env import Subject, actions_of, run, subject
from fdbench.draw import Uniform
from fdbench.envs import DRAWN_NAMESPACE, environment_ids
from fdbench.envs.drive_env import DriveEnv
from fdbench.envs.drive_vector_env import DriveVectorEnv
from fdbench.envs.tasks.identification import UNDRAWN_DEVIATION
from fdbench.errors import SpecError, UnknownName
from fdbench.record import Record
from fdbench.scenario import Reality, load_scenario, scenario_ids
from fdbench.simulate import compose
from fdbench.simulate.system import Noise

REPOSITORY = Path(__file__).resolve().parents[2]
DRAWN = "fdbench-drawn/ShakerConstant-v2"
N = 300


def rewards_and_rows(env: DriveEnv, actions: list[Any], seed: int = 4) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return the reward of each step, and the observations by column."""
    steps = run(env, seed, actions)[1:]
    rows = np.array([step[0] for step in steps])
    return np.array([step[1] for step in steps]), dict(zip(env.columns, rows.T, strict=True))


# ---- tasks

STANDING_STILL = '''"""Stand still."""

from fdbench.envs.tasks import Task


class StandingStill(Task):
    """Minus the speed."""

    unit = "m/s"

    @classmethod
    def unfit(cls, scenario, system):
        return None

    def reward(self, k, row, action):
        return -abs(row[self.system.columns.index("velocity_m_per_s")])
'''


@pytest.mark.parametrize("name", ["MillingAir-v0", "ShakerControl-v2"])
def test_identification_rewards_the_information_of_the_regression(name: str) -> None:
    env = DriveEnv(name, task="identification")
    actions = actions_of(env, N)
    rewards, seen = rewards_and_rows(env, actions)
    machine, period = env.machine, env.interface.period_s
    seen["reference_velocity_m_per_s"] = (
        seen["reference_velocity_m_per_s"] + env.interface.action_scale * np.array(actions, dtype=float).ravel()
    )
    record = Record({"time_s": np.arange(N) * period, **seen}, {}, name)
    Z = machine.linear_model.regression(record).regressors
    prior = env.scenario.context().covariance
    if prior is None:
        nominal = np.array(list(env.scenario.linear_model.nominal_parameters(period).values()))
        prior = np.diag((UNDRAWN_DEVIATION * nominal) ** 2)
    # det(1 + P Z^T Z / sigma^2) is det F_n / det F_0, also where P is singular.
    sigma = machine.reality.noise.equation_velocity_m_per_s
    sign, expected = np.linalg.slogdet(np.eye(len(prior)) + prior @ (Z.T @ Z) / sigma**2)
    assert sign == 1.0
    assert rewards[: N - 1].sum() == pytest.approx(expected, rel=1e-8)
    assert (rewards > 0.0).all()


def test_moving_tells_more_than_the_published_trial_at_rest() -> None:
    env = DriveEnv("ShakerConstant-v0", task="identification")
    still, _ = rewards_and_rows(env, [np.zeros(1, dtype=np.float32)] * 100)
    moving, _ = rewards_and_rows(env, [np.float32([(-1.0) ** (k // 10)]) for k in range(100)])
    assert moving.sum() > still.sum() + 1.0


@pytest.mark.parametrize(
    ("name", "column", "factor"),
    [("ShakerConstant-v0", "velocity_m_per_s", 1e3), ("BallScrewAxis-v0", "position_m", 1e6)],
)
def test_disturbance_rejection_is_the_deviation_from_the_quiet_machine(name: str, column: str, factor: float) -> None:
    env = DriveEnv(name, task="disturbance_rejection")
    rewards, seen = rewards_and_rows(env, actions_of(env, N))
    scenario = load_scenario(name)
    kept = tuple(effect for effect in scenario.reality.effects if not effect.disturbance)
    assert len(kept) < len(scenario.reality.effects)
    quiet = dataclasses.replace(scenario, reality=Reality(effects=kept, noise=Noise()), validation=None)
    expected = quiet.record()[column][:N]
    np.testing.assert_allclose(rewards, -((factor * (expected - seen[column])) ** 2), rtol=1e-9)


def test_pre_compensation_of_one_axis_is_the_error_of_its_table() -> None:
    env = DriveEnv("BallScrewAxis-v0", task="pre_compensation")
    rewards, seen = rewards_and_rows(env, actions_of(env, N))
    np.testing.assert_allclose(rewards, -((1e6 * (seen["reference_position_m"] - seen["table_position_m"])) ** 2))


def test_pre_compensation_of_two_axes_is_the_distance_to_the_tangent() -> None:
    env = DriveEnv("ServoSpiral-v0", task="pre_compensation")
    rewards, seen = rewards_and_rows(env, actions_of(env, N))
    error = np.column_stack([seen[f"{axis}_reference_position_m"] - seen[f"{axis}_position_m"] for axis in "xy"])
    velocity = np.column_stack([seen[f"{axis}_reference_velocity_m_per_s"] for axis in "xy"])
    moving = np.hypot(*velocity.T) > 1e-3
    along = velocity[moving] / np.hypot(*velocity[moving].T)[:, None]
    across = error[moving] - (error[moving] * along).sum(axis=1)[:, None] * along
    # The task takes the direction of the path from its points, the velocities are exact.
    np.testing.assert_allclose(rewards[moving], -1e12 * (across**2).sum(axis=1), rtol=0.0, atol=2e-3 * -rewards.min())
    assert moving.sum() > N // 2


def test_a_task_that_does_not_fit_names_those_that_do() -> None:
    with pytest.raises(
        SpecError, match=r"'identification' does not fit: .* Tasks that fit: pre_compensation, tracking"
    ):
        gymnasium.make("fdbench/ServoSpiral-v0", task="identification")
    with pytest.raises(SpecError, match=r"is a disturbance.*Tasks that fit: identification, tracking"):
        DriveVectorEnv("ShakerControl-v0", 2, task="disturbance_rejection")
    with pytest.raises(SpecError, match="not to a commanded position"):
        DriveEnv("SlotMilling-v0", task="pre_compensation")
    with pytest.raises(UnknownName, match=r"unknown task 'trackin'\. Did you mean tracking"):
        DriveEnv("ShakerConstant-v0", task="trackin")


def test_a_task_in_a_file_is_found(tmp_path: Path) -> None:
    file = tmp_path / "standing_still.py"
    file.write_text(STANDING_STILL, "utf-8")
    env = DriveEnv("ShakerConstant-v0", task=str(file))
    rewards, seen = rewards_and_rows(env, actions_of(env, 20))
    assert np.array_equal(rewards, -np.abs(seen["velocity_m_per_s"]))


# ---- drawn machines


def test_every_drawn_scenario_with_an_environment_is_registered() -> None:
    scenarios = [load_scenario(name) for name in scenario_ids()]
    drawn = [f"{DRAWN_NAMESPACE}/{one.id}" for one in scenarios if one.environment is not None and one.draw]
    assert drawn
    assert environment_ids(DRAWN_NAMESPACE) == drawn


@pytest.mark.parametrize(
    "check",
    [
        check_env.zero_action_is_the_record,
        check_env.forgets_on_reset,
        check_env.can_be_copied,
        check_env.stays_in_its_space,
        check_env.lanes_equal_single_runs,
        check_env.resets_by_mask,
    ],
    ids=lambda check: check.__name__,
)
def test_drawn_environment(check: Callable[[Subject], None]) -> None:
    check(subject(DRAWN))


@pytest.mark.parametrize("name", ["ServoSpiral-v1", "SlotMilling-v2", "SensorNetwork-v1"])
def test_zero_actions_give_the_record_of_a_drawn_machine(name: str) -> None:
    env: Any = gymnasium.make(f"{DRAWN_NAMESPACE}/{name}")
    env.reset(seed=8)
    zero = np.zeros(env.action_space.shape, dtype=np.float32)
    steps = run(env.unwrapped, 5, [zero] * N)[1:]
    record, _ = env.unwrapped.scenario.observe(5)
    for column, values in zip(env.unwrapped.columns, np.array([step[0] for step in steps]).T, strict=True):
        assert np.array_equal(values, record[column][:N]), column
    assert all(step[0] in env.observation_space for step in steps)


@pytest.mark.parametrize("task", ["identification", "disturbance_rejection"])
def test_lanes_of_drawn_machines_have_their_own_rewards(task: str) -> None:
    envs = DriveVectorEnv("ShakerConstant-v2", 3, task=task)
    env = DriveEnv("ShakerConstant-v2", task=task)
    actions = actions_of(envs, 50)  # type: ignore[arg-type]
    envs.reset(seed=7)
    envs.step(actions[0])
    envs.reset(seed=[1, 2, 3], options={"reset_mask": np.array([False, True, True])})
    rewards = np.array([envs.step(action)[1] for action in actions])
    for lane, seed in ((1, 2), (2, 3)):
        assert np.array_equal(rewards_and_rows(env, [action[lane] for action in actions], seed)[0], rewards[:, lane])
    assert not np.array_equal(rewards[:, 1], rewards[:, 2])


def test_another_machine_is_not_another_compilation() -> None:
    env = DriveEnv("ShakerConstant-v2")
    env.reset(seed=0)
    masses, before = set(), compose._advance.cache_info().misses
    for seed in range(3):
        env.reset(seed=seed)
        assert env.machine.plant == env.scenario.drawn(seed).plant
        masses.add(env.machine.plant.mass_kg)
    assert len(masses) == 3
    assert compose._advance.cache_info().misses == before


def test_lanes_of_a_stage_cannot_be_different_machines() -> None:
    with pytest.raises(SpecError, match="vectorization_mode='sync'"):
        gymnasium.make_vec(f"{DRAWN_NAMESPACE}/ServoSpiral-v1", num_envs=2)
    envs = gymnasium.make_vec(f"{DRAWN_NAMESPACE}/ServoSpiral-v1", num_envs=2, vectorization_mode="sync")
    observation, _ = envs.reset(seed=3)
    assert observation.shape[0] == 2


def test_a_drawn_command_is_refused() -> None:
    draw = (Uniform(values=("motion.hold_s",), low=0.5, high=0.6),)
    scenario = dataclasses.replace(load_scenario("ShakerConstant-v0"), draw=draw)
    with pytest.raises(SpecError, match=r"'motion\.hold_s' cannot be drawn"):
        DriveEnv(scenario)


# ---- wrong actions


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ([0.5], r"found list \[0\.5\]"),
        ("left", "found str 'left'"),
        (None, "found NoneType"),
        (0.5, "found float"),
        (np.array(["left"]), "found the dtype <U4"),
        (np.array([1j]), "found the dtype complex128"),
        (np.array([True]), "found the dtype bool"),
        (np.array([None]), "found the dtype object"),
        (np.zeros(2, dtype=np.float32), r"shape \(1,\).*found the shape \(2,\)"),
        (np.zeros((), dtype=np.float32), r"found the shape \(\)"),
        (np.zeros((1, 1), dtype=np.float32), r"found the shape \(1, 1\)"),
        (np.array([np.nan]), "found nan, which is outside"),
        (np.array([-np.inf]), "found -inf, which is outside"),
        (np.array([2]), "found 2, which is outside"),
    ],
)
def test_a_wrong_action_is_told(action: Any, message: str) -> None:
    env = DriveEnv("ShakerControl-v0")
    env.reset(seed=0)
    with pytest.raises(InvalidAction, match=f"^ShakerControl-v0: action: .*{message}"):
        env.step(action)
    envs = DriveVectorEnv("ShakerControl-v0", 1)
    envs.reset(seed=0)
    lanes = action[None] if isinstance(action, np.ndarray) else action
    with pytest.raises(InvalidAction, match=r"^ShakerControl-v0: action: an array of shape"):
        envs.step(lanes)
    zero = np.zeros(1, dtype=np.float32)
    first = run(DriveEnv("ShakerControl-v0"), 0, [zero])[1]
    assert np.array_equal(env.step(zero)[0], first[0]), "the refused action has moved something"


def test_whole_numbers_are_actions() -> None:
    env, same = DriveEnv("ShakerControl-v0"), DriveEnv("ShakerControl-v0")
    runs = [run(each, 0, [np.array([1], dtype=kind)] * 20) for each, kind in ((env, np.int64), (same, np.float32))]
    assert all(np.array_equal(a[0], b[0]) for a, b in zip(*runs, strict=True))


# ---- without an import, and the examples


def test_gymnasium_imports_the_package_by_its_name() -> None:
    code = "import gymnasium; print(gymnasium.make('fdbench:fdbench/ShakerControl-v0').unwrapped.scenario.id)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "ShakerControl-v0\n"


@pytest.fixture(scope="module")
def policies() -> ModuleType:
    return example("reference_policies")


@pytest.fixture
def agent(policies: ModuleType, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.setitem(sys.modules, "reference_policies", policies)
    return example("learned_pre_compensation")


def example(name: str) -> ModuleType:
    file = REPOSITORY / "examples" / "learning" / f"{name}.py"
    specification = importlib.util.spec_from_file_location(name, file)
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.mark.parametrize("env_id", ["fdbench/ServoSpiral-v0", "fdbench/BallScrewAxis-v0"])
def test_policies_without_learning_beat_zero_action(policies: ModuleType, env_id: str) -> None:
    zero, inverse, learnt = policies.compare(env_id, seeds=[200], trials=1).values()
    assert inverse < 0.8 * zero
    assert learnt < 0.8 * zero


def test_a_policy_that_does_nothing_beats_nothing(policies: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(policies, "damped", lambda response, error: np.zeros_like(error))
    zero, inverse, learnt = policies.compare("fdbench/ServoSpiral-v0", seeds=[200], trials=1).values()
    assert zero == inverse == learnt


def test_a_learned_agent_beats_zero_action(agent: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(agent, "FIRST_DEVIATION", 0.03)
    policy = agent.Policy("fdbench/ServoSpiral-v0")
    weights = agent.learn(policy, generations=3)
    learned, inverse = (agent.judge(policy, used, range(200, 201)) for used in (weights, np.zeros_like(weights)))
    policy.forward = np.zeros_like(policy.forward)
    zero = agent.judge(policy, np.zeros_like(weights), range(200, 201))
    assert learned < 0.9 * inverse
    assert inverse < 0.5 * zero


def test_an_agent_without_weights_is_the_inverse_model_on_drawn_machines_too(agent: ModuleType) -> None:
    policy = agent.Policy("fdbench-drawn/ServoSpiral-v1")
    found = agent.judge(policy, np.zeros(policy.shape), range(200, 202))
    wanted = agent.compare("fdbench-drawn/ServoSpiral-v1", range(200, 202))["inverse model"]
    assert np.sqrt(found.mean()) == pytest.approx(wanted, rel=1e-6)
