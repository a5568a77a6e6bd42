"""What no data sheet says of a known friction is calibrated, and its size is one number whatever it is made of."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import axis_lab
import numpy as np
import pytest
from scipy.optimize import least_squares

from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.model.axis_parameters import Viscous
from fdbench.diagnosis.model.candidates import candidates
from fdbench.diagnosis.model.friction_parameters import (
    BristleForm,
    BristleStiffness,
    KnownAmplitude,
    KnownFurtherAmplitude,
)
from fdbench.diagnosis.model.hypothesis import Hypothesis, is_corner, is_hollow, penalty, start
from fdbench.diagnosis.model.known_effects import WIDTH, resized
from fdbench.diagnosis.model.nominal import Covered, Nominal, Simulation, Uncertainty
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.model.parameter_vector import adjustables_of, parameter_vector, with_parameters
from fdbench.diagnosis.settings import MODEL
from fdbench.effects import effects
from fdbench.plants.feed_drive import RotaryMotor
from fdbench.record import FloatArray

LUGRE = effects.get("lugre_friction")


def nominal(**uncertainty: float) -> Nominal:
    """Return an axis that knows LuGre friction."""
    known = LUGRE.typical(coulomb_force_N=100.0, static_force_N=130.0)
    drive = dataclasses.replace(axis_lab.drive(), effects=(known,))
    return Nominal(plant=drive, simulation=Simulation(substeps=10), uncertainty=Uncertainty(**uncertainty))


def test_all_amplitudes_of_a_known_effect_have_one_size() -> None:
    known: Any = resized(nominal().drive, 0, 1.5).effects[0]
    assert (known.coulomb_force_N, known.static_force_N) == (150.0, 195.0)


def test_what_a_known_effect_has_in_another_unit_is_in_doubt_apart() -> None:
    cable = effects.get("cable_stiffness").typical(stiffening_N_per_m2=0.0)
    model = Nominal(
        plant=dataclasses.replace(axis_lab.drive(), effects=(cable,)),
        simulation=Simulation(substeps=10),
        uncertainty=Uncertainty(known_effects=0.2),
    )
    scale = nominal_parameters(model)
    (spring,) = [item for item in scale if isinstance(item, KnownAmplitude)]
    (rub,) = [item for item in scale if isinstance(item, KnownFurtherAmplitude)]
    assert (spring.unit_on(model.drive), rub.unit_on(model.drive)) == ("N/m", "N")
    (moved,) = rub.apply(model.drive, 1.0)[0].effects
    assert moved == cable.changed(dahl_force_N=1.2 * cable.dahl_force_N)
    (least,) = rub.apply(model.drive, -9.0)[0].effects
    assert least.dahl_force_N == 0.0
    assert rub.cause(model) == ""
    assert not any(isinstance(item, KnownFurtherAmplitude) for item in nominal_parameters(nominal())), "both in newtons"


def test_masses_that_move_against_one_another_have_no_name() -> None:
    model = nominal()
    names = [item.name for item in nominal_parameters(model)]

    def moved(motor: float, table: float) -> Hypothesis:
        return start(model).moved([{"motor_mass": motor, "table_mass": table}.get(name, 0.0) for name in names])

    assert moved(-4.0, 8.0).contradiction == pytest.approx(penalty(4.0) - penalty(MODEL.changed))
    assert moved(-4.0, 8.0).far_fetched == pytest.approx(
        penalty(8.0) - penalty(MODEL.far_fetched) + penalty(4.0) - penalty(MODEL.changed)
    )
    assert moved(4.0, 8.0).contradiction == moved(-1.5, 8.0).contradiction == moved(-4.0, 4.0).contradiction == 0.0


def test_the_stiffness_of_bristles_is_in_doubt_by_its_logarithm() -> None:
    model = nominal(bristle_stiffness=0.5)
    (found,) = [item for item in nominal_parameters(model) if isinstance(item, BristleStiffness)]
    (before,), (after,) = model.drive.effects, found.apply(model.drive, 2.0)[0].effects
    stiffness = "bristle_stiffness_N_per_m"
    assert getattr(after, stiffness) == pytest.approx(getattr(before, stiffness) * math.e)
    assert after.changed(**{stiffness: getattr(before, stiffness)}) == before
    assert not any(isinstance(item, BristleStiffness) for item in nominal_parameters(nominal(bristle_stiffness=0.0)))


def test_bristles_that_bend_twice_as_far_are_no_cause() -> None:
    model = nominal()
    (known,) = model.drive.effects
    stiffness: Any = "bristle_stiffness_N_per_m"
    built = dataclasses.replace(model.drive, effects=(known.changed(**{stiffness: 0.5 * getattr(known, stiffness)}),))
    found = diagnose(model, *axis_lab.repeated(built))
    assert not [cause.effect for cause in found.answer.causes if cause.probability > 0.5]
    (own,) = [item for item in nominal_parameters(found.calibrated.nominal) if isinstance(item, BristleStiffness)]
    shift = found.calibrated.shifts[nominal_parameters(found.calibrated.nominal).index(own)]
    assert math.exp(shift * own.deviation) == pytest.approx(0.5, rel=0.2)


def test_a_fit_finds_no_less_friction_at_rest_than_while_sliding() -> None:
    effect: Any = LUGRE.typical(coulomb_force_N=100.0, static_force_N=130.0)
    assert (effect.within(static_force_N=20.0).static_force_N, effect.static_force_N) == (100.0, 130.0)
    moved: Any = effect.within(coulomb_force_N=150.0)
    assert (moved.coulomb_force_N, moved.static_force_N) == (150.0, 150.0)
    hypothesis = start(nominal()).with_effect(effect)
    numbers = [item.name for item in adjustables_of(hypothesis)]
    values = parameter_vector(hypothesis)
    values[numbers.index("static_force_N")] = -1.0
    found: Any = with_parameters(hypothesis, values).effects[0]
    assert found.static_force_N == found.coulomb_force_N == 100.0


def test_viscous_friction_that_is_not_on_paper_is_in_doubt_as_far_as_the_forces_go() -> None:
    paper = axis_lab.drive()
    assert isinstance(paper.motor, RotaryMotor)
    assert paper.table is not None
    without = dataclasses.replace(
        paper,
        motor=dataclasses.replace(paper.motor, viscous_friction_N_s_per_m=0.0),
        table=dataclasses.replace(paper.table, viscous_friction_N_s_per_m=0.0),
    )
    nominal = Nominal(plant=without, simulation=Simulation(substeps=10))
    covered = Covered(fastest_m_per_s=0.5, longest_s=5.0, force_N=100.0, period_s=1e-3)
    doubts = [item.deviation for item in Viscous.of(nominal.beside(covered))]
    assert doubts == pytest.approx([0.1 * 100.0 / 0.5 / math.sqrt(2.0)] * 2)
    assert math.hypot(*(item.deviation for item in Viscous.of(nominal))) == pytest.approx(0.1e-3 * without.mass_kg)


def test_the_first_added_friction_says_where_all_turn_their_sign_where_none_is_known() -> None:
    bare = dataclasses.replace(axis_lab.drive(), effects=())
    first: Any = effects.get("coulomb_friction").typical(**{WIDTH: 4e-3})
    second: Any = effects.get("position_dependent_friction").typical()
    for drive, moves in ((bare, True), (axis_lab.drive(), False)):
        hypothesis = start(Nominal(plant=drive, simulation=Simulation(substeps=10))).with_effect(first)
        assert (WIDTH in [item.name for item in adjustables_of(hypothesis)]) is moves
        both = hypothesis.with_effect(second)
        assert [item.name for item in adjustables_of(both)].count(WIDTH) == int(moves)
        values = parameter_vector(both)
        assert with_parameters(both, values) == both
        assert {getattr(item, WIDTH) for item in both.variant.extra} == ({4e-3} if moves else {1e-3})


def test_the_step_of_a_known_grid_is_as_on_paper() -> None:
    grid: Any = effects.get("encoder_quantisation").typical()
    wave: Any = effects.get("encoder_interpolation_error").typical()
    model = axis_lab.drive()
    known = dataclasses.replace(model, effects=(*model.effects, grid, wave))
    moved = [item.name for item in KnownAmplitude.of(Nominal(plant=known, simulation=Simulation(substeps=10)))]
    assert "known_encoder_interpolation_error" in moved
    assert "known_encoder_quantisation" not in moved


def test_an_added_friction_turns_its_sign_as_the_known_one_does() -> None:
    """They share a contact: calibrated, both are wider, and what is written says so."""
    model = Nominal(plant=axis_lab.drive(), simulation=Simulation(substeps=10))
    place = [item.kind for item in nominal_parameters(model)].index("width")
    shifts = [0.0] * len(nominal_parameters(model))
    shifts[place] = 1.3
    added: Any = effects.get("position_dependent_friction").typical()
    plain: Any = effects.get("cogging").typical()
    hypothesis = start(model).with_effect(added).with_effect(plain).moved(shifts)
    known: Any = hypothesis.variant.plant.effects[0]
    friction, other = hypothesis.variant.extra
    assert getattr(friction, WIDTH) == getattr(known, WIDTH) == pytest.approx(math.exp(1.3) * getattr(added, WIDTH))
    assert friction.changed(**{WIDTH: getattr(added, WIDTH)}) == added
    assert other == plain
    assert hypothesis.as_it_acts().effects == (friction, plain)
    assert hypothesis.as_it_acts().variant.extra == hypothesis.variant.extra


def test_a_friction_of_another_law_is_as_large_as_on_paper() -> None:
    """Half as strong bristles in place of a known friction cost what half of that friction costs."""
    model = Nominal(
        plant=axis_lab.drive(), simulation=Simulation(substeps=10), uncertainty=Uncertainty(known_effects=0.2)
    )
    alike: Any = LUGRE.in_place_of(model.drive.effects[0])
    assert start(model).with_effect(alike, 0).named_penalty() == 0.0
    half = alike.changed(coulomb_force_N=60.0, static_force_N=60.0)
    assert start(model).with_effect(half, 0).named_penalty() == pytest.approx(penalty(-2.5))
    place = [item.kind for item in nominal_parameters(model)].index("known_effects")
    shifts = [0.0] * len(nominal_parameters(model))
    shifts[place] = -2.5
    assert start(model).moved(shifts).named_penalty() == pytest.approx(penalty(-2.5))


def test_a_cable_that_only_rubs_is_none() -> None:
    """A part of an effect that is none without the rest stands for a cause that the library lacks."""
    cable: Any = effects.get("cable_stiffness")
    assert not is_hollow(cable.typical())
    assert not is_hollow(cable.typical(dahl_force_N=0.0))
    assert is_hollow(cable.typical(spring_stiffness_N_per_m=0.0))
    assert is_hollow(cable.typical(spring_stiffness_N_per_m=1.0, dahl_force_N=8.0))
    asymmetry: Any = effects.get("direction_dependent_friction")
    assert not is_hollow(asymmetry.typical(viscous_asymmetry_N_s_per_m=0.0))
    answer = diagnose(*axis_lab.case((cable.typical(spring_stiffness_N_per_m=0.0, dahl_force_N=40.0),), seed=1)).answer
    assert answer.unknown_probability > 0.5
    assert answer.chances().get("cable_stiffness", 0.0) < 0.1


def test_a_bump_where_friction_turns_its_sign_is_no_stribeck_friction_unless_both_fall() -> None:
    """Another law of rounding looks like one that falls within twice that speed, but is nowhere above its level."""
    stribeck: Any = effects.get("stribeck_friction")
    speeds = {WIDTH: 2e-3, "stribeck_velocity_m_per_s": 3e-3}
    assert is_corner(stribeck.typical(**speeds, stribeck_force_N=15.0), 100.0)
    assert not is_corner(stribeck.typical(**speeds, stribeck_force_N=60.0), 100.0)
    assert not is_corner(stribeck.typical(**(speeds | {WIDTH: 1e-3}), stribeck_force_N=15.0), 100.0)
    others = ("coulomb_friction", "lugre_friction", "cogging")
    assert not any(is_corner(effects.get(name).typical(), 100.0) for name in others)


@pytest.mark.parametrize(
    "law",
    [
        lambda ratio: np.clip(ratio, -1.0, 1.0),
        lambda ratio: np.arctan(0.5 * np.pi * ratio) / (0.5 * np.pi),
        lambda ratio: ratio / np.sqrt(1.0 + ratio**2),
    ],
)
def test_another_law_of_rounding_is_a_corner(law: Callable[[FloatArray], FloatArray]) -> None:
    """What is closest to it, over speeds that a record holds, is named for no cause."""
    stribeck: Any = effects.get("stribeck_friction")
    speed = np.linspace(0.0, 0.05, 400)[1:]

    def resistance(parameters: FloatArray) -> FloatArray:
        level, width, added, falling = np.exp(parameters)
        return np.asarray(np.tanh(speed / width) * (level + added * np.exp(-((speed / falling) ** 2))))

    real = 100.0 * law(speed / 1e-3)
    fit = least_squares(lambda p: resistance(p) - real, np.log((100.0, 1e-3, 20.0, 1.2e-3)))
    level, width, added, falling = np.exp(fit.x)
    found = stribeck.typical(
        stribeck_force_N=added, stribeck_velocity_m_per_s=falling, transition_velocity_m_per_s=width
    )
    assert added > 10.0
    assert is_corner(found, level)


def test_a_fit_moves_by_how_much_bristles_stick_more_than_they_slide() -> None:
    """Then the two forces are no corner to it: with the Coulomb force the static force moves either way."""
    effect = LUGRE.typical(coulomb_force_N=100.0, static_force_N=100.0)
    tried = Hypothesis(nominal=nominal(), shifts=start(nominal()).shifts, effects=(effect,))
    numbers, values = adjustables_of(tried), parameter_vector(tried)
    place = {item.name: index for index, item in enumerate(numbers)}
    coulomb, static = place["coulomb_force_N"], place["static_force_N"]
    assert (values[coulomb], values[static], numbers[static].low) == (100.0, 0.0, 0.0)
    for change, expected in ({coulomb: 7.0}, (107.0, 107.0)), ({coulomb: -7.0, static: 2.0}, (93.0, 95.0)):
        moved = values.copy()
        moved[[*change]] += [*change.values()]
        (found,) = with_parameters(tried, moved).effects
        assert (found.coulomb_force_N, found.static_force_N) == pytest.approx(expected)
    assert effect.within(coulomb_force_N=120.0).static_force_N == 120.0


def test_friction_turns_its_sign_over_next_to_nothing_within_a_few_deviations() -> None:
    """As exact Coulomb friction does; wider, and near what is on paper, a deviation is a factor of e."""
    model = Nominal(plant=axis_lab.drive(), simulation=Simulation(substeps=10))
    (own,) = [item for item in nominal_parameters(model) if item.kind == "width"]
    paper: Any = model.drive.effects[0]
    ratios = {}
    for shift in (-2.0, -1e-3, 1e-3, 1.0):
        known: Any = own.apply(model.drive, shift)[0].effects[0]
        ratios[shift] = getattr(known, WIDTH) / getattr(paper, WIDTH)
    assert ratios[1.0] == pytest.approx(math.e)
    assert ratios[1e-3] * ratios[-1e-3] == pytest.approx(1.0, abs=1e-6)
    assert ratios[-2.0] < 0.02


def test_a_measured_speed_of_turning_is_as_known_to_be_lower_as_to_be_higher() -> None:
    known = Uncertainty(transition_velocity=0.06)
    model = Nominal(plant=axis_lab.drive(), simulation=Simulation(substeps=10), uncertainty=known)
    (own,) = [item for item in nominal_parameters(model) if item.kind == "width"]
    paper: Any = model.drive.effects[0]
    low, high = (own.apply(model.drive, shift)[0].effects[0] for shift in (-4.0, 4.0))
    assert getattr(low, WIDTH) * getattr(high, WIDTH) == pytest.approx(getattr(paper, WIDTH) ** 2, rel=0.03)


def test_friction_that_bends_by_slips_is_no_cause() -> None:
    """60 % of it slips, as Maxwell's springs do, in place of bending as LuGre's bristles."""
    model = nominal()
    known: Any = model.drive.effects[0]
    slips = effects.get("presliding_curve").typical(
        soft_force_N=20.0, middle_force_N=25.0, stiff_force_N=15.0, way_m=known.bend_m
    )
    recorded = axis_lab.repeated(dataclasses.replace(model.drive, effects=(known, slips)))
    found = diagnose(model, *recorded).answer
    assert not [cause for cause in found.causes if cause.probability > 0.5]
    assert found.unknown_probability < 0.3
    rigid = dataclasses.replace(model, uncertainty=Uncertainty(bristle_form=0.0))
    assert diagnose(rigid, *recorded).answer.unknown_probability > found.unknown_probability


def test_only_a_friction_that_bends_has_another_form_of_bending() -> None:
    forms = [item for item in nominal_parameters(nominal()) if isinstance(item, BristleForm)]
    assert [item.name for item in forms] == ["bristle_soft_force_N", "bristle_middle_force_N", "bristle_stiff_force_N"]
    assert [item.size(nominal().drive) for item in forms] == [20.0, 20.0, 20.0]
    sliding = Nominal(plant=axis_lab.drive(), simulation=Simulation(substeps=10))
    assert not [item for item in nominal_parameters(sliding) if isinstance(item, BristleForm)]
    assert not [item for item in candidates(start(sliding)) if item.name == "presliding_curve"]


@pytest.mark.parametrize("bends", [False, True])
def test_a_known_friction_may_act_on_the_motor_whether_it_bends_or_not(bends: bool) -> None:
    """Whoever writes one friction of the axis does not say on which side of the screw it is."""
    model = nominal() if bends else Nominal(plant=axis_lab.drive(), simulation=Simulation(substeps=10))
    (side,) = (item for item in nominal_parameters(model) if item.name == "friction_side")
    drive, (on_motor,) = side.apply(model.drive, 0.25 / side.deviation)
    friction = model.drive.effects[0]
    amplitude = getattr(friction, friction.amplitude)
    assert getattr(drive.effects[0], friction.amplitude) == pytest.approx(0.75 * amplitude)
    assert on_motor.name == "motor_coulomb_friction"
    assert getattr(on_motor, on_motor.amplitude) == pytest.approx(0.25 * amplitude)
