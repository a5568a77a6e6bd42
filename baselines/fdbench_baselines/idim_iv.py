"""IDIM-IV: a drive's linear model with instruments from a simulation of its closed loop."""

import dataclasses
from collections.abc import Mapping
from typing import ClassVar, final

import numpy as np

from fdbench.errors import SpecError
from fdbench.estimator import BatchEstimator, Context, Estimate, FloatArray, Regression
from fdbench.plants.feed_drive import FeedDrive, LinearMotor, RotaryMotor
from fdbench.record import Record
from fdbench_baselines._drive_least_squares import LOOP, drive_least_squares, process_columns
from fdbench_baselines._mixed_estimation import CONFOUNDED
from fdbench_baselines._process_force import process_waves, turns
from fdbench_baselines._slip import below_half
from fdbench_baselines._straight_friction import VELOCITIES, force_left, straight
from fdbench_baselines.least_squares import factorise


@final
class IdimIv(BatchEstimator):
    r"""Instrumental variables from a noise-free simulation of the closed loop at the present estimate.

    Of :math:`y = Z \beta + n` the regressors Z are measured under feedback: noise and disturbance n are in them, and
    least squares is biased by :math:`(Z^T Z)^{-1} E[Z^T n]`. The same drive, simulated from the command alone,
    makes regressors W that know nothing of n,

    .. math::
        \hat\beta_i = (\tilde W_i^T \tilde Z)^{-1} \tilde W_i^T \tilde y, \qquad
        W_i = Z(\text{simulation at } \hat\beta_{i-1}), \qquad E[W^T n] = 0

    where the tilde is the filter of the errors, of a velocity loop alone (`_aitken`). A few iterations
    do, as the loop makes the simulated motion nearly the same for any parameters. A velocity loop is simulated by its
    own equation; of an axis in a cascade, masses and viscous friction are those of the estimate, all else is
    nominal.

    Beside Z stand harmonics of a process force that grows with the feed, of a spindle or shaker that slips and drifts
    (`_process_force`), and rows off the straight line of the nominal friction are left out. Last, the data sheet is
    weighed with what the record says, a process force of unknown mean among it (`_mixed_estimation`): without a stated
    covariance the record alone counts. ``covariance`` is that of all this; ``disturbance_N`` is what the parameters
    leave of the target, 0 on rows of inverse dynamics that are left out, and ``output`` is :math:`Z \hat\beta`.

    Parameters
    ----------
    iterations : int
        Simulations, at least 1.
    harmonics : int
        Of the period, where one is known; at least 0.

    Raises
    ------
    SpecError
        If an argument is out of bounds, or the record does not identify every parameter.

    Validity
    --------
    The model's structure must be right: an instrument removes the bias of noise, not that of what the model lacks.

    References
    ----------
    Janot, Vandanjon, Gautier, A generic instrumental variable approach for industrial robot identification, IEEE Trans.
    Control Systems Technology 22 (2014), 132-145; Young, Recursive estimation and time-series analysis, 2nd ed. 2011,
    chapter 7 (refined instruments). Harmonics and data sheet are ours.

    Examples
    --------
    The mass is 1.25 times that of the data sheet, so that beta_1 is 0.4; a shaker biases least squares.

    >>> from fdbench_baselines.least_squares import LeastSquares
    >>> from fdbench_baselines._example import example_drive
    >>> shaken = example_drive(mass_ratio=1.25, wave_N=5.0, period_s=0.065)
    >>> [round(method().fit(*shaken).parameters["beta_1"], 3) for method in (LeastSquares, IdimIv)]
    [0.399, 0.4]
    """

    made_for: ClassVar[tuple[str, ...] | None] = tuple(CONFOUNDED)

    def __init__(self, iterations: int = 3, harmonics: int = 6) -> None:
        for name, value, least in (("iterations", iterations, 1), ("harmonics", harmonics, 0)):
            if not isinstance(value, int) or value < least:
                raise SpecError(f"idim_iv: {name} = {value!r} must be an integer of at least {least}.")
        self.iterations, self.harmonics = iterations, harmonics

    def skip(self, context: Context) -> str | None:
        """Skip where the model is no equation of a drive whose loop can be simulated."""
        if context.model in CONFOUNDED and isinstance(context.plant, FeedDrive):
            return None
        return "the model is no equation of a feed drive in parameters"

    def fit(self, context: Context, record: Record) -> Estimate:
        """Simulate and solve in turn."""
        regression = context.regression(record)
        Z, y, names, gain = regression.regressors, regression.target, regression.names, regression.disturbance_gain
        factorise(Z, names)
        beside = process_columns(regression)
        drive = drive_least_squares(context, regression, beside)
        if context.disturbance_period_s is not None:
            left = np.where(straight(context, Z), y - Z @ drive.record.beta - beside @ drive.beside, 0.0)
            beside = np.hstack((beside, self._waves(context, regression, left)))
        for _ in range(self.iterations):
            parameters = dict(zip(names, drive.found.beta.tolist(), strict=True))
            drive = drive_least_squares(context, regression, beside, simulated(context, record, parameters))
        beta, covariance = drive.found
        output = Z @ beta
        return Estimate(
            parameters=dict(zip(names, beta.tolist(), strict=True)),
            covariance=covariance,
            disturbance_N=force_left(context, Z, y - output) / gain,
            output=output,
            output_variance=float(np.mean((y - output) ** 2)) + np.einsum("ij,jk,ik->i", Z, covariance, Z),
        )

    def _waves(self, context: Context, regression: Regression, left: FloatArray) -> FloatArray:
        time_s, period_s = regression.time_s, context.disturbance_period_s
        if period_s is None or self.harmonics == 0:
            return np.empty((len(time_s), 0))
        if context.model == LOOP:
            feed, harmonics = regression.regressors[:, 0], self.harmonics
        else:  # whose rows are filtered, and hold nothing above
            feed = regression.regressors[:, VELOCITIES[context.model]].sum(axis=1)
            harmonics = below_half(time_s, period_s, self.harmonics)
        return process_waves(turns(time_s, left, period_s), feed, harmonics)


