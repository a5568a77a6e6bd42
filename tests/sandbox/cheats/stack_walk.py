"""Looks for the truth in the variables of its callers."""

import inspect
import sys

import numpy as np

from fdbench.estimator import BatchEstimator, Estimate


def truth(context, record):
    frame = sys._getframe()
    frames = [info.frame for info in inspect.stack()]
    while frame is not None:
        frames.append(frame)
        frame = frame.f_back
    for frame in frames:
        for value in frame.f_locals.values():
            found = getattr(value, "truth", value)
            if type(found).__name__ == "Truth":
                return dict(found.parameters), found.disturbance_N
    return None


class Cheat(BatchEstimator):
    """Claims the truth where it finds it, and otherwise what null claims."""

    def fit(self, context, record):
        regression = context.regression(record)
        target = regression.target
        claims = dict.fromkeys(regression.names, 0.0), np.zeros(len(target))
        try:
            claims = truth(context, record) or claims
        except Exception as error:  # noqa: BLE001 - goes on as if it had not tried
            print("refused:", error)
        parameters, disturbance = claims
        disturbance = disturbance if len(disturbance) == len(target) else disturbance[regression.rows]
        output = np.concatenate((target[:1], target[:-1]))
        if any(parameters.values()):
            beta = [parameters[name] for name in regression.names]
            output = regression.regressors @ beta + regression.disturbance_gain * disturbance
        return Estimate(parameters=parameters, disturbance_N=disturbance, output=output)
