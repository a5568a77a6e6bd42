"""In place of a value: an effect of its type that leaves it as known, and none that does not."""

import dataclasses

import pytest
from search_lab import NOMINAL, PERIOD_S, search

from fdbench.diagnosis.model.hypothesis import Hypothesis, start
from fdbench.diagnosis.model.nominal import Covered, Uncertainty
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.search.in_place_of_a_value import Exchange, in_place_of_a_value
from fdbench.diagnosis.settings import JUDGE
from fdbench.effects import Effect, effects

DRAG = effects.get("quadratic_drag").typical(quadratic_drag_N_s2_per_m2=4000.0)
VISCOUS = effects.get("viscous_friction").typical(viscous_friction_N_s_per_m=300.0)
MOTOR = effects.get("motor_constant").typical()


def moved(hypothesis: Hypothesis, name: str = "viscous_friction") -> float:
    shifts = zip(nominal_parameters(hypothesis.nominal), hypothesis.shifts, strict=True)
    return max(abs(shift) for item, shift in shifts if item.cause(hypothesis.nominal) == name)


def exchanged(planted: Effect, rival: Effect, value: str = "viscous_friction") -> Exchange | None:
    own = search(planted, speeds_m_per_s=(0.1, 0.03))
    base = own.refinement.calibrate(start(NOMINAL))
    assert moved(base, value) > JUDGE.beyond_doubt
    stage = own.compared(base, [(type(rival), base.with_effect(rival), True)])
    return in_place_of_a_value(own, base, stage, base)


def test_a_drag_takes_the_place_of_a_viscous_friction_that_is_as_known() -> None:
    found = exchanged(DRAG, DRAG)
    assert found is not None
    assert (found.value, found.kind.name) == ("viscous_friction", "quadratic_drag")
    assert found.odds > 0.99
    assert moved(found.hypothesis) < JUDGE.beyond_doubt < moved(found.without)


def test_a_viscous_friction_that_is_wrong_stays_so_beside_a_drag() -> None:
    found = exchanged(VISCOUS, DRAG)
    assert found is None or found.odds < 0.01


def test_one_cause_of_all_that_moved_is_as_likely_as_one_value_of_them() -> None:
    """Mass and friction moved by one share; friction is known too roughly to say so by itself."""
    found = exchanged(effects.get("motor_constant").typical(relative_change=-0.1), MOTOR, "inertia_mismatch")
    assert found is not None
    assert (found.value, found.kind.name) == ("inertia_mismatch", "motor_constant")
    assert found.odds > 0.8
    assert exchanged(effects.get("inertia_mismatch").typical(), MOTOR, "inertia_mismatch") is None


def test_what_of_a_slow_drift_hardly_falls_in_a_record_is_not_another_size_of_friction() -> None:
    """It takes three times as long as a record, in which it falls by a fourth."""
    seconds = max(run.n_samples * run.period_s for run in search().split.runs)
    true = effects.get("friction_drift").typical(cold_force_N=60.0, warm_up_time_s=3.0 * seconds)
    covered = Covered(fastest_m_per_s=0.3, longest_s=seconds, force_N=100.0, period_s=PERIOD_S)
    known = dataclasses.replace(NOMINAL, uncertainty=Uncertainty(known_effects=0.05, friction_form=1e-3))
    nominal = known.beside(covered)
    own = search(true, nominal=nominal)
    base = own.refinement.refine(start(nominal).with_effect(true.changed(cold_force_N=20.0, warm_up_time_s=seconds)))
    stage = own.compared(base, [(type(true), base, True)])
    assert vars(base.effects[0])["warm_up_time_s"] == pytest.approx(seconds, rel=0.02)
    assert moved(base, "coulomb_friction") > JUDGE.beyond_doubt
    found = in_place_of_a_value(own, base, stage, base)
    assert found is not None
    assert (found.value, found.kind.name) == ("coulomb_friction", "friction_drift")
    assert found.odds > 0.9
    assert moved(found.hypothesis, "coulomb_friction") < 1.0
    assert vars(found.hypothesis.effects[0])["warm_up_time_s"] == pytest.approx(3.0 * seconds, rel=0.2)


@pytest.mark.parametrize("name", ["cogging", "torque_ripple"])
def test_an_effect_of_another_type_is_not_tried(name: str) -> None:
    assert exchanged(DRAG, effects.get(name).typical()) is None


def test_a_dead_time_shares_with_a_known_lag_that_has_grown() -> None:
    """Motions as slow as these tell a lag and a dead time by little: which of the two it is stays in doubt."""
    lag, delay = effects.get("current_loop_lag"), effects.get("dead_time")
    known = lag.typical(time_constant_s=2e-4)
    nominal = dataclasses.replace(NOMINAL, plant=dataclasses.replace(NOMINAL.drive, effects=(known,)))
    own = search(delay.typical(dead_time_s=6e-4), nominal=nominal, speeds_m_per_s=(0.1, 0.03))
    base = own.refinement.calibrate(start(nominal))
    assert moved(base, "current_loop_lag") > JUDGE.beyond_doubt
    stage = own.compared(base, [(delay, base.with_effect(delay.typical()), False)])
    found = in_place_of_a_value(own, base, stage, base)
    assert found is not None
    assert (found.value, found.kind.name) == ("current_loop_lag", "dead_time")
    assert moved(found.hypothesis, "current_loop_lag") < 1.0
    assert vars(found.hypothesis.effects[-1])["dead_time_s"] == pytest.approx(6e-4, rel=0.2)
    assert found.odds > 0.3


@pytest.mark.parametrize(("planted", "is_likelier"), [("dead_time", True), ("current_loop_lag", False)])
def test_a_dead_time_that_was_added_shares_with_a_known_lag_that_would_have_grown(
    planted: str, is_likelier: bool
) -> None:
    """A lag that is known well stays in its valley; without the dead time it is another one that fits."""
    lag, delay = effects.get("current_loop_lag"), effects.get("dead_time")
    known = lag.typical(time_constant_s=2e-4)
    nominal = dataclasses.replace(
        NOMINAL,
        plant=dataclasses.replace(NOMINAL.drive, effects=(known,)),
        uncertainty=Uncertainty(effects={"current_loop_lag": 0.1}),
    )
    later = {"dead_time": delay.typical(dead_time_s=1e-3), "current_loop_lag": lag.typical(time_constant_s=1e-3)}
    own = search(later[planted], nominal=nominal, speeds_m_per_s=(0.1, 0.03))
    base = own.refinement.refine(start(nominal).with_effect(delay.typical()))
    assert moved(base, "current_loop_lag") < JUDGE.beyond_doubt
    without = own.refinement.refine(own.refinement.calibrate(start(nominal)), tempered=False)
    found = in_place_of_a_value(own, base, own.compared(base, [(delay, base, True)]), without)
    assert found is not None
    assert (found.value, found.kind.name) == ("current_loop_lag", "dead_time")
    assert found.hypothesis is base
    assert found.held == ["known_current_loop_lag"]
    assert moved(found.without, "current_loop_lag") > 2.0 * JUDGE.beyond_doubt
    assert (found.odds > 0.5) is is_likelier
