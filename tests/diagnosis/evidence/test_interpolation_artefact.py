"""Interpolation errors of an encoder are read off the readings, whatever the model says and however fast it moves."""

import numpy as np
import pytest
from axis_lab import drive

from fdbench.diagnosis.evidence.interpolation_artefact import interpolation_artefact, with_probability
from fdbench.diagnosis.model.nominal import Nominal, Simulation
from fdbench.diagnosis.records.runs import RecordedRun
from fdbench.effects import effects

PERIOD_S, N, NOISE_M = 1e-3, 6000, 5e-8
TIME_S = np.arange(N) * PERIOD_S
NOMINAL = Nominal(plant=drive(), simulation=Simulation(substeps=10))
WAVE_M, PHASE_RAD = 1.5e-5, 0.7


def run_of(error_m: float, wave_m: float = WAVE_M, seed: int = 0) -> RecordedRun:
    """Return a run whose samples are up to 400 micrometres apart, with an error of the reading."""
    true = 0.1 * np.sin(4.0 * TIME_S) + 0.01 * np.sin(11.0 * TIME_S)
    reading = true + error_m * np.sin(2.0 * np.pi * true / wave_m + PHASE_RAD)
    reading += NOISE_M * np.random.default_rng(seed).standard_normal(N)
    reference = np.column_stack((true, np.gradient(true, PERIOD_S), np.zeros(N)))
    channels = {"motor_force_N": 50.0 * np.cos(3.0 * TIME_S), "position_m": reading}
    return RecordedRun(name="x", period_s=PERIOD_S, reference=reference, channels=channels, lap=None)


@pytest.mark.parametrize("error_m", [2e-8, 1e-7, 1e-6])
def test_a_wave_is_found_with_its_size_period_and_energy(error_m: float) -> None:
    found = interpolation_artefact([run_of(error_m, seed=seed) for seed in range(3)], NOMINAL)
    assert found is not None
    assert found.kind.declared is effects.get("encoder_interpolation_error")
    assert found.value == pytest.approx(error_m, rel=0.1)
    assert found.low < error_m < found.high
    assert found.energy["position_m"] == pytest.approx(0.5 * error_m**2, rel=0.3)


def test_noise_is_no_wave() -> None:
    assert interpolation_artefact([run_of(0.0, seed=seed) for seed in range(3)], NOMINAL) is None


def test_a_wave_as_long_as_a_ripple_of_the_motor_is_none_of_the_encoder() -> None:
    assert NOMINAL.turn_m is not None
    assert interpolation_artefact([run_of(1e-7, NOMINAL.turn_m / 24.0)], NOMINAL) is None


def test_steps_of_the_motion_are_no_wave() -> None:
    run = run_of(0.0)
    run.channels["position_m"][500::500] += 1e-4
    assert interpolation_artefact([run], NOMINAL) is None


def test_the_larger_the_wave_beside_the_noise_the_more_probable_the_cause() -> None:
    found = interpolation_artefact([run_of(1e-7)], NOMINAL)
    assert found is not None
    chances = [with_probability(found, size).probability for size in (0.01, 0.3, 3.0)]
    assert chances[0] < 0.01
    assert chances[1] == pytest.approx(0.5)
    assert chances[2] > 0.99
