"""Inverse dynamics of one mass, by hand."""

import dataclasses

import numpy as np
import pytest
from axis_lab import drive

from fdbench.diagnosis.evidence.inverse_dynamics import inverse_dynamics_residuals
from fdbench.diagnosis.records.noise_model import white
from fdbench.diagnosis.records.runs import RecordedRun

PERIOD_S = 1e-3
NOISE = {"motor_force_N": white(2.0, measured=True), "position_m": white(1e-12, measured=True)}


def test_inverse_dynamics_of_one_mass_by_hand() -> None:
    """Motions that a force explains ask for nothing more; the rest is the force that was added, in units of noise."""
    paper = dataclasses.replace(drive(), table=None, screw=None)
    time_s = np.arange(2000) * PERIOD_S
    omega = 2.0 * np.pi * 3.0
    position = 1e-3 * np.sin(omega * time_s)
    inertia = -paper.mass_kg * omega**2 * position
    drag = paper.viscous_friction_N_s_per_m * 1e-3 * omega * np.cos(omega * time_s)
    run = RecordedRun(name="x", period_s=PERIOD_S, reference=np.zeros((2000, 3)), channels={}, lap=None)
    gap = {"motor_force_N": inertia + drag + 5.0, "position_m": position}
    (left,) = inverse_dynamics_residuals(run, gap, NOISE, paper)
    # Between samples the force is held while the motion goes on, hence half a sample of lag.
    lag = np.abs(np.gradient(inertia + drag)).max() * 0.5
    assert left.mean() == pytest.approx(5.0 / np.hypot(2.0, paper.mass_kg / PERIOD_S**2 * 1e-12), abs=0.01)
    assert np.abs(left - 2.5).max() < 0.55 * lag
