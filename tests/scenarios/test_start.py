"""Drawn starts: another one for every seed, where the reference begins too, and refused where a plant has none."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from fdbench.draw import Uniform
from fdbench.envs.drive_env import DriveEnv
from fdbench.envs.drive_vector_env import DriveVectorEnv
from fdbench.errors import SpecError
from fdbench.scenario import Reality, Scenario, load_scenario
from fdbench.simulate.start import Start

ZERO = np.zeros(1, dtype=np.float32)
POSITION = Uniform(values=("start.position_m.0",), low=-0.02, high=0.05)
VELOCITY = Uniform(values=("start.velocity_m_per_s.0",), low=-0.01, high=0.01)


def beginning(name: str, *draws: Uniform, quiet: bool = False, duration_s: float = 0.3) -> Scenario:
    """Return a short scenario that draws its start, at will without forces and noise that its data sheet has not."""
    scenario = load_scenario(name)
    assert scenario.timing is not None
    axes = scenario.setup.reference().shape[1] // 3
    return dataclasses.replace(
        scenario,
        timing=dataclasses.replace(scenario.timing, duration_s=duration_s),
        estimation=dataclasses.replace(scenario.estimation, window_s=None),
        start=Start(position_m=(0.0,) * axes, velocity_m_per_s=(0.0,) * axes),
        draw=draws,
        **({"reality": Reality(), "validation": None} if quiet else {}),
    )


@pytest.mark.parametrize("name", ["ShakerConstant-v0", "BallScrewAxis-v0", "ServoStaircase-v0", "ServoSpiral-v0"])
def test_every_seed_begins_elsewhere_and_the_record_there(name: str) -> None:
    draw = dataclasses.replace(POSITION, low=-0.005, high=0.005)
    scenario = beginning(name, draw)
    assert scenario.drawn(3).start == scenario.drawn(3).start
    starts = [scenario.drawn(seed).start.position_m[0] for seed in range(5)]
    assert len(set(starts)) == 5
    usual = load_scenario(name).record()
    prefix = "x_" if name == "ServoSpiral-v0" else ""
    for seed, start in enumerate(starts[:2]):
        record = scenario.record(seed)
        assert record[f"{prefix}reference_position_m"][0] == usual[f"{prefix}reference_position_m"][0] + start
        assert record[f"{prefix}position_m"][0] == pytest.approx(usual[f"{prefix}position_m"][0] + start, abs=2e-5)


@pytest.mark.parametrize(
    ("name", "signal"),
    [("BallScrewAxis-v0", "motor_torque_Nm"), ("ShakerConstant-v0", "motor_force_N")],
)
def test_the_loop_sees_no_step_of_the_position(name: str, signal: str) -> None:
    scenario = beginning(name, POSITION, quiet=True)
    displaced, usual = scenario.record(1), dataclasses.replace(scenario, draw=()).record(1)
    assert scenario.drawn(1).start.position_m[0] != 0.0
    np.testing.assert_allclose(displaced[signal], usual[signal], rtol=0.0, atol=1e-6 * np.abs(usual[signal]).max())


def test_an_axis_begins_in_motion_with_the_readings_of_that_motion() -> None:
    scenario = beginning("BallScrewAxis-v0", VELOCITY, quiet=True)
    velocity = scenario.drawn(2).start.velocity_m_per_s[0]
    record = scenario.record(2)
    assert abs(velocity) > 1e-4
    assert record["velocity_m_per_s"][0] == pytest.approx(velocity, rel=1e-9)
    assert abs(record["position_m"][-1] - record["reference_position_m"][-1]) < 5e-5


@pytest.mark.parametrize("name", ["ServoStaircase-v0", "ServoSpiral-v0"])
def test_a_stage_moves_on_as_it_did_before(name: str) -> None:
    scenario = beginning(name, quiet=True)
    response = next(iter(scenario.plant.axes().values()))  # type: ignore[attr-defined]
    state = response.motion
    assert response.C @ state == pytest.approx(0.0, abs=1e-12)
    command = -(response.C @ np.linalg.solve(response.A, response.rest)) / (response.C @ response.rest)
    # Steady motion: the state grows along the states at rest, whatever the command is that leads to it.
    np.testing.assert_allclose(
        response.A @ state + response.B * command, response.rest, rtol=1e-6, atol=1e-6 * np.abs(response.rest).max()
    )
    axes = len(scenario.start.velocity_m_per_s)
    record = dataclasses.replace(scenario, start=Start(velocity_m_per_s=(0.01,) * axes)).record()
    usual = scenario.record()
    way = {name: record[name] - usual[name] for name in record.columns if name.endswith("position_m")}
    moved = [value for name, value in way.items() if "reference" not in name]
    assert all(abs(value[0]) < 1e-9 and value[1] > 0.0 for value in moved)


def test_a_drawn_start_moves_no_other_draw() -> None:
    drawn = load_scenario("ShakerConstant-v1")
    with_start = dataclasses.replace(drawn, start=Start(position_m=(0.0,)), draw=(*drawn.draw, POSITION))
    assert with_start.drawn(4).plant == drawn.drawn(4).plant
    assert with_start.drawn(4).reality == drawn.drawn(4).reality


@pytest.mark.parametrize("draw", [POSITION, VELOCITY])
def test_an_environment_begins_as_the_record_does(draw: Uniform) -> None:
    scenario = beginning("BallScrewAxis-v0", draw)
    env = DriveEnv(scenario)
    for seed in range(2):
        observation, _ = env.reset(seed=seed)
        start, record = env.machine.start, scenario.record(seed)
        places = {name: env.columns.index(name) for name in ("reference_position_m", "position_m", "velocity_m_per_s")}
        assert observation[places["reference_position_m"]] == observation[places["position_m"]] == start.position_m[0]
        assert observation[places["velocity_m_per_s"]] == start.velocity_m_per_s[0]
        rows = np.array([env.step(ZERO)[0] for _ in range(20)])
        for column, name in enumerate(env.columns):
            assert np.array_equal(rows[:, column], record[name][:20])


def compare_lanes(scenario: Scenario, task: str, n_lanes: int, compared: Sequence[int]) -> None:
    """Step lanes beyond the end of their first episodes, and some of them alone beside that, with the same actions."""
    envs: Any = gymnasium.make_vec(
        "fdbench/BallScrewAxis-v0",
        num_envs=n_lanes,
        scenario=scenario,
        task=task,
    )
    alone = {lane: DriveEnv(scenario, task=task) for lane in compared}
    envs.action_space.seed(0)
    first, _ = envs.reset(seed=5)
    for lane, env in alone.items():
        assert np.array_equal(first[lane], env.reset(seed=5 + lane)[0])
    assert len(np.unique(first, axis=0)) == n_lanes
    for _ in range(envs.system.n_samples + 20):
        actions = envs.action_space.sample()
        observations, rewards, terminated, truncated, infos = envs.step(actions)
        for lane, env in alone.items():
            observation, reward, *ended, info = env.step(actions[lane])
            assert np.array_equal(observations[lane], observation)
            assert rewards[lane] == reward
            assert [terminated[lane], truncated[lane]] == ended
            assert {name: infos["truth"][name][lane] for name in info["truth"]} == info["truth"]
        over = terminated | truncated
        if over.any():
            observations, _ = envs.reset(options={"reset_mask": over})
            for lane in np.flatnonzero(over).tolist():
                if lane in alone:
                    assert np.array_equal(observations[lane], alone[lane].reset()[0])


@pytest.mark.parametrize("n_lanes", [3, 70])
@pytest.mark.parametrize(
    ("name", "task"),
    [
        ("BallScrewAxis-v0", "tracking"),
        ("BallScrewAxis-v0", "pre_compensation"),
        ("ShakerConstant-v0", "disturbance_rejection"),
        ("ShakerConstant-v0", "identification"),
        ("ServoStaircase-v0", "tracking"),
        ("ServoSpiral-v0", "tracking"),
        ("ServoSpiral-v0", "pre_compensation"),
    ],
)
def test_lanes_begin_where_their_seeds_say(name: str, task: str, n_lanes: int) -> None:
    position = dataclasses.replace(POSITION, low=-0.005, high=0.005)
    scenario = beginning(name, position, VELOCITY, duration_s=0.05)
    compare_lanes(scenario, task, n_lanes, (0, n_lanes - 1))


def test_lanes_begin_elsewhere_from_a_start_that_is_given() -> None:
    scenario = beginning("ServoSpiral-v0", dataclasses.replace(POSITION, low=0.001, high=0.002), duration_s=0.05)
    scenario = dataclasses.replace(scenario, start=Start(position_m=(0.0, 0.003), velocity_m_per_s=(0.01, -0.01)))
    compare_lanes(scenario, "tracking", 3, (0, 2))


def test_lanes_of_drawn_machines_begin_elsewhere() -> None:
    drawn = beginning("ShakerConstant-v2", POSITION, duration_s=0.05)
    machines = load_scenario("ShakerConstant-v2").draw
    compare_lanes(dataclasses.replace(drawn, draw=(*machines, POSITION)), "disturbance_rejection", 3, (0, 2))


def test_lanes_reset_by_gymnasium_begin_elsewhere_again() -> None:
    scenario = beginning("BallScrewAxis-v0", POSITION, duration_s=0.05)
    envs = gymnasium.vector.SyncVectorEnv([lambda: DriveEnv(scenario)] * 2)
    first, _ = envs.reset(seed=0)
    truncated = np.zeros(2, dtype=np.bool_)
    while not truncated.all():
        _, _, _, truncated, _ = envs.step(np.zeros((2, 1), dtype=np.float32))
    second = envs.step(np.zeros((2, 1), dtype=np.float32))[0]
    alone = DriveEnv(scenario)
    assert np.array_equal(first[1], alone.reset(seed=1)[0])
    assert np.array_equal(second[1], alone.reset()[0])
    assert len({*first[:, 0].tolist(), *second[:, 0].tolist()}) == 4


def test_a_stage_whose_machine_is_drawn_too_is_stepped_in_turns() -> None:
    machines = load_scenario("ServoSpiral-v1").draw
    scenario = dataclasses.replace(beginning("ServoSpiral-v0", POSITION), draw=(POSITION, *machines))
    with pytest.raises(SpecError, match=r"one xy_stage.*another for each seed, by 'plant\..*'sync'"):
        DriveVectorEnv(scenario, 3)


FILE = """extends = "{base}"
{start}

