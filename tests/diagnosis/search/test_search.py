"""Rounds of the search: probabilities by hand, one effect found among all, and nothing where there is nothing."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import pytest
import search_lab
from search_lab import NOMINAL, PERIOD_S, refined_rival, search

from fdbench.diagnosis.evidence.evidence import gather
from fdbench.diagnosis.evidence.least_squares import Fit, Scores
from fdbench.diagnosis.evidence.run_to_run import Change
from fdbench.diagnosis.model.candidates import Candidate, candidates
from fdbench.diagnosis.model.hypothesis import Hypothesis, penalty, start
from fdbench.diagnosis.model.nominal import Covered, Uncertainty
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.model.replay import Replay, Replayed
from fdbench.diagnosis.records.noise_model import white
from fdbench.diagnosis.search.refinement import Refinement, Tangent, _Steps
from fdbench.diagnosis.search.screen import Screen, foremost
from fdbench.diagnosis.search.search import Search
from fdbench.diagnosis.search.stage import Rival, Stage, ranked
from fdbench.diagnosis.settings import MODEL, SEARCH, changed
from fdbench.effects import Effect, effects


def test_the_effect_that_is_there_comes_first() -> None:
    true = effects.get("direction_dependent_friction").typical(viscous_asymmetry_N_s_per_m=60.0)
    stage = search(true).stage(start(NOMINAL))
    assert stage is not None
    best = stage.rivals[0]
    assert best.kind.declared is type(true)
    assert best.refined
    assert stage.gain(best) > 0.9
    assert stage.present() > 0.9
    found = best.hypothesis.effects[0]
    assert getattr(found, found.amplitude) == pytest.approx(getattr(true, true.amplitude), rel=0.1)


def test_a_cable_that_stiffens_is_one_effect() -> None:
    true = effects.get("cable_stiffness").typical(
        spring_stiffness_N_per_m=3000.0, stiffening_N_per_m2=2.5e4, dahl_force_N=0.0
    )
    own = search(true)
    found, _ = own.run(start(NOMINAL))
    (effect,) = found.effects
    assert effect.declared is type(true)
    assert effect.spring_stiffness_N_per_m == pytest.approx(3000.0, rel=0.2)
    assert effect.stiffening_N_per_m2 == pytest.approx(2.5e4, rel=0.2)


def test_an_effect_is_reviewed_beside_the_rivals_that_it_was_chosen_from() -> None:
    """The ripple is among those that come after the friction in the first round, too; the second round chose it."""
    friction = effects.get("direction_dependent_friction").typical(viscous_asymmetry_N_s_per_m=120.0)
    own = search(friction, effects.get("cogging").typical(cogging_force_N=20.0))
    found, stages = own.run(start(NOMINAL))
    final, contests = own.review(found, stages)
    assert {effect.declared for effect in final.effects} == {effects.get("cogging"), type(friction)}
    last = final.effects[-1]
    assert any(rival.kind is type(last) for rival in stages[0].rivals[1:])
    assert contests[-1] is stages[1]


def test_noise_alone_needs_no_round() -> None:
    assert search().stage(start(NOMINAL)) is None


@pytest.mark.parametrize(("of_floor", "is_judged"), [(0.85, False), (0.6, True)])
def test_what_no_class_takes_anything_of_needs_no_round_unless_much_is_left(of_floor: float, is_judged: bool) -> None:
    own = search()
    quieter = {name: white(rms * of_floor, measured=True) for name, rms in search_lab.FLOORS.items()}
    split = dataclasses.replace(own.split, noise_models=quieter)
    stage = Search(Refinement(own.readings, split)).stage(start(NOMINAL))
    assert (stage is not None) == is_judged
    assert stage is None or stage.is_last()


def test_values_that_strain_are_searched_beside_noise_alone() -> None:
    """Noise alone is left of a friction that is moved far: something else may be there in its place."""
    friction = effects.get("coulomb_friction").typical(coulomb_force_N=20.0, transition_velocity_m_per_s=2e-3)
    own = search(friction)
    base = own.refinement.calibrate(start(NOMINAL))
    assert base.named_penalty() < base.cost_of_a_cause
    assert own.stage(base) is None
    doubted = dataclasses.replace(NOMINAL, uncertainty=Uncertainty(known_effects=0.01, friction_form=1e-3))
    narrow = search(friction, nominal=doubted)
    base = narrow.refinement.calibrate(start(doubted))
    assert base.named_penalty() > base.cost_of_a_cause
    assert narrow.stage(base) is not None


@pytest.mark.parametrize("gap_m", [15e-6, 60e-6])
def test_backlash_is_found_from_beyond_the_size_that_fits_linearly(gap_m: float) -> None:
    true = effects.get("backlash").typical(gap_m=gap_m)
    stage = search(true).stage(start(NOMINAL))
    assert stage is not None
    assert stage.rivals[0].kind.declared is type(true)
    (found,) = stage.rivals[0].effect.values()
    assert found == pytest.approx(gap_m, rel=0.1)


def test_runout_beyond_its_linear_size_is_begun_with_as_it_is_turned() -> None:
    true = effects.get("runout_force").typical(radial_runout_m=2e-5, spindle_frequency_Hz=52.0, angle_rad=-1.6)
    own, base = search(true, speeds_m_per_s=(0.02,)), start(NOMINAL)
    linear = Candidate(members=(true.changed(radial_runout_m=5e-6),))
    first, *beyond = own._starts(base, base.with_effect(linear.members[0]), linear)
    assert first.effects == linear.members
    assert [vars(item.effects[-1])["radial_runout_m"] for item in beyond] == pytest.approx([1e-5, 2e-5])
    assert {vars(item.effects[-1])["angle_rad"] for item in beyond} == {-1.6}


def test_teeth_are_counted_again_beside_values_that_made_up_for_a_wrong_number() -> None:
    """Two teeth have the line of three, and another mean force, which viscous friction passes for."""
    true = effects.get("tooth_passing_force").typical(teeth=3.0, spindle_frequency_Hz=11.0, angle_rad=0.4)
    own, base = search(true), start(NOMINAL)
    two = true.changed(teeth=2.0, spindle_frequency_Hz=16.5, angle_rad=0.6)
    wrong = own.refinement.refine(base.with_effect(two))
    assert vars(wrong.effects[-1])["teeth"] == 2.0
    found = own.with_best_number(base, wrong).effects[-1]
    assert vars(found)["teeth"] == 3.0
    assert vars(found)["spindle_frequency_Hz"] == pytest.approx(11.0, rel=0.01)


def test_a_screw_that_warms_up_in_part_by_its_motion_is_not_taken_for_one_that_does_by_time() -> None:
    true = effects.get("thermal_expansion").typical(temperature_rise_K=6.0, warm_up_time_s=4.0, share_of_motion=0.4)
    stage = search(true).stage(start(NOMINAL))
    assert stage is not None
    best = stage.rivals[0]
    assert best.kind.declared is type(true)
    assert vars(best.effect)["share_of_motion"] == pytest.approx(0.4, abs=0.15)
    assert best.misfit < 1.04


def test_a_class_that_shows_nothing_in_a_linear_fit_is_refined_from_its_usual_size() -> None:
    """A gap that is left is not called unknown before."""
    true = effects.get("axial_compliance").typical(stiffness_loss_percent=40.0)
    own, base = search(true), start(NOMINAL)
    linear = base.with_effect(type(true).typical(stiffness_loss_percent=-0.1))
    kind, found, refined = own._looked_at_again(base, type(true), linear)
    (value,) = found.effects[-1].values()
    assert kind is type(true)
    assert refined
    assert value == pytest.approx(40.0, rel=0.15)


def test_a_class_that_was_refined_in_vain_is_refined_from_its_usual_size(monkeypatch: pytest.MonkeyPatch) -> None:
    """Near the edge of stability a response says nothing of an effect of any size, and a fit stays where it began."""
    true = effects.get("axial_compliance").typical(stiffness_loss_percent=40.0)

    def stuck(_: Search, base: Hypothesis, candidate: Candidate, *others: object) -> Hypothesis:
        return base.with_effect(candidate.members[0].scaled(1e-3))

    contested = Search.contested

    def alone(own: Search, base: Hypothesis, found: Sequence[tuple[type[Effect], Hypothesis, bool]]) -> Stage:
        return contested(own, base, [item for item in found if item[0].declared is type(true)])

    monkeypatch.setattr(Search, "_refined", stuck)
    monkeypatch.setattr(Search, "contested", alone)
    own = search(true)
    quieter = {name: white(0.5 * rms, measured=True) for name, rms in search_lab.FLOORS.items()}
    stage = Search(Refinement(own.readings, dataclasses.replace(own.split, noise_models=quieter))).stage(start(NOMINAL))
    assert stage is not None
    assert stage.misfit >= SEARCH.unexplained
    assert stage.rivals[0].kind.declared is type(true)
    assert stage.gain(stage.rivals[0]) > 0.8


def test_probabilities_of_a_round_by_hand() -> None:
    """Evidence is M to the power of -n/2 for each; that there is none is as likely beforehand as the whole library."""
    base = start(NOMINAL)
    kinds = [effects.get(name) for name in ("backlash", "cogging")]
    rivals = tuple(
        Rival(kind=kind, hypothesis=base, misfit=misfit, penalty=penalty, refined=True, size=1.0, own_size=1.0)
        for kind, misfit, penalty in zip(kinds, (1.5, 1.6), (2.0, 0.0), strict=True)
    )
    stage = Stage(base=base, misfit=1.8, penalty=0.0, test_count=1e3, rivals=rivals, effective=10.0)
    weights = [1.5**-5 * math.exp(-1.0), 1.6**-5, len(NOMINAL.library) * 1.8**-5]
    assert stage.probabilities() == pytest.approx([weight / sum(weights) for weight in weights[:2]])
    assert stage.present() == pytest.approx(1.0 - weights[2] / sum(weights))
    assert stage.gain(rivals[0]) == pytest.approx(0.3 / 0.9)
    kinds_of_values = [item.kind for item in nominal_parameters(NOMINAL)]
    far = base.moved([2.0 * MODEL.far_fetched if kind == "viscous" else 0.0 for kind in kinds_of_values])
    ratio = (1.0 + 4.0 * MODEL.far_fetched**2 / MODEL.freedom) / (1.0 + MODEL.far_fetched**2 / MODEL.freedom)
    alone = 1.8 * ratio ** (kinds_of_values.count("viscous") * (MODEL.freedom + 1.0) / 10.0)
    assert dataclasses.replace(stage, base=far).gain(rivals[0]) == pytest.approx(
        (alone - 1.5) / max(alone - 1.0, 0.5 * alone)
    )


@pytest.mark.parametrize(("inverter_ratio", "first", "odds"), [(0.3, "current_loop_lag", 0.0), (0.5, "dead_time", 0.5)])
def test_a_look_alike_on_a_bound_of_its_form_is_no_closer_for_it(
    inverter_ratio: float, first: str, odds: float
) -> None:
    """Always closer, it is sure within its bounds; on one it is behind by half the number that brought it there."""
    base = start(NOMINAL)
    lag = effects.get("current_loop_lag").typical(inverter_ratio=inverter_ratio)
    rivals = tuple(
        refined_rival(base, item, misfit) for item, misfit in ((lag, 1.00), (effects.get("dead_time").typical(), 1.01))
    )
    squares = np.column_stack((np.ones(40), 1.0 + np.random.default_rng(0).uniform(0.1, 0.3, 40)))
    stage = ranked(Stage(base=base, misfit=5.0, penalty=0.0, test_count=1e3, rivals=rivals), squares)
    assert stage.rivals[0].kind.name == first
    closer, behind = map(stage.evidence_of, stage.rivals)
    assert closer - behind == pytest.approx(odds) if odds else closer - behind > 5.0


@pytest.mark.parametrize(("spring", "first"), [(0.0, "quadratic_stiffness"), (300.0, "cable_stiffness")])
def test_what_is_hollow_is_behind_a_look_alike_that_is_not(spring: float, first: str) -> None:
    """A cable that only stiffens is a quadratic stiffness, however much closer its further numbers bring it."""
    cable = effects.get("cable_stiffness").typical(spring_stiffness_N_per_m=spring, stiffening_N_per_m2=3e3)
    base, items = start(NOMINAL), (effects.get("quadratic_stiffness").typical(), cable)
    rivals = tuple(refined_rival(base, item, misfit) for item, misfit in zip(items, (1.1, 1.0), strict=True))
    stage = Stage(base=base, misfit=3.0, penalty=0.0, test_count=1e3, rivals=rivals)
    gaps = np.random.default_rng(0).uniform(1.0, 1.2, (40, 2)) + np.array([0.1, 0.0])
    found = ranked(stage, gaps)
    assert found.rivals[0].kind.name == first
    before = [
        dataclasses.replace(item, hypothesis=item.hypothesis.with_effect(effects.get("cogging").typical()))
        for item in rivals
    ]
    assert ranked(dataclasses.replace(stage, rivals=tuple(before)), gaps).rivals[0].kind.name == first, (
        "whatever is added after it"
    )
    assert found.present() == pytest.approx(stage.present())
    assert (found.probabilities()[1] < 1e-9) == (first == "quadratic_stiffness")


@pytest.mark.parametrize(
    ("misfit", "size", "is_last"), [(1.0, 1.0, True), (0.85, 1.0, False), (0.85, 0.1, True), (0.75, 0.1, False)]
)
def test_what_is_no_trace_is_worth_adding_by_a_quarter(misfit: float, size: float, is_last: bool) -> None:
    base = start(NOMINAL)
    rival = Rival(
        kind=effects.get("cogging"),
        hypothesis=base,
        misfit=misfit,
        penalty=0.0,
        refined=True,
        size=size,
        own_size=1.0,
    )
    stage = Stage(base=base, misfit=1.2, penalty=0.0, test_count=1e3, rivals=(rival,), effective=15.0)
    assert stage.gain(rival) > SEARCH.smallest_gain
    assert (stage.present() < 0.5) == (misfit > 0.8)
    assert stage.is_doubtful(rival) == is_last == stage.is_last()


def test_two_fits_without_an_effect_are_compared_as_any_others() -> None:
    """What is left of a gap is judged beside both the search's end and the written model, which may have none."""
    base = start(NOMINAL)
    ends = [base.moved(shift * np.eye(len(base.shifts))[0]) for shift in (0.1, 0.2)]
    rivals = tuple(
        Rival(kind=Effect, hypothesis=item, misfit=1.0, penalty=0.0, refined=True, size=1.0, own_size=1.0)
        for item in ends
    )
    squares = np.column_stack((np.ones(40), 1.0 + np.random.default_rng(0).uniform(0.1, 0.3, 40)))
    stage = ranked(Stage(base=base, misfit=5.0, penalty=0.0, test_count=1e3, rivals=rivals), squares)
    assert [rival.hypothesis for rival in stage.rivals] == ends


