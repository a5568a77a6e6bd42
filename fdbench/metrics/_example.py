"""An outcome of a few rows whose numbers are all given, for the worked examples of metrics."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from fdbench.estimator import Estimate
from fdbench.metrics._metric import Outcome
from fdbench.plants.spindle_testbed import SpindleTestbed
from fdbench.record import Record
from fdbench.regression import Regression
from fdbench.scenario import Reality, Truth, load_scenario

DRIVE, TESTBED = "ShakerConstant-v0", "SpindleTestbedRandom-v0"
SEGMENT = 4  # samples


def example_outcome(
    estimate: Estimate,
    *,
    target: Sequence[float] | np.ndarray = (),
    regressors: ArrayLike | None = None,
    parameters: Mapping[str, float] | None = None,
    disturbance_N: Sequence[float] | np.ndarray | None = None,
    response: Sequence[float] | None = None,
    predicted_response: Sequence[float] | None = None,
    seconds: float = 0.0,
) -> Outcome:
    """Return an outcome on the drive of ``ShakerConstant-v0`` without its shaker, scored over all rows.

    Parameters
    ----------
    estimate : Estimate
    target : (n_rows,) array_like
        Zeros by default, as many as there are true disturbances.
    regressors : (n_rows, n_parameters) array_like, optional
        Ones by default.
    parameters : mapping of str to float, optional
        True parameters.
    disturbance_N : (n_rows,) array_like, optional
        True disturbance.
    response, predicted_response : (n_rows,) array_like, optional
        True response to the validation motion, and what the estimator predicts.
    seconds : float
        Time of ``fit``.

    Examples
    --------
    >>> outcome = example_outcome(Estimate(), target=[0.1, 0.2])
    >>> outcome.regression.target.tolist(), round(outcome.regression.sampling_time_s, 6)
    ([0.1, 0.2], 0.003003)
    """
    shaker = load_scenario(DRIVE)
    scenario = dataclasses.replace(
        shaker,
        estimation=dataclasses.replace(shaker.estimation, window_s=None),
        reality=Reality(noise=shaker.reality.noise),
    )
    given = dict(parameters or {})
    n = max(1, len(target), 0 if disturbance_N is None else len(disturbance_N))
    time_s = scenario.setup.timing.sampling_time_s * np.arange(n, dtype=np.float64)
    regression = Regression(
        regressors=np.ones((n, len(given))) if regressors is None else np.asarray(regressors, dtype=np.float64),
        target=np.asarray(target, dtype=np.float64) if len(target) else np.zeros(n),
        names=tuple(given),
        target_name="velocity_m_per_s",
        time_s=time_s,
        rows=np.arange(n),
        disturbance_gain=1.0,
    )
    return Outcome(
        scenario=scenario,
        record=Record({"time_s": scenario.setup.timing.sampling_time_s * np.arange(n + 2, dtype=np.float64)}),
        regression=regression,
        truth=Truth(
            parameters=given,
            disturbance_N=None if disturbance_N is None else np.asarray(disturbance_N, dtype=np.float64),
            response=None if response is None else np.asarray(response, dtype=np.float64),
        ),
        estimate=estimate,
        seconds=seconds,
        response=None if predicted_response is None else np.asarray(predicted_response, dtype=np.float64),
    )


def example_segments(claimed_N: Sequence[float], true_N: Sequence[float]) -> Outcome:
    """Return an outcome on a spindle testbed of one segment for training and withheld ones of four samples each.

    Parameters
    ----------
    claimed_N, true_N : (4 n_segments,) array_like
        Force of the withheld segments.

    Examples
    --------
    >>> example_segments([0.0] * 8, [1.0] * 8).scenario.plant.name
    'spindle_testbed'
    """
    testbed = load_scenario(TESTBED)
    period_s = testbed.setup.timing.sampling_time_s
    if not isinstance(testbed.plant, SpindleTestbed):
        raise TypeError(f"{TESTBED} is a scenario of a {type(testbed.plant).__name__}.")
    plant = dataclasses.replace(testbed.plant, segment_s=SEGMENT * period_s, bandwidth_Hz=1.0 / (SEGMENT * period_s))
    n = SEGMENT + len(true_N)
    is_training = np.arange(n) < SEGMENT
    zeros = np.zeros(n)
    columns = {"time_s": period_s * np.arange(n, dtype=np.float64), "acceleration_m_per_s2": zeros, "force_N": zeros}
    regression = Regression(
        regressors=np.empty((len(true_N), 0)),
        target=np.zeros(len(true_N)),
        names=(),
        target_name="force_N",
        time_s=period_s * np.arange(SEGMENT, n, dtype=np.float64),
        rows=np.arange(SEGMENT, n),
        disturbance_gain=1.0,
    )
    return Outcome(
        scenario=dataclasses.replace(testbed, plant=plant),
        record=Record({**columns, "training_sample": is_training.astype(np.float64)}),
        regression=regression,
        truth=Truth(parameters={}, disturbance_N=np.concatenate((np.zeros(SEGMENT), true_N))),
        estimate=Estimate(disturbance_N=np.asarray(claimed_N, dtype=np.float64)),
        seconds=0.0,
    )
