"""Probabilities of look-alikes: one claim, divided as the misfits have it."""

import dataclasses
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from axis_lab import as_built, drive, other_friction, protocol, record
from scipy.special import expit
from search_lab import refined_rival

from fdbench.diagnosis.answer.cause import VALUE, Cause, ForceBalances, RivalReduction
from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.judge import probability_models, verdict
from fdbench.diagnosis.judge.contested import Contested, is_no_cause, size_as_cause
from fdbench.diagnosis.judge.findings import Findings
from fdbench.diagnosis.judge.look_alikes import akin, divided, force_balances
from fdbench.diagnosis.judge.nominal_values import Deviating
from fdbench.diagnosis.judge.probability_models import Beside, ProbabilityModels, effect_features
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.known_effects import known_friction
from fdbench.diagnosis.model.nominal import Nominal, Simulation, Uncertainty
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.search.in_place_of_a_value import Exchange
from fdbench.diagnosis.search.stage import Stage
from fdbench.effects import Effect, effects
from fdbench.record import Record

LAG, DELAY, CABLE = (type(effects.get(name).typical()) for name in ("current_loop_lag", "dead_time", "cable_stiffness"))


def stage(misfit: float, **rivals: float) -> Stage:
    """Return a stage with the misfit of the base and those of rivals by name."""
    base = start(Nominal(plant=drive(), simulation=Simulation(substeps=10)))
    found = [
        refined_rival(base, item, own)
        for item, own in ((effects.get(name).typical(), own) for name, own in rivals.items())
    ]
    return Stage(base=base, misfit=misfit, penalty=0.0, test_count=1000.0, rivals=tuple(found))


def test_look_alikes_divide_one_probability() -> None:
    found = divided(stage(3.0, dead_time=1.10, current_loop_lag=1.12, cable_stiffness=2.9), DELAY, [LAG.name], 0.9)
    assert found["dead_time"] + found["current_loop_lag"] == pytest.approx(0.9)
    assert found["dead_time"] / found["current_loop_lag"] == pytest.approx((1.12 / 1.10) ** 30)
    assert found.get("cable_stiffness", 0.0) < 0.02


def test_beyond_all_doubt_look_alikes_are_divided_too() -> None:
    """Evidence against all others is so strong that what these leave to them is zero in double precision."""
    found = divided(stage(1e9, dead_time=1.0, current_loop_lag=1.0), DELAY, [LAG.name], 0.99)
    assert found == pytest.approx({"dead_time": 0.495, "current_loop_lag": 0.495})


def test_a_rival_that_is_nearly_as_good_does_not_speak_against_both() -> None:
    """It has 0.84 of what a stiffness that grows removes: one of the two is there, and which is told by the odds."""
    contest = stage(2.0, quadratic_stiffness=1.10, cable_stiffness=1.24, lead_error=1.9)
    growing = effects.get("quadratic_stiffness")
    assert akin(contest, growing) == [CABLE.name]
    margins = [effect_features(contest, growing, Beside(), same)["margin"] for same in ([], [CABLE.name])]
    assert margins == pytest.approx([math.asinh(30.0 * math.log(x / 1.10)) for x in (1.24, 1.9)])


@pytest.mark.parametrize(("odds", "told"), [({"dead_time": 0.8, "current_loop_lag": 0.05}, True), (None, False)])
def test_what_holds_little_of_a_shared_probability_is_told_from_the_rest(
    odds: dict[str, float] | None, told: bool
) -> None:
    contest = stage(3.0, dead_time=1.10, current_loop_lag=1.11)
    own = Contested(
        effect=DELAY.typical(),
        contest=contest,
        same=[LAG.name],
        own_size=1.0,
        features={},
        probability=0.9,
        odds=odds or divided(contest, DELAY, [LAG.name], 0.9),
        instead_of_a_value=False,
        in_part=0.0,
        no_cause=False,
    )
    assert own.indistinguishable == ([] if told else [LAG.name])


def test_the_force_balance_check_leaves_look_alikes_aside() -> None:
    removed = {DELAY: 0.5, LAG: 0.6, CABLE: 0.2}
    best_other = RivalReduction(effect="cable_stiffness", reduction=0.2)
    assert force_balances(removed, DELAY, [LAG.name]) == ForceBalances(reduction=0.5, instead=best_other)
    assert force_balances({DELAY: 0.5}, DELAY, []) == ForceBalances(reduction=0.5)


def test_the_corner_of_a_known_friction_is_no_cause_that_others_are_small_beside() -> None:
    """Where the speed over which it turns its sign is known exactly, there is no corner but an effect."""
    falling: Any = effects.get("stribeck_friction")
    width = 1e-3
    contest = stage(3.0, stribeck_friction=1.1, cogging=1.2)
    known_N = known_friction(contest.base.nominal.drive)
    for speed, share, size in ((1.5 * width, 0.15, 0.0), (3.0 * width, 0.15, 1.0), (1.5 * width, 0.6, 1.0)):
        effect = falling.typical(
            stribeck_force_N=share * known_N, stribeck_velocity_m_per_s=speed, transition_velocity_m_per_s=width
        )
        assert size_as_cause(effect, contest, contest.base) == size
        exact = dataclasses.replace(contest.base.nominal, uncertainty=Uncertainty(transition_velocity=0.0))
        assert size_as_cause(effect, contest, start(exact)) == 1.0


