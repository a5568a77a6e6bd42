"""Drawn machines: other ones for other seeds, within what the data sheet leaves open, and never told to estimators."""

import dataclasses
import pickle

import numpy as np
import pytest

from fdbench.draw import LogUniform, Normal, Uniform, changed, drawn
from fdbench.errors import SpecError
from fdbench.plants.feed_drive import FeedDrive
from fdbench.scenario import Scenario, Validation, load_scenario, scenario_ids

DRAWN = [name for name in scenario_ids() if load_scenario(name).draw]


@pytest.fixture
def shaker() -> Scenario:
    return load_scenario("ShakerConstant-v1")


def mass(scenario: Scenario) -> float:
    assert isinstance(scenario.plant, FeedDrive)
    return scenario.plant.mass_kg


@pytest.mark.parametrize("name", DRAWN)
def test_every_seed_is_another_machine_about_the_same_data_sheet(name: str) -> None:
    scenario = load_scenario(name)
    machines = [scenario.drawn(seed) for seed in range(3)]
    assert len({repr((machine.plant, machine.reality)) for machine in machines}) == 3
    assert machines[0] == scenario.drawn(0)
    assert scenario.context().plant == scenario.plant
    assert all(machine.plant != scenario.plant for machine in machines)
    assert all(machine.id == name and machine.digest == scenario.digest for machine in machines)


def test_values_are_distributed_as_the_file_says(shaker: Scenario) -> None:
    masses = np.array([mass(shaker.drawn(seed)) for seed in range(400)]) / mass(shaker) - 1.0
    (draw,) = [draw for draw in shaker.draw if draw.values == ("plant.motor.mass_kg",)]
    assert abs(masses.mean()) < 4.0 * draw.deviation(1.0) / 20.0
    assert masses.std() == pytest.approx(draw.deviation(1.0), rel=0.15)
    assert np.abs(masses).max() <= 2.0 * 0.05


@pytest.mark.parametrize(
    "draw",
    [
        Normal(values=("a",), relative_deviation=0.1),
        LogUniform(values=("a",), factor=1.2),
        Uniform(values=("a",), low=-3.0, high=1.0),
    ],
)
def test_deviation_and_extremes_are_those_of_the_draws(draw: Normal | LogUniform | Uniform) -> None:
    generator = np.random.default_rng(0)
    values = np.array([draw.drawn(5.0, generator) for _ in range(20_000)])
    assert values.std() == pytest.approx(draw.deviation(5.0), rel=0.03)
    low, high = draw.extreme(5.0, upper=False), draw.extreme(5.0, upper=True)
    assert low <= values.min() < low + 0.01 * (high - low)
    assert high - 0.01 * (high - low) < values.max() <= high


def test_values_of_one_draw_share_their_factor() -> None:
    milling = load_scenario("MillingUpDown-v1")
    for seed in range(5):
        forces = milling.drawn(seed).reality.effects
        assert len({getattr(force, "spindle_frequency_Hz") for force in forces}) == 1  # noqa: B009
        assert len({getattr(force, "angle_rad") for force in forces}) == 1  # noqa: B009


def test_a_further_draw_moves_no_other(shaker: Scenario) -> None:
    fewer = dataclasses.replace(shaker, draw=shaker.draw[:1])
    assert mass(fewer.drawn(7)) == mass(shaker.drawn(7))


def test_the_covariance_is_that_of_the_machines(shaker: Scenario) -> None:
    context, period_s = shaker.context(), 1.0 / 333.0
    drawn_ones = [shaker.drawn(seed).linear_model.nominal_parameters(period_s) for seed in range(600)]
    sampled = np.cov(np.array([list(values.values()) for values in drawn_ones]).T)
    assert context.covariance is not None
    np.testing.assert_allclose(np.sqrt(np.diag(context.covariance)), np.sqrt(np.diag(sampled)), rtol=0.12)
    assert list(context.nominal) == list(drawn_ones[0])


def test_the_context_tells_neither_the_scenario_nor_the_machine(shaker: Scenario) -> None:
    content = pickle.dumps(shaker.context())
    assert b"ShakerConstant" not in content
    assert b"shaker_force" not in content
    assert pickle.dumps(load_scenario("ShakerSweep-v1").context()) == content


def test_the_truth_is_that_of_the_drawn_machine(shaker: Scenario) -> None:
    _, truth = shaker.observe(4)
    machine = shaker.drawn(4)
    assert shaker.timing is not None
    assert truth.parameters == machine.linear_model.nominal_parameters(shaker.timing.sampling_time_s)
    assert truth.response is not None
    command = shaker.command()
    assert command is not None
    response = shaker.linear_model.free_run(command, truth.parameters)
    assert response is not None
    assert np.sqrt(np.mean((response - truth.response) ** 2)) < 1e-3 * np.std(truth.response)


