"""A force that follows its command a small part of a sampling time late is calibrated, and no cause."""

import dataclasses

import axis_lab
import numpy as np
import pytest

from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.judge.contested import is_no_cause
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.loop_parameters import LoopLag
from fdbench.diagnosis.model.nominal import Covered, Nominal, Simulation, Uncertainty
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.settings import MODEL
from fdbench.effects import Effect, effects
from fdbench.plants.feed_drive import Following
from fdbench.record import Record

LAG, DEAD_TIME = effects.get("current_loop_lag"), effects.get("dead_time")
COVERED = Covered(fastest_m_per_s=0.1, longest_s=5.0, force_N=100.0, period_s=1e-3)


def nominal(**uncertainty: float) -> Nominal:
    return Nominal(plant=axis_lab.drive(), simulation=Simulation(substeps=10), uncertainty=Uncertainty(**uncertainty))


def lags(model: Nominal) -> list[LoopLag]:
    return [item for item in nominal_parameters(model) if isinstance(item, LoopLag)]


@pytest.mark.parametrize("samples", [0.1, 1.0])
def test_a_trace_of_lag_is_no_cause_and_a_lag_is_one(samples: float) -> None:
    lag = LAG.typical(time_constant_s=samples * 1e-3)
    axis = axis_lab.as_built(2)
    found = diagnose(nominal(), *axis_lab.repeated(axis, lag))
    named = [cause.effect for cause in found.answer.causes if cause.probability > 0.5]
    if samples < 3.0 * Uncertainty().loop_lag:
        (own,) = lags(found.calibrated.nominal)
        shift = found.final.shifts[nominal_parameters(found.calibrated.nominal).index(own)]
        assert own.lag_s(shift) == pytest.approx(samples * 1e-3, rel=0.1)
        assert named == []
        assert found.answer.no_gap_probability > 0.5 > found.answer.unknown_probability
    else:
        first = max(found.answer.causes, key=lambda cause: cause.probability)
        assert {first.effect, *first.indistinguishable_from} & {LAG.name, "dead_time"}


@pytest.mark.parametrize(
    ("effect", "moved", "no_cause"),
    [
        (DEAD_TIME.typical(dead_time_s=0.12e-3), 0.0, True),
        (DEAD_TIME.typical(dead_time_s=0.17e-3), 0.0, False),
        (LAG.typical(time_constant_s=0.12e-3, inverter_ratio=0.4), 0.5, True),
        (LAG.typical(time_constant_s=0.12e-3, inverter_ratio=0.4), 1.0, False),
        (effects.get("cogging").typical(), 0.0, False),
    ],
)
def test_what_is_late_together_is_no_cause_up_to_what_every_drive_is(
    effect: Effect, moved: float, no_cause: bool
) -> None:
    model = nominal().beside(COVERED)
    shifts = [moved * float(isinstance(item, LoopLag)) for item in nominal_parameters(model)]
    assert is_no_cause(effect, start(model).moved(shifts).with_effect(effect)) is no_cause
    known = nominal(loop_lag=0.0).beside(COVERED)
    assert not is_no_cause(effect, start(known).with_effect(effect))


def test_a_lag_is_bounded_and_one_that_is_excluded_is_not_moved() -> None:
    model = nominal().beside(COVERED)
    (own,) = lags(model)
    assert own.deviation == pytest.approx(0.05e-3)
    assert own.room == (0.0, MODEL.most_lag)
    assert (own.lag_s(-1.0), own.force_read_late_s(-1.0)) == (0.0, own.deviation)
    assert (own.lag_s(1.0), own.force_read_late_s(1.0)) == (own.deviation, 0.0)
    assert start(model).variant.extra == ()
    assert own.apply(model.drive, 2.0)[1][0].time_constant_s == pytest.approx(0.1e-3)
    assert lags(nominal()) == [], "no sampling time is known"
    assert lags(nominal(loop_lag=0.0).beside(COVERED)) == []
    assert lags(dataclasses.replace(nominal(), exclude=(LAG.name, DEAD_TIME.name)).beside(COVERED)) == []


def test_beside_a_lag_that_is_known_the_force_is_late_by_a_dead_time() -> None:
    for known, carried in (((LAG,), DEAD_TIME), ((DEAD_TIME,), LAG), ((LAG, DEAD_TIME), None)):
        axis = axis_lab.drive()
        axis = dataclasses.replace(axis, effects=(*axis.effects, *(kind.typical() for kind in known)))
        found = lags(dataclasses.replace(nominal(), plant=axis).beside(COVERED))
        assert [item.effect.declared for item in found] == ([] if carried is None else [carried])


def test_a_lag_of_every_day_beside_the_longest_one_is_the_longest_one() -> None:
    model = nominal().beside(COVERED)
    shifts = [2.0 * float(isinstance(item, LoopLag)) for item in nominal_parameters(model)]
    longest = LAG.typical(time_constant_s=20e-3)
    assert start(model).moved(shifts).with_effect(longest).variant.extra == (longest,)


def test_a_force_that_is_read_after_the_position_is_no_cause() -> None:
    """As of a simulator that is half a step ahead: 0.1 of a sample, which had been a mode or a mass.

    The virtual loop is made with the force as it is read, so that very quiet positions are left with a gap.
    """
    fitted, judged = axis_lab.repeated(axis_lab.as_built(2))
    blind = dataclasses.replace(nominal(), plant=dataclasses.replace(axis_lab.drive(), controller=Following()))

    def read_late(record: Record) -> Record:
        torque = record["motor_torque_Nm"].copy()
        torque[1:] -= 0.1 * np.diff(torque)
        return Record({**record, "motor_torque_Nm": torque})

    found = diagnose(blind, *([read_late(item) for item in own] for own in (fitted, judged)))
    (own,) = lags(found.calibrated.nominal)
    shift = found.calibrated.shifts[nominal_parameters(found.calibrated.nominal).index(own)]
    assert own.force_read_late_s(shift) == pytest.approx(1e-4, rel=0.3)
    assert [cause.effect for cause in found.answer.causes if cause.probability > 0.5] == []


def test_a_value_of_the_loop_is_at_its_limit_on_either_side() -> None:
    model = nominal().beside(COVERED)
    own = np.array([float(isinstance(item, LoopLag)) for item in nominal_parameters(model)])
    assert {shift: start(model).moved(shift * own).at_limits for shift in (0.0, 2.0, 3.0)} == {0.0: 0, 2.0: 0, 3.0: 1}
    plant = dataclasses.replace(model.drive, controller=Following(bandwidth_Hz=50.0))
    followed = dataclasses.replace(nominal(), plant=plant).beside(COVERED)
    (lag,) = lags(followed)
    assert lag.room == (-MODEL.most_early, MODEL.most_lag)
    own = np.array([float(isinstance(item, LoopLag)) for item in nominal_parameters(followed)])
    assert {shift: start(followed).moved(shift * own).at_limits for shift in (-10.0, -5.0, 3.0)} == {
        -10.0: 1,
        -5.0: 0,
        3.0: 1,
    }
