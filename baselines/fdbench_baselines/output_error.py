"""Output error: the drive on paper is simulated from its command alone, and turned until it does what was recorded."""

from typing import final

import numpy as np

from fdbench.errors import PluginError, SimulationDiverged, SpecError
from fdbench.estimator import BatchEstimator, Context, Estimate, FloatArray, Regression
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
DIFFERENCE, LARGEST, SMALLEST = 1e-3, 0.5, 1e-4  # of a setting: for a sensitivity, and of steps
HALVINGS, LISTENED = 6, 2  # of a step that diverges; passes in which the period is sought anew


@final
class OutputError(BatchEstimator):
    def __init__(self, iterations: int = 8, harmonics: int = 6, other_deviation: float = 0.2) -> None:
        for name, value, least in (("iterations", iterations, 1), ("harmonics", harmonics, 0)):
            if not isinstance(value, int) or value < least:
                raise SpecError(f"output_error: {name} = {value!r} must be an integer of at least {least}.")
        if not 0.0 < other_deviation < np.inf:
            raise SpecError(f"output_error: other_deviation = {other_deviation!r} must be above 0 and finite.")
        self.iterations, self.harmonics, self.other_deviation = iterations, harmonics, other_deviation
        self._found: tuple[FeedDrive, LeftFriction | None] | None = None

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
        knobs, regression = knobs_of(drive), context.regression(record)
        stated = np.array([knob.is_stated for knob in knobs])
        precision = np.diag(np.where(stated, 0.0, self.other_deviation**-2.0))
        settings = np.zeros(len(knobs))

        def target(at: FloatArray) -> FloatArray:
            return context.regression(turned(drive, knobs, at).respond(record)).target

        now = target(settings)
        left = regression.target - now
        for turn in range(self.iterations):
            pole = rigid_parameters(context, drive, knobs, settings)[1] if context.model == LOOP else 0.0
            if turn < LISTENED:
                process = self._process(context, regression, lfilter([1.0, -pole], [1.0], left))
            beside = lfilter([1.0], [1.0, -pole], process, axis=0)
            if turn < LISTENED:
                waves = beside @ np.linalg.lstsq(beside, left, rcond=None)[0]
            S = np.column_stack(
                [(target(settings + DIFFERENCE * unit) - now) / DIFFERENCE for unit in np.eye(len(knobs))]
            )
            step = whitened_step(S, beside, left, left - waves, settings, precision, LAGS)
            wanted = weighed_settings(context, regression, drive, knobs, settings, step)
            change = wanted.settings - settings
            change /= max(1.0, float(np.max(np.abs(change))) / LARGEST)
            before = settings
            for halving in range(HALVINGS):
                settings = before + change / 2**halving
                settings[stated] = np.maximum(settings[stated], LEAST)
                try:
                    now = target(settings)
                    break
                except SimulationDiverged:
                    continue
            left, waves = regression.target - now, beside @ step.beside
            if np.max(np.abs(settings - before)) < SMALLEST:
                break
        found = turned(drive, knobs, settings)
        curve, friction = None, np.zeros(len(left))
        coulomb = context.nominal.get("coulomb_friction_N", 0.0)
        if coulomb > 0.0:
            velocity = context.regression(found.respond(record)).regressors[:, VELOCITIES[context.model]].sum(axis=1)
            curve = left_friction(velocity, left - waves, self.other_deviation * coulomb, step.long_run_variance)
            friction = curve.at(velocity)
        self._found = found, curve
        output = now + waves + friction
        beta = rigid_parameters(context, drive, knobs, settings)
        return Estimate(
            parameters=dict(zip(context.nominal, beta.tolist(), strict=True)),
            covariance=wanted.covariance,
            output=output,
            output_variance=np.full(len(output), float(np.mean((regression.target - output) ** 2))),
        )

    def predict(self, context: Context, estimate: Estimate, command: Record) -> FloatArray | None:
        """Return the target of the drive as it was found, simulated, with the friction that was left."""
        if self._found is None:
            raise PluginError("output_error: fit(context, record) must come before predict.")
        found, curve = self._found
        regression = context.regression(found.respond(command))
        if curve is None:
            return regression.target
        velocity = regression.regressors[:, VELOCITIES[context.model]].sum(axis=1)
        return regression.target + curve.at(velocity)

    def _process(self, context: Context, regression: Regression, equation: FloatArray) -> FloatArray:
        """Return columns (n, m) of a process force in the equation, from what the simulation leaves of it."""
        columns = process_columns(regression)
        time_s, period_s = regression.time_s, context.disturbance_period_s
        if period_s is None or self.harmonics == 0:
            return columns
        if context.model == LOOP:
            feed, harmonics = regression.regressors[:, 0], self.harmonics
        else:
            feed = regression.regressors[:, VELOCITIES[context.model]].sum(axis=1)
            harmonics = below_half(time_s, period_s, self.harmonics)
        return np.hstack((columns, process_waves(turns(time_s, equation, period_s), feed, harmonics)))
