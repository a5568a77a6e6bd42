"""Sensor artefacts: repeated samples are interpolated over, and a grid of readings is recognised."""

import dataclasses

import numpy as np
import pytest
from axis_lab import drive

from fdbench.diagnosis.evidence.sensor_artefacts import (
    Artefact,
    beside_known,
    grid_artefacts,
    held_artefact,
    interpolated,
    of_the_log,
    told_of,
)
from fdbench.diagnosis.model.nominal import Nominal, Simulation
from fdbench.diagnosis.model.replay import Replay
from fdbench.diagnosis.records.noise_model import white
from fdbench.diagnosis.records.runs import RecordedRun
from fdbench.effects import effects

PERIOD_S, N = 1e-3, 3000
TIME_S = np.arange(N) * PERIOD_S
NOMINAL = Nominal(plant=drive(), simulation=Simulation(substeps=10))


def run_of(position: np.ndarray, held: np.ndarray | None = None) -> RecordedRun:
    reference = np.column_stack((position, np.gradient(position, PERIOD_S), np.zeros(len(position))))
    channels = {"motor_force_N": 50.0 * np.cos(3.0 * TIME_S), "position_m": position}
    return RecordedRun(name="x", period_s=PERIOD_S, reference=reference, channels=channels, lap=None, held=held)


def test_repeated_samples_are_interpolated_over() -> None:
    rng = np.random.default_rng(0)
    clean = run_of(0.01 * np.sin(3.0 * TIME_S) + 1e-7 * rng.standard_normal(N))
    held = np.zeros(N, dtype=np.bool_)
    held[[100, 101, 102, 900, 2000]] = True
    fresh = np.maximum.accumulate(np.where(held, 0, np.arange(N)))
    stale = RecordedRun(
        name="x",
        period_s=PERIOD_S,
        reference=clean.reference,
        channels={name: values[fresh] for name, values in clean.channels.items()},
        lap=None,
        held=held,
    )
    model = {"motor_force_N": 50.0 * np.cos(3.0 * TIME_S), "position_m": 0.01 * np.sin(3.0 * TIME_S)}
    mended, count = interpolated(stale, model)
    assert count == 5
    assert np.abs(mended.channels["position_m"] - clean.channels["position_m"]).max() < 1e-6
    assert np.abs(stale.channels["position_m"] - clean.channels["position_m"]).max() > 2e-5
    artefact = held_artefact([stale], [mended], [count])
    assert artefact is not None
    assert artefact.value == pytest.approx(5 / N)
    assert artefact.low < 5 / N < artefact.high


def test_a_sample_that_repeats_while_nothing_moves_is_no_artefact() -> None:
    held = np.zeros(N, dtype=np.bool_)
    held[500] = True
    run = run_of(np.zeros(N), held)
    assert interpolated(run, {name: np.zeros(N) for name in run.channels}) == (run, 0)


def test_an_axis_that_sticks_where_the_model_creeps_repeats_its_reading_and_drops_none() -> None:
    position = 0.01 * np.sin(3.0 * TIME_S)
    position[600:700] = position[600]
    position[700:] += position[599] - position[700]
    held = np.zeros(N, dtype=np.bool_)
    held[601:700] = True
    run = run_of(position, held)
    run.channels["motor_force_N"][600:700] = run.channels["motor_force_N"][600]
    model = {"motor_force_N": 50.0 * np.cos(3.0 * TIME_S), "position_m": 0.01 * np.sin(3.0 * TIME_S)}
    assert interpolated(run, model) == (run, 0)


def test_what_repeats_while_no_motion_is_commanded_was_not_dropped() -> None:
    """A loop without integral stands on one count of its encoder, with one force, beside a model that still creeps."""
    moves = np.arange(N) >= N - 100
    creeps, stroke = 1e-6 * np.exp(-TIME_S), np.cumsum(np.where(moves, 1e-4, 0.0))
    counts = 1e-7 * np.floor(10.0 * np.exp(-TIME_S))
    held = np.append(False, np.diff(counts) == 0.0) & ~moves
    nearly_level = 1e-9 * np.cumsum(moves)
    run = RecordedRun(
        name="x",
        period_s=PERIOD_S,
        reference=np.column_stack((stroke, 0.1 * moves, np.zeros(N))),
        channels={"motor_force_N": 1e6 * counts + nearly_level, "position_m": counts + stroke},
        lap=None,
        held=held,
    )
    model = {"motor_force_N": 1e6 * creeps, "position_m": creeps + stroke}
    assert interpolated(run, model) == (run, 0)
    told_to_move = dataclasses.replace(run, reference=np.column_stack((stroke, np.full(N, 0.1), np.zeros(N))))
    assert interpolated(told_to_move, model)[1] > 1000


@pytest.mark.parametrize("step_m", [1e-6, 2e-7])
def test_a_grid_of_readings_is_recognised(step_m: float) -> None:
    replay = Replay(NOMINAL.drive, NOMINAL.library, NOMINAL.simulation.substeps)
    smooth = 2e-3 * np.sin(2.0 * TIME_S) + 2e-4 * np.sin(17.0 * TIME_S)
    (found,) = grid_artefacts([run_of(np.round(smooth / step_m) * step_m)], replay, 1.0)
    assert found is not None
    assert found.value == pytest.approx(step_m, rel=0.02)
    assert found.low < step_m < found.high
    assert found.probability > 0.9


