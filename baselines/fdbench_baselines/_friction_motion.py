"""A feed drive's record as a motion under forces: what is read, what drives it, and the friction along it."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fdbench.effects import Effect, Port
from fdbench.errors import SpecError
from fdbench.estimator import Context, FloatArray
from fdbench.plants import Plant
from fdbench.plants._controllers import VelocityLoop
from fdbench.plants._friction_curve import FrictionLine, steady_force
from fdbench.plants._velocity_loop import VelocityLoopModel
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import Record
from fdbench_baselines._simulated_drive import Knob, knobs_of, turned

LOOP = "velocity_loop"
MODELS = (LOOP, "inverse_dynamics")
PHYSICAL = ("mass_kg", "viscous_friction_N_s_per_m", "coulomb_friction_N", "offset_N")
HELD = "held_sample"
FEED = "reference_velocity_m_per_s"
SHAPE_DOTS = 2  # effects.place.name
TURN = 0.05  # by which level or shape of the friction is turned for its slope
STEP = 1e-4  # by which a coefficient is, for that of the parameters
SIXTH_OF_WHITE, SIXTH_OF_WALK = 924.0, 252.0  # squares of the sixth and fifth differences' coefficients
DEVIATIONS_PER_MEDIAN = 1.4826
FORCE_SHARE = 0.01  # of the force limit
LIGHTEST = 0.1  # of the nominal reciprocal mass
FULL = 0.999  # of the force limit, from which the loop is open


class Stated(NamedTuple):
    """How far a drive may be from its data sheet: relative deviations but for the offset."""

    mass: float
    viscous: float
    coulomb: float
    offset_N: float


class Rigid(NamedTuple):
    """Mass, viscous and Coulomb friction and offset of a rigid drive."""

    mass_kg: float
    viscous_N_s_per_m: float
    coulomb_N: float
    offset_N: float


class DriveSheet(NamedTuple):
    """The nominal drive, how far each value may be off, and in which size of forces to think.

    Attributes
    ----------
    mass_kg, viscous_N_s_per_m, coulomb_N, offset_N : float
        Of the straight line that a rigid model sees.
    linear_N_s_per_m : float
        Viscous friction without the slope of friction effects.
    force_unit_N : float
        One per cent of the force limit.
    deviations : (4,) array
        As `Stated`.
    """

    mass_kg: float
    viscous_N_s_per_m: float
    coulomb_N: float
    offset_N: float
    linear_N_s_per_m: float
    force_unit_N: float
    deviations: FloatArray

    @property
    def has_friction(self) -> bool:
        """Whether the sheet knows a Coulomb friction."""
        return self.coulomb_N != 0.0

    def rigid(self, b: FloatArray) -> Rigid:
        r"""Return the drive for coefficients :math:`b_1` to :math:`b_4` of its acceleration, in deviations.

        .. math::
            m = \frac{m_0}{1 + \sigma_m b_1}, \quad B = \frac{m}{m_0} (B_0 + \sigma_B b_2), \quad
            F_c = \frac{m}{m_0} F_{c0} (1 + \sigma_c b_3), \quad F_0 = \frac{m}{m_0} (F_{00} + \sigma_0 b_4)
        """
        moved = (self.deviations * b[:4]).tolist()
        ratio = 1.0 / max(1.0 + moved[0], LIGHTEST)
        return Rigid(
            self.mass_kg * ratio,
            (self.viscous_N_s_per_m + moved[1] * self.linear_N_s_per_m) * ratio,
            self.coulomb_N * (1.0 + moved[2]) * ratio,
            (self.offset_N + moved[3]) * ratio,
        )


class Driven(NamedTuple):
    """The record of a drive, sample by sample.

    Attributes
    ----------
    force_N, mean_velocity_m_per_s : (n,) arrays
        Force of the motor held from each sample to the next, and the velocity on the way.
    reading : (n,) array
        Position (m) of the centre of mass, where the screw's spring is no force, or velocity (m/s) in a velocity loop.
    unit : float
        Deviation of the reading's noise, from sixth differences; of a velocity, that of its change in a sample.
    held : (n,) array of bool
        Samples that were not read anew.
    gain_N_s_per_m : float
        Of the velocity loop, force over the error of the velocity; nominal elsewhere.
    """

    force_N: FloatArray
    mean_velocity_m_per_s: FloatArray
    reading: FloatArray
    unit: float
    held: NDArray[np.bool_]
    gain_N_s_per_m: float


class Bent(NamedTuple):
    r"""A drive's friction along a motion, to first order about a level and shapes.

    .. math:: F(\theta, s) = F_r + \theta F_\theta + \sum_j s_j D_j

    Attributes
    ----------
    level : float
        Of the point, over the nominal one.
    shapes : (n_shapes,) array
        Of the point, logarithms over the nominal values, in the order of `shape_knobs`.
    rest_N, level_N : (n,) arrays
        What is left without level and shapes, and the slope with the level.
    slopes_N : (n, n_shapes) array
        With each shape.
    """

    level: float
    shapes: FloatArray
    rest_N: FloatArray
    level_N: FloatArray
    slopes_N: FloatArray


def declined(context: Context) -> str | None:
    """Return why a record is no motion of a feed drive under a force that is logged, or None."""
    if context.model not in MODELS or not isinstance(context.plant, FeedDrive):
        return "the model is no equation of a feed drive in parameters"
    if not np.isfinite(context.plant.controller.force_limit_N):
        return "the drive's force limit, from which the size of forces is told, is not known"
    return None


def driven(context: Context, record: Record) -> Driven:
    """Return what moves the drive; of samples that are held the motion is a spline, the force a line."""
    plant = context.plant
    if not isinstance(plant, FeedDrive):
        raise SpecError(f"the plant of {context.model} is no feed drive.")
    step_s, n = context.sampling_time_s, record.n_samples
    held = record[HELD] > 0.5 if HELD in record else np.zeros(n, dtype=np.bool_)
    fresh, samples = np.flatnonzero(~held), np.arange(n, dtype=np.float64)
    force = np.interp(samples, samples[fresh], logged_force(plant, record)[fresh])
    if context.model == LOOP:
        reading = filled(record["velocity_m_per_s"], fresh)
        velocity = np.append(0.5 * (reading[1:] + reading[:-1]), reading[-1])
    else:
        reading = table = filled(record["motor_position_m"], fresh)
        if plant.screw is not None and plant.table is not None and "table_position_m" in record:
            table = filled(record["table_position_m"], fresh)
            share = plant.table.mass_kg / plant.mass_kg
            reading = (1.0 - share) * reading + share * table
        velocity = np.diff(table, append=table[-1]) / step_s
    differences = float(np.median(np.abs(np.diff(reading, 6)))) * DEVIATIONS_PER_MEDIAN
    unit = differences / np.sqrt(SIXTH_OF_WALK if context.model == LOOP else SIXTH_OF_WHITE)
    least = float(np.finfo(np.float64).eps) * float(np.abs(reading).max())
    gain = 0.0
    if isinstance(plant.controller, VelocityLoop):
        error, gain = record["reference_velocity_m_per_s"] - reading, plant.controller.gain_N_s_per_m
        limited = np.abs(force) >= FULL * plant.controller.force_limit_N
        error = np.where(limited | held, 0.0, error)
        gain = float(error @ force / (error @ error)) if error.any() else gain
    return Driven(force, velocity, reading, max(unit, least, 1e-300), held, gain)


def bent(plant: FeedDrive, drive: Driven, step_s: float, level: float, shapes: FloatArray) -> Bent:
    """Return the friction along a record's motion about a level and shapes (n_shapes,), by differences."""
    names = [f"effects.{place}" for place, effect in enumerate(plant.effects) if effect in frictions(plant)]
    levels, point = [knob for knob in knobs_of(plant) if knob.name in names], np.append(level - 1.0, shapes)
    knobs = [*levels, *shape_knobs(plant)]

    def at(place: FloatArray) -> FloatArray:
        settings = np.append(np.full(len(levels), place[0]), place[1:])
        return carried(turned(plant, knobs, settings), drive.mean_velocity_m_per_s, step_s)

    here = at(point)
    slopes = np.column_stack([(at(point + step) - here) / TURN for step in TURN * np.eye(len(point))])
    rest = here - slopes @ np.append(level, shapes)
    return Bent(level, shapes, rest, slopes[:, 0], slopes[:, 1:])