def test_a_number_more_is_no_argument_on_held_out_stretches() -> None:
    """Where two look-alikes leave the same, each is as probable, though one of them has two numbers that are fitted."""
    base = start(NOMINAL)
    kinds = (effects.get("current_loop_lag").typical(inverter_ratio=0.2), effects.get("dead_time").typical())
    rivals = tuple(
        Rival(
            kind=type(item),
            hypothesis=base.with_effect(item),
            misfit=1.0,
            penalty=0.0,
            refined=True,
            size=1.0,
            own_size=1.0,
        )
        for item in kinds
    )
    squares = np.column_stack((np.random.default_rng(0).uniform(0.9, 1.1, 40),) * 2)
    stage = ranked(Stage(base=base, misfit=5.0, penalty=0.0, test_count=1e3, rivals=rivals), squares)
    one, other = stage.probabilities()
    assert one == pytest.approx(other)


@pytest.mark.parametrize(("misfit", "excess"), [(0.5, 0.25), (1.0, 0.5), (3.0, 2.0)])
def test_half_of_a_misfit_is_an_excess_however_much_repeats_differ_by(misfit: float, excess: float) -> None:
    base = start(NOMINAL)
    rival = Rival(
        kind=effects.get("cogging"), hypothesis=base, misfit=0.1, penalty=0.0, refined=True, size=1.0, own_size=1.0
    )
    stage = Stage(base=base, misfit=misfit, penalty=0.0, test_count=1e3, rivals=(rival,))
    assert stage.gain(rival) == pytest.approx((misfit - 0.1) / excess)


