"""Output error: the nominal drive is simulated from its command alone, and turned until it does what was recorded."""

from collections.abc import Callable
from typing import ClassVar, NamedTuple, final

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import PluginError, SimulationDiverged, SpecError
from fdbench.estimator import BatchEstimator, Context, Estimate, FloatArray, Regression
from fdbench.plants._drive_sensitivities import sensitivities
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import Record
from fdbench_baselines._drive_least_squares import LOOP, process_columns
from fdbench_baselines._left_friction import LeftFriction, left_friction
from fdbench_baselines._mixed_estimation import CONFOUNDED
from fdbench_baselines._process_force import process_waves, turns
from fdbench_baselines._simulated_drive import LEAST, knobs_of, turned
from fdbench_baselines._slip import below_half
from fdbench_baselines._straight_friction import VELOCITIES
from fdbench_baselines._turned_drive import rigid_parameters, weighed_settings
from fdbench_baselines._whitened_step import whitened_step

LAGS = 40
DECIMALS = 6  # of a setting
LARGEST, SMALLEST = 0.5, 1e-4  # step of a setting
HALVINGS, LISTENED = 8, 2  # of a step that diverges; passes in which the period is sought anew
COULOMB = "coulomb_friction_N"


class _Found(NamedTuple):
    """The drive as it was found, and friction that it lacks with its coefficients."""

    drive: FeedDrive
    friction: LeftFriction | None
    coefficients: FloatArray


