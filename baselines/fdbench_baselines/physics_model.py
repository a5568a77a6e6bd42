"""The plant on paper as it stands: what every learning model has to beat."""

from typing import final

from fdbench.errors import SpecError
from fdbench.estimator import BatchEstimator, Context, Estimate
from fdbench.plants import RespondingPlant
from fdbench.record import Record


@final
class PhysicsModel(BatchEstimator):
    r"""Predict the measured output from the command alone, by the plant on paper.

    .. math:: \hat x = G_{pb}\, x_d

    Nothing is learnt from the record: ``output`` does not depend on what was measured.

    References
    ----------
    Chou, Duan, Okwudire, A linear hybrid model for enhanced servo error pre-compensation of feed drives with unmodeled
    nonlinear dynamics, CIRP Annals, eq. (2).
    """

    def skip(self, context: Context) -> str | None:
        """Skip where the plant on paper predicts nothing from the command alone."""
        if not isinstance(context.plant, RespondingPlant):
            return "the plant on paper predicts no output from the command alone"
        return None

    def fit(self, context: Context, record: Record) -> Estimate:
        """Return the nominal response."""
        if not isinstance(context.plant, RespondingPlant):
            raise SpecError(f"physics_model: {self.skip(context)}.")
        return Estimate(output=context.plant.nominal_response(record))
