"""Values that are far off and that no effect stands for: what to say of them."""

from fdbench.diagnosis.model.axis_parameters import EncoderDelay
from fdbench.diagnosis.model.hypothesis import Hypothesis
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.records.encoder_clocks import late_encoder_text
from fdbench.diagnosis.settings import MODEL, PLAUSIBLE


def nameless_warnings(final: Hypothesis) -> list[str]:
    """Return what to say of values of a final model that are far-fetched and have no name, each for itself.

    Where the machine was well before, every value that has changed is told.
    """
    nominal, found = final.nominal, list[str]()
    if nominal.covered.before:
        return found
    for item, shift in zip(nominal_parameters(nominal), final.shifts, strict=True):
        if isinstance(item, EncoderDelay):
            if abs(shift) * item.deviation >= PLAUSIBLE.encoders_apart * nominal.covered.period_s:
                late_s = final.variant.plant.table_read_late_s
                found.append(late_encoder_text(late_s, "that is fitted, and the rest is explained beside it"))
        elif abs(shift) > MODEL.far_fetched and not item.nuisance and not item.cause(nominal):
            here, there = (item.text(nominal.drive, own) for own in (shift, 0.0))
            found.append(
                f"{item.name} seems to be {here}, where the model has {there}: that is fitted, and the rest is "
                "explained beside it. No effect stands for it, so it is an unknown cause; look at what is set there. "
                "If that is as in the model, friction that bends otherwise at reversals than the model's may be why."
            )
    return found
