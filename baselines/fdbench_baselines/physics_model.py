"""The nominal plant as it stands: what every learning model has to beat."""

from typing import final

from fdbench.estimator import BatchEstimator, Context, Estimate
from fdbench.plants import RespondingPlant
from fdbench.record import Record
from fdbench_baselines._data_sheet import sheet_beforehand
from fdbench_baselines._one_step import declined, residual_model


@final
class PhysicsModel(BatchEstimator):
    r"""Predict by the nominal plant: a stage's response to its command, or the target of a linear model.

    .. math:: \hat x = G_{pb}\, x_d \qquad \text{or} \qquad \hat y = Z \beta_0, \quad \hat d = (y - \hat y) / g

    Nothing is learnt from the record: what a drive's nominal equation leaves of a reading is taken for a force. A
    model in state space is one of a single step, if the readings give all states. Parameters and free run would be
    those of the data sheet, which is the row of ``null``, so that none are claimed.

    References
    ----------
    Chou, Duan, Okwudire, A linear hybrid model for enhanced servo error pre-compensation of feed drives with unmodeled
    nonlinear dynamics, CIRP Annals, eq. (2), for the response.

    Examples
    --------
    A machine that is as its data sheet says, under a force of 5 N.

    >>> from fdbench_baselines._example import example_drive
    >>> PhysicsModel().fit(*example_drive(force_N=5.0)).disturbance_N[:3].round(9).tolist()
    [5.0, 5.0, 5.0]
    """

    def skip(self, context: Context) -> str | None:
        """Skip where the nominal plant predicts neither a response nor a target."""
        return None if isinstance(context.plant, RespondingPlant) else declined(context)

    def fit(self, context: Context, record: Record) -> Estimate:
        """Return the nominal response, or the nominal target with what is left of it."""
        if isinstance(context.plant, RespondingPlant):
            return Estimate(output=context.plant.nominal_response(record))
        regression, predicted = residual_model(context, context.regression(record))
        if predicted is not None:
            return Estimate(disturbance_N=regression.target / regression.disturbance_gain, output=predicted)
        output = regression.regressors @ sheet_beforehand(context).nominal
        return Estimate(disturbance_N=(regression.target - output) / regression.disturbance_gain, output=output)