def stated(context: Context) -> Stated:
    r"""Return what the data sheet leaves open; where it states no covariance, as much as each value.

    Of a velocity loop :math:`\beta_1` is uncertain as gain over mass, :math:`\beta_1 + \beta_2 = e^{-B T / m}` as
    viscous friction over mass, :math:`\beta_3` as Coulomb friction over mass, and half of :math:`\beta_3 - \beta_4`
    is the offset. Each is taken for the deviation of the value itself, which it is at most.

    >>> from fdbench.scenario import load_scenario
    >>> [round(value, 2) for value in stated(load_scenario("ShakerConstant-v1").context())]
    [0.05, 0.27, 0.27, 0.0]
    """
    nominal = np.array(list(context.nominal.values()))
    C = np.diag(nominal**2) if context.covariance is None else context.covariance
    deviation = np.sqrt(np.diag(C))
    if context.model != LOOP:
        share = deviation / np.where(nominal != 0.0, np.abs(nominal), np.inf)
        return Stated(float(share[0]), float(share[1]), float(share[2]), float(deviation[3]))
    model, damped = context.linear_model, -float(np.log(min(nominal[0] + nominal[1], 1.0)))
    pole = float(np.sqrt(max(C[0, 0] + C[1, 1] + 2.0 * C[0, 1], 0.0)))
    mass, viscous = float(deviation[0] / nominal[0]), min(pole / damped, 1.0) if damped > 0.0 else 0.0
    if len(nominal) < 4 or not isinstance(model, VelocityLoopModel):
        return Stated(mass, viscous, 0.0, 0.0)
    apart = 0.5 * float(np.sqrt(max(C[2, 2] + C[3, 3] - 2.0 * C[2, 3], 0.0)))
    per_N = model.disturbance_time_s(context.sampling_time_s) / model.mass_kg
    return Stated(mass, viscous, float(deviation[2] / abs(nominal[2])), apart / per_N)


