"""A sample without looking at the arrays is the sample that numba's own call gives, and errors come through."""

import copy
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numba import njit

from fdbench.envs.drive_env import DriveEnv
from fdbench.scenario import load_scenario
from fdbench.simulate.direct import Direct
from fdbench.simulate.random import CHUNK


@pytest.mark.parametrize("name", ["BallScrewAxis-v0", "LinearMotorCogging-v0", "ServoStaircase-v0", "SpindleStep-v0"])
def test_samples_alone_are_those_of_a_whole_trial(name: str) -> None:
    n, whole, alone = CHUNK + 50, load_scenario(name).system(), load_scenario(name).system()
    whole.start([3])
    alone.start([3])
    expected = whole.advance(n)[:, :, 0]
    found = [alone.advance_one(0.0) for _ in range(n)]
    assert np.array_equal([row for _, row in found], expected)
    assert np.array_equal([logged for logged, _ in found], expected[:, : len(whole.columns)])


def test_errors_of_the_function_come_through() -> None:
    @njit
    def fail(array: Any, number: int, factor: float, out: Any) -> None:
        if number > 3:
            raise ValueError("too far")
        out[number] = factor * array[0]

    value, out = np.zeros(1), np.zeros(4)
    direct = Direct(fail, (value, 0, 2.5, out), 1, value, out, [1, 3])
    assert direct.run(direct.address, 3, 2.0) == (0.0, 5.0)
    with pytest.raises(ValueError, match="too far"):
        direct.run(direct.address, 4, 2.0)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_of_a_running_environment_goes_its_own_way(copied: Callable[[DriveEnv], DriveEnv]) -> None:
    env, action = DriveEnv("BallScrewAxis-v0"), np.ones(1, dtype=np.float32)
    env.reset(seed=0)
    env.step(action)
    other = copied(env)
    other.step(-action)
    for _ in range(3):
        env.step(action)
    same = DriveEnv("BallScrewAxis-v0")
    same.reset(seed=0)
    expected = [same.step(action)[0] for _ in range(5)][-1]
    assert np.array_equal(env.step(action)[0], expected)
    assert not np.array_equal(other.step(action)[0], expected)
