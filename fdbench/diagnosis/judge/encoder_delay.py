"""Two encoders: what to say where the table's position is read much later, or earlier, than the motor's."""

from fdbench.diagnosis.model.hypothesis import Hypothesis
from fdbench.diagnosis.settings import PLAUSIBLE
from fdbench.wording import si_text


def late_encoder_warnings(final: Hypothesis) -> list[str]:
    """Return what to say of two positions that are not read at one time, as the final model has them."""
    late_s = final.variant.table_read_late_s
    if abs(late_s) < PLAUSIBLE.encoders_apart * final.nominal.covered.period_s:
        return []
    return [
        f"table_position_m seems to be read {si_text(abs(late_s), 's')} {'after' if late_s > 0.0 else 'before'} "
        "motor_position_m, which is taken out. If each has a clock of its own, "
        f"`late_s = {late_s:.3g}` for the table's column in the mapping puts that right. If they have one, nothing "
        "here names what makes the table lag by a time."
    ]
