"""A process force is described while it acts: when, how large, and its strongest line."""

import math

import numpy as np
import pytest

from fdbench.diagnosis.answer.process_force import ProcessForce
from fdbench.diagnosis.judge.process_force import described
from fdbench.diagnosis.records.runs import RecordedRun
from fdbench.diagnosis.settings import EVIDENCE, JUDGE
from fdbench.record import FloatArray

PERIOD_S, NOISE_N = 1e-3, 0.5
TIME_S = JUDGE.force_balance_margin_s + np.arange(24000) * PERIOD_S


def found(force_N: FloatArray, first_s: float, last_s: float) -> ProcessForce:
    """Return what is said of a force between two times, in noise."""
    run = RecordedRun(name="cut", period_s=PERIOD_S, reference=np.zeros((1, 3)), channels={}, lap=None)
    acts = (first_s <= TIME_S) & (last_s >= TIME_S)
    noise = NOISE_N * np.random.default_rng(0).standard_normal(len(TIME_S))
    return described(run, np.where(acts, force_N, 0.0) + noise, NOISE_N, "repeats")


def test_a_sine_for_a_while_has_its_amplitude() -> None:
    own = found(60.0 * np.sin(2.0 * np.pi * 3.3 * TIME_S), 3.0, 9.0)
    assert own.range_s == pytest.approx((3.0, 9.0), abs=EVIDENCE.segment_s)
    assert own.frequency_Hz == pytest.approx(3.3, rel=0.01)
    assert own.amplitude_N == pytest.approx(60.0, rel=0.02)
    assert own.rms_N == pytest.approx(60.0 / math.sqrt(2.0), rel=0.02)
    assert own.course.time_s[-1] > 20.0


def test_a_square_wave_has_the_amplitude_of_its_fundamental() -> None:
    own = found(178.0 * np.sign(np.sin(2.0 * np.pi * TIME_S)), 12.5, 21.7)
    assert own.amplitude_N == pytest.approx(4.0 / math.pi * 178.0, rel=0.03)
    assert own.rms_N == pytest.approx(178.0, rel=0.02)
    assert own.range_s == pytest.approx((12.5, 21.7), abs=EVIDENCE.segment_s)


def test_noise_alone_acts_nowhere_in_particular() -> None:
    own = found(np.zeros_like(TIME_S), 0.0, 0.0)
    assert own.range_s == (TIME_S[0], TIME_S[-1])
    assert own.rms_N == pytest.approx(NOISE_N, rel=0.05)
    assert own.frequency_Hz is None
