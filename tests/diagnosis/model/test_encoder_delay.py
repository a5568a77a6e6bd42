"""A table that is read after the motor: fitted beside all else, told where it is much, and of no effect."""

from dataclasses import replace

import axis_lab
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.model.as_nominal import as_nominal
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import Covered, Nominal, Simulation, Uncertainty
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.model.replay import Replay, Variant
from fdbench.diagnosis.records.runs import DEFLECTION, POSITION, prepare
from fdbench.diagnosis.repaired import model_text
from fdbench.effects import effects
from fdbench.statistics import rms

NOMINAL = Nominal(plant=axis_lab.drive(), simulation=Simulation(substeps=10))


@pytest.mark.parametrize("late_s", [-4e-4, 1.5e-4, 5e-4])
def test_a_table_is_read_where_it_was_so_much_earlier(late_s: float) -> None:
    _, (record, *_), _ = axis_lab.case((), seed=1)
    run, replay = prepare(record, NOMINAL.drive), Replay(NOMINAL.drive, (), 10)
    drives = (replace(NOMINAL.drive, table_read_late_s=time) for time in (0.0, late_s))
    at_once, late = (replay.alone(run, Variant(plant=drive)) for drive in drives)
    time_s = run.period_s * np.arange(run.n_samples)
    table = at_once[POSITION] - at_once[DEFLECTION]
    expected = at_once[POSITION] - CubicSpline(time_s, table)(time_s - late_s)
    assert np.ptp(expected - at_once[DEFLECTION]) > 1e-5
    assert rms(late[DEFLECTION][1:-1] - expected[1:-1]) < 0.5 * axis_lab.NOISE_M
    assert np.array_equal(late[POSITION], at_once[POSITION])  # the loop follows the motor


@pytest.mark.parametrize("name", [None, "inertia_mismatch"])
def test_the_answer_says_so_and_names_what_else_is_there(name: str | None) -> None:
    injected = () if name is None else (effects.get(name).typical(),)
    nominal, fitted, judged = axis_lab.case(injected, seed=3)
    answer = diagnose(nominal, *([axis_lab.read_late(item, 5e-4) for item in part] for part in (fitted, judged))).answer
    assert [text for text in answer.warnings if "table_position_m seems to be read 500 µs after" in text]
    assert [cause.effect for cause in answer.causes if cause.probability > 0.5] == [item.name for item in injected]
    # No effect of the library is such a delay, even where it is all that is there.
    assert answer.unknown_probability > 0.9
    assert answer.no_gap_probability < 0.1


def test_a_model_says_it_and_what_is_on_paper_is_no_gap() -> None:
    nominal, fitted, judged = axis_lab.case((), seed=3)
    found = diagnose(nominal, *([axis_lab.read_late(item, 5e-4) for item in part] for part in (fitted, judged)))
    known = as_nominal(found.final)
    assert known.drive.table_read_late_s == pytest.approx(5e-4, rel=0.1)
    assert "table_read_late_s = 0.0005" in model_text(found).replace(f"{known.drive.table_read_late_s!r}", "0.0005")
    answer = diagnose(known, *([axis_lab.read_late(item, 5e-4) for item in part] for part in (fitted, judged))).answer
    assert not [text for text in answer.warnings if "seems to be read" in text]
    assert answer.no_gap_probability > 0.5
    assert answer.unknown_probability < 0.1


@pytest.mark.parametrize(("both", "deviation", "n"), [(True, 0.02, 1), (False, 0.02, 0), (True, 0.0, 0)])
def test_it_is_moved_where_both_encoders_are_read_and_none_is_known(both: bool, deviation: float, n: int) -> None:
    doubt = Uncertainty(encoder_delay=deviation)
    model = Nominal(plant=axis_lab.drive(), simulation=Simulation(substeps=10), uncertainty=doubt)
    model = model.beside(Covered(fastest_m_per_s=0.1, longest_s=5.0, force_N=100.0, period_s=1e-3, two_positions=both))
    own = [place for place, item in enumerate(nominal_parameters(model)) if item.name == "encoder_delay"]
    assert len(own) == n
    for place in own:
        moved = start(model).moved(2.0 * np.eye(len(nominal_parameters(model)))[place])
        assert moved.variant.plant.table_read_late_s == pytest.approx(2.0 * deviation * 1e-3)
