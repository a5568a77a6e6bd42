"""What warms up: by itself it does in time, by its own motion only while it runs."""

import math

import pytest

from fdbench.effects import Effect, effects

STEP_S = 1e-3
WARMING = ("friction_drift", "thermal_expansion")


def warmed(name: str, share_of_motion: float, speed: float, duration_s: float) -> float:
    """Return what an effect gives at 0.4 m, at a speed that the axis is brought to for a moment, after a while."""
    effect = effects.get(name).typical(warm_up_time_s=10.0, share_of_motion=share_of_motion)
    state = (0.0,)
    for step in range(round(duration_s / STEP_S)):
        *_, way = kernel(effect, (step + 0.5) * STEP_S, speed, state)
        state = (way,)
    value, *_ = kernel(effect, duration_s, 0.2, state)
    return float(value)


def kernel(effect: Effect, t: float, speed: float, state: tuple[float, ...]) -> tuple[float, ...]:
    found: tuple[float, ...] = type(effect).kernel(t, STEP_S, 0.4, speed, 0.0, *effect.values(), *state)
    return found


@pytest.mark.parametrize("name", WARMING)
def test_an_axis_that_rests_stays_cold_where_its_motion_warms_it(name: str) -> None:
    cold = warmed(name, 1.0, 0.0, 0.0)
    assert warmed(name, 1.0, 0.0, 5.0) == cold
    assert warmed(name, 0.0, 0.0, 5.0) != pytest.approx(cold, rel=0.1)


@pytest.mark.parametrize("name", WARMING)
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_at_its_usual_speed_both_laws_are_one(name: str, direction: float) -> None:
    usual = effects.get(name).typical().usual_velocity_m_per_s  # type: ignore[attr-defined]
    by_time, by_way = (warmed(name, share, direction * usual, 5.0) for share in (0.0, 1.0))
    assert by_way == pytest.approx(by_time, rel=1e-2)
    assert warmed(name, 1.0, 2.0 * direction * usual, 5.0) == pytest.approx(warmed(name, 0.0, usual, 10.0), rel=1e-2)


def test_the_way_is_run_in_either_direction() -> None:
    effect = effects.get("friction_drift").typical(warm_up_time_s=10.0, share_of_motion=1.0, cold_force_N=20.0)
    state = (0.0,)
    for step in range(10_000):
        *_, way = kernel(effect, step * STEP_S, 0.1 * (-1.0) ** step, state)
        state = (way,)
    force, *_ = kernel(effect, 10.0, 1.0, state)
    assert force == pytest.approx(20.0 / math.e, rel=1e-2)