@pytest.mark.parametrize(("misfit", "paraphrase"), [(1.99, True), (1.5, False)])
def test_a_mode_that_says_what_a_wrong_mass_says_is_no_rival_of_it(misfit: float, paraphrase: bool) -> None:
    """Of an excess of 1 it explains a hundredth besides, or half."""
    scale = nominal_parameters(NOMINAL)
    off = tuple(14.0 if item.name == "motor_mass" else 0.0 for item in scale)
    base = dataclasses.replace(start(NOMINAL), shifts=off)
    mode = effects.get("structural_mode").typical()
    stage = Stage(base=base, misfit=2.0, penalty=base.named_penalty(), test_count=1e3, rivals=(), effective=20.0)
    rival = stage.rival(
        type(mode), start(NOMINAL).with_effect(mode), misfit, fitted=1.0, refined=True, size=1.0, own_size=100.0
    )
    assert rival.paraphrase is paraphrase
    assert rival.penalty == pytest.approx(base.named_penalty() if paraphrase else 0.0)
    stage = dataclasses.replace(stage, rivals=(rival,))
    assert stage.is_last() is paraphrase
    assert (stage.gain(rival) > 0.1) is not paraphrase


def test_what_a_replaced_friction_had_for_a_size_is_nothing() -> None:
    """Its size would be that of the free form at low speed, which has a bound."""
    nominal = NOMINAL.beside(Covered(fastest_m_per_s=0.5, longest_s=10.0, force_N=100.0, period_s=1e-3))
    places = {item.name: place for place, item in enumerate(nominal_parameters(nominal))}
    lugre = effects.get("lugre_friction").typical()
    index = next(n for n, item in enumerate(NOMINAL.drive.effects) if lugre.in_place_of(item) is not None)
    found = []
    for known in (0.0, 20.0):
        shifts = [0.0] * len(places)
        shifts[places["friction_force_0_N"]], shifts[places["known_coulomb_friction"]] = 1.0, known
        beside = dataclasses.replace(start(nominal), shifts=tuple(shifts))
        found.append((beside.variant.extra, beside.with_effect(lugre, index).variant.extra))
    (usual, instead), (larger, instead_of_larger) = found
    assert usual != larger
    assert instead == instead_of_larger


