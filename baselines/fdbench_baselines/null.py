"""The floor of every score: an estimator that has learnt nothing beyond the data sheet."""

from typing import final

import numpy as np

from fdbench.estimator import BatchEstimator, Context, Estimate
from fdbench.record import Record


@final
class Null(BatchEstimator):
    r"""Learn nothing: parameters as on the data sheet, disturbance 0, output as before (persistence).

    .. math:: \hat\beta = \beta_0, \quad \hat d = 0, \quad \hat y_k = y_{k-1}, \quad \hat y_0 = y_0

    Its free run is that of the data sheet. An estimator that scores below this one does harm.

    Examples
    --------
    The mass is 1.25 times that of the data sheet, whose parameters are claimed all the same.

    >>> from fdbench_baselines._example import example_drive
    >>> Null().fit(*example_drive(mass_ratio=1.25)).parameters
    {'beta_1': 0.5, 'beta_2': 0.5}
    """

    def fit(self, context: Context, record: Record) -> Estimate:
        """Repeat the data sheet and the previous target."""
        target = context.regression(record).target
        return Estimate(
            parameters=dict(context.nominal),
            disturbance_N=np.zeros(len(target)),
            output=np.concatenate((target[:1], target[:-1])),
        )
