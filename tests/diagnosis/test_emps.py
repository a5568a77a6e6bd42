"""EMPS: the published identification of a measured ball-screw axis, from the user's copy of the data."""

import dataclasses

import pytest
from conftest import REPOSITORY, shared_file

from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.model.nominal import load_nominal
from fdbench.diagnosis.model.replay import Replay, Variant
from fdbench.diagnosis.records.runs import prepare
from fdbench.effects import effects
from fdbench.estimator import Context, Estimate, estimators
from fdbench.metrics import Outcome, metrics
from fdbench.reading import read_record
from fdbench.record import Record
from fdbench.scenario import load_scenario

EXAMPLE = REPOSITORY / "examples" / "emps"

PUBLISHED = {
    "inverse_dynamics": {
        "mass_kg": 95.1089,
        "viscous_friction_N_s_per_m": 203.5034,
        "coulomb_friction_N": 20.3935,
        "offset_N": -3.1648,
    },
    "directional_inverse_dynamics": {
        "mass_kg": 95.154,
        "viscous_friction_positive_N_s_per_m": 166.706,
        "coulomb_friction_positive_N": 20.144,
        "viscous_friction_negative_N_s_per_m": 240.424,
        "coulomb_friction_negative_N": 20.628,
    },
}


@pytest.mark.parametrize("model", PUBLISHED)
def test_least_squares_gives_the_published_parameters(model: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FDBENCH_DATA", str(shared_file("data", "emps", "DATA_EMPS.mat").parent.parent))
    scenario = load_scenario("EMPS-v0")
    record, _ = scenario.observe(0)
    context = scenario.context()
    context = Context(sampling_time_s=context.sampling_time_s, plant=context.plant, model=model)
    estimate: Estimate = estimators.get("least_squares")().fit(context, record)
    assert record.n_samples == 24841
    for name, value in PUBLISHED[model].items():
        assert estimate.parameters[name] == pytest.approx(value, rel=1e-4), name


def test_in_open_loop_the_published_parameters_stray_as_published(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FDBENCH_DATA", str(shared_file("data", "emps", "DATA_EMPS.mat").parent.parent))
    scenario, metric = load_scenario("EMPSOpenLoop-v0"), metrics.get("open_loop_position_error")()
    record, truth = scenario.observe(0)

    def score(**parameters: float) -> float:
        estimate = Estimate(parameters={**truth.parameters, **parameters})
        regression = scenario.context().regression(record)
        outcome = Outcome(
            scenario=scenario, record=record, regression=regression, truth=truth, estimate=estimate, seconds=0.0
        )
        assert metric.skip(outcome) is None
        return metric.score(outcome)

    assert score() == pytest.approx(6.74, rel=0.02)
    assert score(offset_N=-3.0) > 2.0 * score()
    assert score(viscous_friction_N_s_per_m=-1.0) == metric.worst == score(offset_N=-3000.0)


def test_without_the_file_the_scenario_says_where_to_put_it(monkeypatch, tmp_path) -> None:
    from fdbench.errors import MissingData

    monkeypatch.setenv("FDBENCH_DATA", str(tmp_path))
    with pytest.raises(MissingData, match=r"emps/DATA_EMPS\.mat") as told:
        load_scenario("EMPS-v0").observe(0)
    assert str(tmp_path) in str(told.value)
    assert "nonlinearbenchmark" in str(told.value)


def test_an_effect_injected_in_the_record_is_named_beside_the_documented_cause() -> None:
    whole = read_record(EXAMPLE / "emps.toml", shared_file("data", "emps", "DATA_EMPS.mat").parent)
    record = whole.slice(0, 12500)
    nominal = load_nominal(EXAMPLE / "model.toml")
    drive, injected = nominal.drive, effects.get("cogging").typical(cogging_force_N=5.0, pitch_m=4e-3)
    variants = [Variant(plant=drive), Variant(plant=drive, extra=(injected,))]
    simulated = Replay(drive, nominal.library, nominal.simulation.substeps).simulate(prepare(record, drive), variants)
    added = {name: values[1] - values[0] for name, values in simulated.items()}
    added["motor_position_m"] = added["position_m"]
    columns = {name: values + added.get(name, 0.0) for name, values in record.items()}
    # The authors give their whole controller: one that filters the velocity, too, is tried beside it.
    filtered = diagnose(nominal, [Record(columns)]).answer.causes
    uncertainty = dataclasses.replace(nominal.uncertainty, velocity_filter=0.0)
    answer = diagnose(dataclasses.replace(nominal, uncertainty=uncertainty), [Record(columns)]).answer
    causes = {cause.effect: cause for cause in answer.causes}
    found, native = causes["cogging"], causes["direction_dependent_friction"]
    assert found.probability > 0.5
    assert native.probability > 0.5
    assert found.parameters["pitch_m"].value == pytest.approx(4e-3, rel=0.01)
    assert found.parameters["cogging_force_N"].value == pytest.approx(5.0, rel=0.1)
    assert native.parameters["viscous_asymmetry_N_s_per_m"].value == pytest.approx(-36.8, abs=3.0)
    for name in ("cogging", "direction_dependent_friction"):
        assert any(cause.effect == name and cause.probability > 0.5 for cause in filtered)
