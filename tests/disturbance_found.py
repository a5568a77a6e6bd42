"""How far the disturbance that an estimator finds is from the true one."""

import numpy as np

from fdbench.estimator import Estimator
from fdbench.scenario import load_scenario


def error_of(estimator: Estimator, name: str, seed: int) -> float:
    """Return the error relative to the true force, over the rows of the regression."""
    scenario = load_scenario(name)
    record, truth = scenario.observe(seed)
    context = scenario.context()
    found = estimator.fit(context, record).disturbance_N
    assert found is not None
    assert truth.disturbance_N is not None
    force = truth.disturbance_N[context.regression(record).rows]
    return float(np.linalg.norm(found - force) / np.linalg.norm(force))