def simulated(context: Context, record: Record, parameters: Mapping[str, float]) -> FloatArray:
    """Return the regressors (n, p) of the record's command in a closed loop without noise, disturbance or process."""
    plant = context.plant
    if not isinstance(plant, FeedDrive):
        raise SpecError("idim_iv: the model is no equation of a feed drive in parameters.")
    if context.model == LOOP:
        velocity = plant.linear_model(LOOP).free_run(record, parameters)
        columns = {name: record[name] for name in ("time_s", "reference_velocity_m_per_s")}
        columns["velocity_m_per_s"] = np.append(0.0, np.asarray(velocity, dtype=np.float64))
        return context.regression(Record(columns, {}, record.source)).regressors
    viscous = [value for name, value in parameters.items() if name.startswith("viscous")]
    return context.regression(
        at_estimate(plant, parameters["mass_kg"], float(np.mean(viscous))).respond(record)
    ).regressors


def at_estimate(plant: FeedDrive, mass_kg: float, viscous_N_s_per_m: float) -> FeedDrive:
    """Return the nominal drive with another total mass and viscous friction, shared between both sides as before.

    >>> from fdbench.scenario import load_scenario
    >>> moved = at_estimate(load_scenario("BallScrewAxis-v1").plant, 200.0, 500.0)
    >>> round(moved.mass_kg, 6), round(moved.viscous_friction_N_s_per_m, 6)
    (200.0, 500.0)
    """
    heavier = mass_kg / plant.mass_kg
    nominal = plant.viscous_friction_N_s_per_m
    thicker = max(viscous_N_s_per_m, 0.0) / nominal if nominal > 0.0 else 1.0
    motor: LinearMotor | RotaryMotor = plant.motor
    viscous = motor.viscous_friction_N_s_per_m * thicker
    if isinstance(motor, LinearMotor):
        motor = dataclasses.replace(motor, mass_kg=motor.mass_kg * heavier, viscous_friction_N_s_per_m=viscous)
    else:
        inertia = motor.inertia_kg_m2 * heavier
        motor = dataclasses.replace(motor, inertia_kg_m2=inertia, viscous_friction_N_s_per_m=viscous)
    table = plant.table
    if table is not None:
        viscous = table.viscous_friction_N_s_per_m * thicker
        table = dataclasses.replace(table, mass_kg=table.mass_kg * heavier, viscous_friction_N_s_per_m=viscous)
    return dataclasses.replace(plant, motor=motor, table=table)