@pytest.mark.parametrize(("fastest_in_steps", "of_the_text"), [(1.3, 1e-9), (4.0, 1e-9), (10.0, 0.0041), (10.0, 0.03)])
def test_a_grid_is_not_taken_for_one_of_twice_its_step(fastest_in_steps: float, of_the_text: float) -> None:
    """Half of the readings lie between those of twice the step, however slow the axis is or the log is rounded."""
    replay = Replay(NOMINAL.drive, NOMINAL.library, NOMINAL.simulation.substeps)
    step_m = 1e-6
    smooth = step_m / PERIOD_S * fastest_in_steps * (0.5 * np.sin(2.0 * TIME_S) + 0.006 * np.sin(17.0 * TIME_S))
    readings, digit_m = np.round(smooth / step_m) * step_m, of_the_text * step_m
    (found,) = grid_artefacts([run_of(np.round(readings / digit_m) * digit_m)], replay, 1.0)
    assert found is not None
    assert found.value == pytest.approx(step_m, rel=0.02)


def test_the_step_of_an_axis_that_creeps_is_found_as_precisely() -> None:
    replay = Replay(NOMINAL.drive, NOMINAL.library, NOMINAL.simulation.substeps)
    noise = 0.12 * np.random.default_rng(3).standard_normal(N)
    for step_m in np.geomspace(1e-6, 2e-6, 20).tolist():
        steps = np.round(35.0 * np.sin(2.0 * TIME_S) + noise)
        (found,) = grid_artefacts([run_of(steps * step_m)], replay, 1.0)
        assert found is not None
        assert found.low < step_m < found.high
        assert found.value == pytest.approx(step_m, rel=0.01)


@pytest.mark.parametrize(("known_m", "is_named"), [(1e-6, False), (2e-6, False), (3e-7, True)])
def test_a_grid_that_the_model_knows_is_no_cause_and_a_coarser_one_is(known_m: float, is_named: bool) -> None:
    kind = effects.get("encoder_quantisation")
    found = Artefact(kind=kind, probability=0.99, value=1e-6, low=0.98e-6, high=1.02e-6, energy={})
    assert beside_known(found, drive()).probability == 0.99
    known = dataclasses.replace(drive(), effects=(*drive().effects, kind.typical(resolution_m=known_m)))
    assert (beside_known(found, known).probability == 0.99) is is_named


def test_each_encoder_has_a_grid_of_its_own() -> None:
    replay = Replay(NOMINAL.drive, NOMINAL.library, NOMINAL.simulation.substeps)
    smooth = 2e-3 * np.sin(2.0 * TIME_S) + 2e-4 * np.sin(17.0 * TIME_S)
    motor, table = (np.round(smooth / step_m) * step_m for step_m in (2e-7, 1e-6))
    run = run_of(motor)
    run.channels["motor_minus_table_position_m"] = motor - table
    found = {item.kind.name: item.value for item in grid_artefacts([run], replay, 1.0)}
    assert found == pytest.approx({"encoder_quantisation": 2e-7, "scale_quantisation": 1e-6}, rel=0.03)


@pytest.mark.parametrize(("share", "probability"), [(0.3, 0.0), (0.4, 0.9)])
def test_a_grid_is_a_cause_where_it_makes_a_part_of_the_noise_of_a_channel(share: float, probability: float) -> None:
    energy = {"motor_force_N": 4.0 * share, "position_m": 1e-16}
    kind = effects.get("encoder_quantisation")
    grid = Artefact(kind=kind, probability=0.9, value=1e-6, low=0.98e-6, high=1.02e-6, energy=energy)
    floors = {"motor_force_N": white(2.0, measured=True), "position_m": white(1e-6, measured=True)}
    assert told_of(grid, floors).probability == probability


def test_smooth_readings_have_no_grid() -> None:
    replay = Replay(NOMINAL.drive, NOMINAL.library, NOMINAL.simulation.substeps)
    noise = 1e-7 * np.random.default_rng(1).standard_normal(N)
    assert grid_artefacts([run_of(2e-3 * np.sin(2.0 * TIME_S) + noise)], replay, 1.0) == []


@pytest.mark.parametrize(
    ("noise_N", "repeats", "in_the_loop"), [(5.0, True, True), (0.3, True, False), (0.3, False, True)]
)
def test_steps_that_no_force_shows_are_those_of_the_log(noise_N: float, repeats: bool, in_the_loop: bool) -> None:
    """Steps of 10 um would bring 5 N into the force; where repeats differ by 0.3 N, the controller sees none."""
    grid = Artefact(
        kind=type(effects.get("encoder_quantisation").typical()),
        probability=1.0,
        value=1e-5,
        low=1e-5,
        high=1e-5,
        energy={"motor_force_N": 25.0, "position_m": 8e-12},
    )
    noise = {"motor_force_N": white(noise_N, measured=repeats), "position_m": white(1e-7, measured=repeats)}
    found = of_the_log(grid, noise)
    assert found.energy["motor_force_N"] == (25.0 if in_the_loop else 0.0)
    assert found.energy["position_m"] == 8e-12