@pytest.mark.parametrize(
    ("added_N", "known_moved", "no_cause"),
    [(40.0, 0.0, True), (60.0, -0.6, True), (60.0, 0.0, False), (3.0, 1.6, True), (60.0, 1.0, False)],
)
def test_friction_of_another_law_is_no_cause_within_the_doubt_of_the_known_one(
    added_N: float, known_moved: float, no_cause: bool
) -> None:
    """100 N of known LuGre friction are in doubt by 30 N; up to 45 N are none where the law is the same, either."""
    known = effects.get("lugre_friction").typical(coulomb_force_N=100.0, static_force_N=100.0)
    model = Nominal(
        plant=dataclasses.replace(drive(), effects=(known,)),
        simulation=Simulation(substeps=10),
        uncertainty=Uncertainty(known_effects=0.3),
    )
    moved = [known_moved if item.kind == "known_effects" else 0.0 for item in nominal_parameters(model)]
    added = effects.get("coulomb_friction").typical(coulomb_force_N=added_N)
    assert is_no_cause(added, start(model).moved(moved).with_effect(added)) is no_cause


def rubbing(extra: Effect, by: float, judged: float) -> tuple[list[Record], list[Record]]:
    """Return pairs of repeats whose friction is less and more by a share, and records of other motions and friction."""

    def recorded(motion: object, duration_s: float, friction: float, seed: int) -> Record:
        return record(other_friction(as_built(2), friction), (extra,), motion, duration_s, seed)

    pairs = [
        recorded(*motion, friction, seed)
        for motion in protocol(1.0).values()
        for seed, friction in enumerate((1.0 - by, 1.0 + by))
    ]
    return pairs, [recorded(*motion, judged, 10 + seed) for seed, motion in enumerate(protocol(1.3).values())]


def test_another_friction_in_what_is_judged_on_is_no_unknown_cause() -> None:
    """Half of the gap stays on held-out motions whose friction is 8 % more, beside a cogging that closes the rest."""
    cogging = effects.get("cogging").typical()
    recorded = rubbing(cogging, 0.03, 1.08)
    found = diagnose(Nominal(plant=drive(), simulation=Simulation(substeps=10)), *recorded).answer
    gap = found.gap.channels["position_m"]
    assert gap.repaired > 0.7 * gap.recalibrated > 1.4 * gap.noise_floor
    assert [cause.effect for cause in found.causes if cause.probability > 0.5] == ["cogging"]
    assert found.unknown_probability < 0.05


def test_another_friction_in_what_is_judged_on_is_no_gap(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside a cogging that is less than what friction differs by from run to run, and more than noise."""
    cogging = effects.get("cogging").typical().scaled(0.25)
    recorded = rubbing(cogging, 0.04, 1.16)
    model = Nominal(plant=drive(), simulation=Simulation(substeps=10), exclude=("cogging",))
    judged: list[Findings] = []

    def spied(findings: Findings, models: ProbabilityModels) -> verdict.Verdict:
        judged.append(findings)
        return verdict.verdict(findings, models)

    monkeypatch.setattr("fdbench.diagnosis.diagnose.verdict", spied)
    found = diagnose(model, *recorded).answer
    monkeypatch.setattr("fdbench.diagnosis.judge.left._of_another_day", lambda found: np.inf)
    before = verdict.verdict(*judged, probability_models.models())
    assert found.no_gap_probability > 0.9 > 0.1 > before.no_gap_probability
    assert before.unknown_probability > 0.9 > 0.1 > found.unknown_probability


@pytest.mark.parametrize("is_a_cause", [False, True])
def test_what_is_a_cause_is_no_alternative_of_a_value_besides(
    is_a_cause: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is in the hypothesis, and the one in place of the value would only change more slowly."""
    drift, base = effects.get("friction_drift").typical(), stage(1.0).base
    off = Cause(effect="coulomb_friction", kind=VALUE, probability=0.8, share=0.1, unique_share=0.1, parameters={})
    monkeypatch.setattr(verdict, "deviating_parameters", lambda *_: Deviating(causes=[off], features={}, nameless=0.0))
    weighed, slower = (base.with_effect(drift) if is_a_cause else base), base.with_effect(drift)
    exchange = Exchange(value=off.effect, kind=type(drift), without=weighed, hypothesis=slower, log_odds=-1.0)
    models: Any = None
    found: Any = SimpleNamespace(search=None, weighed=weighed, exchange=exchange)
    deviating, exchanged = verdict._values(found, 0.0, models)
    (cause,) = deviating.causes
    assert exchanged == {}
    assert cause.probability == pytest.approx(0.8 * expit(1.0))
    assert cause.alternatives == pytest.approx({} if is_a_cause else {drift.name: 0.8 * expit(-1.0)})
