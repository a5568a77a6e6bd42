"""The motions of a trial: what an engineer would record, and other motions to judge on."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fdbench.diagnosis.experiment.trajectory import moves, multisine
from fdbench.record import FloatArray

PERIOD_S = 1e-3
REPEATS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class Protocol:
    """Commands by name: those recorded ``REPEATS`` times each, and held-out ones recorded once; (n, 3) arrays."""

    records: Mapping[str, FloatArray]
    holdouts: Mapping[str, FloatArray]


def joined(*parts: FloatArray) -> FloatArray:
    """Return commands one after another, each shifted to where the one before ends."""
    placed: list[FloatArray] = []
    for part in parts:
        shift = placed[-1][-1, 0] - part[0, 0] if placed else 0.0
        placed.append(part + np.array((shift, 0.0, 0.0)))
    return np.concatenate(placed)


def full_protocol(rng: np.random.Generator) -> Protocol:
    """Return constant speeds, small reversals, a multisine and fast strokes; held out are two mixtures of others."""

    def about(value: float) -> float:
        return value * float(rng.uniform(0.85, 1.15))

    slow, middle, fast = about(0.005), about(0.04), about(0.16)
    rapid, hard = about(0.45), about(14.0)
    speeds = joined(
        moves((0.0, 0.16, 0.0), (fast,), 4.0, PERIOD_S),
        moves((0.0, 0.06, 0.0), (middle,), 4.0, PERIOD_S),
        moves((0.0, 0.005, 0.0), (slow,), 1.0, PERIOD_S),
    )
    small, tiny = about(2e-3), about(1.5e-4)
    nested = [0.05, *(0.05 + small * share for share in (1.0, 0.3, 0.7, 0.0))]
    minute = [0.0, *(tiny * share for share in (1.0, 0.2, 0.8, 0.0))]
    reversals = joined(moves(nested, (2.0 * small,), 0.5, PERIOD_S), moves(minute, (2.0 * tiny,), 0.1, PERIOD_S))
    shaken = multisine(0.08, about(8e-4), (1.0, 80.0), 4.0, PERIOD_S)
    strokes = moves((0.0, 0.15, 0.0, 0.1, 0.02, 0.0), (rapid,), hard, PERIOD_S, 0.15)
    others = joined(
        moves((0.03, 0.13, 0.03), (0.6 * fast,), 3.0, PERIOD_S),
        moves((0.0, 0.03, 0.01), (0.5 * middle,), 3.0, PERIOD_S),
        moves((0.0, 0.003, 0.0), (0.6 * slow,), 1.0, PERIOD_S),
    )
    mixed = joined(
        moves((0.02, 0.12, 0.04, 0.09), (0.8 * rapid,), 0.7 * hard, PERIOD_S, 0.15),
        moves((0.0, 0.6 * small, 0.2 * small, 0.5 * small), (1.5 * small,), 0.5, PERIOD_S),
        multisine(0.0, 0.6e-3, (2.0, 60.0), 2.5, PERIOD_S),
    )
    return Protocol(
        records={"speeds": speeds, "reversals": reversals, "multisine": shaken, "strokes": strokes},
        holdouts={"other_speeds": others, "mixed": mixed},
    )


def production_cycle(rng: np.random.Generator) -> Protocol:
    """Return one cycle: rapid approach, feed and return, twice; nothing is held out but the last repeat."""
    rapid, feed = float(rng.uniform(0.35, 0.5)), float(rng.uniform(0.03, 0.06))
    there, end = float(rng.uniform(0.08, 0.11)), float(rng.uniform(0.14, 0.17))
    cycle = joined(
        moves((0.0, there), (rapid,), 8.0, PERIOD_S, 0.2),
        moves((there, end, 0.5 * there), (feed, rapid), 8.0, PERIOD_S, 0.2),
        moves((0.5 * there, 0.5 * there + 0.05, 0.0), (0.7 * feed, rapid), 8.0, PERIOD_S, 0.2),
    )
    return Protocol(records={"cycle": cycle}, holdouts={})