@final
class OutputError(BatchEstimator):
    r"""Least squares of what a simulation of the closed loop leaves of the record, weighed with the data sheet.

    The whole nominal drive, screw, friction curves and controller with it, is simulated from the command with its
    values turned by settings :math:`\theta` (`_simulated_drive`), and the target of its linear model is compared:

    .. math::
        y = \hat y(\theta) + X c + n, \quad A(q)\, n = \varepsilon, \qquad
        (\hat\theta, \hat c) = \arg\min \sum_k \varepsilon_k^2 / \sigma^2 + |(\theta, c)|_P^2

    y (n,) is the velocity of a velocity loop, m/s, or the filtered force of inverse dynamics, N: under feedback force
    and position tell the same, and neither drifts. A of order 40 is made from the errors of the last step. Steps are
    those of Gauss and Newton, limited to 0.5 and halved where the drive diverges (`_whitened_step`). Sensitivities are
    exact to rounding,

    .. math:: S_j = \frac{\partial \hat y}{\partial \theta_j} = L \frac{\partial w}{\partial \theta_j}

    with w what the compiled simulator logs, its tangents those of `fdbench.plants._drive_sensitivities`, and L the
    filters of the target, which is linear in w. X is held within a step.

    Columns X (n, m): harmonics of a process force, of a spindle or shaker that slips and drifts (`_process_force`), in
    a velocity loop behind the loop's own pole; in inverse dynamics a friction that differs from the nominal one with
    speed and direction (`_left_friction`).

    Masses and levels of friction are free for the record, which is weighed in every step with the sheet's covariance
    and the doubt of a mean process force (`_mixed_estimation`); without a covariance the record alone counts. P holds
    what the sheet says nothing of within ``other_deviation``. ``parameters`` follow from the drive as it was found,
    ``covariance`` to first order. ``output`` is simulation and columns. In a free run that drive is simulated, its
    friction with it, and not its rigid model: it does what the rigid model cannot, whatever its parameters.

    Parameters
    ----------
    iterations : int
        Steps, at least 1; fewer once none is above 1e-4.
    harmonics : int
        Of the period, where one is known; at least 0.
    other_deviation : float
        How far stiffnesses, shapes of friction and gains may be from the nominal ones, relative, and the friction at a
        node from nominal Coulomb friction, of which it is a share; above 0.

    Raises
    ------
    SpecError
        If an argument is out of bounds, the model is none of a feed drive, or no step leaves its loop stable.
    PluginError
        If a prediction is asked for before a fit, or a kernel of the nominal drive cannot be differentiated.

    Validity
    --------
    It makes no claim of the disturbance. Of white errors of the equation itself it knows no more than least squares
    does. A mean cutting force is taken for friction where neither sheet nor evidence speaks against it, and is not in
    the covariance then. On EMPS, ``free_run_error`` is that of the force in closed loop from the command; the figures
    of nonlinearbenchmark.org are mm of position in open loop from the voltage: `open_loop_position_error`.

    References
    ----------
    Ljung, System Identification, 2nd ed. 1999, sections 4.2 and 10.2; Gautier, Janot, Vandanjon, A new closed-loop
    output error method for parameter identification of robot dynamics, IEEE Trans. Control Systems Technology 21
    (2013), 428-444. Whitening, harmonics, left friction and data sheet are ours.

    Examples
    --------
    The mass is 1.25 times that of the data sheet, so that beta_1 is 0.4 and beta_2 0.6; a shaker moves neither.

    >>> from fdbench_baselines._example import example_drive
    >>> found = OutputError().fit(*example_drive(mass_ratio=1.25, wave_N=5.0, period_s=0.065))
    >>> [round(value, 3) for value in found.parameters.values()]
    [0.4, 0.6]
    """

    made_for: ClassVar[tuple[str, ...] | None] = tuple(CONFOUNDED)

    def __init__(self, iterations: int = 8, harmonics: int = 6, other_deviation: float = 0.2) -> None:
        for name, value, least in (("iterations", iterations, 1), ("harmonics", harmonics, 0)):
            if not isinstance(value, int) or value < least:
                raise SpecError(f"output_error: {name} = {value!r} must be an integer of at least {least}.")
        if not 0.0 < other_deviation < np.inf:
            raise SpecError(f"output_error: other_deviation = {other_deviation!r} must be above 0 and finite.")
        self.iterations, self.harmonics, self.other_deviation = iterations, harmonics, other_deviation
        self._found: _Found | None = None

    def skip(self, context: Context) -> str | None:
        """Skip where the model is no equation of a drive whose loop can be simulated."""
        if context.model in CONFOUNDED and isinstance(context.plant, FeedDrive):
            return None
        return "the model is no equation of a feed drive in parameters"

    def fit(self, context: Context, record: Record) -> Estimate:
        """Simulate, compare and turn the knobs, until they stay where they are."""
        from scipy.signal import lfilter

        drive = context.plant
        if not isinstance(drive, FeedDrive) or context.model not in CONFOUNDED:
            raise SpecError(f"output_error: {self.skip(context)}.")
        regression, knobs = context.regression(record), knobs_of(drive)
        stated = np.array([knob.is_stated for knob in knobs])
        known = np.where(stated, 0.0, self.other_deviation**-2.0)
        deviation_N = self.other_deviation * context.nominal.get(COULOMB, 0.0)

        command = commanded(record)

        def drive_at(settings: NDArray[np.inexact]) -> FeedDrive:
            return turned(drive, knobs, settings)

        def simulated(settings: FloatArray) -> Regression:
            return context.regression(drive_at(settings).respond(command))

        settings = np.zeros(len(knobs))
        now = simulated(settings)
        friction = left_friction(velocity(context, now)) if deviation_N > 0.0 else None
        for turn in range(self.iterations):
            left = regression.target - now.target
            pole = rigid_parameters(context, drive, knobs, settings)[1] if context.model == LOOP else 0.0
            if turn < LISTENED:
                process = self._process(context, regression, lfilter([1.0, -pole], [1.0], left))
            curve = np.empty((len(left), 0)) if friction is None else friction.columns(velocity(context, now))
            beside = np.hstack((lfilter([1.0], [1.0, -pole], process, axis=0), curve))
            of_curve = np.full(curve.shape[1], 1.0) / deviation_N**2 if curve.size else np.empty(0)
            P = np.diag(np.concatenate((known, np.zeros(process.shape[1]), of_curve)))
            if turn < LISTENED:
                coefficients = np.linalg.lstsq(beside, left, rcond=None)[0]
            tangents = sensitivities(drive_at, settings, command)
            S = np.column_stack([context.regression(tangent).target for tangent in tangents])
            step = whitened_step(S, beside, left, left - beside @ coefficients, settings, P, LAGS)
            coefficients = step.beside
            wanted = weighed_settings(context, regression, drive, knobs, settings, step)
            before = settings
            settings, now = stepped(simulated, settings, wanted.settings - settings, stated)
            if np.max(np.abs(settings - before)) < SMALLEST:
                break
        self._found = _Found(turned(drive, knobs, settings), friction, coefficients[process.shape[1] :])
        output = now.target + beside @ coefficients
        beta = rigid_parameters(context, drive, knobs, settings)
        return Estimate(
            parameters=dict(zip(context.nominal, beta.tolist(), strict=True)),
            covariance=wanted.covariance,
            output=output,
            output_variance=np.full(len(output), float(np.mean((regression.target - output) ** 2))),
        )

    def predict(self, context: Context, estimate: Estimate, command: Record) -> FloatArray | None:
        """Return the target of the drive as it was found, simulated, with the friction that it lacks."""
        if self._found is None:
            raise PluginError("output_error: fit(context, record) must come before predict.")
        drive, friction, coefficients = self._found
        regression = context.regression(drive.respond(commanded(command)))
        if friction is None:
            return regression.target
        return np.asarray(regression.target + friction.columns(velocity(context, regression)) @ coefficients)

    def _process(self, context: Context, regression: Regression, equation: FloatArray) -> FloatArray:
        """Return columns (n, m) of a process force in the equation, from what the simulation leaves of it."""
        columns = process_columns(regression)
        time_s, period_s = regression.time_s, context.disturbance_period_s
        if period_s is None or self.harmonics == 0:
            return columns
        if context.model == LOOP:
            feed, harmonics = regression.regressors[:, 0], self.harmonics
        else:
            feed, harmonics = velocity(context, regression), below_half(time_s, period_s, self.harmonics)
        return np.hstack((columns, process_waves(turns(time_s, equation, period_s), feed, harmonics)))


