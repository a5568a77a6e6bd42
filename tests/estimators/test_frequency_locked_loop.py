"""The loop finds the frequency of a periodic force, follows its drift, and leaves friction to the offset."""

from dataclasses import replace

import numpy as np
import pytest
from fdbench_baselines._example import Example, example_drive, example_milling
from fdbench_baselines.frequency_locked_loop import FrequencyLockedLoop

from fdbench.errors import PluginError, SpecError
from fdbench.estimator import Context
from fdbench.record import FloatArray, Record
from fdbench.scenario import load_scenario

GAIN_N_S_PER_M, BETA_1 = 500.0, 0.5


def under(force_N: FloatArray, period_s: float) -> Example:
    """Return the drive of 10 kg, at rest but for a force (n,)."""
    velocity = np.zeros(len(force_N))
    for k in range(len(force_N) - 1):
        velocity[k + 1] = velocity[k] + BETA_1 * (-velocity[k] - force_N[k] / GAIN_N_S_PER_M)
    columns = {"reference_velocity_m_per_s": np.zeros(len(force_N)), "velocity_m_per_s": velocity}
    record = Record({"time_s": 0.01 * np.arange(len(force_N), dtype=np.float64), **columns})
    return Example(replace(example_drive().context, disturbance_period_s=period_s), record)


def found(case: Example, memory_s: float = 0.3, harmonics: int = 1) -> FloatArray:
    estimate = FrequencyLockedLoop(memory_s, harmonics).fit(*case)
    assert estimate.disturbance_N is not None
    return estimate.disturbance_N


def test_a_slip_is_found_and_without_the_loop_it_would_matter() -> None:
    time_s = 0.01 * np.arange(3000)
    force_N = 5.0 * np.sin(2.0 * np.pi * 15.15 * time_s) + 2.0 * np.sin(2.0 * np.pi * 30.3 * time_s + 1.0)
    case = under(force_N, 1.0 / 15.0)
    error = found(case, harmonics=2) - force_N[:-1]
    assert np.abs(error[-1000:]).max() < 1e-3
    # One oscillator that stays at 15 Hz lags by arctan(2 pi 0.15 Hz tau).
    lag = np.arctan(2.0 * np.pi * 0.15 * 0.3)
    assert np.sin(lag) > 0.25


@pytest.mark.parametrize("memory_s", [0.2, 0.3])
def test_a_drift_leaves_the_phase_that_the_loop_has(memory_s: float) -> None:
    time_s, drift_Hz_per_s = 0.01 * np.arange(4000), 0.005
    phase = 2.0 * np.pi * (15.0 * time_s + 0.5 * drift_Hz_per_s * time_s**2)
    force = found(under(5.0 * np.sin(phase), 1.0 / 15.0), memory_s)
    rows = slice(2000, len(force))
    basis = np.column_stack((np.sin(phase[rows.start : rows.stop]), np.cos(phase[rows.start : rows.stop])))
    sine, cosine = np.linalg.lstsq(basis, force[rows], rcond=None)[0]
    expected = 2.0 * memory_s**2 * 2.0 * np.pi * drift_Hz_per_s
    assert -np.arctan2(cosine, sine) == pytest.approx(expected, rel=0.1)


def test_friction_and_a_single_blow_stay_out_of_the_force() -> None:
    still = found(under(np.full(1000, 5.0), 1.0 / 15.0))
    assert np.abs(still[500:]).max() < 1e-2
    force_N = 5.0 * np.sin(2.0 * np.pi * 15.0 * 0.01 * np.arange(1000))
    force_N[600] += 500.0
    error = found(under(force_N, 1.0 / 15.0)) - force_N[:-1]
    # Unheld, the blow would leave 2 mu of itself: 32 N.
    assert np.abs(error[601:]).max() < 2.5


def test_faster_harmonics_are_found_where_they_fold_to() -> None:
    force_N = 3.0 * np.sin(2.0 * np.pi * 70.0 * 0.01 * np.arange(1000))  # of 35 Hz the second, seen at 30 Hz
    error = found(under(force_N, 1.0 / 35.0), harmonics=2) - force_N[:-1]
    assert np.abs(error[500:]).max() < 1e-2


def test_it_declines_what_it_cannot_lock_to() -> None:
    assert FrequencyLockedLoop().skip(example_drive().context) == "no period is known: there is nothing to lock to"
    assert FrequencyLockedLoop().skip(example_milling().context) == "the plant is no feed drive"
    current: Context = load_scenario("DriveCurrentClosed-v2").context()
    assert FrequencyLockedLoop().skip(current) == "the plant's model has no parameters"
    with pytest.raises(SpecError, match="nothing to lock to"):
        FrequencyLockedLoop().fit(*example_drive())


def test_bad_input_is_refused() -> None:
    with pytest.raises(SpecError, match=r"memory_s = 0\.0"):
        FrequencyLockedLoop(0.0)
    with pytest.raises(SpecError, match="harmonics = 0"):
        FrequencyLockedLoop(harmonics=0)
    with pytest.raises(PluginError, match="must come before"):
        FrequencyLockedLoop().estimate()