def test_beside_a_far_fetched_base_an_effect_is_also_fitted_from_the_nominal_values() -> None:
    """Viscous friction eight standard deviations off stands in for a drag; beside the drag it goes back."""
    true = effects.get("quadratic_drag").typical()
    own = search(true)
    given = start(NOMINAL)
    names = [item.name for item in nominal_parameters(NOMINAL)]
    far = given.moved([8.0 if name == "motor_viscous" else 0.0 for name in names])
    assert far.far_fetched > 0.0 == given.far_fetched
    tried = far.with_effect(true.scaled(0.1))
    near = own.refinement.refine(tried)
    found = own.refined_anew(near, far)
    assert found.prior_penalty() <= near.prior_penalty()
    assert found.prior_penalty() < 5.0
    assert found.effects[0].values()[0] == pytest.approx(true.values()[0], rel=0.2)


def test_what_strained_values_hide_from_a_linear_fit_is_sought_beside_them_as_given() -> None:
    """Friction on the wrong side of the screw stands in for backlash, and beside it nothing tells of that."""
    true = effects.get("backlash").typical()
    own = search(true)
    names = [item.name for item in nominal_parameters(NOMINAL)]
    strained = start(NOMINAL).moved([-2.6 if name == "friction_side" else 0.0 for name in names])
    stage = own.stage(strained)
    assert stage is not None
    assert stage.rivals[0].kind.declared is type(true)
    assert stage.rivals[0].hypothesis.effects[0].values()[0] == pytest.approx(true.values()[0], rel=0.1)
    every = candidates(strained, period_s=PERIOD_S)
    gap = Screen(own.refinement, strained).fits((), own.split.fitted).gap
    assert own._unhidden(start(NOMINAL), every, gap) == {}
    assert type(true) in {kind.declared for kind in own._unhidden(strained, every, gap)}


