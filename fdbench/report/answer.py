"""The page of a diagnosis from its answer as JSON: all that `fdbench.report.diagnosis` shows but what needs records."""

from collections.abc import Iterator
from pathlib import Path

from fdbench.diagnosis.answer.answer import Answer, read_answer
from fdbench.errors import FdbenchError
from fdbench.report._page import Block, Section, note, paragraph, table, write_page
from fdbench.report._sections import lead, noise_floors, sections
from fdbench.rotary import spoken_of


def write_answer(source: Path, output: Path) -> None:
    """Write the answer of a diagnosis, a file of ``fdbench diagnose --json``, as one HTML page that works offline.

    Raises
    ------
    FdbenchError
        If the file holds no such answer, or the page cannot be written.
    """
    try:
        answer = read_answer(source)
    except FdbenchError as error:
        raise FdbenchError(
            f"{source}: neither a folder of results nor an answer of `fdbench diagnose --json`: {error}"
        ) from error
    remark = (
        f"Written from {source.name} alone: for curves over time, position and frequency, and for the rivals, diagnose "
        "the records again with --html."
    )
    with spoken_of(answer.axis):
        parts = [*sections(answer), Section("Noise floor and re-calibration", list(_basis(answer)))]
        write_page(output, "fdbench: diagnosis of a gap", [*lead(answer), note(remark)], parts)


def _basis(answer: Answer) -> Iterator[Block]:
    yield noise_floors(answer)
    alone, beside = answer.parametric.moved_in_standard_deviations, answer.parametric.moved_beside_effects
    yield paragraph(
        "What re-calibration moved, in standard deviations of the nominal parameters; a page that `fdbench diagnose` "
        "writes has their values, which the answer has not:"
    )
    rows = [
        [name.replace("_", " "), f"{by:+.2f} σ", f"{beside[name]:+.2f} σ" if name in beside else "–"]
        for name, by in alone.items()
    ]
    yield table(["nominal parameter", "alone", "beside the effects"], rows, "lrr")
