"""An effect alone in its own record: the diagnosis names it first."""

import dataclasses

import numpy as np

from fdbench.checks._report import NotApplicable
from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.effects import Effect, Port
from fdbench.errors import PluginError
from fdbench.record import FloatArray, Record
from fdbench.specification import load_toml, read
from fdbench.virtual_axes import protocol
from fdbench.virtual_axes.bench import ERRORS
from fdbench.virtual_axes.cases import AXIS, record_of
from fdbench.virtual_axes.library_axis import LibraryBench, as_logged

SEED, REPEATS = 0, 2
SIDES = ("motor_position_m", "table_position_m")
NAMED = 0.5  # probability from which on a cause is named


def is_named_first(kind: type[Effect]) -> None:
    """Alone on an axis, at its typical size, the effect is the first cause that a diagnosis names.

    The axis is that of the blind trials, with the nominal parameters; four motions are recorded twice and another is
    held out, 45 s in all. Where the records do not tell effects apart, it is enough to be among those that the
    diagnosis calls indistinguishable from the first, or that give the same signal (``same_signal_as``).

    Raises
    ------
    NotApplicable
        If the effect is no candidate of a diagnosis.
    PluginError
        If another effect comes first, or none is named.
    """
    nominal = read(Nominal, load_toml(AXIS), AXIS.name)
    if (
        kind.port is not Port.LOGGING
        and kind not in (item.declared for item in nominal.library)
        and not kind.same_signal_as
    ):
        unfit = {
            "random": kind.random,
            "told by records from before alone": kind.scales_every_value,
            "that of an axis that turns, and this one is linear": kind.needs_turn,
            "a process force of unknown course": True,
        }
        what = next(text for text, holds in unfit.items() if holds)
        raise NotApplicable(f"a diagnosis does not look for it: it is {what}")
    answer = diagnose(nominal, *recorded(kind, nominal)).answer
    named = [cause for cause in answer.causes if cause.probability > NAMED]
    said = ", ".join(f"{cause.effect} {cause.probability:.2f}" for cause in answer.causes) or "none"
    said += f"; unknown cause {answer.unknown_probability:.2f}; no gap {answer.no_gap_probability:.2f}"
    if not named:
        raise PluginError(
            f"alone in its own record, at its typical size, it is not named; probabilities: {said}. "
            "A typical size shows in the records of a small axis."
        )
    if not {kind.name, kind.same_signal_as} & {named[0].effect, *named[0].indistinguishable_from}:
        raise PluginError(
            f"alone in its own record {named[0].effect} comes first; probabilities: {said}. Where the two are one "
            "signal, say so by same_signal_as; else give the reason in expected_failures."
        )


def recorded(kind: type[Effect], nominal: Nominal) -> tuple[list[Record], list[Record]]:
    """Return the records of the axis with the effect alone: to fit, and to judge on."""
    rng = np.random.default_rng(SEED)
    motions = protocol.full_protocol(rng)
    # Of effects with the same signal the library holds one.
    real = dataclasses.replace(nominal, exclude=(kind.same_signal_as,)) if kind.same_signal_as else nominal
    bench = LibraryBench(real, dict.fromkeys(ERRORS, 0.0), protocol.PERIOD_S, substeps=nominal.simulation.substeps)
    effect = bench.typical(kind.name)
    logged = kind.port is Port.LOGGING
    axis = bench.axis({} if logged else {kind.name: dataclasses.asdict(effect)})  # type: ignore[call-overload]

    def record(name: str, motion: FloatArray) -> Record:
        readings = axis.readings(motion, rng)
        if logged:
            readings = as_logged(readings, effect, rng, protocol.PERIOD_S)
        return record_of(name, motion, readings, SIDES)

    fitted = [record(f"{name}_{turn}", motion) for name, motion in motions.records.items() for turn in range(REPEATS)]
    return fitted, [record("held_out", motions.holdouts["mixed"])]
