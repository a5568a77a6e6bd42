"""Feed drive: linear motor or ball screw, rigid or with an elastic screw, in a velocity loop or position cascade."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import final

import numpy as np

from fdbench.effects import Effect, Port
from fdbench.errors import RecordError, SimulationDiverged, SpecError
from fdbench.plants._controllers import Cascade, Following, OpenLoop, VelocityLoop
from fdbench.plants._drive_loop import DriveLoop, drive_plant
from fdbench.plants._drive_observer import Sensors, change_per_newton, state_space
from fdbench.plants._drive_parts import LinearMotor, RotaryMotor, Screw, Table
from fdbench.plants._friction_curve import FrictionLine, friction_line
from fdbench.plants._inverse_dynamics import NAMES_OF, InverseDynamics, InverseDynamicsModel
from fdbench.plants._linear_system import LinearSystem
from fdbench.plants._plant import LinearModel, Plant, StateSpace
from fdbench.plants._state_space import StateSpaceModel
from fdbench.plants._velocity_loop import VelocityLoopModel
from fdbench.record import Record
from fdbench.simulate import layout
from fdbench.simulate.axis import Axis
from fdbench.simulate.block import Mechanics
from fdbench.simulate.stability import check_substep, needed_substeps
from fdbench.simulate.system import FloatArray, Sampled, Setup, Timing
from fdbench.specification import bounded, positive

__all__ = ["Cascade", "FeedDrive", "Following", "LinearMotor", "OpenLoop", "RotaryMotor", "Screw", "Table"]

FEWEST_SUBSTEPS = 10


@final
@dataclass(frozen=True, kw_only=True)
class FeedDrive(Plant):
    r"""One feed axis.

    .. math::
        m_m \dot v_m + B_m v_m + k (x_m - x_t) + c (v_m - v_t) = F_m - F_{effects,m}, \qquad
        m_t \dot v_t + B_t v_t - k (x_m - x_t) - c (v_m - v_t) = -F_{effects,t}

    A rigid axis has x_m = x_t and the sums of masses and frictions. ``effects`` are those that the nominal model
    knows. Models for estimators: ``velocity_loop`` (McPherson 2024, eq. (2.6)), ``inverse_dynamics`` and
    ``directional_inverse_dynamics`` (Janot, Gautier, Brunot 2019), and with ``sensors`` ``state_space``, without linear
    parameters: the target is the velocity (Salehi 2013, chapter 4).

    Parameters
    ----------
    motor : LinearMotor or RotaryMotor
        What drives the axis.
    controller : VelocityLoop, Cascade, OpenLoop or Following
        What asks the motor for its force.
    table : Table or None
        What the motor moves; without it the motor moves itself alone.
    screw : Screw or None
        What is elastic between motor and table; without it the axis is rigid. It needs a table.
    travel_m : float
        How far the axis may be from its zero, to either side. `fdbench diagnose` refuses commands that span much more,
        and proposes motions within it.
    velocity_limit_m_per_s : float
        Greatest speed. `fdbench diagnose` refuses commands that are much faster, and proposes none that is.
    effects : tuple of Effect
        Friction, cogging and so on that the nominal model knows.
    inverse_dynamics : InverseDynamics or None
        What the models of inverse dynamics filter; for estimators alone.
    table_read_late_s : float
        By how much later than the motor's position the table's is read, to first order; earlier where it is negative.
    sensors : Sensors or None
        Noise of the readings; for observers among the estimators alone.
    """

    motor: LinearMotor | RotaryMotor
    controller: VelocityLoop | Cascade | OpenLoop | Following
    table: Table | None = None
    screw: Screw | None = None
    travel_m: float = positive()
    velocity_limit_m_per_s: float = positive()
    effects: tuple[Effect, ...] = ()
    table_read_late_s: float = bounded(-0.1, 0.1, default=0.0)
    inverse_dynamics: InverseDynamics | None = None
    sensors: Sensors | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.sensors is not None and self.sensors.current_noise_A > 0.0 and self.motor.logged != "motor_current_A":
            raise SpecError(f"sensors.current_noise_A: the motor logs no current; it has no {self.motor.constant}.")
        if self.screw is not None and self.table is None:
            raise SpecError("table: missing table; an axis with a screw has a table behind it.")

    @property
    def mass_kg(self) -> float:
        """Total moved mass."""
        return self.motor.mass_kg + (self.table.mass_kg if self.table else 0.0)

    @property
    def viscous_friction_N_s_per_m(self) -> float:
        """Total viscous friction of the linear part."""
        return self.motor.viscous_friction_N_s_per_m + (self.table.viscous_friction_N_s_per_m if self.table else 0.0)

    @property
    def _masses(self) -> dict[Port, float]:
        """Mass that the forces on either side move."""
        if self.screw is None or self.table is None:
            return {Port.MOTOR_FORCE: self.mass_kg, Port.TABLE_FORCE: self.mass_kg}
        return {Port.MOTOR_FORCE: self.motor.mass_kg, Port.TABLE_FORCE: self.table.mass_kg}

    def mechanics(self) -> Mechanics:
        """Return the linear part as matrices."""
        k = c = 0.0
        if self.screw is None or self.table is None:
            mass, viscous = self.mass_kg, self.viscous_friction_N_s_per_m
            moving = [0.0, 1.0, 0.0, 0.0], [0.0, -viscous / mass, 0.0, 0.0]
            A = np.array([*moving, *moving])
            B = np.array([[0.0, 0.0], [1.0 / mass, 1.0 / mass]] * 2)
        else:
            k, c = self.screw.stiffness_N_per_m, self.screw.damping_N_s_per_m
            m, t = self.motor, self.table
            motor = np.array([-k, -c - m.viscous_friction_N_s_per_m, k, c]) / m.mass_kg
            table = np.array([k, c, -k, -c - t.viscous_friction_N_s_per_m]) / t.mass_kg
            A = np.array([[0.0, 1.0, 0.0, 0.0], motor, [0.0, 0.0, 0.0, 1.0], table])
            B = np.array([[0.0, 0.0], [1.0 / m.mass_kg, 0.0], [0.0, 0.0], [0.0, 1.0 / t.mass_kg]])
        return Mechanics(
            A=A,
            B=B,
            stiffness_N_per_m=k,
            damping_N_s_per_m=c,
            rigid=self.screw is None,
            position_limit_m=self.travel_m,
            velocity_limit_m_per_s=self.velocity_limit_m_per_s,
        )

    def rows(self) -> dict[str, float]:
        """Return the rows of a block that encoders and controller set."""
        return {"TABLE_LATE": self.table_read_late_s, **self.controller.rows()}

    @property
    def table_limits(self) -> tuple[float, float]:
        """Travel (m) and velocity (m/s) of the table."""
        return self.travel_m, self.velocity_limit_m_per_s

    def system(self, setup: Setup, n_lanes: int = 1) -> Axis:
        """Return the axis with modelled and unmodelled effects.

        Raises
        ------
        SpecError
            If a substep is too long for the effects, or the nominal control loop is unstable.
        """
        noises = ["motor_position_m", "table_position_m", "velocity_m_per_s", "equation_velocity_m_per_s"]
        noises += ["through_encoders"]
        noises += ["motor_current_A"] if self.motor.logged == "motor_current_A" else []
        setup.noise.check_only(noises, "this feed drive")
        effects = (*self.effects, *setup.unmodelled)
        check_substep(effects, self._masses, setup.timing.sampling_time_s, setup.timing.substeps)
        self.check_loop(setup.timing.sampling_time_s)
        columns = {"motor_position_m": layout.OUT_MOTOR}
        if self.screw is not None:
            columns["table_position_m"] = layout.OUT_TABLE
        columns["position_m"] = layout.OUT_TABLE if self.controller.uses_table else layout.OUT_MOTOR
        columns["velocity_m_per_s"] = layout.OUT_VELOCITY
        columns[self.motor.logged] = layout.OUT_FORCE
        return Axis(
            self.mechanics(),
            self.rows(),
            effects,
            setup,
            columns,
            1.0 / self.motor.force_per_unit,
            self.controller.action_row,
            self.controller.action_name,
            n_lanes,
        )

    def linear_models(self) -> tuple[LinearModel, ...]:
        """Return the models that apply to the controller and specification at hand."""
        models: list[LinearModel] = []
        if isinstance(self.controller, VelocityLoop):
            gain = self.controller.gain_N_s_per_m
            models.append(VelocityLoopModel(mass_kg=self.mass_kg, line=self.friction_line, gain_N_s_per_m=gain))
        if self.inverse_dynamics is not None:
            models += [InverseDynamicsModel(drive=self, protocol=self.inverse_dynamics, name=name) for name in NAMES_OF]
        if self.sensors is not None:
            models.append(StateSpaceModel(plant=self, disturbance_gain=change_per_newton))
        return tuple(models)

    @property
    def friction_line(self) -> FrictionLine:
        """The straight line that a rigid model sees in all nominal friction, at speed."""
        return friction_line(self.effects, self.velocity_limit_m_per_s, self.viscous_friction_N_s_per_m)

    def motor_force(self, record: Record) -> FloatArray:
        """Return the motor's force in table coordinates (n_samples,), from whichever command the record has.

        Raises
        ------
        RecordError
            If the record has no force, torque or current that the nominal motor turns into a force.
        """
        known = self.motor.per_unit()
        for name, newtons in known.items():
            if name in record and newtons is not None:
                return record[name] * newtons if newtons != 1.0 else record[name]
        if "motor_current_A" in record:
            raise RecordError(
                f"{record.source}: motor_current_A gives no force: the model's [plant.motor] has no "
                f"{self.motor.constant}. Add it, or map the column to motor_force_N with its gain in N/A."
            )
        if "motor_torque_Nm" in record:
            raise RecordError(
                f"{record.source}: motor_torque_Nm gives no force: the model's motor is linear. Map the column to "
                "motor_force_N with its gain, or give the model a rotary_motor with its lead_m."
            )
        raise RecordError(
            f"{record.source}: no column {' or '.join(known)}; log the controller's output and map it with its gain, "
            "such as `gain = 35.15` for N per volt."
        )

    def respond(self, command: Record) -> Record:
        """Return what the nominal axis would log of a commanded motion, without noise."""
        columns = _responded(self, *_commanded(command))
        return Record({"time_s": command["time_s"], **columns}, {}, command.source)

    def control_loop(self, sampling_time_s: float) -> DriveLoop:
        """Return the linear part with the nominal effects and the controller; without one that is known, alone."""
        table_mass_kg = self._masses[Port.TABLE_FORCE]
        plant = drive_plant(self.mechanics(), table_mass_kg, self.effects, self.velocity_limit_m_per_s)
        is_unknown = isinstance(self.controller, Following) and self.controller.mass_kg is None
        return DriveLoop(plant, {} if is_unknown else self.controller.rows(), sampling_time_s)

    def check_loop(self, sampling_time_s: float) -> None:
        """Raise a SpecError where the nominal control loop is unstable, with words that say by how much."""
        self.control_loop(sampling_time_s).check()

    def linear_system(self, sampling_time_s: float) -> LinearSystem:
        """Return the nominal axis and its loops; see `LinearisedPlant`."""
        return self.control_loop(sampling_time_s).linear_system()

    def state_space(self, sampling_time_s: float) -> StateSpace:
        """Return the linear part for observers; the nominal friction effects are not in it."""
        if self.sensors is None:
            raise SpecError("sensors: missing table; an observer needs the noise of the readings.")
        motor, reads_table = self.motor, self.controller.uses_table
        return state_space(self.mechanics(), self.sensors, motor.logged, motor.force_per_unit, reads_table)


def nominal_axis(drive: FeedDrive, command: Record) -> Axis:
    """Return the nominal axis of a commanded motion, without noise."""
    return _axis(drive, *_commanded(command))


def _commanded(command: Record) -> tuple[float, bytes, bytes]:
    """Return sampling time, position and velocity of a commanded motion."""
    position, period_s = command["reference_position_m"], command.sampling_time_s
    is_known = "reference_velocity_m_per_s" in command
    velocity = command["reference_velocity_m_per_s"] if is_known else np.gradient(position, period_s)
    return period_s, position.tobytes(), velocity.tobytes()


def _axis(drive: FeedDrive, period_s: float, position: bytes, velocity: bytes) -> Axis:
    speed = np.frombuffer(velocity)
    reference = np.column_stack((np.frombuffer(position), speed, np.gradient(speed, period_s)))
    substeps = max(FEWEST_SUBSTEPS, needed_substeps(drive.effects, drive._masses, period_s))
    timing = Timing(sampling_time_s=period_s, duration_s=len(speed) * period_s, substeps=substeps)
    return drive.system(Setup(timing=timing, motion=Sampled(reference)))


@lru_cache(maxsize=4)
def _responded(drive: FeedDrive, period_s: float, position: bytes, velocity: bytes) -> Mapping[str, FloatArray]:
    """Return the columns that a drive logs; kept, as every estimator of a scenario asks for the same."""
    axis = _axis(drive, period_s, position, velocity)
    axis.start([0])
    rows = axis.advance(axis.n_samples)[:, :, 0]
    if bool(axis.diverged[0]) or not np.isfinite(rows).all():
        raise SimulationDiverged("the nominal axis leaves its travel or velocity limit under this command.")
    return {name: rows[:, index].copy() for index, name in enumerate(axis.columns)}
