"""Periods are located: lines over time, wavelengths over position, in what a gap asks for."""

import dataclasses

import numpy as np
import pytest
from axis_lab import drive

from fdbench.diagnosis.evidence.run_to_run import Change
from fdbench.diagnosis.evidence.split import Split
from fdbench.diagnosis.experiment.trajectory import moves
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import Nominal, Simulation
from fdbench.diagnosis.model.readings import Readings
from fdbench.diagnosis.model.replay import Replay
from fdbench.diagnosis.records.noise_model import white
from fdbench.diagnosis.records.runs import DEFLECTION, RecordedRun
from fdbench.diagnosis.search.periods import _lines_in_position, _pitches, _telling, located
from fdbench.diagnosis.settings import SEARCH
from fdbench.effects import effects

PERIOD_S = 1e-3
STROKES = moves((0.0, 0.2, 0.0), (0.1,), 4.0, PERIOD_S)


def run_along(reference: np.ndarray) -> RecordedRun:
    position = reference[:, 0]
    channels = {"motor_force_N": np.zeros(len(position)), "position_m": position}
    return RecordedRun(name="x", period_s=PERIOD_S, reference=reference, channels=channels, lap=None)


@pytest.mark.parametrize("pitch_m", [1.3e-3, 4e-3, 0.05])
def test_a_wavelength_is_found_whatever_the_sign_in_either_direction(pitch_m: float) -> None:
    run = run_along(STROKES)
    wave = np.sin(2.0 * np.pi * STROKES[:, 0] / pitch_m) * np.sign(STROKES[:, 1])
    noise = 0.3 * np.random.default_rng(1).standard_normal(len(wave))
    found = _lines_in_position([(wave + noise)[None, 1:-2]], [run], None, 1.0)
    assert min(abs(found_m / pitch_m - 1.0) for found_m in found) < 0.02


def test_a_slow_change_is_no_wave_as_long_as_the_way_of_a_sample() -> None:
    """At 0.5 m/s samples lie 0.5 mm apart, at the same places in every run; the pitch is weaker than what is slow."""
    reference = moves((0.0, 0.2, 0.0), (0.5,), 8.0, PERIOD_S)
    slow = 20.0 * np.sin(2.0 * np.pi * reference[:, 0] / 0.11) + 10.0 * np.sign(reference[:, 1])
    wave = np.sin(2.0 * np.pi * reference[:, 0] / 3.07e-3)
    noise = 0.3 * np.random.default_rng(3).standard_normal(len(wave))
    runs = [run_along(reference)] * 3
    found = _lines_in_position([(slow + wave + noise)[None, 1:-2]] * 3, runs, None, 1.0)
    first_short = next(own for own in found if own < 0.2 / SEARCH.long_waves)
    assert first_short == pytest.approx(3.07e-3, rel=0.02)


def test_no_wave_is_sought_that_passes_faster_than_it_is_sampled() -> None:
    """At 4 m/s samples lie 4 mm apart; a wave of 44 mm has echoes of some strength between two of them."""
    reference = moves((0.0, 3.0, 0.2, 2.5), (4.0,), 40.0, PERIOD_S)
    wave = np.sin(2.0 * np.pi * reference[:, 0] / 0.0438)
    noise = 2.0 * np.random.default_rng(4).standard_normal(len(wave))
    found = _lines_in_position([(wave + noise)[None, 1:-2]] * 2, [run_along(reference)] * 2, None, 1.0)
    short = [own for own in found if own < 3.0 / SEARCH.long_waves]
    assert min(short) > 2.0 * np.median(np.abs(reference[:, 1])) * PERIOD_S
    assert min(abs(own / 0.0438 - 1.0) for own in short) < 0.01


def test_a_pitch_goes_before_its_aliases_at_a_steady_speed() -> None:
    """Where samples lie 4 mm apart, a wave and its alias are the same; where they lie otherwise, they are not."""
    pitch_m, step_m = 0.1025, 4e-3
    steady, other = step_m * np.arange(800), 1.7e-3 * np.arange(900)
    parts = [(position, 5.0 * np.sin(2.0 * np.pi * position / pitch_m + 0.4)[None]) for position in (steady, other)]
    aliases = [1.0 / step_m - 1.0 / pitch_m, 1.0 / step_m + 1.0 / pitch_m]
    assert _telling([*aliases, 1.0 / pitch_m], parts)[0] == 1.0 / pitch_m
    assert _telling([*aliases, 30.0], parts[:1])[0] in aliases


