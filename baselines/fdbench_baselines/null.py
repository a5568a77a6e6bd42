"""The floor of every score: an estimator that has learnt nothing."""

from typing import final

import numpy as np

from fdbench.estimator import BatchEstimator, Context, Estimate
from fdbench.record import Record


@final
class Null(BatchEstimator):
    r"""Predict nothing: parameters 0, disturbance 0, output as before (persistence).

    .. math:: \hat\beta = 0, \quad \hat d = 0, \quad \hat y_k = y_{k-1}, \quad \hat y_0 = y_0

    An estimator that scores below this one does harm.
    """

    def fit(self, context: Context, record: Record) -> Estimate:
        """Repeat the previous target."""
        regression = context.regression(record)
        target = regression.target
        return Estimate(
            parameters=dict(context.nominal),
            disturbance_N=np.zeros(len(target)),
            output=np.concatenate((target[:1], target[:-1])),
        )
