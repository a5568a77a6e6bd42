"""Two encoders: what to say where the table's position is read much later, or earlier, than the motor's."""

from fdbench.diagnosis.model.hypothesis import Hypothesis
from fdbench.diagnosis.records.encoder_clocks import late_encoder_text
from fdbench.diagnosis.settings import PLAUSIBLE


def late_encoder_warnings(final: Hypothesis) -> list[str]:
    """Return what to say of two positions that are not read at one time, as the final model has them."""
    late_s = final.variant.table_read_late_s
    if abs(late_s) < PLAUSIBLE.encoders_apart * final.nominal.covered.period_s:
        return []
    return [late_encoder_text(late_s, "that is fitted, and the rest is explained beside it")]
