"""What re-calibration made of the nominal parameters, in their units."""

from fdbench.diagnosis.diagnose import Diagnosis
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.report._page import table
from fdbench.report._templates import Html

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
            *(item.text(nominal.drive, shift) for shift in (0.0, alone, beside)),
            f"{alone:+.2f} σ",
            f"{beside:+.2f} σ",
        ]
        for item, alone, beside in moved
    ]
    return table(HEADER, rows, "lrrrrr")
