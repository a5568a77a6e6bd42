"""Interpolation errors of an encoder are read off the readings, whatever the model says and however fast it moves."""

from dataclasses import replace

import numpy as np
import pytest
from axis_lab import drive

from fdbench.diagnosis.evidence.interpolation_artefact import interpolation_artefact, interpolation_error
from fdbench.diagnosis.model.nominal import Nominal, Simulation
from fdbench.diagnosis.model.replay import Replay, Variant
from fdbench.diagnosis.records.noise_model import white
from fdbench.diagnosis.records.runs import RecordedRun
from fdbench.effects import effects

PERIOD_S, N, NOISE_M = 1e-3, 6000, 5e-8
TIME_S = np.arange(N) * PERIOD_S
NOMINAL = Nominal(plant=drive(), simulation=Simulation(substeps=10))
WAVE_M, PHASE_RAD = 1.5e-5, 0.7


def run_of(error_m: float, wave_m: float = WAVE_M, seed: int = 0, way: float = 1.0) -> RecordedRun:
    """Return a run whose samples are up to 400 um apart, or a share of that, with an error of the reading."""
    true = way * (0.1 * np.sin(4.0 * TIME_S) + 0.01 * np.sin(11.0 * TIME_S))
    reading = true + error_m * np.sin(2.0 * np.pi * true / wave_m + PHASE_RAD)
    reading += NOISE_M * np.random.default_rng(seed).standard_normal(N)
    reference = np.column_stack((true, np.gradient(true, PERIOD_S), np.zeros(N)))
    channels = {"motor_force_N": 50.0 * np.cos(3.0 * TIME_S), "position_m": reading}
    return RecordedRun(name="x", period_s=PERIOD_S, reference=reference, channels=channels, lap=None)


@pytest.mark.parametrize("error_m", [2e-8, 1e-7, 1e-6])
def test_a_wave_is_found_with_its_size_and_period(error_m: float) -> None:
    found = interpolation_error([run_of(error_m, seed=seed) for seed in range(3)], NOMINAL)
    assert found is not None
    assert found.effect.name == "encoder_interpolation_error"
    assert found.size_m == pytest.approx(error_m, rel=0.05)
    assert found.low_m < error_m < found.high_m
    assert found.effect.values()[1] == pytest.approx(WAVE_M, rel=1e-4)


def test_where_an_axis_creeps_a_wave_is_any_size_and_that_is_none() -> None:
    """Along 2 mm there are 200 samples to a wave of 0.15 mm, of which no bend is above the noise."""
    runs = [run_of(1e-6, 1.5e-4, seed, way) for seed, way in enumerate((1.0, 0.02, 1.0))]
    found = interpolation_error(runs, NOMINAL)
    assert found is not None
    assert found.size_m == pytest.approx(1e-6, rel=0.05)


def test_what_some_runs_have_alone_is_no_error_of_an_encoder() -> None:
    runs = [run_of(error_m, seed=seed) for seed, error_m in enumerate((4e-7, 4e-7, 1e-8, 1e-8))]
    assert interpolation_error(runs[:2], NOMINAL) is not None
    assert interpolation_error(runs, NOMINAL) is None


def test_a_wave_of_the_scale_that_the_loop_is_closed_over_is_one_of_the_scale() -> None:
    axis = drive()
    over_scale = replace(axis, controller=replace(axis.controller, feedback="table"))
    found = interpolation_error([run_of(1e-7, seed=seed) for seed in range(3)], replace(NOMINAL, plant=over_scale))
    assert found is not None
    assert found.effect.name == "scale_interpolation_error"
    assert found.size_m == pytest.approx(1e-7, rel=0.05)


def test_noise_is_no_wave() -> None:
    assert interpolation_error([run_of(0.0, seed=seed) for seed in range(3)], NOMINAL) is None


def test_a_wave_as_long_as_a_ripple_of_the_motor_is_none_of_the_encoder() -> None:
    assert NOMINAL.turn_m is not None
    assert interpolation_error([run_of(1e-7, NOMINAL.turn_m / 24.0)], NOMINAL) is None


@pytest.mark.parametrize("step_m", [2e-6, 2e-5])
def test_true_motion_that_is_read_on_a_grid_is_no_wave_below_its_step(step_m: float) -> None:
    run = run_of(2e-5, NOMINAL.turn_m / 24.0 if NOMINAL.turn_m else 0.0)
    run.channels["position_m"][:] = step_m * np.round(run.channels["position_m"] / step_m)
    assert interpolation_error([run], NOMINAL) is None


def test_steps_of_the_motion_are_no_wave() -> None:
    run = run_of(0.0)
    run.channels["position_m"][500::500] += 1e-4
    assert interpolation_error([run], NOMINAL) is None


def test_the_force_has_of_a_wave_what_was_measured() -> None:
    run, replay = run_of(0.0), Replay(NOMINAL.drive, NOMINAL.library, NOMINAL.simulation.substeps)
    kind = effects.get("encoder_interpolation_error")
    effect = kind.typical(error_amplitude_m=2e-7, signal_period_m=WAVE_M, phase_rad=PHASE_RAD)
    without, with_error = (replay.alone(run, Variant(plant=NOMINAL.drive, extra=extra)) for extra in ((), (effect,)))
    rng = np.random.default_rng(2)
    noise = {"motor_force_N": 0.3 * rng.standard_normal(N), "position_m": 2e-8 * rng.standard_normal(N)}
    floors = {name: white(float(np.std(own)), measured=True) for name, own in noise.items()}
    expected = float(np.mean((with_error["motor_force_N"] - without["motor_force_N"]) ** 2))
    for force, share in ((with_error, 1.0), (without, 0.0)):
        read = {"motor_force_N": force["motor_force_N"], "position_m": with_error["position_m"]}
        logged = replace(run, channels={name: own + noise[name] for name, own in read.items()})
        error = interpolation_error([logged], NOMINAL)
        assert error is not None
        energy = interpolation_artefact(error, [logged], replay, floors).energy
        assert energy["motor_force_N"] == pytest.approx(share * expected, rel=0.2, abs=0.05 * expected)


def test_the_larger_the_wave_beside_the_noise_the_more_probable_the_cause() -> None:
    run = run_of(1e-7)
    error = interpolation_error([run], NOMINAL)
    assert error is not None
    replay = Replay(NOMINAL.drive, NOMINAL.library, NOMINAL.simulation.substeps)
    quiet, loud = (
        interpolation_artefact(
            error,
            [run],
            replay,
            {name: white(rms, measured=True) for name, rms in (("position_m", own), ("motor_force_N", 1e3))},
        )
        for own in (2e-8, 1e-6)
    )
    assert quiet.energy["position_m"] == pytest.approx(0.5 * error.size_m**2, rel=0.1)
    assert quiet.probability > 0.99
    assert loud.probability < 0.01