[[draw]]
kind = "uniform"
values = ["{path}"]
low = {low}
high = {high}
"""


@pytest.mark.parametrize(
    ("base", "start", "path", "low", "high", "message"),
    [
        ("BallScrewAxis-v0", "position_m = [0.0]", "position_m.0", -0.1, 0.45, r"draw\[0\].*allowed: -0.5 to 0.3[78]"),
        ("BallScrewAxis-v0", "velocity_m_per_s = [0.0]", "velocity_m_per_s.0", -2.0, 2.0, "velocity limit.*-1 to 1"),
        ("BallScrewAxis-v0", "position_m = [0.0, 0.0]", "position_m.0", -0.1, 0.1, "2 numbers.*moves 1 axes"),
        ("BallScrewAxis-v0", "", "position_m.0", -0.1, 0.1, r"there is no '0'; the list is empty"),
        ("SpindleStep-v0", "position_m = [0.0]", "position_m.0", -0.1, 0.1, "only simulated feed drives and servo"),
    ],
)
def test_bad_starts_are_refused(
    tmp_path: Path, base: str, start: str, path: str, low: float, high: float, message: str
) -> None:
    file = tmp_path / "begins.toml"
    table = f"[start]\n{start}" if start else ""
    file.write_text(FILE.format(base=base, start=table, path=f"start.{path}", low=low, high=high), "utf-8")
    with pytest.raises(SpecError, match=message):
        load_scenario(file)
