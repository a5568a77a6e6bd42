"""Attacks: files of every kind that users feed in, mutated, and given to the functions behind the commands.

``python benchmarks/mutated_inputs.py`` prints how they ended. Each may be accepted, or refused by one clear message; a
traceback, a hang of more than 5 s, a message that is long or cannot be printed, and numbers that are not those of the
file are defects.
"""

import contextlib
import io
import math
import signal
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import typer

from fdbench.errors import LONGEST_MESSAGE, FdbenchError, printable
from mutations import targets
from mutations.mutate import mutated

LIMIT_S = 5.0  # of processor time
LONGEST_WAIT_S = 60.0
ACCEPTED, REFUSED, TRACEBACK, HANG, UNCLEAR, WRONG = OUTCOMES = (
    *("accepted", "refused", "traceback", "hang", "unclear message", "other numbers"),
)
DEFECTS = (TRACEBACK, HANG, UNCLEAR, WRONG)


class _Hang(BaseException):
    """The time is over; no handler of the code under attack may take it for its own."""


@dataclass
class Tally:
    """How the mutations of one row ended, and what each defect was."""

    counts: Counter[str] = field(default_factory=Counter)
    defects: list[str] = field(default_factory=list)
    slowest_s: float = 0.0


@contextlib.contextmanager
def _alarm() -> Iterator[None]:
    def ring(*_: object) -> None:
        raise _Hang

    clocks = ((signal.SIGPROF, signal.ITIMER_PROF, LIMIT_S), (signal.SIGALRM, signal.ITIMER_REAL, LONGEST_WAIT_S))
    before = [signal.signal(number, ring) for number, *_ in clocks]
    for _, timer, limit_s in clocks:
        signal.setitimer(timer, limit_s)
    try:
        yield
    finally:
        for (number, timer, _), handler in zip(clocks, before, strict=True):
            signal.setitimer(timer, 0.0)
            signal.signal(number, handler)


def outcome(call: Callable[[], str]) -> tuple[str, str]:
    """Return how a call ended, and in words why; a call that returns a text says so that numbers are wrong.

    What the command line turns into one message and an exit with 2 is refused: errors of input, of files and of memory.
    """
    said = io.StringIO()
    try:
        with (
            _alarm(),
            contextlib.redirect_stdout(said),
            contextlib.redirect_stderr(said),
            warnings.catch_warnings(record=True),
        ):
            warnings.simplefilter("always")
            wrong = call()
    except _Hang:
        return HANG, traceback.format_exc()
    except FdbenchError as error:
        text = str(error)
        is_clear = text == printable(text, in_lines=error.in_lines) and 5 < len(text) <= LONGEST_MESSAGE
        return (REFUSED, text) if is_clear else (UNCLEAR, repr(text))
    except typer.Exit:
        return REFUSED, "exit"
    except MemoryError as error:
        return REFUSED, f"memory: {error}"
    except OSError as error:
        return (REFUSED if error.errno is not None else TRACEBACK), traceback.format_exc()
    except Exception:  # noqa: BLE001 - what is looked for
        return TRACEBACK, traceback.format_exc()
    if wrong:
        return WRONG, wrong
    text = said.getvalue()
    if text != "".join(f"{printable(line)}\n" for line in text.splitlines()):
        return UNCLEAR, f"printed: {text!r:.300}"
    return ACCEPTED, ""


def attack(target: targets.Target, count: int, seed: int, folder: Path, kept: Path | None = None) -> Tally:
    """Return how so many mutations ended; the inputs of defects are kept in a folder."""
    tally = Tally()
    folder.mkdir(parents=True)
    names = target.make(folder)
    contents = {name: (folder / name).read_bytes() for name in names}
    fine = outcome(lambda: target.call(folder, names[0], False))
    if fine[0] != ACCEPTED:
        raise AssertionError(f"{target.name}: what is not mutated is {fine[0]}: {fine[1]}")
    for number in range(math.ceil(target.share * count)):
        random = np.random.default_rng([seed, number])
        name = names[int(random.integers(len(names)))]
        kind, content = mutated(contents[name], random)
        (folder / name).write_bytes(content)
        start = time.process_time()
        found, words = outcome(partial(target.call, folder, name, content != contents[name]))
        elapsed_s = time.process_time() - start
        if elapsed_s > LIMIT_S:
            found, words = HANG, words or f"{elapsed_s:.1f} s"
        tally.slowest_s = max(tally.slowest_s, elapsed_s)
        tally.counts[found] += 1
        if found in DEFECTS:
            tally.defects.append(f"{target.name}, {name}, {kind}, number {number}: {found}\n{words}")
            if kept is not None:
                place = kept / target.name.replace(" ", "_") / f"{number}_{Path(name).name}"
                place.parent.mkdir(parents=True, exist_ok=True)
                place.write_bytes(content)
        (folder / name).write_bytes(contents[name])
    return tally


def table(tallies: dict[str, Tally]) -> str:
    """Return the table of the documents."""
    lines = [f"| attack | tried | {' | '.join(OUTCOMES)} | slowest |", f"| --- | {'---: | ' * 8}".rstrip()]
    for name, tally in tallies.items():
        cells = [str(sum(tally.counts.values())), *(str(tally.counts[outcome]) for outcome in OUTCOMES)]
        lines.append(f"| {name} | {' | '.join(cells)} | {tally.slowest_s:.1f} s |")
    total = sum((tally.counts for tally in tallies.values()), Counter())
    lines.append(f"| all | {total.total()} | {' | '.join(str(total[outcome]) for outcome in OUTCOMES)} | |")
    return "\n".join(lines)
