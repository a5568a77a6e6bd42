"""The joint filter tracks an inertia and a frequency that change, row by row, and knows how well."""

from typing import NamedTuple

import numpy as np
import pytest
from fdbench_baselines.joint_kalman import JointKalman

from fdbench.errors import SpecError
from fdbench.estimator import Context, FloatArray
from fdbench.record import Record
from fdbench.scenario import load_scenario

CHANGE_S, FREQUENCY_HZ, NOISE_M_PER_S = 7.0, 55.0, 2e-5


class Drive(NamedTuple):
    context: Context
    record: Record
    beta: FloatArray  # (n_rows, 4)
    force_N: FloatArray  # (n_rows,)


def drive(seed: int, mass_ratio: float = 1.0, drift_Hz_per_s: float = 0.0, jump_Hz: float = 0.0) -> Drive:
    """Return the model's own equation under a shaker, whose mass and frequency become others at `CHANGE_S`."""
    scenario = load_scenario("ShakerConstant-v2")
    context, usual = scenario.context(), scenario.record(100)
    gain = context.regression(usual).disturbance_gain
    time_s, reference = usual["time_s"], usual["reference_velocity_m_per_s"]
    n = len(time_s)
    phase = 2.0 * np.pi * (FREQUENCY_HZ * time_s + 0.5 * drift_Hz_per_s * time_s**2)
    phase += 2.0 * np.pi * jump_Hz * np.maximum(time_s - CHANGE_S, 0.0)
    force, noise = 1.2 * np.sin(phase), NOISE_M_PER_S * np.random.default_rng(seed).standard_normal(n)
    nominal = np.array(list(context.nominal.values()))
    lost = 1.0 - nominal[0] - nominal[1]
    velocity, beta = np.zeros(n), np.empty((n - 1, 4))
    for k in range(n - 1):
        m = mass_ratio if time_s[k] >= CHANGE_S else 1.0
        beta[k] = nominal[0] / m, 1.0 - (lost + nominal[0]) / m, nominal[2] / m, nominal[3] / m
        v = velocity[k]
        row = np.array([reference[k], v, -float(v > 1e-3), float(v < -1e-3)])
        velocity[k + 1] = row @ beta[k] + gain / m * force[k] + noise[k]
    columns = {"time_s": time_s, "reference_velocity_m_per_s": reference, "velocity_m_per_s": velocity}
    return Drive(context, Record(columns), beta, force[:-1])


def test_a_changed_inertia_is_found_by_parameters_that_walk() -> None:
    changed = drive(0, mass_ratio=1.25)
    walks = JointKalman().fit(changed.context, changed.record).parameters["beta_1"]
    holds = JointKalman(parameter_walk_per_root_s=0.0).fit(changed.context, changed.record).parameters["beta_1"]
    assert walks == pytest.approx(changed.beta[-1, 0], rel=2e-3)
    assert abs(holds / changed.beta[-1, 0] - 1.0) > 0.05


@pytest.mark.parametrize(("drift_Hz_per_s", "largest_N"), [(0.02, 0.06), (0.3, 0.2)])
def test_a_drifting_frequency_is_followed(drift_Hz_per_s: float, largest_N: float) -> None:
    """0.3 Hz/s are 22 turns off the nominal phase after 12 s: a force that is lost errs by 0.85 N and more."""
    drifting = drive(0, drift_Hz_per_s=drift_Hz_per_s)
    force = JointKalman().fit(drifting.context, drifting.record).disturbance_N
    assert force is not None
    assert np.sqrt(np.mean((force - drifting.force_N)[2000:] ** 2)) < largest_N


@pytest.mark.linear_algebra
@pytest.mark.parametrize("change", [{"drift_Hz_per_s": 0.05}, {"jump_Hz": 0.5}])
def test_inertia_and_frequency_are_followed_at_once_with_their_uncertainty(change: dict[str, float]) -> None:
    """A force that is lost errs by its own 0.85 N; over-confidence would make the squares many times 1."""
    squares, errors_N = [], []
    for seed in range(4):
        changed = drive(seed, mass_ratio=1.25, **change)
        estimate = JointKalman().fit(changed.context, changed.record)
        assert estimate.parameters["beta_1"] == pytest.approx(changed.beta[-1, 0], rel=2e-3)
        assert estimate.covariance is not None
        assert estimate.disturbance_N is not None
        error = np.array(list(estimate.parameters.values())) - changed.beta[-1]
        squares.append(error**2 / np.diag(estimate.covariance))
        errors_N.append((estimate.disturbance_N - changed.force_N)[3200:])
    assert np.mean(squares) < 1.6
    assert np.sqrt(np.mean(np.square(errors_N))) < 0.17


@pytest.mark.linear_algebra
def test_the_covariance_is_that_of_the_errors() -> None:
    """The mean of so many squares, some two of them independent for each seed, is 1 within three deviations of 0.2."""
    squares = []
    for seed in range(24):
        usual = drive(seed)
        estimate = JointKalman().fit(usual.context, usual.record)
        assert estimate.covariance is not None
        error = np.array(list(estimate.parameters.values())) - usual.beta[-1]
        squares.append(error**2 / np.diag(estimate.covariance))
    assert 0.4 < np.mean(squares) < 1.6


def test_a_row_depends_on_no_later_one() -> None:
    usual = drive(0)
    half = usual.record.n_samples // 2
    begun = Record({name: usual.record[name][:half] for name in usual.record})
    whole = JointKalman().fit(usual.context, usual.record).disturbance_N
    part = JointKalman().fit(usual.context, begun).disturbance_N
    assert whole is not None
    assert part is not None
    assert np.array_equal(part, whole[: len(part)])


@pytest.mark.parametrize("bad", [{"harmonics": -1}, {"harmonics": 2.0}, {"parameter_walk_per_root_s": -1.0}])
def test_bad_arguments_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(SpecError, match="joint_kalman: "):
        JointKalman(**bad)  # type: ignore[arg-type]
