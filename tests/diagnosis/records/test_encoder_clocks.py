"""Encoders with a clock each: said where one is read late, and of no effect."""

import re

import axis_lab
import numpy as np
import pytest

from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import Nominal, Simulation
from fdbench.diagnosis.model.replay import Replay
from fdbench.diagnosis.records.encoder_clocks import encoder_clock_warnings
from fdbench.diagnosis.records.runs import prepare
from fdbench.effects import effects
from fdbench.record import Record

NOMINAL = Nominal(plant=axis_lab.drive(), simulation=Simulation(substeps=10))


def read_late(record: Record, late_s: float) -> Record:
    table = np.interp(record["time_s"] - late_s, record["time_s"], record["table_position_m"])
    return Record({**record, "table_position_m": table}, dict(record.provenance), record.source)


def said(records: list[Record]) -> list[str]:
    runs = [prepare(record, NOMINAL.drive) for record in records]
    replay = Replay(NOMINAL.drive, NOMINAL.library, NOMINAL.simulation.substeps)
    return encoder_clock_warnings(runs, replay.on_each(runs, start(NOMINAL).variant))


@pytest.mark.parametrize("late_s", [-4e-4, 1.5e-4, 1e-3])
def test_a_late_encoder_is_told_with_its_delay(late_s: float) -> None:
    _, fitted, _ = axis_lab.case((), seed=1)
    (text,) = said([read_late(record, late_s) for record in fitted])
    assert ("before" if late_s < 0.0 else "after") + " motor_position_m" in text
    (found,) = re.findall(r"late_s = (\S+)`", text)
    assert float(found) == pytest.approx(late_s, rel=0.05)


@pytest.mark.parametrize(
    "name", ["axial_compliance", "backlash", "coulomb_friction", "inertia_mismatch", "lead_error", "thermal_expansion"]
)
def test_no_effect_is_a_late_encoder(name: str) -> None:
    _, fitted, _ = axis_lab.case((effects.get(name).typical(),), seed=2)
    assert said(fitted) == []
