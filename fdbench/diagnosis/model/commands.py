"""LoopCommands of runs as a controller takes them."""

import operator
from collections.abc import Sequence

import numpy as np

from fdbench.diagnosis.records.runs import RecordedRun
from fdbench.record import FloatArray


class LoopCommands:
    """LoopCommands of runs as a controller takes them, one behind the other.

    Attributes
    ----------
    rows : (n_rows, 3) array
    first_rows : dict of int to int
        Where that of a run begins, by its id.
    """

    def __init__(self, runs: Sequence[RecordedRun], loops: int) -> None:
        self._runs = list(runs)
        own = [at_each_loop(run.command, run.period_s, loops) for run in runs]
        starts = np.cumsum([0, *map(len, own)]).tolist()
        self.first_rows = {id(run): start for run, start in zip(runs, starts, strict=False)}
        # A lane that none takes the place of runs on behind its command.
        self.rows = np.concatenate([*own, np.zeros((max(map(len, own)), 3))])

    def are_of(self, runs: Sequence[RecordedRun]) -> bool:
        """Whether they are those of these very runs."""
        return len(runs) == len(self._runs) and all(map(operator.is_, runs, self._runs))


def at_each_loop(reference: FloatArray, period_s: float, loops: int) -> FloatArray:
    """Return a command (n, 3) as a controller takes it that acts several times in a sampling time, (n * loops, 3).

    Positions and velocities are cubics between samples, accelerations straight lines.

    >>> at_each_loop(np.array([[0.0, 0.0, 2.0], [1.0, 2.0, 2.0]]), 1.0, 2)[1].tolist()
    [0.25, 1.0, 2.0]
    """
    if loops == 1:
        return reference
    after = np.vstack((reference[1:], reference[-1:]))
    rows = np.empty((len(reference), loops, 3))
    for place in range(loops):
        part = place / loops
        rise, leave, arrive = part**2 * (3.0 - 2.0 * part), part * (1.0 - part) ** 2, part**2 * (part - 1.0)
        rows[:, place] = reference + rise * (after - reference)
        rows[:, place, :2] += period_s * (leave * reference[:, 1:] + arrive * after[:, 1:])
        rows[:, place, 2] = reference[:, 2] + part * (after[:, 2] - reference[:, 2])
    return rows.reshape(-1, 3)