def sheet(context: Context) -> DriveSheet:
    """Return what the data sheet says before any sample."""
    plant = context.plant
    if not isinstance(plant, FeedDrive):
        raise SpecError(f"the plant of {context.model} is no feed drive.")
    line, unit_N = plant.friction_line, FORCE_SHARE * plant.controller.force_limit_N
    values = plant.mass_kg, line.viscous_N_s_per_m, line.coulomb_N, line.offset_N
    return DriveSheet(*values, plant.viscous_friction_N_s_per_m, unit_N, np.array(stated(context)))


def model_parameters(context: Context, rigid: Rigid, gain_N_s_per_m: float) -> FloatArray:
    """Return the parameters of the linear model (p,), in the order of ``context.nominal``, for a rigid drive."""
    model = context.linear_model
    if not isinstance(model, VelocityLoopModel):
        return np.array(rigid)
    line = FrictionLine(viscous_N_s_per_m=rigid.viscous_N_s_per_m, coulomb_N=rigid.coulomb_N, offset_N=rigid.offset_N)
    found = replace(model, mass_kg=rigid.mass_kg, gain_N_s_per_m=gain_N_s_per_m, line=line)
    values = found.nominal_parameters(context.sampling_time_s)
    return np.array([values.get(name, 0.0) for name in context.nominal])


def parameters_with_covariance(
    context: Context, drive: Driven, paper: DriveSheet, b: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the model's parameters (p,) and their covariance, for coefficients b and theirs, to first order."""

    def at(place: FloatArray) -> FloatArray:
        return model_parameters(context, paper.rigid(place), drive.gain_N_s_per_m)

    slopes = [(at(b + step) - at(b - step)) / (2.0 * STEP) for step in STEP * np.eye(len(b))]
    J = np.column_stack(slopes)
    spread = J @ covariance @ J.T
    return at(b), np.asarray(0.5 * (spread + spread.T))


def logged_force(plant: FeedDrive, record: Record) -> FloatArray:
    """Return the motor's force (n,) in N; of a velocity loop that logs none that which its nominal gain makes."""
    controller = plant.controller
    if isinstance(controller, VelocityLoop) and not any(name in record for name in plant.motor.per_unit()):
        error = record["reference_velocity_m_per_s"] - record["velocity_m_per_s"]
        limit = controller.force_limit_N
        return np.asarray(np.clip(controller.gain_N_s_per_m * error, -limit, limit))
    return plant.motor_force(record)


def filled(values: FloatArray, fresh: NDArray[np.intp]) -> FloatArray:
    """Return values (n,) with those that are not among the ``fresh`` ones from a cubic spline.

    >>> filled(np.array([0.0, 1.0, 1.0, 9.0, 16.0, 25.0]), np.array([0, 1, 3, 4, 5])).round(9)
    array([ 0.,  1.,  4.,  9., 16., 25.])
    """
    from scipy.interpolate import CubicSpline

    if len(fresh) == len(values) or len(fresh) < 4:
        return values.astype(np.float64)
    return np.asarray(CubicSpline(fresh, values[fresh])(np.arange(len(values))))


def frictions(drive: FeedDrive) -> list[Effect]:
    """Return the nominal effects that resist motion; one that pushes alike in both directions is no friction."""
    fast = drive.velocity_limit_m_per_s
    sources = [e for e in drive.effects if e.port in (Port.MOTOR_FORCE, Port.TABLE_FORCE) and not e.disturbance]
    return [source for source in sources if steady_force(source, fast) != steady_force(source, -fast)]


def carried(drive: FeedDrive, velocity: FloatArray, step_s: float) -> FloatArray:
    """Return the nominal friction (n,) in N along a motion of velocities (n,), with its internal states.

    >>> from fdbench.scenario import load_scenario
    >>> drive = load_scenario("LinearMotorAxis-v1").plant
    >>> carried(drive, np.array([0.0, 0.1, 0.1, -0.1, -0.1]), 5e-4).round(1)[[0, 2, 4]]
    array([  0.,  45., -45.])
    """
    total = np.zeros(len(velocity))
    for effect in frictions(drive):
        kernel, values, states = type(effect).kernel.py_func, effect.values(), [0.0] * len(effect.states)
        for k, v in enumerate(velocity.tolist()):
            force, _, *states = kernel(0.0, step_s, 0.0, v, 0.0, *values, *states)
            total[k] += force
    return total


def shape_knobs(plant: Plant) -> list[Knob]:
    """Return the knobs of what shapes the nominal friction, where the plant is a drive."""
    if not isinstance(plant, FeedDrive):
        return []
    return [knob for knob in knobs_of(plant) if knob.name.count(".") == SHAPE_DOTS]
