"""A feed drive as a state-space model for observers: command in, velocity and position out."""

from dataclasses import dataclass
from typing import final

import numpy as np

from fdbench.plants._plant import StateSpace
from fdbench.record import FloatArray
from fdbench.simulate.block import Mechanics
from fdbench.simulate.exponential import exponential
from fdbench.specification import check_bounds, nonnegative, positive


@final
@dataclass(frozen=True, kw_only=True)
class Sensors:
    """Standard deviations of the readings of a drive, as data sheets give them.

    Parameters
    ----------
    velocity_noise_m_per_s : float
        Of the tachometer.
    position_noise_m : float
        Of the motor's encoder.
    current_noise_A : float
        Of the logged current.
    """

    velocity_noise_m_per_s: float = positive()
    position_noise_m: float = positive()
    current_noise_A: float = nonnegative(default=0.0)

    def __post_init__(self) -> None:
        check_bounds(self)


def state_space(
    mechanics: Mechanics, sensors: Sensors, command: str, force_per_unit: float, reads_table: bool
) -> StateSpace:
    """Return position and velocity, or those of motor and table, under the command and a force on the table."""
    n = 2 if mechanics.rigid else 4
    C = np.zeros((2, n))
    C[0, 3 if reads_table and not mechanics.rigid else 1] = 1.0
    C[1, 0] = 1.0
    limits = [mechanics.position_limit_m, mechanics.velocity_limit_m_per_s] * (n // 2)
    return StateSpace(
        A=mechanics.A[:n, :n],
        B=mechanics.B[:n, :1] * force_per_unit,
        E=-mechanics.B[:n, 1],
        C=C,
        inputs=(command,),
        outputs=("velocity_m_per_s", "motor_position_m"),
        input_variances=np.array([sensors.current_noise_A**2]),
        output_variances=np.array([sensors.velocity_noise_m_per_s, sensors.position_noise_m]) ** 2,
        initial_variances=np.array(limits) ** 2,
        process_variances=np.zeros(n),
    )


def change_per_newton(space: StateSpace, sampling_time_s: float) -> float:
    """Return by how much a force of one newton over a sampling time changes the first output."""
    n = len(space.A)
    generator = np.zeros((n + 1, n + 1))
    generator[:n, :n], generator[:n, n] = space.A, space.E
    flow: FloatArray = exponential(generator * sampling_time_s)
    return float(space.C[0] @ flow[:n, n])
