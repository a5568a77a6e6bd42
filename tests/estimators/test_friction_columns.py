"""Friction columns on the nominal curve: the curve itself, and where there is none."""

from dataclasses import replace

import numpy as np
from fdbench_baselines._friction_columns import curved

from fdbench.effects.coulomb_friction import CoulombFriction
from fdbench.effects.lugre_friction import LugreFriction
from fdbench.plants.feed_drive import FeedDrive
from fdbench.scenario import load_scenario

CONTEXT = load_scenario("ShakerConstant-v2").context()
assert isinstance(CONTEXT.plant, FeedDrive)
PLANT: FeedDrive = CONTEXT.plant
VELOCITY = np.array([-0.2, -0.003, -0.0004, 0.0, 0.0004, 0.003, 0.2])
Z = np.column_stack((VELOCITY, VELOCITY, -1.0 * (VELOCITY > 1e-3), 1.0 * (VELOCITY < -1e-3)))


def test_columns_are_the_nominal_curve_over_its_coulomb_force() -> None:
    found = curved(CONTEXT, Z)
    (friction,) = (effect for effect in PLANT.effects if isinstance(effect, CoulombFriction))
    share = np.tanh(VELOCITY / friction.transition_velocity_m_per_s)
    np.testing.assert_allclose(found[:, 3] - found[:, 2], np.abs(share), atol=2e-3)
    np.testing.assert_allclose(-found[:, 2] - found[:, 3], share, atol=2e-3)
    np.testing.assert_array_equal(found[:, :2], Z[:, :2])


def test_friction_with_memory_and_other_models_keep_their_columns() -> None:
    plant = replace(PLANT, effects=(LugreFriction.typical(),))
    assert curved(replace(CONTEXT, plant=plant), Z) is Z
    assert curved(replace(CONTEXT, model="inverse_dynamics"), Z) is Z
    assert curved(replace(CONTEXT, plant=replace(PLANT, effects=())), Z) is Z
