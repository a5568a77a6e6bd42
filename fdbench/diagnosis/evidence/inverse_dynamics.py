"""Inverse dynamics: the forces that a motion asks for and the model does not have, on motor side and table."""

import math
from collections.abc import Mapping

import numpy as np

from fdbench.diagnosis.records.noise_model import NoiseModel
from fdbench.diagnosis.records.runs import DEFLECTION, RecordedRun
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import FloatArray


def inverse_dynamics_residuals(
    run: RecordedRun, gap: Mapping[str, FloatArray], noise_models: Mapping[str, NoiseModel], drive: FeedDrive
) -> FloatArray:
    r"""Return the inverse-dynamics residuals of a run, (n_balances, ..., n_samples - 3), in units of their noise.

    The gaps of two runs of one linear drive obey its equations of motion, so that what is left is what acts on the
    motor side and on the table, at the time and the place where it acts, whatever the loop makes of it:

    .. math::
        d_m = \Delta F - m_m \Delta\ddot x_m - B_m \Delta\dot x_m - k \Delta s - c \Delta\dot s, \qquad
        d_t = k \Delta s + c \Delta\dot s - m_t \Delta\ddot x_t - B_t \Delta\dot x_t

    with the deflection of the screw :math:`s = x_m - x_t`; where it was not measured, the sum of both with one mass.
    Derivatives are those in the middle between samples, where a force that is held acts on average.
    """
    h, force, position = run.period_s, gap["motor_force_N"][..., 1:-2], gap["position_m"]
    noise = {name: floor.rms for name, floor in noise_models.items()}
    motor, table, screw = drive.motor, drive.table, drive.screw

    if screw is None or table is None or DEFLECTION not in gap:
        left = force - inertia_and_drag(drive.mass_kg, drive.viscous_friction_N_s_per_m, position, h)
        return np.asarray(left / math.hypot(noise["motor_force_N"], drive.mass_kg / h**2 * noise["position_m"]))[None]
    deflection = gap[DEFLECTION]
    x_t = table_position(gap, drive)
    k, c = screw.stiffness_N_per_m, screw.damping_N_s_per_m
    spring = (
        k * 0.5 * (deflection[..., 1:-2] + deflection[..., 2:-1])
        + c * (deflection[..., 2:-1] - deflection[..., 1:-2]) / h
    )
    spread = noise[DEFLECTION] * math.hypot(k / math.sqrt(2.0), c * math.sqrt(2.0) / h)
    on_motor = force - inertia_and_drag(motor.mass_kg, motor.viscous_friction_N_s_per_m, x_t + deflection, h) - spring
    on_table = spring - inertia_and_drag(table.mass_kg, table.viscous_friction_N_s_per_m, x_t, h)
    jerky = noise["position_m"] / h**2
    found = np.empty((2, *spring.shape))
    np.divide(on_motor, math.hypot(noise["motor_force_N"], motor.mass_kg * jerky, spread), out=found[0])
    np.divide(on_table, math.hypot(table.mass_kg * jerky, spread), out=found[1])
    return found


def inertia_and_drag(mass_kg: float, viscous: float, x: FloatArray, h: float) -> FloatArray:
    """Return the force that moves a mass against viscous friction along x, in the middle between samples h apart."""
    acceleration = (x[..., 3:] - x[..., 2:-1] - x[..., 1:-2] + x[..., :-3]) / (2.0 * h**2)
    return np.asarray(mass_kg * acceleration + viscous * (x[..., 2:-1] - x[..., 1:-2]) / h)


def table_position(channels: Mapping[str, FloatArray], drive: FeedDrive) -> FloatArray:
    """Return the position of the table, or that of the motor where the deflection of the screw was not measured."""
    position = channels["position_m"]
    return position if drive.controller.uses_table or DEFLECTION not in channels else position - channels[DEFLECTION]
