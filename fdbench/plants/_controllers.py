"""Controllers of a feed drive; each acts once a sampling time and holds its force."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal, final

from fdbench.errors import SpecError, did_you_mean
from fdbench.specification import bounded, check_bounds, nonnegative, positive

FEEDBACK = ("motor", "table")


def check_feedback(feedback: str, name: str = "feedback") -> None:
    """Raise a SpecError unless the feedback is that of the motor or of the table."""
    if feedback not in FEEDBACK:
        raise SpecError(f"{name}: unknown side '{feedback}'.{did_you_mean(feedback, FEEDBACK)}")


@final
@dataclass(frozen=True, kw_only=True)
class VelocityLoop:
    """Proportional velocity control, F = K (v_reference - v); source: McPherson (2024), eq. (2.1).

    The velocity v is that of a tachometer, or the difference of the motor's reading over ``difference_span`` samples.

    Parameters
    ----------
    gain_N_s_per_m : float
        K, force at the table, behind lead or gear, over error of velocity.
    force_limit_N : float
        Greatest force that is asked of the motor, as force at the table, behind lead or gear.
    difference_span : int
        Samples over which the velocity is differenced; 0: a tachometer.
    """

    gain_N_s_per_m: float = positive()
    force_limit_N: float = positive()
    difference_span: int = bounded(0, 2, default=0)

    action_row: ClassVar[str] = "ACTION_VELOCITY"
    action_name: ClassVar[str] = "velocity_m_per_s"
    uses_table: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_bounds(self)

    def rows(self) -> Mapping[str, float]:
        """Return the controller's rows of a block."""
        return {
            "VELOCITY_FEEDFORWARD": 1.0,
            "DIFFERENCE_SPAN": float(self.difference_span),
            "VELOCITY_GAIN": self.gain_N_s_per_m,
            "FORCE_LIMIT": self.force_limit_N,
        }


@final
@dataclass(frozen=True, kw_only=True)
class Cascade:
    r"""Position and velocity cascade with feed-forward and a limited force.

    .. math::
        e = k_v (v_r - \delta a_r) + K_x (x_r - x) - \hat v, \qquad
        F = K_p e + K_i \int e\,dt + m_{ff} a_r, \quad |F| \le F_{max}

    The velocity's reference comes later than the position's by :math:`\delta`, to first order; earlier where it is
    negative. The velocity v is the difference of the reading on the side of ``velocity_feedback`` (that of the position
    without it) over ``difference_span`` samples (0: a tachometer), behind a filter of first order with the time
    constant :math:`\tau` = ``velocity_filter_s``,

    .. math:: \hat v_k = \hat v_{k-1} + \frac{T}{T + \tau} (v_k - \hat v_{k-1})

    with the sampling time T of the velocity loop, of which the position loop takes ``position_loop_cycles``: between
    them, the velocity that it asks for is held, and :math:`a_r` goes on. A filter that takes the share :math:`\alpha`
    of each new velocity is one of :math:`\tau = T (1 / \alpha - 1)`. The integral is T times the sum of the errors up
    to the sample before, and stops while the force is limited; one with the error of this sample is that of
    :math:`K_p + K_i T`. Source: Altintas, Manufacturing Automation (2012), section 5.5.

    Parameters
    ----------
    position_gain_per_s : float
        :math:`K_x`, velocity over error of position; 0: a velocity loop alone.
    velocity_gain_N_s_per_m : float
        :math:`K_p`, force at the table, behind lead or gear, over error of velocity.
    integral_gain_N_per_m : float
        :math:`K_i`, force over integral of the error of velocity; :math:`K_p / T_n` with the reset time.
    velocity_feedforward : float
        :math:`k_v`, share of the commanded velocity that is fed forward; 1: all of it.
    acceleration_feedforward_kg : float
        :math:`m_{ff}`, force over commanded acceleration; 0: none is fed forward.
    force_limit_N : float
        :math:`F_{max}`, greatest force that is asked of the motor, as force at the table, behind lead or gear.
    feedback : str
        Whose position closes the position loop, ``"motor"`` or ``"table"``.
    difference_span : int
        Samples over which the velocity is differenced; 0: a tachometer.
    velocity_reference_delay_s : float
        :math:`\delta`, by how much the velocity's reference is later than the position's.
    velocity_feedback : str or None
        Whose velocity closes the velocity loop, ``"motor"`` or ``"table"``; without it as ``feedback``.
    velocity_filter_s : float
        :math:`\tau`, time constant of the filter of the velocity; 0: no filter.
    position_loop_cycles : int
        Cycles of the velocity loop in one of the position loop.
    """

    position_gain_per_s: float = nonnegative()
    velocity_gain_N_s_per_m: float = positive()
    integral_gain_N_per_m: float = nonnegative()
    velocity_feedforward: float = bounded(0.0, 2.0)
    acceleration_feedforward_kg: float = nonnegative()
    force_limit_N: float = positive()
    feedback: str = "motor"
    difference_span: int = bounded(0, 2)
    velocity_reference_delay_s: float = bounded(-0.1, 0.1, default=0.0)
    velocity_feedback: str | None = None
    velocity_filter_s: float = nonnegative(default=0.0)
    position_loop_cycles: int = bounded(1, 64, default=1)

    action_row: ClassVar[str] = "ACTION_POSITION"
    action_name: ClassVar[str] = "position_m"

    def __post_init__(self) -> None:
        check_bounds(self)
        check_feedback(self.feedback)
        if self.velocity_feedback is not None:
            check_feedback(self.velocity_feedback, "velocity_feedback")

    @property
    def uses_table(self) -> bool:
        """Whether the table's scale closes the position loop."""
        return self.feedback == "table"

    def rows(self) -> Mapping[str, float]:
        """Return the controller's rows of a block."""
        return {
            "USE_TABLE": float(self.uses_table),
            "VELOCITY_OF_TABLE": float((self.velocity_feedback or self.feedback) == "table"),
            "VELOCITY_FILTER": self.velocity_filter_s,
            "DIFFERENCE_SPAN": float(self.difference_span),
            "POSITION_LOOP_CYCLES": float(self.position_loop_cycles),
            "POSITION_GAIN": self.position_gain_per_s,
            "VELOCITY_FEEDFORWARD": self.velocity_feedforward,
            "VELOCITY_REFERENCE_DELAY": self.velocity_reference_delay_s,
            "VELOCITY_GAIN": self.velocity_gain_N_s_per_m,
            "INTEGRAL_GAIN": self.integral_gain_N_per_m,
            "ACCELERATION_FEEDFORWARD": self.acceleration_feedforward_kg,
            "FORCE_LIMIT": self.force_limit_N,
        }


