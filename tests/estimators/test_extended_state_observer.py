"""The extended state observer has the poles and the lag that its bandwidth says."""

import numpy as np
import pytest
from fdbench_baselines._example import example_drive
from fdbench_baselines.extended_state_observer import ExtendedStateObserver, observe

from fdbench.errors import SpecError


@pytest.mark.parametrize("pole", [1.0, 0.9])
def test_a_step_of_the_force_is_met_as_by_two_equal_poles(pole: float) -> None:
    k, kept = np.arange(1, 40), 0.8
    force = observe(np.zeros(2), np.ones(len(k)), pole, kept)[:, 0]
    assert np.allclose(force, 1.0 - (1.0 + k * (1.0 - kept)) * kept**k, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize(("pole", "lags"), [(1.0, 2.0), (0.0, 1.0)])
def test_a_slow_force_is_late_as_stated(pole: float, lags: float) -> None:
    ramp, kept = np.arange(400.0), 0.8
    late = ramp - observe(np.zeros(2), ramp, pole, kept)[:, 0]
    assert late[-1] == pytest.approx(lags * kept / (1.0 - kept), rel=1e-9)


def test_what_the_sheet_has_wrong_is_a_force() -> None:
    """At constant speed a heavier drive is no other one; while it accelerates its inertia is a force."""
    context, record = example_drive(mass_ratio=1.25)
    force = ExtendedStateObserver(1e5).fit(context, record).disturbance_N
    assert force is not None
    acceleration = np.diff(record["velocity_m_per_s"]) / context.sampling_time_s
    assert np.allclose(force, 2.5 * acceleration, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("bandwidth", [0.0, -1.0, np.inf, np.nan])
def test_a_bandwidth_that_is_none_is_refused(bandwidth: float) -> None:
    with pytest.raises(SpecError, match="extended_state_observer: bandwidth_rad_per_s"):
        ExtendedStateObserver(bandwidth)