def test_a_fit_beside_values_as_given_ends_where_it_goes_back_to_those_of_the_base() -> None:
    """Of a mass that is wrong nothing is hidden: beside a cogging that is not there it has to be as wrong again."""
    own, given = search(effects.get("inertia_mismatch").typical(extra_mass_kg=20.0)), start(NOMINAL)
    base = own.refinement.refine(given)
    assert max(map(abs, base.shifts)) > SEARCH.strained
    begun = given.with_effect(effects.get("cogging").typical().scaled(0.1))
    ended, whole = own.refinement.refine(begun, away_from=base), own.refinement.refine(begun)
    assert ended.is_nearer_to(base)
    assert whole.apart_from(base) < 0.5 * ended.apart_from(base)
    every = [item for item in candidates(base, period_s=PERIOD_S) if item.kind.name == "cogging"]
    assert own._unhidden(base, every, Screen(own.refinement, base).fits((), own.split.fitted).gap) == {}


def test_a_short_lag_is_told_from_a_dead_time_by_all_substeps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few substeps are later by as much as the two differ; a lag that makes up for that is a dead time."""
    monkeypatch.setattr(search_lab, "FLOORS", {name: 0.1 * rms for name, rms in search_lab.FLOORS.items()})
    true = effects.get("current_loop_lag").typical(time_constant_s=3e-4, inverter_ratio=0.1)
    fine = search(true, speeds_m_per_s=(0.3,))
    readings = fine.readings.coarsened(start(NOMINAL), fine.split.noise_models)
    assert readings.replay.substeps < NOMINAL.simulation.substeps
    stage = Search(Refinement(readings, fine.split)).stage(start(NOMINAL))
    assert stage is not None
    first, second = stage.rivals[:2]
    assert (first.kind.name, second.kind.name) == ("current_loop_lag", "dead_time")
    assert stage.evidence_of(first) - stage.evidence_of(second) > 1.5


def test_friction_over_velocity_is_also_fitted_without_a_free_form_of_friction() -> None:
    """A form of friction at its limit stands in for Stribeck friction; beside it, short steps stay there."""
    true = effects.get("stribeck_friction").typical(stribeck_force_N=60.0)
    own = search(true)
    base = own.refinement.calibrate(start(NOMINAL))
    assert base.far_fetched == 0.0
    tried = base.with_effect(true.scaled(0.1))
    with changed({"search.quick": SEARCH.steps}):
        beside_the_form = own.refinement.refine(tried)
        found = own.refined_anew(beside_the_form, base)
    assert own.refinement.better(base, [found, beside_the_form]) is found
    assert found.effects[0].values()[0] == pytest.approx(60.0, rel=0.2)
    assert beside_the_form.effects[0].values()[0] < found.effects[0].values()[0]


def test_what_is_right_on_what_is_fitted_is_refined_too() -> None:
    """A drag of another shape is best on what is held out, Stribeck friction of a wrong velocity on what is fitted."""
    kinds = [effects.get(name) for name in ("quadratic_drag", "stribeck_friction", "cogging", "backlash", "dead_time")]
    gains = dict(zip(kinds, (10.0, -1.0, 3.0, 2.5, 2.4), strict=True))
    assert foremost(gains) == set(kinds[:1]) | {kinds[2], kinds[3]}
    assert foremost(dict(zip(kinds, (4.0, 20.0, 0.0, 0.0, 3.9), strict=True))) == {kinds[0], kinds[1]}
    assert foremost(dict.fromkeys(kinds, -1.0)) == foremost({}) == set()


def test_a_load_on_the_table_is_not_left_on_the_motor() -> None:
    """80 kg: 44 deviations of the table, 23 of the motor, on which a quadratic in place of a Student's t would end."""
    true = effects.get("inertia_mismatch").typical(extra_mass_kg=80.0)
    own = search(true)
    places = {item.name: place for place, item in enumerate(nominal_parameters(NOMINAL))}
    sizes = [item.size(NOMINAL.drive) for item in nominal_parameters(NOMINAL)]
    motor, table = places["motor_mass"], places["table_mass"]
    for found in (own.refinement.calibrate(start(NOMINAL)), own.refinement.refine(start(NOMINAL))):
        assert found.shifts[table] * sizes[table] == pytest.approx(80.0, rel=0.02)
        assert abs(found.shifts[motor]) < 1.0


def test_what_is_far_off_on_one_side_is_tried_on_either_alone() -> None:
    places = {item.name: place for place, item in enumerate(nominal_parameters(NOMINAL))}
    sizes = [item.size(NOMINAL.drive) for item in nominal_parameters(NOMINAL)]
    motor, table = places["motor_mass"], places["table_mass"]
    shifts = [0.0] * len(places)
    assert start(NOMINAL).moved(shifts).on_one_side() == []
    shifts[motor], shifts[table], shifts[places["motor_viscous"]] = MODEL.far_fetched + 1.0, -1.0, 0.5
    given = start(NOMINAL).moved(shifts)
    change = shifts[motor] * sizes[motor] + shifts[table] * sizes[table]
    on_motor, on_table = given.on_one_side()
    assert (on_motor.shifts[table], on_table.shifts[motor]) == (0.0, 0.0)
    assert on_motor.shifts[motor] * sizes[motor] == pytest.approx(change)
    assert on_table.shifts[table] * sizes[table] == pytest.approx(change)
    assert on_motor.shifts[places["motor_viscous"]] == on_table.shifts[places["motor_viscous"]] == 0.5


