"""The noise model: white noise has its own size, with repeats or without, and lines are no noise."""

import numpy as np
import pytest

from fdbench.diagnosis.records.noise_model import Way, assumed, noise_floor, raised, spectrum_of, white, without_profile
from fdbench.diagnosis.records.runs import RecordedRun

PERIOD_S, N = 1e-3, 20_000


def run_of(values: np.ndarray) -> RecordedRun:
    reference = np.zeros((len(values), 3))
    return RecordedRun(name="x", period_s=PERIOD_S, reference=reference, channels={"position_m": values}, lap=None)


def test_a_spectrum_adds_up_to_the_mean_square() -> None:
    values = 3.0 * np.random.default_rng(0).standard_normal(N)
    assert spectrum_of([values]).sum() == pytest.approx(np.mean(values**2), rel=1e-9)


def test_assumed_noise_is_that_of_the_quietest_parts() -> None:
    """Bursts and a line are 100 times the noise; a model may not have them, but they are not noise."""
    rng, time_s = np.random.default_rng(1), np.arange(N) * PERIOD_S
    noise = 2.0 * rng.standard_normal(N)
    burst = np.where((time_s % 4.0) < 1.5, 20.0 * np.sin(40.0 * time_s), 0.0)
    line = 10.0 * np.sin(2.0 * np.pi * 60.0 * time_s)
    found = noise_floor([run_of(noise + burst + line)], "position_m")
    assert not found.measured
    assert found.rms == pytest.approx(2.0, rel=0.1)
    assert np.sqrt(assumed([noise]).sum()) == pytest.approx(2.0, rel=0.1)


@pytest.mark.parametrize("line_Hz", [2.5, 4.9, 8.0, 12.0])
def test_a_line_at_the_lowest_frequencies_is_no_noise(line_Hz: float) -> None:
    """In a piece of 256 samples there are no frequencies below it to take a median with."""
    noise = 2.0 * np.random.default_rng(3).standard_normal(N)
    line = 20.0 * np.sin(2.0 * np.pi * line_Hz * np.arange(N) * PERIOD_S)
    assert np.sqrt(assumed([noise + line]).sum()) == pytest.approx(2.0, rel=0.1)


def test_an_artefact_adds_its_energy() -> None:
    found = raised({"position_m": white(3.0, measured=True)}, {"position_m": 16.0})["position_m"]
    assert found.rms == pytest.approx(5.0)
    assert found.measured


def test_what_repeats_with_the_position_is_no_noise() -> None:
    """A rough way is 3 times the noise and always there; it is told from it where the axis comes by again."""
    rng, time_s = np.random.default_rng(2), np.arange(N) * PERIOD_S
    speed = 0.05 + 0.02 * np.sin(1.7 * time_s) + 0.01 * np.sin(4.1 * time_s)
    position = np.cumsum(speed) * PERIOD_S
    noise = 2.0 * rng.standard_normal(N)
    rough = np.interp(position, np.arange(250) * 2e-4, 6.0 * rng.standard_normal(250), period=0.05)
    force = noise + rough
    run = RecordedRun(
        name="x",
        period_s=PERIOD_S,
        reference=np.zeros((N, 3)),
        channels={"position_m": position, "motor_force_N": force},
        lap=None,
    )
    turning, never_there_again = (
        noise_floor([run], "motor_force_N", Way(bin_m=5e-5, turn_m=turn_m)).rms for turn_m in (0.05, None)
    )
    assert turning == pytest.approx(2.0, rel=0.1)
    assert never_there_again > 2.0 * turning


def test_the_mean_over_few_visits_gives_the_noise_back() -> None:
    rng, way = np.random.default_rng(3), np.concatenate([np.linspace(0.0, 1.0, 2000), np.linspace(1.0, 0.0, 2000)] * 3)
    runs = [
        RecordedRun(
            name="x", period_s=PERIOD_S, reference=np.zeros((12_000, 3)), channels={"position_m": way}, lap=None
        )
    ]
    (left,) = without_profile(runs, [rng.standard_normal(12_000)], Way(bin_m=4e-4))
    assert np.std(left) == pytest.approx(1.0, rel=0.03)
