"""Encoders that count from zeros of their own: the same verdict, wherever the zeros are."""

import axis_lab
import numpy as np
import pytest

from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.evaluation.evaluate import evaluate
from fdbench.diagnosis.model.nominal import Nominal, Simulation
from fdbench.diagnosis.records.encoder_zeros import with_common_zeros
from fdbench.diagnosis.records.runs import DEFLECTION, RecordedRun
from fdbench.effects import effects
from fdbench.record import Record

NOMINAL = Nominal(plant=axis_lab.drive(), simulation=Simulation(substeps=10))


def from_another_zero(record: Record, apart_m: float) -> Record:
    columns = {**record, "motor_position_m": record["motor_position_m"] + apart_m}
    return Record(columns, dict(record.provenance), record.source)


@pytest.mark.parametrize("name", ["lead_error", "backlash"])
def test_a_verdict_does_not_depend_on_the_zero_of_an_encoder(name: str) -> None:
    effect = effects.get(name).typical()
    nominal, fitted, judged = axis_lab.case((effect,), seed=3)
    parts = fitted[2:], judged[1:]
    answers = [
        diagnose(nominal, *([from_another_zero(item, apart_m) for item in part] for part in parts)).answer
        for apart_m in (0.0, 2e-3)
    ]
    for answer in answers:
        assert [cause.effect for cause in answer.causes if cause.probability > 0.5] == [name]
    same, other = answers
    assert other.causes[0].probability == pytest.approx(same.causes[0].probability, abs=0.01)
    assert not [line for line in same.warnings if "zeros" in line]
    assert [line for line in other.warnings if "2 mm apart" in line]


def test_a_lead_error_is_found_whatever_its_phase_is_at_the_zero() -> None:
    """The library's error is zero where the motor's reading is; that of a machine is not."""
    effect = effects.get("lead_error").typical(phase_rad=1.3, periodic_error_m=5e-6)
    shift_m = effect.periodic_error_m * np.sin(effect.phase_rad)
    nominal, fitted, judged = axis_lab.case((effect,), seed=4)
    parts = ([from_another_zero(item, -shift_m) for item in part] for part in (fitted, judged))
    answer = diagnose(nominal, *parts).answer
    assert [cause.effect for cause in answer.causes if cause.probability > 0.5] == ["lead_error"]
    assert answer.causes[0].parameters["periodic_error_m"].value == pytest.approx(5e-6, rel=0.05)


def test_models_are_evaluated_from_a_common_zero() -> None:
    _, fitted, _ = axis_lab.case((), seed=5)
    scores = [
        [
            score.root_mean_square_error
            for score in evaluate(
                {"model": NOMINAL}, [from_another_zero(item, apart_m) for item in fitted]
            ).evaluation.scores
        ]
        for apart_m in (0.0, 2e-3)
    ]
    assert scores[1] == pytest.approx(scores[0], rel=1e-3)


def test_one_number_is_taken_from_all_runs() -> None:
    def run(*left: float) -> RecordedRun:
        channels = {"position_m": np.zeros(len(left)), DEFLECTION: np.array(left)}
        return RecordedRun(name="x", period_s=1e-3, reference=np.zeros((len(left), 3)), channels=channels, lap=None)

    runs = [run(1.0, 1.1, 0.9), run(1.0, 1.2, 0.8)]
    still = [{DEFLECTION: np.zeros(3)}] * 2
    found, said = with_common_zeros(runs, still)
    np.testing.assert_allclose(
        [own.channels[DEFLECTION] for own in found], [[0.0, 0.1, -0.1], [0.0, 0.2, -0.2]], atol=0.01
    )
    assert said == [
        "The positions of motor and table count from zeros that are 1 m apart, which is no cause of anything: it is "
        "taken out."
    ]
    assert with_common_zeros(found, still)[1] == []