def test_a_value_that_is_a_cause_costs_no_more_than_naming_one() -> None:
    places = {item.name: place for place, item in enumerate(nominal_parameters(NOMINAL))}
    shifts = [0.0] * len(places)
    shifts[places["motor_mass"]] = 1.0
    near = start(NOMINAL).moved(shifts)
    assert near.named_penalty() == pytest.approx(near.prior_penalty())
    shifts[places["motor_mass"]], shifts[places["table_mass"]] = 30.0, 0.0
    far = start(NOMINAL).moved(shifts)
    assert far.named_penalty() == pytest.approx(2.0 * math.log(len(NOMINAL.library)))
    assert far.prior_penalty() > 3.0 * far.named_penalty()
    shifts[places["table_mass"]] = -20.0
    assert start(NOMINAL).moved(shifts).named_penalty() == pytest.approx(far.named_penalty() + penalty(-20.0))


def test_a_strong_saturation_is_found_though_its_response_grows_with_its_square() -> None:
    """Its linear fit is out by its square; twice that size the loop gives a gap many times larger."""
    true = effects.get("force_saturation").typical(saturation_per_N=2.5e-3)
    stage = search(true).stage(start(NOMINAL))
    assert stage is not None
    best = stage.rivals[0]
    assert best.kind.declared is type(true)
    assert best.hypothesis.effects[0].values()[0] == pytest.approx(true.values()[0], rel=0.1)


def test_a_fit_that_came_further_than_its_round_is_judged_in_its_place() -> None:
    """An effect at half of its size, where a round left it, does not stand for what was found beside others."""
    true = effects.get("direction_dependent_friction").typical(viscous_asymmetry_N_s_per_m=60.0)
    kind, own = type(true), search(true)
    base = own.refinement.refine(start(NOMINAL))
    stopped = base.with_effect(true.scaled(0.5))
    further = own.refinement.refine(stopped)
    final, (contest,) = own.review(further, [own.compared(base, [(kind, stopped, True)])])
    assert final is further
    assert contest.rivals[0].hypothesis is further
    best = own.compared(base, [(kind, further, True)])
    assert own.review(further, [best]) == (further, [best])


def test_what_stands_in_for_an_effect_hides_it_from_its_base_alone() -> None:
    """Beside the re-calibrated axis a drag changes little; in its own hypothesis it changes what it does."""
    true = effects.get("quadratic_drag").typical()
    own = search(true)
    base = own.refinement.refine(start(NOMINAL))
    found = own.refined_anew(base.with_effect(true), base)
    (rival,) = own.compared(base, [(type(true), found, True)]).rivals
    (bare,) = own.compared(start(NOMINAL), [(type(true), start(NOMINAL).with_effect(true), True)]).rivals
    assert bare.own_size == pytest.approx(bare.size)
    assert rival.own_size == pytest.approx(bare.own_size, rel=0.3)
    assert rival.size < 0.5 * rival.own_size


def test_a_step_that_overshoots_is_tried_smaller(monkeypatch: pytest.MonkeyPatch) -> None:
    """A mass three times the nominal one: told that a step is ten times as far, a fit still gets there."""
    nominal = dataclasses.replace(NOMINAL, uncertainty=Uncertainty(mass=0.5))
    own = search(effects.get("inertia_mismatch").typical())
    given = start(nominal)
    plain = own.refinement.refine(given)
    fit = Scores.fit

    def far(self: Scores, columns: Sequence[int], damping: float = 0.0) -> Fit:
        found = fit(self, columns, damping)
        return dataclasses.replace(found, coefficients=60.0 * found.coefficients)

    monkeypatch.setattr(Scores, "fit", far)
    found = own.refinement.refine(given)
    evidence = gather(own.readings, own.split, given, [plain, found])
    before, best, reached = evidence.squares(held_out=False)
    assert reached - best < 0.5 * (before - best)


def test_the_form_of_friction_leaves_what_is_more_to_an_effect() -> None:
    """Beyond its limit upwards a fit does not move it; downwards, where no effect is, it does.

    At a few thousandths of the fastest speed, where laws round the sign in different ways, it goes further.
    """
    nominal = NOMINAL.beside(Covered(fastest_m_per_s=0.1, longest_s=5.0, force_N=100.0))
    place = [item.kind for item in nominal_parameters(nominal)].index("friction_form")
    room = start(nominal).moved(np.eye(len(nominal_parameters(nominal)))[place]).room()
    assert room[place] == (-math.inf, MODEL.most_form[0] - 1.0)
    assert [high for _, high in start(nominal).room()[place : place + 4]] == list(MODEL.most_form)
    assert MODEL.most_form[-1] > max(MODEL.most_form[:-1])
    assert room[0] == (-math.inf, math.inf)


def test_a_prior_pulls_as_the_penalty_that_hypotheses_are_compared_by() -> None:
    """The slope of w s^2 is that of the penalty at s, times its weight."""
    shift, weight, step = 1.7, 3.0, 1e-6
    base = start(NOMINAL).moved([shift])
    (stand, own), *_ = base.priors(weight)
    rise = base.moved([step]).prior_penalty() - base.moved([-step]).prior_penalty()
    assert stand == shift
    assert 2.0 * own * shift == pytest.approx(weight * rise / (2.0 * step), rel=1e-6)


