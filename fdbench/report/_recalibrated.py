"""What re-calibration made of the nominal parameters, in their units."""

from fdbench.diagnosis.diagnose import Diagnosis
from fdbench.diagnosis.model.hypothesis import WIDTH, NominalParameter, amplitude_of, nominal_parameters
from fdbench.plants.feed_drive import Cascade, FeedDrive
from fdbench.report._page import table
from fdbench.report._templates import Html
from fdbench.units import unit_of
from fdbench.wording import percent, si_text

HEADER = ("nominal parameter", "nominal", "re-calibrated", "beside the effects", "moved by", "beside them")


def recalibrated(found: Diagnosis) -> Html:
    """Return the table of nominal parameters: values before and after, alone and beside the effects, and how far.

    How far is in standard deviations of the nominal value.
    """
    nominal = found.final.nominal
    moved = zip(nominal_parameters(nominal), found.calibrated.shifts, found.final.shifts, strict=True)
    rows = [
        [
            item.name.replace("_", " "),
            *(value_text(item, nominal.drive, shift) for shift in (0.0, alone, beside)),
            f"{alone:+.2f} σ",
            f"{beside:+.2f} σ",
        ]
        for item, alone, beside in moved
    ]
    return table(HEADER, rows, "lrrrrr")


def value_text(item: NominalParameter, drive: FeedDrive, shift: float) -> str:
    """Return the value of a nominal parameter that is moved by so many standard deviations, with its unit."""
    moved, added = item.apply(drive, shift)
    if item.kind == "friction_side":
        share = amplitude_of(added[0]) / (amplitude_of(drive.effects[item.index]) or 1.0) if added else 0.0
        return f"{percent(share)} on the motor"
    if item.effect is not None:
        return si_text(getattr(added[0], item.amplitude), unit_of(item.amplitude))
    if item.kind == "reference_delay" and isinstance(moved.controller, Cascade):
        return si_text(moved.controller.velocity_reference_delay_s, "s")
    if item.kind == "width":
        return si_text(getattr(moved.effects[item.index], WIDTH), unit_of(WIDTH))
    if item.kind == "known_effects":
        known = moved.effects[item.index]
        return si_text(amplitude_of(known), unit_of(type(known).amplitude))
    part = moved.motor if item.side == "motor" else moved.table
    name = "mass_kg" if item.kind == "mass" else "viscous_friction_N_s_per_m"
    return si_text(getattr(part, name), unit_of(name))
