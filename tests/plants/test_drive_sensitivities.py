"""Sensitivities of a simulated drive against closed forms, to rounding."""

import numpy as np
import pytest
from numpy.typing import NDArray

from fdbench.effects.constant_force import ConstantForce
from fdbench.plants._drive_sensitivities import sensitivities
from fdbench.plants.feed_drive import FeedDrive, LinearMotor, OpenLoop
from fdbench.record import Record

TIME_S = 1e-3 * np.arange(500)
PUSH_N = 50.0  # 100 kg of feed-forward at 0.5 m/s^2


def pushed(settings: NDArray[np.inexact]) -> FeedDrive:
    """Return a mass under a constant push, of mass, viscous friction, a force against it and N/A of its motor."""
    mass, viscous, force, constant = settings.tolist()
    return FeedDrive(
        motor=LinearMotor(mass_kg=mass, viscous_friction_N_s_per_m=viscous, force_constant_N_per_A=constant),
        controller=OpenLoop(acceleration_feedforward_kg=100.0, force_limit_N=1e3),
        travel_m=10.0,
        velocity_limit_m_per_s=10.0,
        effects=(ConstantForce(constant_force_N=force),),
    )


def test_a_pushed_mass_moves_with_its_values_as_the_closed_form_says() -> None:
    """v = (F - F_0) (1 - e^{-B t / m}) / B."""
    m, B, F_0 = 40.0, 200.0, 8.0
    command = Record(
        {"time_s": TIME_S, "reference_position_m": 0.25 * TIME_S**2, "reference_velocity_m_per_s": 0.5 * TIME_S}
    )
    of_mass, of_viscous, of_force, of_constant = sensitivities(pushed, np.array([m, B, F_0, 20.0]), command)
    decay, force = np.exp(-B * TIME_S / m), PUSH_N - F_0
    expected = (
        (of_mass, -force * TIME_S / m**2 * decay),
        (of_viscous, force * (TIME_S / m * decay / B - (1.0 - decay) / B**2)),
        (of_force, -(1.0 - decay) / B),
    )
    for found, derivative in expected:
        error = np.abs(found["velocity_m_per_s"] - derivative).max()
        assert error == pytest.approx(0.0, abs=1e-12 * np.abs(derivative).max())
        assert not found["motor_current_A"].any()
    np.testing.assert_allclose(of_constant["motor_current_A"], -PUSH_N / 20.0**2, rtol=1e-12)
