"""Errors that a user can cause. Each says where, what, what is allowed and what was probably meant."""

import difflib
import re
from collections.abc import Iterable
from typing import ClassVar

LONGEST_MESSAGE = 1600
LONGEST_WORD = 240
LEFT_OUT = " [...] "
_BREAKS = re.compile(r"\s*[\t\n\v\f\r\x1c-\x1f\x85\u2028\u2029]\s*")


def printable(text: str, *, in_lines: bool = False) -> str:
    r"""Return a text that may hold what users gave, fit for a terminal.

    Breaks of lines become blanks, unless it is ``in_lines``; other characters that cannot be printed are written as
    escapes.

    >>> printable("a\nb \x1b[31mred")
    'a b \\x1b[31mred'
    """
    if in_lines:
        return "\n".join(printable(line) for line in text.splitlines())
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in _BREAKS.sub(" ", text))


def brief(text: str) -> str:
    """Return a text of which the middle is left out where it is long; so it is done with each long word.

    >>> len(brief(100_000 * "9")), len(brief(5_000 * "word "))
    (240, 1600)
    """
    if len(text) > LONGEST_WORD:
        text = re.sub(rf"\S{{{LONGEST_WORD + 1},}}", lambda found: _shortened(found[0], LONGEST_WORD), text)
    return _shortened(text, LONGEST_MESSAGE)


def _shortened(text: str, longest: int) -> str:
    """Return the begin and the end of a text that is longer than the longest."""
    if len(text) <= longest:
        return text
    end = longest // 3
    return f"{text[: longest - end - len(LEFT_OUT)]}{LEFT_OUT}{text[-end:]}"


class FdbenchError(Exception):
    """Base of every error caused by input; the command line prints it and exits with 2.

    The message is made `printable` and `brief`, as it may quote the input.
    """

    in_lines: ClassVar[bool] = False  # whether breaks of lines are its own

    def __init__(self, message: str = "") -> None:
        super().__init__(brief(printable(message, in_lines=self.in_lines)))


class SpecError(FdbenchError):
    """A scenario, model or mapping file breaks its schema."""


class UnstableLoop(SpecError):
    """The control loop of a model is unstable."""


class RecordError(FdbenchError):
    """A record has missing, misnamed or damaged data."""


class MissingData(RecordError):
    """Measured data that the user has to fetch are not on this machine."""


class UnknownName(FdbenchError):
    """A plug-in, scenario or column of this name does not exist."""


class PluginError(FdbenchError):
    """A plug-in file cannot be loaded or breaks its contract."""

    in_lines = True


class SimulationDiverged(FdbenchError):
    """A simulated state left the limits of its scenario."""


def raise_all(misses: Iterable[str], error: type[FdbenchError] = PluginError) -> None:
    """Raise one error that holds all misses, each a sentence of its own; nothing if there are none.

    >>> raise_all(["mass_kg is not finite.", "lead_m is below 0."])
    Traceback (most recent call last):
    ...
    fdbench.errors.PluginError: mass_kg is not finite. lead_m is below 0.
    """
    found = list(misses)
    if found:
        rest = f" And {len(found) - MOST_MISSES} more." if len(found) > MOST_MISSES else ""
        raise error(" ".join(found[:MOST_MISSES]) + rest)


MOST_MISSES = 8  # that one error names

LONGEST_LIST = 30
LONGEST_NAME = 200  # beyond it, no name is near


def did_you_mean(name: str, allowed: Iterable[str]) -> str:
    """Return `` Did you mean x?`` for the nearest allowed name, else the list of allowed names.

    Case does not count, and a part of a name, of at least three letters, is near. Of a long list the five nearest
    names are returned.

    >>> did_you_mean("mas_kg", ["mass_kg", "stiffness_N_per_m"])
    ' Did you mean mass_kg?'
    >>> did_you_mean("LuGre", ["lugre_friction", "backlash"])
    ' Did you mean lugre_friction?'
    >>> did_you_mean("zzz", ["b", "a"])
    ' Allowed: a, b.'
    """
    name, candidates = name[:LONGEST_NAME], sorted(set(allowed))
    folded = {candidate.casefold(): candidate for candidate in candidates}
    wanted = name.casefold()
    nearest = difflib.get_close_matches(name, candidates, n=1, cutoff=0.6)
    nearest += [folded[near] for near in difflib.get_close_matches(wanted, folded, n=1, cutoff=0.6)]
    nearest += [candidate for near, candidate in folded.items() if len(wanted) >= 3 and wanted in near]
    if nearest:
        return f" Did you mean {nearest[0]}?"
    if len(candidates) > LONGEST_LIST:
        first = [folded[near] for near in difflib.get_close_matches(wanted, folded, n=5, cutoff=0.0)]
        return f" Nearest of the {len(candidates)} that are allowed: {', '.join(first)}."
    return f" Allowed: {', '.join(candidates) if candidates else 'none'}."
