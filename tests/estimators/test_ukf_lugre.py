"""The unscented filter is a Kalman filter where all is linear, its bristle that of LuGre; both find a shaker."""

import numpy as np
import pytest
from disturbance_found import error_of
from fdbench_baselines._motion_smoother import Drift, ForcedMotion, passed
from fdbench_baselines._unscented_drive import (
    BRISTLE,
    VELOCITY,
    WALK,
    WAVES,
    DriveNoise,
    Numbers,
    Signals,
    pass_point,
    root_of,
    run_unscented,
)
from fdbench_baselines.extended_state_observer import ExtendedStateObserver
from fdbench_baselines.ukf_lugre import UkfLugre

from fdbench.effects.lugre_friction import LugreFriction
from fdbench.errors import SpecError


def numbers(**changes: float) -> Numbers:
    """Return a drive of 2 kg without friction, in units of 1 m and a sample of 1 ms."""
    zeros = dict.fromkeys(Numbers._fields, 0.0)
    return Numbers(
        **zeros | {"place": 0, "velocity_unit": 1e3, "kick_per_N": 5e-7, "step_s": 1e-3, "stribeck": 1.0} | changes  # type: ignore[arg-type]
    )


def test_without_friction_it_is_the_kalman_filter() -> None:
    rng, n = np.random.default_rng(3), 200
    force, reading, off = rng.normal(size=n), np.cumsum(rng.normal(size=n)), rng.random(n) < 0.1
    drive = numbers(force_unit=4e5)
    fresh, start = np.zeros(WAVES), np.zeros(WAVES)
    fresh[VELOCITY], fresh[WALK] = 0.3, 0.02
    start[[0, VELOCITY, WALK]] = 0.5, 0.5, 1.0
    rows, zero = np.empty((n, 2)), np.zeros(n)
    signals = Signals(force, zero, zero, zero, reading, off, zero)
    x, P, found = run_unscented(drive, signals, DriveNoise(0.5, fresh, start, 1.0, 1.0), rows)
    motion = ForcedMotion(5e-7 * force, np.full((n, 1), -0.2), reading, off, zero, np.zeros(n, dtype=np.bool_), 0)
    run = passed(motion, Drift(0.5, 0.3, np.ones(1), np.array([0.02]), np.ones(1)))
    assert found == pytest.approx(run.log_likelihood, rel=1e-9)
    np.testing.assert_allclose(x[[0, VELOCITY, WALK]], run.states[-1], rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(P[WALK, WALK], run.covariances[-1, 2, 2], rtol=1e-8)
    np.testing.assert_allclose(rows[-2, 0], run.states[-1, 2], rtol=0.3)


@pytest.mark.parametrize("velocity", [1e-4, 3e-3, -0.2])
def test_the_bristle_is_that_of_the_simulated_friction(velocity: float) -> None:
    friction = LugreFriction.typical()
    level, stiffness = friction.coulomb_force_N, friction.bristle_stiffness_N_per_m
    drive = numbers(
        kick_per_N=0.0,
        velocity_unit=1.0,
        coulomb=level,
        static_share=friction.static_force_N / level - 1.0,
        stribeck=friction.stribeck_velocity_m_per_s,
        bend_per_m=stiffness / level,
        damping_s=friction.bristle_damping_N_s_per_m / stiffness,
    )
    s, z = np.zeros(WAVES), 0.0
    s[VELOCITY] = velocity
    for _ in range(20):
        pass_point(drive, 0.0, 0.0, 0.0, 0.0, 1.0, s)
        z = LugreFriction.kernel.py_func(0.0, 1e-3, 0.0, velocity, 0.0, *friction.values(), z)[2]
        assert s[BRISTLE] == pytest.approx(stiffness * z / level, rel=1e-9)


def test_a_root_has_zeros_where_a_state_is_known() -> None:
    rng = np.random.default_rng(6)
    half = rng.normal(size=(5, 3)) * np.array([1.0, 1e4, 1e-6])
    P = np.zeros((6, 6))
    P[np.ix_([0, 1, 3, 4, 5], [0, 1, 3, 4, 5])] = half @ half.T + 1e-3 * np.eye(5)
    L = np.ones((6, 6))
    root_of(P, L)
    np.testing.assert_allclose(L @ L.T, P, rtol=0.0, atol=1e-9 * np.abs(P).max())
    assert not L[2].any()
    assert not L[:, 2].any()


def test_a_shaker_is_told_from_the_friction_of_reversals() -> None:
    name, seed = "LinearMotorAxis-v1", 101
    found = error_of(UkfLugre(), name, seed)
    assert found < 0.05
    assert found < 0.1 * error_of(ExtendedStateObserver(), name, seed)


@pytest.mark.parametrize("harmonics", [-1, 1.5])
def test_harmonics_that_are_none_are_refused(harmonics: float) -> None:
    with pytest.raises(SpecError, match="ukf_lugre: harmonics"):
        UkfLugre(harmonics)  # type: ignore[arg-type]


@pytest.mark.parametrize("deviation", [-1.0, np.inf, np.nan])
def test_a_deviation_that_is_none_is_refused(deviation: float) -> None:
    with pytest.raises(SpecError, match="ukf_lugre: stiffness_deviation"):
        UkfLugre(stiffness_deviation=deviation)
