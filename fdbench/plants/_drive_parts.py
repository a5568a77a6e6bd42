"""Parts of a feed drive: motors, table and screw."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from fdbench.specification import check_bounds, nonnegative, positive

TWO_PI = 2.0 * np.pi


@final
@dataclass(frozen=True, kw_only=True)
class LinearMotor:
    """Linear motor: the primary part moves with the table or, on an elastic axis, before it.

    With a force constant, :math:`F = k_f i`, the drive logs its current in place of its force.

    Parameters
    ----------
    mass_kg : float
        What moves with the motor, before the screw if there is one; the table's own comes on top.
    viscous_friction_N_s_per_m : float
        Friction in proportion to speed on the motor's side.
    force_constant_N_per_A : float or None
        Force of one ampere; needed where a current is logged instead of the force.
    """

    mass_kg: float = positive()
    viscous_friction_N_s_per_m: float = nonnegative()
    force_constant_N_per_A: float | None = positive(default=None)

    constant: ClassVar[str] = "force_constant_N_per_A"

    def __post_init__(self) -> None:
        check_bounds(self)

    @property
    def force_per_unit(self) -> float:
        """Newton of motor force in the table's coordinates for one newton or, if logged, one ampere."""
        return self.force_constant_N_per_A or 1.0

    @property
    def logged(self) -> str:
        """Column in which the drive logs the motor's command."""
        return "motor_force_N" if self.force_constant_N_per_A is None else "motor_current_A"

    def per_unit(self) -> dict[str, float | None]:
        """Return the newtons of one unit of each column that may hold the motor's command; None where unknown."""
        return {"motor_force_N": 1.0, "motor_current_A": self.force_constant_N_per_A}


@final
@dataclass(frozen=True, kw_only=True)
class RotaryMotor:
    r"""Rotary motor with ball screw: :math:`m = J (2\pi/l)^2`, :math:`F = T\, 2\pi/l`, :math:`x = \varphi\, l/2\pi`.

    With a torque constant, :math:`T = k_t i`, the drive logs its current in place of its torque.

    Parameters
    ----------
    inertia_kg_m2 : float
        What turns with the motor, as the motor sees it: rotor, coupling, gear, screw or pulley.
    lead_m : float
        Way of the table in one turn of the motor: the lead of a screw; :math:`2 \pi r / i` for a pinion or pulley of
        radius r behind a gear, of which i turns of the motor are one turn. A rotary axis has i itself, ``gear_ratio``:
        turns of the motor for one of the axis.
    viscous_friction_N_s_per_m : float
        Friction in proportion to speed on the motor's side, as force over speed of the table; behind a gear as torque
        over speed of the axis.
    torque_constant_Nm_per_A : float or None
        Torque of one ampere at the motor; needed where a current is logged instead of the torque.
    """

    inertia_kg_m2: float = positive()
    lead_m: float = positive()
    viscous_friction_N_s_per_m: float = nonnegative()
    torque_constant_Nm_per_A: float | None = positive(default=None)

    constant: ClassVar[str] = "torque_constant_Nm_per_A"

    def __post_init__(self) -> None:
        check_bounds(self)

    @property
    def mass_kg(self) -> float:
        """Inertia of motor and screw as a mass at the table."""
        return self.inertia_kg_m2 * (TWO_PI / self.lead_m) ** 2

    @property
    def force_per_unit(self) -> float:
        """Newton of motor force in the table's coordinates for one newton metre or, if logged, one ampere."""
        return TWO_PI / self.lead_m * (self.torque_constant_Nm_per_A or 1.0)

    @property
    def logged(self) -> str:
        """Column in which the drive logs the motor's command."""
        return "motor_torque_Nm" if self.torque_constant_Nm_per_A is None else "motor_current_A"

    def per_unit(self) -> dict[str, float | None]:
        """Return the newtons of one unit of each column that may hold the motor's command; None where unknown."""
        ampere = None if self.torque_constant_Nm_per_A is None else self.force_per_unit
        return {"motor_force_N": 1.0, "motor_torque_Nm": TWO_PI / self.lead_m, "motor_current_A": ampere}


@final
@dataclass(frozen=True, kw_only=True)
class Table:
    """Table with workpiece.

    Parameters
    ----------
    mass_kg : float
        What moves behind the screw; on a rigid axis, what comes on top of the motor's.
    viscous_friction_N_s_per_m : float
        Friction in proportion to speed at the table.
    """

    mass_kg: float = positive()
    viscous_friction_N_s_per_m: float = nonnegative()

    def __post_init__(self) -> None:
        check_bounds(self)


@final
@dataclass(frozen=True, kw_only=True)
class Screw:
    """Axial spring and damper between motor side and table; an axis without this table is rigid.

    Parameters
    ----------
    stiffness_N_per_m : float
        Force over stretch, both as seen at the table.
    damping_N_s_per_m : float
        Force over rate of the stretch.
    """

    stiffness_N_per_m: float = positive()
    damping_N_s_per_m: float = nonnegative()

    def __post_init__(self) -> None:
        check_bounds(self)
