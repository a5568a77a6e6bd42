"""Cogging is the drive's own and a disturbance none the less: scored as one, and there without one."""

from dataclasses import replace

import numpy as np
import pytest

from fdbench.effects import effects
from fdbench.scenario import Reality, Scenario, load_scenario

AMPLITUDES_N, PITCHES_M, PHASES = (45.0, 20.0), (0.032, 0.016), (0.4, -1.1)


def scenario() -> Scenario:
    return load_scenario("LinearMotorCogging-v0")


def with_reality(reality: Reality) -> Scenario:
    changed = replace(load_scenario("LinearMotorCogging-v1"), reality=reality, draw=())
    object.__setattr__(changed, "id", "Changed-v0")
    return changed


def test_the_disturbance_is_the_force_at_the_place() -> None:
    """Mean over a sampling time by Simpson's rule, between the places of a record without noise."""
    record, truth = with_reality(replace(scenario().reality, noise=type(scenario().reality.noise)())).observe(0)
    assert truth.disturbance_N is not None
    place, v = record["motor_position_m"], record["velocity_m_per_s"]
    step_s = record.sampling_time_s
    middle = 0.5 * (place[1:] + place[:-1]) + 0.125 * step_s * (v[:-1] - v[1:])

    def force(x: np.ndarray[tuple[int], np.dtype[np.float64]]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        waves = zip(AMPLITUDES_N, PITCHES_M, PHASES, strict=True)
        return np.asarray(sum(A * np.sin(2.0 * np.pi * x / p + phase) for A, p, phase in waves))

    mean = (force(place[:-1]) + 4.0 * force(middle) + force(place[1:])) / 6.0
    assert truth.disturbance_N[:-1] == pytest.approx(mean, abs=0.05)


def test_the_validation_motion_has_the_cogging_but_no_process_force() -> None:
    drawn = load_scenario("LinearMotorCogging-v1")
    usual = with_reality(drawn.reality).response(0)
    without = with_reality(replace(drawn.reality, effects=())).response(0)
    shaker = effects.get("shaker_force").typical()
    shaken = with_reality(replace(drawn.reality, effects=(*drawn.reality.effects, shaker))).response(0)
    assert usual is not None
    assert without is not None
    assert np.std(usual - without) > 1e-3
    assert np.array_equal(usual, shaken)


def test_the_pitch_is_told_and_no_period() -> None:
    context = scenario().context()
    assert (context.disturbance_pitch_m, context.disturbance_period_s) == (0.032, None)


def test_the_way_crosses_many_pitches_at_several_speeds_in_both_directions() -> None:
    record, _ = scenario().observe(0)
    moved = np.diff(record["reference_position_m"])
    for way in (moved[moved > 0.0].sum(), -moved[moved < 0.0].sum()):
        assert way > 15.0 * 0.032
    speeds = np.round(record["reference_velocity_m_per_s"], 6)
    held = [v for v in np.unique(speeds) if v != 0.0 and np.sum(speeds == v) * 0.003 * abs(v) > 0.032]
    assert len([v for v in held if v > 0.0]) >= 4
    assert len([v for v in held if v < 0.0]) >= 4


def test_every_machine_has_other_magnets() -> None:
    machines = [load_scenario("LinearMotorCogging-v1").drawn(seed).reality.effects for seed in range(3)]
    for first, second in machines:
        assert first.pitch_m == pytest.approx(2.0 * second.pitch_m, rel=1e-12)  # type: ignore[attr-defined]
    assert len({first.pitch_m for first, _ in machines}) == 3  # type: ignore[attr-defined]


def test_effects_that_count_as_disturbance_are_process_forces_and_cogging() -> None:
    own = {name for name in effects.names() if effects.get(name).adds_to_disturbance()}
    process = {name for name in effects.names() if effects.get(name).disturbance}
    assert own - process == {"cogging"}
