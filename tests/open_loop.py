"""A mass in open loop: the same force moves it another way in each run, by its friction."""

import numpy as np

from fdbench.diagnosis.model.nominal import Nominal, Simulation
from fdbench.plants.feed_drive import FeedDrive, Following, LinearMotor
from fdbench.record import Record

PERIOD_S, MASS_KG = 1e-3, 10.0
STAIRS = np.repeat([0.0, 30.0, -60.0, 30.0, -45.0, 90.0, -45.0, 0.0], 250)
NOMINAL = Nominal(
    plant=FeedDrive(
        motor=LinearMotor(mass_kg=MASS_KG, viscous_friction_N_s_per_m=30.0),
        controller=Following(),
        travel_m=5.0,
        velocity_limit_m_per_s=5.0,
    ),
    simulation=Simulation(substeps=10),
)


def recorded(force: np.ndarray, friction: float, seed: int, **columns: np.ndarray) -> Record:
    """Return a record of the mass under a force."""
    speed = np.zeros(len(force))
    for k in range(len(force) - 1):
        speed[k + 1] = speed[k] + PERIOD_S / MASS_KG * (force[k] - friction * speed[k])
    position = PERIOD_S * np.cumsum(speed) + 1e-7 * np.random.default_rng(seed).standard_normal(len(force))
    time = PERIOD_S * np.arange(len(force))
    return Record({"time_s": time, "position_m": position, "motor_force_N": force, **columns}, {}, f"run {seed}")
