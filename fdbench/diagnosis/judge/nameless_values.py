"""Values that are far off and that no effect stands for: what to say of them."""

from fdbench.diagnosis.model.axis_parameters import EncoderDelay
from fdbench.diagnosis.model.hypothesis import Hypothesis
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.model.nominal_parameter import NominalParameter
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.records.encoder_clocks import late_encoder_text
from fdbench.diagnosis.settings import MODEL, PLAUSIBLE

BESIDE = "that is fitted, and the rest is explained beside it"


def nameless_warnings(final: Hypothesis) -> list[str]:
    """Return what to say of values of a final model that are far-fetched and have no name.

    Where the machine was well before, every value that has changed is told.
    """
    nominal, found = final.nominal, list[str]()
    if nominal.covered.before:
        return found
    drive, scale = nominal.drive, zip(nominal_parameters(nominal), final.shifts, strict=True)
    if any(isinstance(item, EncoderDelay) and _is_apart(item, shift, nominal) for item, shift in scale):
        found.append(late_encoder_text(final.variant.plant.table_read_late_s, BESIDE))
    values = [
        f"{item.name} seems to be {item.text(drive, shift)}, where the model has {item.text(drive, 0.0)}"
        for item, shift in nameless(final)
    ]
    if values:
        found.append(
            f"{', and '.join(values)}: {BESIDE}. No effect stands for it, so it is an unknown cause; look at what "
            "is set there. If that is as in the model, friction that bends otherwise at reversals than the model's may "
            "be why."
        )
    return found


def nameless(final: Hypothesis) -> list[tuple[NominalParameter, float]]:
    """Return the values that are far-fetched and that no effect stands for, such as a gain, and their shifts."""
    return [
        (item, shift)
        for item, shift in zip(nominal_parameters(final.nominal), final.shifts, strict=True)
        if abs(shift) > MODEL.far_fetched and not item.nuisance and not item.cause(final.nominal)
        if not isinstance(item, EncoderDelay)
    ]


def _is_apart(item: EncoderDelay, shift: float, nominal: Nominal) -> bool:
    return abs(shift) * item.deviation >= PLAUSIBLE.encoders_apart * nominal.covered.period_s
