"""The nominal machine's own free run, axis by axis: what estimators correct that learn its error."""

from typing import NamedTuple

import numpy as np

from fdbench.errors import SpecError
from fdbench.estimator import Context, FloatArray
from fdbench.plants import RespondingPlant
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import Record

LOOP = "velocity_loop"
DRIVES = (LOOP, "inverse_dynamics", "directional_inverse_dynamics")


class Run(NamedTuple):
    """The nominal machine's own run under a command: target (n,), and inputs of a model of its error (n, n_inputs)."""

    target: FloatArray
    inputs: FloatArray


def unpredictable(context: Context) -> str | None:
    """Return why the nominal machine has no free run, or None if it has one."""
    if isinstance(context.plant, RespondingPlant):
        return None
    if context.model in DRIVES and isinstance(context.plant, FeedDrive):
        return None
    return "the nominal model predicts nothing from a command alone"


def nominal_runs(context: Context, command: Record, name: str) -> list[Run]:
    """Return the nominal machine's run under a command, one for each axis; ``name`` is the estimator that asks."""
    plant, model, reason = context.plant, context.linear_model, unpredictable(context)
    if isinstance(plant, RespondingPlant):
        return [Run(axis, axis[:, None]) for axis in np.split(plant.nominal_response(command), len(context.nominal))]
    if reason is not None or not isinstance(plant, FeedDrive):
        raise SpecError(f"{name}: {reason}.")
    if context.model == LOOP:
        velocity = np.asarray(model.free_run(command, context.nominal))
        moved = {"velocity_m_per_s": np.append(0.0, velocity)}
        reference = {column: command[column] for column in ("time_s", "reference_velocity_m_per_s")}
        return [Run(velocity, model.regression(Record(reference | moved)).regressors)]
    regressors = model.regression(plant.respond(command)).regressors
    return [Run(regressors @ np.array(list(context.nominal.values())), regressors)]


def known(context: Context, run: Run) -> FloatArray:
    """Return inputs (n, m): those of a nominal run, of a stage its response's first and second change by row too."""
    if not isinstance(context.plant, RespondingPlant):
        return run.inputs
    change = np.diff(run.inputs, axis=0, prepend=run.inputs[:1])
    return np.hstack((run.inputs, change, np.diff(change, axis=0, prepend=change[:1])))


def root_mean_square(values: FloatArray) -> FloatArray:
    """Return the size of each column, 1 where there is nothing."""
    size = np.sqrt(np.mean(values**2, axis=0))
    return np.where(size > 0.0, size, 1.0)