def test_orders_of_the_lead_are_tried_where_something_is_there() -> None:
    run, rng = run_along(STROKES), np.random.default_rng(2)
    noise = 0.3 * rng.standard_normal(len(STROKES))
    strong = sum(np.sin(2.0 * np.pi * STROKES[:, 0] / own) for own in (1.9e-3, 2.7e-3, 3.3e-3))
    weak = 0.2 * np.sin(2.0 * np.pi * STROKES[:, 0] / 5e-3)
    both = (strong + weak + noise)[None, 1:-2]
    assert min(abs(own - 5e-3) for own in _lines_in_position([both], [run], None, 1.0)) > 1e-4
    assert 5e-3 in _lines_in_position([both], [run], 0.01, 1.0)


def test_a_travel_of_a_few_waves_has_long_ones_alone() -> None:
    reference = moves((0.0, 2e-3, 0.0), (0.02,), 1.0, PERIOD_S)
    wave = np.sin(2.0 * np.pi * reference[:, 0] / 1e-3)
    found = _lines_in_position([wave[None, 1:-2]], [run_along(reference)], None, 1.0)
    assert min(abs(own / 1e-3 - 1.0) for own in found) < 0.1


def test_no_wavelength_where_the_axis_stands() -> None:
    assert _lines_in_position([np.ones((1, 997))], [run_along(np.zeros((1000, 3)))], 0.01, 1.0) == []


def test_a_turn_of_a_pulley_is_tried_though_the_travel_has_few_of_it() -> None:
    """Beside a slow change that is larger; other waves as long are no pitch."""
    reference = moves((0.0, 0.5, 0.0), (0.3,), 6.0, PERIOD_S)
    turn_m, travel = 0.1257, 0.5
    wave = np.sin(2.0 * np.pi * reference[:, 0] / turn_m) + 3.0 * np.sin(2.0 * np.pi * reference[:, 0] / 0.4)
    runs = [run_along(reference)]
    found = _pitches(_lines_in_position([wave[None, 1:-2]], runs, turn_m, 1.0), travel, turn_m, 1.0)
    assert min(abs(own / turn_m - 1.0) for own in found) < 0.03
    assert all(own < 0.14 for own in found)
    assert min(_pitches([0.4, turn_m], travel, None, 1.0), default=None) is None


def test_what_changes_from_run_to_run_hides_no_pitch() -> None:
    """Beside 600 N s/m of friction that a run may have, a ripple of 1.2 % is far smaller."""
    nominal = Nominal(plant=drive(), simulation=Simulation(substeps=4))
    reference = moves((0.0, 0.2, 0.05, 0.15, 0.0, 0.2, 0.1), (0.1, 0.3, 0.5, 0.2, 0.4, 0.05), 4.0, PERIOD_S)
    still = dict.fromkeys(("motor_force_N", "position_m", DEFLECTION), np.zeros(len(reference)))
    run = RecordedRun(name="x", period_s=PERIOD_S, reference=reference, channels=still, lap=None)
    replay, given = Replay(nominal.drive, nominal.library, 4), start(nominal)
    rubbing = given.with_effect(effects.get("viscous_friction").typical(viscous_friction_N_s_per_m=600.0))
    rippled = rubbing.with_effect(effects.get("torque_ripple").typical(relative_ripple=0.012, pitch_m=1.75e-3))
    alone, moved, measured = ({**Readings(replay, [run]).alone(0, item)} for item in (given, rubbing, rippled))
    noise = {"motor_force_N": 3.0, "position_m": 3e-7, DEFLECTION: 1e-7}
    generator = np.random.default_rng(5)
    noisy = {name: values + noise[name] * generator.standard_normal(len(values)) for name, values in measured.items()}
    run = dataclasses.replace(run, channels=noisy)
    direction = np.stack([(moved[name] - alone[name]) / rms for name, rms in noise.items()])
    split = Split(
        runs=[run],
        held_out=[np.zeros(len(reference), dtype=np.bool_)],
        noise_models={name: white(rms, measured=True) for name, rms in noise.items()},
        changes=[Change(directions=direction[None] / np.linalg.norm(direction), shrinkage=np.array([0.999]))],
    )
    found = located(Readings(replay, [run]), split, given)["pitch_of_ratio"]
    assert min(abs(pitch / 1.75e-3 - 1.0) for pitch in found) < 0.01
