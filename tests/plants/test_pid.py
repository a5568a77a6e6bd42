"""A PID of the position error is the cascade that the how-to says."""

import math

import numpy as np
import pytest
from scipy.signal import lfilter

from fdbench.motions import motions
from fdbench.plants._controllers import Cascade
from fdbench.plants.feed_drive import FeedDrive, LinearMotor
from fdbench.simulate.system import Setup, Timing

PERIOD_S, MASS_KG = 1e-3, 8.0
STIFF, SUMMED, DAMPED = 3.1e5, 7e6, 2.4e3  # N/m, N/(m s), N s/m


@pytest.mark.parametrize("filter_s", [0.0, 4e-4])
def test_a_pid_is_a_cascade(filter_s: float) -> None:
    proportional = STIFF - SUMMED * (PERIOD_S + filter_s)
    integral_gain = 0.5 * (proportional - math.sqrt(proportional**2 - 4.0 * SUMMED * DAMPED))
    velocity_gain, delay_s = DAMPED + integral_gain * (PERIOD_S + filter_s), 0.5 * PERIOD_S + filter_s
    controller = Cascade(
        position_gain_per_s=SUMMED / integral_gain,
        velocity_gain_N_s_per_m=velocity_gain,
        integral_gain_N_per_m=integral_gain,
        velocity_feedforward=1.0,
        acceleration_feedforward_kg=MASS_KG + velocity_gain * delay_s,
        force_limit_N=1e4,
        difference_span=1,
        velocity_reference_delay_s=delay_s,
        velocity_filter_s=filter_s,
    )
    drive = FeedDrive(
        motor=LinearMotor(mass_kg=10.0, viscous_friction_N_s_per_m=30.0),
        controller=controller,
        travel_m=1.0,
        velocity_limit_m_per_s=2.0,
    )
    limits = {"velocity_m_per_s": 0.4, "acceleration_m_per_s2": 5.0, "jerk_m_per_s3": 100.0}
    motion = motions.get("jerk_limited_moves")(stops_m=(0.0, 0.2, -0.1, 0.0), dwell_s=0.1, **limits)
    system = drive.system(Setup(timing=Timing(sampling_time_s=PERIOD_S, duration_s=3.0, substeps=10), motion=motion))
    system.start([0])
    rows = system.advance(system.n_samples)[:, :, 0]
    logged = {name: rows[:, place] for place, name in enumerate(system.columns)}
    position, force = logged["position_m"], logged["motor_force_N"]

    reference = system.reference
    error = reference[:, 0] - position
    change, share = np.diff(position, prepend=position[0]) / PERIOD_S, PERIOD_S / (PERIOD_S + filter_s)
    speed = lfilter([share], [1.0, share - 1.0], change)
    integral = PERIOD_S * (np.cumsum(error) - error)
    asked = STIFF * error + SUMMED * integral + DAMPED * (reference[:, 1] - speed) + MASS_KG * reference[:, 2]
    off = np.sqrt(np.mean((asked - force) ** 2) / np.mean(force**2))
    assert off < 5e-3
    # What the integral has too much without the delay is seen.
    assert np.ptp(integral_gain * delay_s * reference[:, 1]) > 0.05 * np.ptp(force)