@final
@dataclass(frozen=True, kw_only=True)
class OpenLoop:
    """No feedback: the force is the mass times the commanded acceleration, plus the action.

    Parameters
    ----------
    acceleration_feedforward_kg : float
        Force over commanded acceleration; 0: no force but the action.
    force_limit_N : float
        Greatest force that is asked of the motor, as force at the table, behind lead or gear.
    """

    acceleration_feedforward_kg: float = nonnegative()
    force_limit_N: float = positive()

    action_row: ClassVar[str] = "ACTION_FORCE"
    action_name: ClassVar[str] = "force_N"
    uses_table: ClassVar[Literal[False]] = False

    def __post_init__(self) -> None:
        check_bounds(self)

    def rows(self) -> Mapping[str, float]:
        """Return the controller's rows of a block."""
        return {
            "ACCELERATION_FEEDFORWARD": self.acceleration_feedforward_kg,
            "FORCE_LIMIT": self.force_limit_N,
        }


@final
@dataclass(frozen=True, kw_only=True)
class Following:
    r"""No controller is known: `fdbench diagnose` makes the simulated axis follow the measured motion with this one.

    .. math:: F = m \omega \, [v_r - v + \tfrac{\omega}{4} (x_r - x)], \quad \omega = 2 \pi f

    The velocity v is the difference of two readings. What is not given is found from model and
    records: the mass is the nominal one, the greatest force the measured one. Where the loop would be loud, readings
    are smoothed without phase above ``smoothed_Hz``; where it would ring or still be loud, the bandwidth f is lowered.

    Parameters
    ----------
    bandwidth_Hz : float
        f, the highest that is tried.
    feedback : str or None
        Whose position is followed, ``"motor"`` or ``"table"``; `fdbench diagnose` takes the side that was measured,
        and this one where a column does not say which it is.
    mass_kg : float or None
        m; `fdbench diagnose` takes the nominal one.
    greatest_force_N : float or None
        Half of what the drive can probably give; `fdbench diagnose` takes the greatest that was measured.
    smoothed_Hz : float or None
        Frequency above which readings are smoothed; `fdbench diagnose` finds whether it is needed.
    """

    bandwidth_Hz: float = bounded(0.1, 1000.0, default=60.0)
    feedback: str | None = None
    mass_kg: float | None = positive(default=None)
    greatest_force_N: float | None = positive(default=None)
    smoothed_Hz: float | None = positive(default=None)

    action_row: ClassVar[str] = "ACTION_POSITION"
    action_name: ClassVar[str] = "position_m"
    difference_span: ClassVar[int] = 1

    def __post_init__(self) -> None:
        check_bounds(self)
        if self.feedback is not None:
            check_feedback(self.feedback)

    @property
    def uses_table(self) -> bool:
        """Whether the table's position is followed."""
        return self.feedback == "table"

    @property
    def force_limit_N(self) -> float:
        """Force that the drive can probably give: twice the greatest that was measured."""
        return math.inf if self.greatest_force_N is None else 2.0 * self.greatest_force_N

    @property
    def velocity_gain_N_s_per_m(self) -> float:
        """Force for a velocity error."""
        if self.mass_kg is None:
            raise SpecError("controller: the drive has none that is known; only fdbench diagnose does without.")
        return 2.0 * math.pi * self.bandwidth_Hz * self.mass_kg

    @property
    def position_gain_per_s(self) -> float:
        """Velocity for a position error; both poles lie at half the bandwidth."""
        return 2.0 * math.pi * self.bandwidth_Hz / 4.0

    def rows(self) -> Mapping[str, float]:
        """Return the controller's rows of a block."""
        return {
            "USE_TABLE": float(self.uses_table),
            "VELOCITY_OF_TABLE": float(self.uses_table),
            "DIFFERENCE_SPAN": float(self.difference_span),
            "POSITION_GAIN": self.position_gain_per_s,
            "VELOCITY_FEEDFORWARD": 1.0,
            "VELOCITY_GAIN": self.velocity_gain_N_s_per_m,
            "FORCE_LIMIT": math.inf,
        }
