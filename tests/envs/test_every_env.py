"""Every registered environment holds the shared checks, and the checks find what breaks them."""

import copy
import dataclasses
import json
import re
import subprocess
import sys
import warnings
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import InvalidAction, ResetNeeded

from fdbench.checks.check_env import CHECKS, Subject, check_env, subject
from fdbench.envs import environment_ids, register_all
from fdbench.envs._picture import CHARACTERS, COLUMNS, DOT, GLYPHS, ROWS
from fdbench.envs.drive_env import DriveEnv
from fdbench.envs.drive_vector_env import DriveVectorEnv
from fdbench.errors import PluginError, SpecError, UnknownName
from fdbench.scenario import Scenario, load_scenario, scenario_ids
from fdbench.simulate.axis import Axis
from fdbench.simulate.block import ROW
from fdbench.simulate.random import CHUNK

IDS = environment_ids()
QUICK = "fdbench/ShakerConstant-v0"
ZERO = np.zeros(1, dtype=np.float32)


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("env_id", IDS)
def test_environment(env_id: str, check: Callable[[Subject], None]) -> None:
    check(subject(env_id))


def test_every_scenario_with_an_environment_is_registered() -> None:
    scenarios = [load_scenario(name) for name in scenario_ids()]
    expected = [f"fdbench/{one.id}" for one in scenarios if one.environment is not None and not one.draw]
    assert expected
    assert expected == IDS


@pytest.mark.parametrize("env_id", IDS)
def test_spec_travels_as_text(env_id: str) -> None:
    with gymnasium.make(env_id) as env:
        assert env.spec is not None
        text = env.spec.to_json()
    assert json.loads(text)["kwargs"] == {"scenario": env_id.removeprefix("fdbench/")}
    assert gymnasium.make(EnvSpec.from_json(text)).unwrapped.scenario.id == env_id.removeprefix("fdbench/")


@pytest.mark.parametrize("env_id", IDS)
def test_picture_moves(env_id: str) -> None:
    env = gymnasium.make(env_id, render_mode="rgb_array")
    env.reset(seed=0)
    first: Any = env.render()
    for _ in range(300):
        env.step(env.action_space.sample())
    second: Any = env.render()
    for picture in (first, second):
        assert picture.shape == (360, 640, 3)
        assert picture.dtype == np.uint8
    assert np.mean(np.any(first != second, axis=2)) > 0.002
    env.reset(seed=0)
    assert np.array_equal(env.render(), first)


def test_picture_shows_the_table_where_it_is() -> None:
    env = DriveEnv("BallScrewAxis-v0", render_mode="rgb_array")
    env.reset(seed=0)
    centres = []
    for _ in range(3):
        for _ in range(700):
            observation, *_ = env.step(ZERO)
        picture: Any = env.render()
        blue = (picture[50:] == (44, 97, 176)).all(axis=2).any(axis=0)  # below the legend
        centres.append((float(np.flatnonzero(blue).mean()), float(observation[env.columns.index("position_m")])))
    (x_0, p_0), (x_1, p_1), (x_2, p_2) = centres
    assert (x_1 - x_0) / (p_1 - p_0) == pytest.approx((x_2 - x_0) / (p_2 - p_0), rel=0.05)
    assert x_1 > x_0


def test_picture_of_two_axes_shows_the_table_on_its_path() -> None:
    env = DriveEnv("ServoSpiral-v0", render_mode="rgb_array")
    env.reset(seed=0)
    pixels, positions = [], []
    for _ in range(4):
        for _ in range(900):
            observation, *_ = env.step(np.zeros(2, dtype=np.float32))
        picture: Any = env.render()
        blue = (picture == (44, 97, 176)).all(axis=2)
        # The table is the only square of 7 x 7 dots; the path is three dots wide.
        solid = np.lib.stride_tricks.sliding_window_view(blue | (picture == (196, 57, 50)).all(axis=2), (7, 7))
        row, column = np.argwhere(solid.all(axis=(2, 3))).mean(axis=0)
        pixels.append([column, -row])
        positions.append([float(observation[env.columns.index(f"{axis}_position_m")]) for axis in "xy"])
    moved, shown = np.diff(positions, axis=0), np.diff(pixels, axis=0)
    scale = float(np.vdot(moved, shown) / np.vdot(moved, moved))
    np.testing.assert_allclose(shown, scale * moved, rtol=0.0, atol=2.0)
    assert scale > 0.0


