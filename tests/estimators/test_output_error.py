"""Output error: steps and curves by hand, drawn machines against the equation, and what it refuses."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from conftest import shared_file
from fdbench_baselines._left_friction import left_friction
from fdbench_baselines._simulated_drive import knobs_of, turned
from fdbench_baselines._whitened_step import whitened_step
from fdbench_baselines.idim_iv import IdimIv
from fdbench_baselines.null import Null
from fdbench_baselines.output_error import OutputError
from numpy.typing import NDArray

from fdbench.effects.coulomb_friction import CoulombFriction
from fdbench.effects.stribeck_friction import StribeckFriction
from fdbench.errors import PluginError, SpecError
from fdbench.estimator import Estimator, FloatArray
from fdbench.plants._drive_sensitivities import sensitivities
from fdbench.plants.feed_drive import FeedDrive
from fdbench.scenario import load_scenario


def test_a_step_finds_a_line_in_errors_that_go_on_and_says_how_well() -> None:
    rng = np.random.default_rng(3)
    S, none = np.cumsum(rng.standard_normal((4000, 1)), axis=0) / 30.0, np.empty((4000, 0))
    found = []
    for _ in range(100):
        noise = np.zeros(4000)
        for k, kick in enumerate(rng.standard_normal(3999)):
            noise[k + 1] = 0.9 * noise[k] + kick
        found.append(whitened_step(S, none, 2.0 * S[:, 0] + noise, noise, np.zeros(1), np.zeros((1, 1)), 5))
    changes = np.array([step.change[0] for step in found])
    claimed = np.sqrt(np.mean([step.covariance[0, 0] for step in found]))
    assert changes.mean() == pytest.approx(2.0, abs=3.0 * claimed / 10.0)
    assert changes.std() == pytest.approx(claimed, rel=0.25)


def test_a_step_heeds_what_is_known() -> None:
    # One row in effect: 4 rows of 1 with errors +-1 say 3 with variance 1/4, the sheet 0 with variance 1/4.
    S, left = np.ones((4, 1)), np.array([4.0, 2.0, 4.0, 2.0])
    step = whitened_step(S, np.empty((4, 0)), left, left - 3.0, np.zeros(1), np.array([[4.0]]), 0)
    assert step.change[0] == pytest.approx(1.5)


def test_left_friction_holds_none_of_a_straight_line() -> None:
    velocity = 0.1 * np.sin(np.linspace(0.0, 20.0, 500))
    friction = left_friction(velocity)
    columns = friction.columns(velocity)
    straight = 3.0 * velocity + 2.0 * np.sign(velocity) - 1.0
    assert np.abs(columns.T @ straight).max() < 1e-9
    slower = np.abs(velocity)  # one direction less viscous than the other, which no symmetric line can be
    left = slower - columns @ np.linalg.lstsq(columns, slower, rcond=None)[0]
    line = np.column_stack((velocity, np.sign(velocity), np.ones(500)))
    assert np.abs(left - line @ np.linalg.lstsq(line, left, rcond=None)[0]).max() < 1e-9


def test_knobs_turn_what_they_say() -> None:
    drive = load_scenario("BallScrewAxis-v1").plant
    assert isinstance(drive, FeedDrive)
    knobs = knobs_of(drive)
    at = {knob.name: 0.0 for knob in knobs} | {"mass": 0.1, "viscous_friction": -0.2, "effects.1": 0.5}
    other = turned(drive, knobs, np.array(list(at.values())))
    assert other.mass_kg == pytest.approx(1.1 * drive.mass_kg)
    assert other.friction_line.viscous_N_s_per_m == pytest.approx(0.8 * 600.0)
    assert other.friction_line.offset_N == pytest.approx(15.0 + 0.5 * 120.0)  # half of the Coulomb friction
    assert turned(drive, knobs, np.zeros(len(knobs))) == drive


def errors(estimator: Estimator, name: str, seed: int) -> tuple[float, float]:
    scenario = load_scenario(name)
    (record, truth), command, context = scenario.observe(seed), scenario.command(), scenario.context()
    assert command is not None
    assert truth.response is not None
    estimate = estimator.fit(context, record)
    response = estimator.predict(context, estimate, command)
    assert response is not None
    size = np.sqrt(np.mean(context.regression(record).regressors ** 2, axis=0))
    of = np.array([estimate.parameters[key] - truth.parameters[key] for key in truth.parameters])
    return float(np.linalg.norm(size * of)), float(np.sqrt(np.mean((response - truth.response) ** 2)))


@pytest.mark.parametrize(("name", "margin"), [("ShakerControl-v1", 2.0), ("MillingDecreasing-v1", 0.8)])
def test_a_simulation_knows_more_than_the_equation(name: str, margin: float) -> None:
    own, instruments, sheet = (errors(kind(), name, 100) for kind in (OutputError, IdimIv, Null))
    assert own[0] < 0.5 * sheet[0]
    assert own[1] < 0.8 * sheet[1]
    assert margin * own[1] < instruments[1]


def rounded(drive: FeedDrive) -> FeedDrive:
    """Return a drive with smooth friction: at the corner of LuGre at rest differences are no derivatives."""
    friction = CoulombFriction.typical(transition_velocity_m_per_s=5e-3)
    slow = StribeckFriction.typical(transition_velocity_m_per_s=5e-3)
    return replace(drive, effects=(friction, slow, *drive.effects[1:]))


@pytest.mark.parametrize(
    ("name", "of", "step", "tolerance"),
    [
        ("MillingAir-v1", lambda drive: drive, 4e-3, 1e-6),
        ("ShakerControl-v1", lambda drive: drive, 4e-3, 1e-6),
        ("EMPS-v1", lambda drive: drive, 2e-3, 1e-6),
        ("BallScrewAxis-v1", rounded, 4e-3, 2e-6),
        ("BallScrewAxis-v1", lambda drive: drive, 1e-4, 1e-4),
    ],
)
def test_sensitivities_are_those_of_extrapolated_differences(
    name: str, of: Callable[[FeedDrive], FeedDrive], step: float, tolerance: float
) -> None:
    if name.startswith("EMPS"):
        shared_file("data", "emps", "DATA_EMPS.mat")
    scenario = load_scenario(name)
    assert isinstance(scenario.plant, FeedDrive)
    drive, context, command = of(scenario.plant), scenario.context(), scenario.command()
    assert command is not None
    knobs = knobs_of(drive)
    at = 0.01 * np.arange(1, len(knobs) + 1)

    def drive_at(settings: NDArray[np.inexact]) -> FeedDrive:
        return turned(drive, knobs, settings)

    def target(settings: FloatArray) -> FloatArray:
        return context.regression(drive_at(settings).respond(command)).target

    def central(change: FloatArray) -> FloatArray:
        return (target(at + change) - target(at - change)) / (2.0 * change.max())

    for tangent, unit, knob in zip(sensitivities(drive_at, at, command), np.eye(len(knobs)), knobs, strict=True):
        expected = (4.0 * central(0.5 * step * unit) - central(step * unit)) / 3.0
        error = np.linalg.norm(context.regression(tangent).target - expected) / np.linalg.norm(expected)
        assert error < tolerance, knob.name


def test_knobs_that_are_complex_turn_the_drive_as_they_do_otherwise() -> None:
    drive = load_scenario("BallScrewAxis-v1").plant
    assert isinstance(drive, FeedDrive)
    knobs = knobs_of(drive)
    at = np.full(len(knobs), 0.1)
    rows = [turned(drive, knobs, settings).mechanics().rows(1e-4) for settings in (at, at + 1e-200j)]
    np.testing.assert_array_equal(rows[1].real, rows[0])


def test_a_loop_on_the_brink_is_found() -> None:
    """After a step on this machine a thousandth more of a setting is beyond the stability limit of its loop."""
    own, sheet = (errors(kind(), "LinearMotorAxis-v1", 2613265489975045558) for kind in (OutputError, Null))
    assert own[0] < 0.5 * sheet[0]


def test_it_declines_and_refuses() -> None:
    assert OutputError().skip(load_scenario("SlotMilling-v1").context()) is not None
    for arguments in ({"iterations": 0}, {"harmonics": -1}, {"other_deviation": 0.0}):
        with pytest.raises(SpecError, match="output_error: "):
            OutputError(**arguments)  # type: ignore[arg-type]
    scenario = load_scenario("ShakerControl-v1")
    with pytest.raises(PluginError, match="before predict"):
        OutputError().predict(scenario.context(), None, scenario.record())  # type: ignore[arg-type]