def test_responses_that_serve_on_lead_to_the_same_minimum(monkeypatch: pytest.MonkeyPatch) -> None:
    """Simulated anew at each step, or only where a step breaks its promise: the fits agree, the second is cheaper."""
    true = effects.get("cogging").typical()
    given = start(NOMINAL).with_effect(true.scaled(0.7))
    lanes = [0]
    fill = Replay.fill

    def counted(self: Replay, replayed: Sequence[Replayed]) -> None:
        lanes[-1] += sum(len(item.variants) for item in replayed)
        fill(self, replayed)

    monkeypatch.setattr(Replay, "fill", counted)
    found = []
    for promise in (math.inf, SEARCH.kept_promise):
        own = search(true)
        lanes.append(0)
        with changed({"search.kept_promise": promise}):
            found.append(own.refinement.refine(given))
    _, anew, served = lanes
    assert served < 0.8 * anew
    evidence = gather(own.readings, own.split, given, found)
    before, *after = evidence.squares(held_out=False).tolist()
    assert abs(after[0] - after[1]) < 1e-3 * (before - min(after))
    assert found[0].effects[0].values() == pytest.approx(found[1].effects[0].values(), rel=0.02, abs=0.01)


@pytest.mark.parametrize(("most", "serve"), [(SEARCH.tangents, True), (1, False)])
def test_responses_about_several_points_serve_where_a_fit_comes_near_them_again(most: int, serve: bool) -> None:
    refinement = search().refinement
    here = start(NOMINAL)
    far = here.moved((1.5 * SEARCH.near + 1.0) * np.eye(len(here.shifts))[0])
    with changed({"search.tangents": most}):
        first = refinement.tangent(here)
        assert refinement.tangent(far).about[0] is far
        again = refinement.tangent(here.moved(0.5 * SEARCH.near * np.eye(len(here.shifts))[0]))
    assert (again.about[0] is first.about[0]) is serve
    assert len(refinement.nominal) <= most


def test_a_step_is_tried_beside_damped_ones_where_the_last_one_broke_its_promise() -> None:
    own = search(effects.get("cogging").typical())
    given = start(NOMINAL).with_effect(effects.get("cogging").typical().scaled(0.7))
    probed, _, _ = own.refinement.promise(given)
    steps = _Steps(given, probed, range(len(Tangent.at(given).moved)), 1.0)
    tried: list[int] = []
    squares = own.refinement._squares

    def counted(base: Hypothesis, trials: Sequence[Hypothesis]) -> list[float]:
        tried.append(len(trials))
        return squares(base, trials)

    own.refinement._squares = counted  # type: ignore[method-assign]
    (one, fell), (other, deeper) = (
        own.refinement._stepped(steps, given, fresh=True, likely=own_, slow=False) for own_ in (True, False)
    )
    assert tried == [1, 1 + len(SEARCH.dampings)]
    assert fell > 0.0
    assert other is one or deeper > fell
    assert one.effects[0].values() == pytest.approx(other.effects[0].values(), rel=0.1)


def test_of_a_slow_fit_the_best_step_is_tried_several_times_as_long() -> None:
    """A step that is damped to a tenth falls short of where one several times as long ends."""
    true = effects.get("cogging").typical()
    own = search(true)
    given = start(NOMINAL).with_effect(true.scaled(0.7))
    probed, _, _ = own.refinement.promise(given)
    steps = _Steps(given, probed, range(len(Tangent.at(given).moved)), 1.0)
    (steps.undamped,), steps.promise = steps.damped([10.0]), 0.0
    with changed({"search.creeping": 1.0}):
        ends = [own.refinement._stepped(steps, given, fresh=True, likely=True, slow=slow) for slow in (False, True)]
    (_, fell), (longer, deeper) = ends
    assert deeper > 1.3 * fell > 0.0
    assert longer in steps.longer(steps.undamped)


def test_a_fit_from_where_one_has_begun_before_simulates_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    refinement = search(effects.get("cogging").typical()).refinement
    found = refinement.refine(start(NOMINAL))
    monkeypatch.setattr(Replay, "fill", None)
    assert refinement.refine(start(NOMINAL)) is found
    monkeypatch.undo()
    refinement.look_at(refinement.readings, refinement.split)
    assert refinement.refine(start(NOMINAL)) is not found


def test_no_step_leads_beyond_the_bounds_of_an_effect_and_what_it_promises_is_within_them() -> None:
    """Of bristles whose static force would have to be below the Coulomb force, all other numbers are fitted."""
    kind = effects.get("lugre_friction")
    true = kind.typical(coulomb_force_N=40.0, static_force_N=40.0)
    own = search(true)
    tried = start(NOMINAL).with_effect(true.changed(coulomb_force_N=42.0, static_force_N=42.0))
    probed, _, _ = own.refinement.promise(tried)
    steps = _Steps(tried, probed, range(len(Tangent.at(tried).moved)), 1.0)
    (bristles,) = steps.undamped.effects
    assert bristles.static_force_N == pytest.approx(bristles.coulomb_force_N)
    assert bristles.coulomb_force_N < 41.5
    (after,) = own.refinement._squares(tried, [steps.undamped])[1:]
    assert steps.before - after - steps.undamped.prior_penalty() == pytest.approx(steps.promise, rel=0.25)


