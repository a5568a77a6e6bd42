"""Encoders with a clock each: said where one is read late, and of no effect, by a model and by one that is fitted."""

import re
from collections.abc import Callable

import axis_lab
import pytest

from fdbench.diagnosis.evidence.prepare import aligned
from fdbench.diagnosis.judge.nameless_values import nameless_warnings
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import Nominal, Simulation
from fdbench.diagnosis.model.replay import Replay
from fdbench.diagnosis.records.encoder_clocks import encoder_clock_warnings
from fdbench.diagnosis.records.runs import prepare
from fdbench.diagnosis.search.calibrated import Calibrated
from fdbench.effects import effects
from fdbench.record import Record

NOMINAL = Nominal(plant=axis_lab.drive(), simulation=Simulation(substeps=10))


def by_a_model(fitted: list[Record], judged: list[Record]) -> list[str]:
    runs = [prepare(record, NOMINAL.drive) for record in fitted]
    replay = Replay(NOMINAL.drive, NOMINAL.library, NOMINAL.simulation.substeps)
    return encoder_clock_warnings(runs, replay.on_each(runs, start(NOMINAL).variant))


def by_a_fit(fitted: list[Record], judged: list[Record]) -> list[str]:
    return nameless_warnings(Calibrated.of(aligned(NOMINAL, fitted, judged)).hypothesis)


Said = Callable[[list[Record], list[Record]], list[str]]
either = pytest.mark.parametrize("said", [by_a_model, by_a_fit])


@either
@pytest.mark.parametrize("late_s", [-4e-4, 1.5e-4, 1e-3])
def test_a_late_encoder_is_told_with_its_delay(said: Said, late_s: float) -> None:
    _, *parts = axis_lab.case((), seed=1)
    (text,) = said(*([axis_lab.read_late(item, late_s) for item in part] for part in parts))
    assert ("before" if late_s < 0.0 else "after") + " motor_position_m" in text
    (found,) = re.findall(r"late_s = (\S+)`", text)
    assert float(found) == pytest.approx(late_s, rel=0.05)


@either
@pytest.mark.parametrize(
    "name", ["axial_compliance", "backlash", "coulomb_friction", "inertia_mismatch", "lead_error", "thermal_expansion"]
)
def test_no_effect_is_a_late_encoder(said: Said, name: str) -> None:
    _, fitted, judged = axis_lab.case((effects.get(name).typical(),), seed=2)
    assert said(fitted, judged) == []
