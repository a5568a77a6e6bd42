"""Lines of a spectrum: found where they are, told to a part of what is resolved, and none in noise."""

import numpy as np
import pytest

from fdbench.diagnosis.records.spectral_lines import Stretches, fitted, lines_in_time

PERIOD_S = 1e-3


def test_lines_are_found_and_noise_has_none() -> None:
    rng = np.random.default_rng(0)
    noise, time_s = rng.standard_normal(4000), np.arange(4000) * PERIOD_S
    assert lines_in_time([noise[None]], PERIOD_S) == []
    lines = np.sin(2.0 * np.pi * 17.3 * time_s) + 0.7 * np.sin(2.0 * np.pi * 90.1 * time_s)
    found = lines_in_time([(noise + lines)[None]], PERIOD_S)
    assert sorted(found) == pytest.approx([17.3, 90.1], abs=0.03)


def test_of_a_force_that_is_no_sine_the_line_that_others_are_harmonics_of_comes_first() -> None:
    """Its harmonics are sharper than it is, and more of them than are tried."""
    rng = np.random.default_rng(1)
    time_s = np.arange(8000) * PERIOD_S
    sizes = {1: 0.5, 4: 1.0, 5: 1.0, 6: 1.0, 7: 1.0}
    comb = sum(size * np.sin(2.0 * np.pi * order * 30.3 * time_s) for order, size in sizes.items())
    found = lines_in_time([(rng.standard_normal(8000) + comb)[None]], PERIOD_S)
    assert found[0] == pytest.approx(30.3, abs=0.03)


def test_a_line_is_told_to_a_part_of_what_is_resolved_and_taken_whole() -> None:
    time_s = np.arange(3000) * PERIOD_S
    signal = 2.0 * np.cos(2.0 * np.pi * 23.117 * time_s + 0.4)
    whole = Stretches.whole(len(signal))
    frequency = whole.sharpened(signal, 23.3 * PERIOD_S)
    assert frequency / PERIOD_S == pytest.approx(23.117, abs=0.01)
    found = whole.component(signal, frequency)
    assert (abs(found), np.angle(found)) == pytest.approx((2.0, 0.4), abs=0.02)
    left = signal - fitted(signal[None], whole.tones([frequency]))[0]
    assert np.abs(left).max() < 0.02