def velocity(context: Context, regression: Regression) -> FloatArray:
    """Return the velocity (n,) in the rows, m/s."""
    return np.asarray(regression.regressors[:, VELOCITIES[context.model]].sum(axis=1))


def commanded(record: Record) -> Record:
    """Return the command of a record; where a velocity alone is commanded, with the position that it leads to."""
    columns = {name: record[name] for name in record.columns if name.startswith("reference_")}
    if "reference_position_m" not in columns and "reference_velocity_m_per_s" in columns:
        velocity_m_per_s = columns["reference_velocity_m_per_s"]
        columns["reference_position_m"] = record.sampling_time_s * np.append(0.0, np.cumsum(velocity_m_per_s[:-1]))
    return Record({"time_s": record["time_s"], **columns}, {}, record.source)


def stepped(
    simulated: Callable[[FloatArray], Regression], settings: FloatArray, change: FloatArray, factors: NDArray[np.bool_]
) -> tuple[FloatArray, Regression]:
    """Return the settings after a change, or after as much of it as leaves the loop stable, and their simulation.

    Factors stay positive.
    """
    change = change / max(1.0, float(np.max(np.abs(change))) / LARGEST)
    for halving in range(HALVINGS):
        # Rounded, so that what the last bits of processors differ by does not grow from step to step.
        tried = np.round(settings + change / 2.0**halving, DECIMALS)
        tried[factors] = np.maximum(tried[factors], LEAST)
        try:
            return tried, simulated(tried)
        except (SimulationDiverged, SpecError):
            continue
    raise SpecError("output_error: the nominal drive is so near its limits that no step leaves its loop stable.")