def test_a_published_trial_has_one_machine() -> None:
    published = load_scenario("ShakerConstant-v0")
    assert published.drawn(5) is published
    assert published.context().covariance is None


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("plant.motor.mas_kg", r"plant\.motor\.mas_kg: there is no 'mas_kg'\. Did you mean mass_kg\?"),
        ("plant.motor", r"plant\.motor: not a number but LinearMotor"),
        ("plant.effects.friction.coulomb_force_N", r"there is no 'friction'; there are coulomb_friction"),
        ("plant.effects.3.coulomb_force_N", r"there is no '3'"),
        ("title", r"title: not a number but str"),
    ],
)
def test_a_path_that_names_no_number_is_told(shaker: Scenario, path: str, message: str) -> None:
    with pytest.raises(SpecError, match=message):
        changed(shaker, path, lambda value: value)


def test_numbers_count_in_lists() -> None:
    spindle = load_scenario("SpindleStep-v1")
    first = changed(spindle, "plant.modes.0.frequency_Hz", lambda value: 2.0 * value)
    assert getattr(first.plant, "modes")[0].frequency_Hz == 2.0 * 753.0  # noqa: B009
    assert drawn(spindle, (), 3) is spindle


def written(tmp_path, text: str):  # type: ignore[no-untyped-def]
    file = tmp_path / "Own-v0.toml"
    file.write_text('extends = "ShakerConstant-v0"\n' + text)
    return file


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[[draw]]\nkind = "normal"\nvalues = ["plant.motor.mass"]\nrelative_deviation = 0.1', "Did you mean mass_kg"),
        (
            '[[draw]]\nkind = "uniform"\nvalues = ["plant.motor.mass_kg"]\nlow = -1.0\nhigh = 2.0',
            r"draw\[0\]\.values: mass_kg: -1 is outside \(0, inf\) kg",
        ),
        (
            '[[draw]]\nkind = "log_uniform"\nvalues = ["plant.travel_m", "plant.travel_m"]\nfactor = 1.1',
            "plant.travel_m is drawn twice",
        ),
        ('[[draw]]\nkind = "gaussian"\nvalues = []', "unknown kind 'gaussian'"),
        ("[validation]\nstart_s = 3.0", "validation: a simulated scenario has motion, found start_s"),
    ],
)
def test_a_faulty_draw_is_told(tmp_path, text: str, message: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(SpecError, match=message):
        load_scenario(written(tmp_path, text))


def test_a_file_extends_another(tmp_path) -> None:  # type: ignore[no-untyped-def]
    base = load_scenario("ShakerConstant-v0")
    own = load_scenario(written(tmp_path, "[timing]\nduration_s = 6.0\n[estimation]\nwindow_s = [2.4, 5.9]\n"))
    assert own.timing is not None
    assert base.timing is not None
    assert own.timing == dataclasses.replace(base.timing, duration_s=6.0)
    assert (own.plant, own.motion, own.reality) == (base.plant, base.motion, base.reality)
    other = load_scenario(written(tmp_path, '[motion]\nkind = "standstill"\n'))
    assert type(other.motion).__name__ == "Standstill"
    assert len({base.digest, own.digest, other.digest}) == 3
    for wrong in ('extends = "Own-v0"', 'extends = "ShakerConst-v0"', "extends = 3"):
        (tmp_path / "Own-v0.toml").write_text(wrong)
        with pytest.raises(SpecError, match=r"Own-v0.toml: extends: the id of another scenario"):
            load_scenario(tmp_path / "Own-v0.toml")


def test_a_validation_is_a_motion_or_a_part_of_what_was_measured_or_open_loop() -> None:
    measured, simulated = load_scenario("EMPS-v0"), load_scenario("ShakerSweep-v0")
    for scenario, wrong, message in (
        (measured, Validation(motion=simulated.motion), "a measured scenario has open_loop or start_s, found motion"),
        (measured, Validation(start_s=1.0, open_loop=True), "found open_loop and start_s"),
        (measured, Validation(), "found none"),
        (simulated, Validation(open_loop=True), "a simulated scenario has motion, found open_loop"),
    ):
        with pytest.raises(SpecError, match=message):
            dataclasses.replace(scenario, validation=wrong)
    other = dataclasses.replace(measured.estimation, model="directional_inverse_dynamics")
    with pytest.raises(SpecError, match=r"validation\.open_loop: needs the model inverse_dynamics"):
        dataclasses.replace(measured, estimation=other, validation=Validation(open_loop=True))
