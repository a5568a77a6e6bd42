"""A force that all lanes have alike is computed once for them, and is the same to the bit where they differ."""

import copy
import pickle

import numpy as np
import pytest

from fdbench.effects import effects
from fdbench.scenario import load_scenario
from fdbench.simulate.axis import Axis
from fdbench.simulate.block import Blocks
from fdbench.simulate.memory import CACHE_LINE
from fdbench.simulate.ports import of_time_alone
from fdbench.simulate.system import System

N_LANES = 20  # enough to lie side by side, and not a whole block


def started(name: str) -> System:
    system = load_scenario(name).system(N_LANES)
    system.start(list(range(N_LANES)))
    return system


def test_forces_of_time_alone_are_told_by_what_their_kernels_read() -> None:
    alone = {name for name in effects.names() if of_time_alone(effects.get(name))}
    assert {"shaker_force", "periodic_force", "tooth_passing_force", "runout_force"} <= alone
    assert not {"cogging", "lugre_friction", "viscous_friction", "dropped_samples", "torque_ripple"} & alone
    generator = np.random.default_rng(0)
    for name in sorted(alone):
        effect = effects.get(name)
        values = effect.typical().values()
        t, h, velocity = 0.1234, 1e-4, 0.01
        for x, v, u in generator.standard_normal((5, 3)).tolist():
            moving = velocity if effect.follows_command else v
            assert effect.kernel(t, h, x, moving, u, *values) == effect.kernel(t, h, 0.0, velocity, 0.0, *values)


def test_one_lane_with_another_force_leaves_the_others_their_bits() -> None:
    alike, mixed = started("MillingUpDown-v0"), started("MillingUpDown-v0")
    assert isinstance(mixed, Axis)
    force = next(n for n, effect in enumerate(mixed.effects) if effect.name == "tooth_passing_force")
    other = np.array(mixed.effects[force].values())
    other[2] *= 2.0  # depth of cut
    mixed.set_parameters(force, other, np.array([7]))
    mixed.start(list(range(N_LANES)))
    expected, found = alike.advance(300), mixed.advance(300)
    rest = np.arange(N_LANES) != 7
    assert np.array_equal(found[:, :, rest], expected[:, :, rest])
    assert not np.array_equal(found[:, :, 7], expected[:, :, 7])


@pytest.mark.parametrize("name", ["MillingUpDown-v0", "ServoSpiral-v0"])
def test_a_lane_that_begins_later_leaves_the_others_their_bits(name: str) -> None:
    alike, mixed = started(name), started(name)
    expected = alike.advance(300)
    first = mixed.advance(100)
    mixed.start([3], np.array([3]))
    found = mixed.advance(200)
    rest = np.arange(N_LANES) != 3
    assert np.array_equal(np.concatenate((first, found))[:, :, rest], expected[:, :, rest])
    assert np.array_equal(found[:, :, 3], expected[:200, :, 3])


def test_blocks_and_their_copies_begin_at_a_cache_line() -> None:
    blocks = Blocks((), N_LANES, N_LANES)
    blocks.values[:] = 1.0
    for same in (blocks, copy.deepcopy(blocks), pickle.loads(pickle.dumps(blocks))):
        assert same.values.ctypes.data % CACHE_LINE == 0
        np.testing.assert_array_equal(same.values, blocks.values)
