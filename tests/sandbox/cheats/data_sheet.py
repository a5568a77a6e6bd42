"""The nominal values for an estimate."""

import numpy as np

from fdbench.estimator import BatchEstimator, Estimate


def truth(context, record):
    nominal = dict(context.nominal)
    return nominal, np.zeros(record.n_samples)


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
