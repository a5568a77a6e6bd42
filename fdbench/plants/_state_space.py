"""The regression ``state_space``: no linear parameters, but readings for an observer."""

import numpy as np

from fdbench.plants._plant import StateSpace
from fdbench.record import Record
from fdbench.regression import Regression

MODEL = "state_space"


def regression(record: Record, model: StateSpace, disturbance_gain: float) -> Regression:
    """Return the first output at the end of each sampling time as target, with the readings of an observer.

    Row k lasts from sample k to sample k + 1: its readings are the inputs u_k and the outputs y_{k+1}.
    """
    inputs = [record[name][:-1] for name in model.inputs]
    outputs = [record[name][1:] for name in model.outputs]
    n = record.n_samples - 1
    return Regression(
        regressors=np.empty((n, 0)),
        target=outputs[0],
        names=(),
        target_name=model.outputs[0],
        time_s=record["time_s"][:-1],
        rows=np.arange(n),
        disturbance_gain=disturbance_gain,
        readings=np.column_stack(inputs + outputs),
    )