def test_a_step_by_smaller_steps_of_the_numbers_ends_where_that_by_whole_ones_does() -> None:
    """Where the responses are proportional to the numbers, priors and bounds in their units included."""
    own = search()
    n = len(nominal_parameters(NOMINAL))
    here = start(NOMINAL).moved(0.5 * np.eye(n)[0] - 0.3 * np.eye(n)[1])
    ends = []
    for scale in (1.0, SEARCH.fine):
        probed = gather(own.readings, own.split, here, Tangent.at(here, scale).moved, own.split.fitted)
        steps = _Steps(here, probed, range(n), 10.0, scale)
        assert steps.promise > 0.0
        ends.append(steps.undamped.shifts)
    assert ends[1] == pytest.approx(ends[0], abs=0.05)
    assert max(map(abs, np.subtract(ends[0], here.shifts))) > 0.2


def test_a_tangent_serves_hypotheses_near_it_alone() -> None:
    here = start(NOMINAL)
    tangent = Tangent.at(here)
    assert tangent.is_about(here)
    assert len(tangent.moved) == len(nominal_parameters(NOMINAL))
    one, other = np.eye(len(here.shifts))[:2]
    assert tangent.distance(here.moved(0.9 * one - 0.2 * other)) == pytest.approx(0.9)
    assert tangent.distance(dataclasses.replace(here, replaced=(0,))) == math.inf
    refinement = search().refinement
    refinement.tangent(here)
    assert refinement.tangent(here.moved(0.9 * SEARCH.near * one)).about[0] is here
    assert refinement.tangent(here.moved(1.1 * SEARCH.near * one)).about[0] is not here


def test_what_a_tangent_says_of_another_base_is_counted_from_its_own() -> None:
    """The response to a moved mass is the same column, whether gathered about its base or for a base beside it."""
    own = search()
    here = start(NOMINAL)
    beside = here.moved(0.5 * np.eye(len(here.shifts))[1])
    (moved,) = Tangent.at(here).moved[:1]
    direct = gather(own.readings, own.split, here, [moved])
    told = gather(own.readings, own.split, beside, [moved], about=[here])
    assert told.products[:, 1, 1] == pytest.approx(direct.products[:, 1, 1])
    assert not np.allclose(told.products[:, 0, 0], direct.products[:, 0, 0])


def test_what_is_fitted_together_has_the_products_that_all_have(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where changes from run to run are whitened away, and where a column is so large that it is lost."""
    monkeypatch.setattr("fdbench.diagnosis.evidence.segment_products.HUGE", 2e4)
    own = search()
    here = start(NOMINAL)
    gain = [item.name == "velocity_gain_N_s_per_m" for item in nominal_parameters(NOMINAL)]
    lost = here.moved(1e4 * np.array(gain, dtype=np.float64))
    moved = Tangent.at(here).moved
    every = [*moved, lost, moved[0], lost]
    directions = np.linalg.qr(np.random.default_rng(3).standard_normal((own.split.runs[0].n_samples, 2)))[0].T
    change = Change(
        directions=np.stack([directions] * len(own.split.runs[0].channels), 1), shrinkage=np.array([0.9, 0.5])
    )
    for changes in ([], [change, *[None] * (len(own.split.runs) - 1)]):
        split = dataclasses.replace(own.split, changes=changes)
        whole = gather(own.readings, split, here, every)
        part = gather(own.readings, split, here, every, common=3, neighbours=2)
        assert part.products.shape[1:] == (3, 1 + len(every))
        assert not whole.diagonal[:, -3].any()
        assert whole.diagonal[:, -2].all()
        assert part.products == pytest.approx(whole.products[:, :3], rel=1e-9, abs=1e-6)
        assert part.diagonal == pytest.approx(whole.diagonal, rel=1e-9, abs=1e-6)
        assert part.squared_gaps() == pytest.approx(whole.squared_gaps(), rel=1e-9, abs=1e-6)
        for found, expected in zip(part.sums, whole.sums, strict=True):
            place = np.arange(len(found))
            together = np.abs(place[:, None] - place) < 2
            together[:3] = together[:, :3] = True
            assert found[together] == pytest.approx(expected[together], rel=1e-9, abs=1e-6)
            assert not found[~together].any()


def test_what_diverges_explains_nothing() -> None:
    """Counted as its base it would win by its lower penalty."""
    own = search(effects.get("quadratic_drag").typical())
    runaway = effects.get("structural_mode").typical(moving_mass_kg=60.0, natural_frequency_Hz=2000.0)
    places = {item.name: place for place, item in enumerate(nominal_parameters(NOMINAL))}
    shifts = [4.0 * float(place == places["motor_viscous"]) for place in range(len(places))]
    base, lost = start(NOMINAL).moved(shifts), start(NOMINAL).with_effect(runaway)
    assert not np.isfinite(own.readings.alone(0, lost)["position_m"]).all()
    with np.errstate(over="ignore", invalid="ignore"):
        assert own.refinement.better(base, [lost, base]) is base
        stage = own.compared(base, [(type(runaway), lost, True)])
    assert stage.gain(stage.rivals[0]) < 0.0
    assert stage.present() < 1e-6
