"""Sparse regression on drives: the right terms are chosen, parameters mean what they say, and the free run has both."""

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from fdbench_baselines._drive_features import library, on_parameters, straight_line, waves
from fdbench_baselines._drive_run import follow, from_table
from fdbench_baselines._sparse_drive import Sparseness, chosen
from fdbench_baselines.least_squares import LeastSquares
from fdbench_baselines.slr_nfb import SlrNfb

from fdbench.effects import effects
from fdbench.errors import SpecError
from fdbench.estimator import Context, FloatArray
from fdbench.scenario import Reality, Scenario, load_scenario

HOW = Sparseness(share=0.05, iterations=10, harmonics=4, envelope_s=1.0)


def rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_the_terms_that_act_are_chosen() -> None:
    random = np.random.default_rng(0)
    base, candidates = random.standard_normal((500, 2)), random.standard_normal((500, 30))
    candidates[:, 5] = base @ [1.0, 2.0]  # nothing of its own
    y = base @ [3.0, -1.0] + candidates[:, 3] - 0.2 * candidates[:, 17] + 0.01 * random.standard_normal(500)
    assert np.flatnonzero(chosen(base, candidates, y, HOW)).tolist() == [3, 17]
    assert not chosen(base, candidates, base @ [3.0, -1.0], HOW).any()


def test_a_curve_of_friction_counts_as_its_straight_line() -> None:
    half = 0.1
    v = half * np.array([-2.0, -1.0, 1.0, 2.0])
    line = straight_line((7.0 * v + 3.0 * np.sign(v) + 0.5)[:, None], half)[:, 0]
    np.testing.assert_allclose(line, [7.0, 3.5, -2.5], atol=1e-12)
    more = on_parameters(line)
    assert more["viscous_friction_N_s_per_m"] == pytest.approx(7.0)
    assert more["coulomb_friction_N"] == pytest.approx(3.0)
    assert more["offset_N"] == pytest.approx(0.5)
    assert more["coulomb_friction_negative_N"] == pytest.approx(2.5)
    # A target that v drives by -3.5 forwards and +2.5 backwards is one with beta_3 = 3.5 and beta_4 = 2.5.
    more = on_parameters(np.array([0.0, -3.5, 2.5]))
    assert (more["beta_3"], more["beta_4"]) == (3.5, 2.5)


def test_amplitudes_of_a_wave_are_lines_between_knots() -> None:
    time_s = np.linspace(0.0, 2.0, 401)
    columns = waves(time_s, 0.1, 2, 1.0)
    assert columns.shape == (401, 12)
    rising = columns[:, :3] @ [0.0, 1.0, 2.0]
    np.testing.assert_allclose(rising, time_s * np.cos(2.0 * np.pi * 10.0 * time_s), atol=1e-12)


def test_a_free_run_by_hand() -> None:
    """v1 = 0.5 * 2 + 0.1 = 1.1 and v2 = 0.5 * 2 + 0.25 * 1.1 - 0.3 + 0.1 (1 - 1.1) = 0.965."""
    curve, flat = np.array([0.3, 0.1, -0.1]), np.zeros(3)  # 0.1 (1 - v) between -2 and 2
    found = follow(
        np.full(3, 2.0), np.array([0.5, 0.25, 0.3, 0.3]), (-2.0, 2.0), curve, (-1.0, 1.0), flat, 1e-3, 0.0, 0.01
    )
    np.testing.assert_allclose(found, [1.1, 0.965])
    assert from_table(9.0, (-2.0, 2.0), curve) == pytest.approx(-0.1)


def test_harmonics_of_the_lead_are_there_where_there_is_a_screw() -> None:
    context = load_scenario("BallScrewAxis-v0").context()
    v, x = np.array([-1.0, 2.0]), np.array([0.0, 0.0025])
    found = library(context, v, x)
    assert found.lead_m == 0.01
    np.testing.assert_allclose(found.place(x)[1, 3:5], [0.0, 1.0], atol=1e-12)
    assert library(load_scenario("ShakerConstant-v0").context(), v, x).place(x).shape == (2, 3)


def dragged() -> tuple[Scenario, Context]:
    """A control trial whose drive has a drag that its data sheet does not know."""
    scenario = load_scenario("ShakerConstant-v1")
    drag = effects.get("quadratic_drag").typical(quadratic_drag_N_s2_per_m2=4000.0)
    plain = replace(scenario, reality=Reality(noise=scenario.reality.noise, effects=(drag,)), draw=())
    for name in ("id", "digest"):
        object.__setattr__(plain, name, getattr(scenario, name))
    return plain, plain.context()


def test_drag_that_no_data_sheet_has_is_learnt() -> None:
    scenario, context = dragged()
    record, truth = scenario.observe(0)
    command = scenario.command()
    assert command is not None
    assert truth.response is not None
    errors = []
    for estimator in (SlrNfb(), LeastSquares()):
        run = estimator.predict(context, estimator.fit(context, record), command)
        errors.append(rms(cast(FloatArray, run) - truth.response))
    assert errors[0] < 0.2 * errors[1]


@pytest.mark.parametrize("seed", [0, 1])
def test_a_drawn_machine_and_its_shaker_are_found(seed: int) -> None:
    scenario = load_scenario("ShakerConstant-v1")
    context, (record, truth) = scenario.context(), scenario.observe(seed)
    found, regression = SlrNfb().fit(context, record), context.regression(record)
    size = np.sqrt(np.mean(regression.regressors**2, axis=0))

    def error(parameters: Any) -> float:
        return rms(size * [parameters[name] - truth.parameters[name] for name in regression.names])

    assert error(found.parameters) < 0.1 * error(context.nominal)
    assert truth.disturbance_N is not None
    d = truth.disturbance_N[regression.rows]
    window = (regression.time_s > 2.4) & (regression.time_s < 9.6)
    assert rms((cast(FloatArray, found.disturbance_N) - d)[window]) < 0.2 * rms(d[window])


def test_a_step_of_force_is_found_where_the_drive_has_a_current_input() -> None:
    scenario = load_scenario("DriveCurrentClosed-v0")
    context, (record, truth) = scenario.context(), scenario.observe(0)
    estimator = SlrNfb()
    found = estimator.fit(context, record)
    assert truth.disturbance_N is not None
    assert rms(cast(FloatArray, found.disturbance_N) - truth.disturbance_N[:-1]) < 0.2 * truth.disturbance_N.std()
    assert estimator.predict(context, found, record) is None


@pytest.mark.parametrize("wrong", [{"share": -1.0}, {"harmonics": -1}, {"envelope_s": 0.0}, {"iterations": -1}])
def test_arguments_out_of_bounds_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(SpecError, match=next(iter(wrong))):
        SlrNfb(**wrong)
