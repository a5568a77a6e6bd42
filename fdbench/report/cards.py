"""What a notebook shows of a result: the verdict, the rankings, what has changed."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from fdbench.benchmark import compare_text
from fdbench.benchmark.compare import Comparison
from fdbench.benchmark.leaderboard import check_mergeable, interval_text
from fdbench.benchmark.statistics import LEVEL, rankings, standings
from fdbench.diagnosis.answer.answer import Answer
from fdbench.report import diagnosis_text, doubts_text, verdict_text
from fdbench.report._page import folded, paragraph, table
from fdbench.report._sections import cause_tables, channel_table
from fdbench.report._templates import Html, part, rendered
from fdbench.rotary import spoken_of

if TYPE_CHECKING:
    import pandas as pd


def _card(title: str, content: Iterable[Html]) -> str:
    return str(rendered("card.html", title=title, content=list(content)))


def verdict_card(answer: Answer) -> str:
    """Return the verdict of a diagnosis, the gap of each channel and the causes as HTML for a notebook."""
    with spoken_of(answer.axis):
        doubts = list(doubts_text.doubts(answer))
        content = [*(paragraph(sentence) for sentence in verdict_text.verdict(answer)), channel_table(answer)]
        content += cause_tables(answer)
        content += [folded("Doubts", part("bullets", doubts))] if doubts else []
        return _card(diagnosis_text.title(answer), content)


def ranking_card(scores: "pd.DataFrame") -> str:
    """Return the rankings of all tracks and kinds of plant as HTML for a notebook."""
    check_mergeable(scores)
    content = []
    for track, plant in rankings(scores):
        rows = [
            [
                "" if line.rank is None else str(line.rank),
                line.estimator,
                f"{line.score.value:.3f}",
                interval_text(line.score),
                f"{line.scenarios} of {line.of_scenarios}",
                str(line.failures),
            ]
            for line in standings(scores, track, plant)
        ]
        header = ["rank", "estimator", "score", f"{LEVEL:.0%} interval", "scenarios", "failures"]
        content += [paragraph(f"{track}: {plant}"), table(header, rows, "rlrrrr")]
    return _card("Score: 1 knows the truth, 0 has learnt nothing (null)", content or [paragraph("No ranking.")])


def comparison_card(comparison: Comparison) -> str:
    """Return what has changed between two runs as HTML for a notebook."""
    rows = compare_text.changes(comparison)
    content = [table(compare_text.HEADER, rows, "llllllr")] if rows else []
    content += [part("bullets", notes)] if (notes := list(compare_text.notes(comparison))) else []
    return _card(compare_text.summary(comparison), content)
