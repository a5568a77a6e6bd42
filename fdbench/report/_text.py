"""What the texts of a diagnosis share: from when on something is said, and words for it."""

import re
import textwrap

from fdbench.diagnosis.answer.quantity import Quantity
from fdbench.diagnosis.answer.recorded import Recorded
from fdbench.effects import effects
from fdbench.units import split_unit
from fdbench.wording import percent, si_text

WIDTH = 100
LIKELY = 0.5
WORTH_SAYING = 0.1  # probability of a cause that is worth a sentence
UNEXPLAINED = 0.2  # share of the gap that is worth a sentence
MOSTLY = 0.5  # share of the noise within a run that is most of it
NOISE_ALONE = 1.1  # mean squared gap in units of the floor that passes for noise
MOVED = 3.0  # standard deviations by which a nominal parameter may move without a remark
AFTER, NOMINAL = "mean squared gap after re-calibration", "mean squared nominal gap"
BESIDE_CHANGES = "beside what friction changes by from run to run"


def wrapped(text: str) -> list[str]:
    """Return the lines of a text; a number stays with its unit."""
    depth = len(text) - len(text.lstrip())
    joined = re.sub(r"(?<=\d) (?=(?:%|[nµmkM]?(?:m|s|N|Hz)\b))", "\N{NO-BREAK SPACE}", text.strip())
    first, later = " " * (2 + depth), " " * (4 + depth)
    lines = textwrap.wrap(joined, WIDTH, initial_indent=first, subsequent_indent=later, break_on_hyphens=False)
    return [line.replace("\N{NO-BREAK SPACE}", " ") for line in lines]


def plain(name: str) -> str:
    """Return the words of a name without its unit.

    >>> plain("motor_force_N")
    'motor force'
    """
    return split_unit(name)[0].replace("_", " ")


def is_since_baseline(recorded: Recorded | None) -> bool:
    """Return whether a diagnosis is of what has changed since a baseline."""
    return recorded is not None and recorded.baseline > 0


def scales_all(effect: str) -> bool:
    """Return whether an effect changes every size of a model alike, so that re-calibration hides it."""
    return effect in effects.names() and effects.get(effect).scales_every_value


def signed(change: Quantity) -> str:
    """Return a change with its sign; in per cent where it has no unit."""
    text = si_text(change.value, change.unit) if change.unit else percent(change.value)
    return text if change.value < 0.0 else f"+{text}"


def part_text(reduction: float) -> str:
    """Return a share that is removed; more than all, as of what is beyond the noise alone, is all.

    >>> part_text(1.1), part_text(0.79), part_text(-0.2)
    ('all', '79 %', '0 %')
    """
    return "all" if reduction >= 1.0 else percent(max(reduction, 0.0))
