"""The page of a diagnosis: the answer, the worst gap, where it lies, causes, shrinkage; then all curves and rivals."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from fdbench.diagnosis.diagnose import Diagnosis
from fdbench.diagnosis.repaired import model_text
from fdbench.diagnosis.search.stage import Stage
from fdbench.diagnosis.settings import SEARCH
from fdbench.report._bars import bars
from fdbench.report._curves import Curves
from fdbench.report._page import Block, Section, folded, note, paragraph, table, write_page
from fdbench.report._recalibrated import recalibrated
from fdbench.report._sections import lead, noise_floors, sections
from fdbench.report._templates import part
from fdbench.rotary import spoken_of
from fdbench.wording import percent, si_text

SEEN_RIVALS = 8


def write_diagnosis(found: Diagnosis, path: str | Path) -> None:
    """Write a diagnosis as one HTML file that works offline.

    Parameters
    ----------
    found : Diagnosis
    path : path

    Raises
    ------
    FdbenchError
        If the file cannot be written.
    """
    with spoken_of(found.answer.axis):
        curves = Curves(found)
        parts = [
            Section("The gap", [curves.worst()]),
            *sections(found.answer),
            Section("All curves", curves.folded()),
            Section("Rivals", list(_rivals(found.stages))),
            Section("Records, noise floor and re-calibration", list(_basis(found))),
            Section("Repaired model", [folded("As a file", part("preformatted", model_text(found)))]),
        ]
        write_page(Path(path), "fdbench: diagnosis of a gap", list(lead(found.answer)), parts)


def _rivals(stages: Sequence[Stage]) -> Iterator[Block]:
    yield note(
        "Each round tries every effect of the library on top of those found before; bars show which share of the gap "
        f"beyond the noise it removes on what was not fitted. Below {percent(SEARCH.smallest_gain)} none is "
        "added. Only the best are refined in closed loop; the others are estimated from one simulation."
    )
    for number, stage in enumerate(stages, start=1):
        base = ", ".join(effect.name for effect in stage.base.effects) or "the re-calibrated model"
        gains = [(rival, stage.gain(rival)) for rival in stage.rivals]
        names = [rival.kind.name for rival, _ in gains[:SEEN_RIVALS]]
        blocks: list[Block] = [note(f"On top of {base}.")]
        if names:
            shares = [min(max(gain, 0.0), 1.0) for _, gain in gains[:SEEN_RIVALS]]
            blocks.append(bars("Share removed", names, shares, longest=1.0))
        rows = [
            [
                rival.kind.name,
                percent(min(gain, 1.0)) if gain > -1.0 else "much worse",
                f"{rival.misfit:.4g}",
                "yes" if rival.refined else "no",
            ]
            for rival, gain in gains
        ]
        header = ["effect", "removes", "weighted misfit", "refined in closed loop"]
        blocks.append(folded("Numbers", table(header, rows, "lrrl")))
        yield Section(f"Round {number}", blocks)


def _basis(found: Diagnosis) -> Iterator[Block]:
    rows = [
        [
            Path(run.name).name,
            str(run.repeats),
            str(run.n_samples),
            si_text(run.period_s, "s"),
            "–" if run.lap is None else si_text(run.lap * run.period_s, "s"),
            percent(float(out.mean())),
        ]
        for run, out in zip(found.split.runs, found.split.held_out, strict=True)
    ]
    yield table(["record", "mean of", "samples", "sampling time", "repeats itself after", "held out"], rows, "lrrrrr")
    yield noise_floors(found.answer)
    yield paragraph("What re-calibration moved:")
    yield recalibrated(found)