def test_every_character_has_its_dots() -> None:
    assert {len(rows) for rows in GLYPHS.values()} == {ROWS}
    assert len(set(GLYPHS.values())) == len(CHARACTERS)


@pytest.mark.parametrize("name", ["ShakerConstant-v2", "ServoSpiral-v1"])
def test_words_of_a_picture_can_be_written_and_fit(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Names, values with prefixes as people write them, and what the colours stand for."""
    written: list[str] = []

    def write(image: Any, text: str, x: int, *_: Any) -> None:
        written.append(text)
        assert set(text) <= {*CHARACTERS, " "}
        assert x + DOT * (COLUMNS + 1) * len(text) <= image.shape[1]

    monkeypatch.setattr("fdbench.envs._picture.write", write)
    env = DriveEnv(name, render_mode="rgb_array")
    env.reset(seed=0)
    for _ in range(50):
        env.step(env.action_space.sample())
    env.render()
    assert {"position", "reference"} < set(written)
    assert any(re.match(r"error of .* [-.\d]+ [mµn]m", text) for text in written), written


def test_rendering_without_a_mode_warns() -> None:
    env = DriveEnv("ShakerConstant-v0")
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="render_mode"):
        assert env.render() is None


def test_registering_twice_is_silent() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        register_all()


def test_registering_is_light() -> None:
    code = "import sys, fdbench.envs; fdbench.envs.register_all(); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "gymnasium" in done.stdout.split()
    assert not {"numba", "scipy", "fdbench.scenario"} & set(done.stdout.split())


# ---- semantics


def shaker(**timing: Any) -> Scenario:
    scenario = load_scenario("ShakerConstant-v0")
    assert scenario.timing is not None
    return dataclasses.replace(scenario, timing=dataclasses.replace(scenario.timing, **timing))


def test_action_deviates_from_the_command() -> None:
    scenario = shaker(duration_s=0.5)
    assert scenario.environment is not None
    quiet = dataclasses.replace(scenario, reality=dataclasses.replace(scenario.reality, effects=()))
    env = DriveEnv(quiet)
    env.reset(seed=0)
    rows = np.array([env.step(np.ones(1, dtype=np.float32))[0] for _ in range(100)])
    velocity = rows[-1, env.columns.index("velocity_m_per_s")]
    reference = rows[-1, env.columns.index("reference_velocity_m_per_s")]
    loop = scenario.linear_model.nominal_parameters(env.interface.period_s)
    steady = (loop["beta_1"] * (reference + scenario.environment.action_scale) - loop["beta_3"]) / (1 - loop["beta_2"])
    assert velocity == pytest.approx(steady, abs=5 * 2e-5)


def test_an_action_is_seen_one_step_later() -> None:
    envs = [DriveEnv(shaker(duration_s=0.5)) for _ in range(2)]
    for env in envs:
        env.reset(seed=0)
    first = [env.step(action)[0] for env, action in zip(envs, (ZERO, ZERO + 1), strict=True)]
    second = [env.step(ZERO)[0] for env in envs]
    column = envs[0].columns.index("velocity_m_per_s")
    force = envs[0].columns.index("motor_force_N")
    assert first[0][column] == first[1][column]
    assert first[0][force] != first[1][force]
    assert second[0][column] != second[1][column]


def test_reward_is_the_squared_error() -> None:
    env = DriveEnv("ShakerConstant-v0")
    env.reset(seed=0)
    columns = env.columns
    for _ in range(50):
        observation, reward, *_ = env.step(ZERO)
        error = (
            observation[columns.index("reference_velocity_m_per_s")] - observation[columns.index("velocity_m_per_s")]
        )
        assert reward == -(error**2)


def test_the_xy_stage_has_an_action_for_each_axis() -> None:
    env = DriveEnv("ServoSpiral-v0")
    columns = env.columns
    assert env.system.action_names == ("x_position_m", "y_position_m")
    scale = env.interface.action_scale
    runs = []
    for action in ([0.0, 0.0], [1.0, 0.0], [0.0, -1.0]):
        env.reset(seed=3)
        runs.append([env.step(np.array(action, dtype=np.float32)) for _ in range(2500)])
    still, x_alone, y_alone = (np.array([step[0] for step in run]) for run in runs)
    for moved, name, by in ((x_alone, "x_position_m", scale), (y_alone, "y_position_m", -scale)):
        difference = moved - still
        column = columns.index(name)
        assert not difference[0, column]
        assert difference[1, column]
        assert difference[-100:, column].mean() == pytest.approx(by, rel=0.05)
        assert not np.delete(difference, column, axis=1).any(), "the other axis and both references stay as they are"


def test_reward_of_the_xy_stage_is_the_sum_of_squared_errors() -> None:
    env = DriveEnv("ServoSpiral-v0")
    env.reset(seed=0)
    for _ in range(200):
        observation, reward, *_ = env.step(env.action_space.sample())
        seen = dict(zip(env.columns, observation, strict=True))
        errors = [seen[f"{axis}_reference_position_m"] - seen[f"{axis}_position_m"] for axis in "xy"]
        assert reward == pytest.approx(-(errors[0] ** 2) - errors[1] ** 2, rel=1e-12)
        assert min(np.abs(errors)) > 0.0


def test_leaving_the_travel_terminates() -> None:
    scenario = load_scenario("ShakerConstant-v0")
    narrow = dataclasses.replace(scenario, plant=dataclasses.replace(scenario.plant, travel_m=0.02))
    env, envs = DriveEnv(narrow), DriveVectorEnv(narrow, 2)
    env.reset(seed=0)
    envs.reset(seed=0)
    terminated, steps = False, 0
    while not terminated:
        observation, _, terminated, truncated, info = env.step(ZERO)
        steps += 1
        assert observation in env.observation_space
        assert envs.step(np.zeros((2, 1), dtype=np.float32))[2].tolist() == [terminated, terminated]
        assert not truncated
    assert info["truth"]["diverged"] == 1.0
    assert steps < env.system.n_samples
    with pytest.raises(ResetNeeded, match="reset"):
        env.step(ZERO)
    with pytest.raises(ResetNeeded, match="reset"):
        envs.step(np.zeros((2, 1), dtype=np.float32))


@pytest.mark.parametrize("name", [name for name in scenario_ids() if f"fdbench/{name}" in IDS])
def test_a_system_ends_with_its_episode(name: str) -> None:
    system = load_scenario(name).system()
    system.start([0])
    with pytest.raises(SpecError, match=f"ends after {system.n_samples} samples"):
        system.advance(system.n_samples + 1)


def test_an_axis_ends_with_the_first_of_its_lanes() -> None:
    one, many = shaker(duration_s=0.6).system(), shaker(duration_s=0.6).system(70)
    n = one.n_samples
    assert n % CHUNK
    for _ in range(2):
        one.start([0])
        for _ in range(n):
            one.advance_one(0.0)
        with pytest.raises(SpecError, match=f"ends after {n} samples"):
            one.advance_one(0.0)
    many.start(range(70))
    many.advance(n - 10)
    for done in range(n - 10, n - 1):
        first = 7 * (done - n + 10)
        many.start(range(7), np.arange(first, first + 7))
        with pytest.raises(SpecError, match=f"ends after {n} samples"):
            many.advance(n + 1 - done)
        many.advance(1)
    many.start(range(7), np.arange(63, 70))
    with pytest.raises(SpecError, match=f"ends after {n} samples"):
        many.advance(n - 8)
    many.advance(n - 9)


def test_lanes_that_only_fill_a_block_stay_within_the_reference() -> None:
    system = shaker(duration_s=0.05).system(70)
    assert isinstance(system, Axis)
    rows = system._now.values[:, ROW["INDEX"]]
    for _ in range(3):
        system.start(range(70))
        system.advance(system.n_samples)
        assert rows.min() == rows.max() == system.n_samples


def test_truth_is_not_observed() -> None:
    env = DriveEnv("ShakerConstant-v0")
    assert not set(env.columns) & set(env.system.truth_columns)


def test_a_sequence_of_seeds_reaches_its_lanes() -> None:
    seeds = [5, 900, 3]
    envs = DriveVectorEnv("ShakerConstant-v0", 3)
    envs.reset(seed=seeds)
    rows = [envs.step(np.zeros((3, 1), dtype=np.float32))[0] for _ in range(20)]
    for index, seed in enumerate(seeds):
        env = DriveEnv("ShakerConstant-v0")
        env.reset(seed=seed)
        assert np.array_equal([env.step(ZERO)[0] for _ in range(20)], [row[index] for row in rows])


def test_lanes_differ() -> None:
    envs = DriveVectorEnv("ShakerConstant-v0", 70)
    envs.reset(seed=0)
    for _ in range(5):
        observation, *_ = envs.step(np.zeros((70, 1), dtype=np.float32))
    assert len(np.unique(observation[:, envs.columns.index("velocity_m_per_s")])) == 70


def test_gymnasium_wrappers_take_the_vector_environment() -> None:
    envs: Any = gymnasium.make_vec(QUICK, num_envs=3)
    envs = gymnasium.wrappers.vector.DictInfoToList(gymnasium.wrappers.vector.ClipAction(envs))
    envs.reset(seed=0)
    infos = envs.step(np.full((3, 1), 7.0, dtype=np.float32))[-1]
    assert [set(info) for info in infos] == [{"truth", "time_s"}] * 3
    assert set(infos[1]["truth"]) == {"disturbance_N", "held_sample", "diverged"}


# ---- errors


@pytest.mark.parametrize("value", [1.5, -1.0001, np.nan, np.inf])
def test_actions_outside_their_space_are_refused(value: float) -> None:
    env, envs = DriveEnv("ShakerConstant-v0"), DriveVectorEnv("ShakerConstant-v0", 2)
    env.reset(seed=0)
    envs.reset(seed=0)
    with pytest.raises(InvalidAction, match="outside"):
        env.step(np.array([value], dtype=np.float32))
    with pytest.raises(InvalidAction, match="within"):
        envs.step(np.array([[0.0], [value]], dtype=np.float32))
    with pytest.raises(InvalidAction, match="shape"):
        envs.step(np.zeros(2, dtype=np.float32))
    plane, planes = DriveEnv("ServoSpiral-v0"), DriveVectorEnv("ServoSpiral-v0", 3)
    plane.reset(seed=0)
    planes.reset(seed=0)
    with pytest.raises(InvalidAction, match="outside"):
        plane.step(np.array([0.0, value], dtype=np.float32))
    with pytest.raises(InvalidAction, match="within"):
        planes.step(np.array([[0.0, 0.0], [0.0, value], [0.0, 0.0]], dtype=np.float32))
    for shape in ((1,), (3,), (2, 1)):
        with pytest.raises(InvalidAction, match=r"shape \(2,\)"):
            plane.step(np.zeros(shape, dtype=np.float32))
    with pytest.raises(InvalidAction, match=r"shape \(3, 2\)"):
        planes.step(np.zeros((2, 3), dtype=np.float32))


def test_a_step_before_the_reset_is_refused() -> None:
    with pytest.raises(ResetNeeded, match="reset"):
        gymnasium.make(QUICK).step(ZERO)
    with pytest.raises(ResetNeeded, match="reset"):
        gymnasium.make_vec(QUICK, num_envs=2).step(np.zeros((2, 1), dtype=np.float32))


def test_users_errors_are_told() -> None:
    measured = next(name for name in scenario_ids() if load_scenario(name).measured is not None)
    assert f"fdbench/{measured}" not in IDS
    with pytest.raises(SpecError, match=f"{measured}: no environment"):
        DriveEnv(measured)
    with pytest.raises(UnknownName, match="Did you mean ShakerConstant-v0"):
        DriveEnv("ShakerConstnt-v0")
    with pytest.raises(SpecError, match="render_mode: unknown 'human'"):
        DriveEnv("ShakerConstant-v0", render_mode="human")
    with pytest.raises(SpecError, match="unknown option 'x'"):
        DriveEnv("ShakerConstant-v0").reset(options={"x": 1})
    scenario = load_scenario("ShakerConstant-v0")
    assert scenario.environment is not None
    unknown = dataclasses.replace(scenario, environment=dataclasses.replace(scenario.environment, reward="velocity"))
    with pytest.raises(SpecError, match=r"environment\.reward: 'velocity'.*Did you mean velocity_m_per_s"):
        DriveEnv(unknown)


@pytest.mark.parametrize("mask", [[True], np.zeros(2, dtype=bool), np.ones(2), np.ones(3, dtype=bool)])
def test_a_wrong_reset_mask_is_refused(mask: Any) -> None:
    envs = DriveVectorEnv("ShakerConstant-v0", 2)
    with pytest.raises(SpecError, match="reset_mask: 2 booleans"):
        envs.reset(seed=0, options={"reset_mask": mask})


def test_a_wrong_number_of_seeds_is_refused() -> None:
    with pytest.raises(SpecError, match="seed: 2 are expected"):
        DriveVectorEnv("ShakerConstant-v0", 2).reset(seed=[1, 2, 3])


# ---- the checks can fail


class Faulty(gymnasium.Env[Any, Any]):
    """A drive with a fault; ``step`` and ``reset`` are wrapped by what a test gives."""

    def __init__(self, fault: str = "") -> None:
        self.inner = DriveEnv("ShakerConstant-v0")
        self.observation_space, self.action_space = self.inner.observation_space, self.inner.action_space
        self.columns, self.scenario, self.fault = self.inner.columns, self.inner.scenario, fault
        self.noise = np.random.default_rng()
        self.episodes = self.count = 0

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self.count = 0
        self.episodes += 1
        return self.inner.reset(seed=0 if self.fault == "ignores the seed" else seed, options=options)

    def step(self, action: Any) -> Any:
        given = np.zeros_like(action) if self.fault == "ignores the action" else action
        observation, reward, terminated, truncated, info = self.inner.step(given)
        self.count += 1
        if self.fault == "random after ten steps" and self.count > 10:
            observation[4] += 1e-9 * self.noise.random()
        if self.fault == "remembers episodes" and self.count > 10:
            observation[4] += 1e-9 * self.episodes
        if self.fault == "global random numbers" and self.count > 10:
            np.random.random()  # noqa: NPY002
        if self.fault == "leaves its space" and self.count > 10:
            observation[4] = 50.0
        if self.fault == "single precision" and self.count > 10:
            observation = observation.astype(np.float32)
        if self.fault == "numpy bool":
            truncated = np.bool_(truncated)
        if self.fault == "never ends":
            truncated = False
        if self.fault == "moves the record" and self.count == 300:
            observation[4] = np.nextafter(observation[4], 1.0)
        return observation, reward, terminated, truncated, info

    def __deepcopy__(self, memo: Any) -> "Faulty":
        copied = Faulty(self.fault)
        if self.fault == "forgets when copied":
            copied.inner.reset(seed=0)
        else:
            copied.inner = copy.deepcopy(self.inner, memo)
        copied.episodes, copied.count = self.episodes, self.count
        return copied


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("random after ten steps", r"repeats_under_a_seed: .*step 11: velocity_m_per_s is"),
        ("remembers episodes", r"forgets_on_reset: .*step 11: velocity_m_per_s is"),
        ("global random numbers", "leaves_global_random_state: the global random state has changed"),
        ("leaves its space", "stays_in_its_space: step 11: velocity_m_per_s = 50 is outside"),
        ("single precision", "stays_in_its_space: step 11: observation of float32"),
        ("numpy bool", "follows_gymnasium: .*truncates"),
        ("never ends", "zero_action_is_the_record"),
        ("moves the record", "zero_action_is_the_record: step 299: velocity_m_per_s is"),
        ("ignores the action", "every_action_is_seen: action 0 gives the same observations as no action in 200 steps"),
        ("ignores the seed", "depends_on_the_seed: .*seeds 1 and 2 give the same"),
        ("forgets when copied", "can_be_copied: a deep copy: step 0"),
    ],
)
def test_faults_are_found(fault: str, message: str) -> None:
    with pytest.raises(PluginError, match=message):
        check_env(Faulty(fault))


def test_without_a_fault_the_checks_pass() -> None:
    assert all(line.endswith(": ok") for line in check_env(Faulty()))
