"""Candidates: what may be added to a hypothesis, at which points, and what a linear fit makes of it."""

import dataclasses
import math

import pytest
from axis_lab import drive

from fdbench.diagnosis.model.candidates import QUARTER_TURN, Candidate, candidates, middle_shapes, with_other_numbers
from fdbench.diagnosis.model.hypothesis import adjustables, at_bound, start
from fdbench.diagnosis.model.nominal import Covered, Nominal, Simulation
from fdbench.effects import effects

BASE = start(Nominal(plant=drive(), simulation=Simulation(substeps=10)))


def test_two_phases_become_one_amplitude_and_phase() -> None:
    """3 cos + 4 sin is 5 at the angle of atan(4/3), about the phase that was tried."""
    kind = effects.get("cogging")
    effect = kind.typical(cogging_force_N=2.0, phase_rad=0.1)
    pair = Candidate(members=(effect, effect.changed(phase_rad=0.1 + QUARTER_TURN)))
    (found,) = (pair.scaled([0.3, 0.4]) or pair).members
    values = dict(zip((item.name for item in kind.parameters()), found.values(), strict=True))
    assert values["cogging_force_N"] == pytest.approx(0.5 * 2.0)
    assert values["phase_rad"] == pytest.approx(0.1 + math.atan2(0.4, 0.3))


def test_sizes_beyond_the_bounds_are_refused_or_cut() -> None:
    gap = effects.get("backlash").typical(gap_m=1e-5)
    assert Candidate(members=(gap,)).scaled([-1.0]) is None
    largest = Candidate(members=(gap,)).scaled([100.0])
    assert largest is not None
    assert largest.members[0].values()[0] == pytest.approx(4e-5)


def test_a_replacement_is_whole_or_none() -> None:
    (index,) = [place for place, item in enumerate(BASE.nominal.drive.effects) if item.name == "coulomb_friction"]
    every = [item for item in candidates(BASE) if item.replaces == index]
    assert {item.name for item in every} >= {"lugre_friction"}
    assert every[0].scaled([0.9]) is every[0]
    assert every[0].scaled([3.5]) is None


def test_what_is_there_or_a_nominal_parameter_is_no_candidate() -> None:
    names = {item.name for item in candidates(BASE)}
    assert "backlash" in names
    assert not names & {"coulomb_friction", "viscous_friction", "inertia_mismatch", "constant_force"}
    with_gap = BASE.with_effect(effects.get("backlash").typical())
    assert "backlash" not in {item.name for item in candidates(with_gap)}
    assert "encoder_quantisation" in names


def test_periods_are_tried_where_they_were_located() -> None:
    found = [item for item in candidates(BASE, {"pitch": [3e-3, 7e-3]}) if item.name == "cogging"]
    assert [dict(zip((p.name for p in item.kind.parameters()), item.members[0].values(), strict=True))["pitch_m"]
            for item in found] == [3e-3, 7e-3]  # fmt: skip
    assert [len(item.members) for item in found] == [2, 2]
    assert "cogging" not in {item.name for item in candidates(BASE, {})}


def test_a_further_order_of_a_known_cogging_is_a_candidate_and_the_known_one_is_not() -> None:
    known = effects.get("cogging").typical(pitch_m=7e-3)
    plant = dataclasses.replace(drive(), effects=(*drive().effects, known))
    base = start(Nominal(plant=plant, simulation=Simulation(substeps=10)))
    found = [item for item in candidates(base, {"pitch": [3e-3, 7.05e-3]}) if item.name == "cogging"]
    (effect,) = (item.members[0] for item in found)
    assert (
        dict(zip((item.name for item in found[0].kind.parameters()), effect.values(), strict=True))["pitch_m"] == 3e-3
    )
    with_both = base.with_effect(effect)
    assert "cogging" not in {item.name for item in candidates(with_both, {"pitch": [5e-3]})}


@pytest.mark.parametrize(("fastest_m_per_s", "expected"), [(0.3, 3), (3.0, 6), (0.03, 6)])
def test_speeds_of_a_fast_axis_are_also_tried_as_shares_of_its_fastest(fastest_m_per_s: float, expected: int) -> None:
    base = start(BASE.nominal.beside(Covered(fastest_m_per_s=fastest_m_per_s)))
    speeds = [
        dict(zip((own.name for own in item.kind.parameters()), item.members[0].values(), strict=True))[
            "stribeck_velocity_m_per_s"
        ]
        for item in candidates(base)
        if item.kind.declared is effects.get("stribeck_friction")
    ]
    assert len(speeds) == expected
    assert max(speeds) == pytest.approx(1e-2 * max(1.0, fastest_m_per_s / 0.3))


def test_one_shape_of_each_class() -> None:
    every = candidates(BASE)
    middle = middle_shapes(every)
    assert [item.kind for item in middle] == list(dict.fromkeys(item.kind for item in every))


def test_phases_of_what_is_not_proportional_to_its_size_are_candidates_of_their_own() -> None:
    located = {"line_of_motion": [47.0]}
    own = [item for item in candidates(BASE, located) if item.name == "runout_force"]
    assert [len(item.members) for item in own] == [1] * 8
    assert len({vars(item.members[0])["angle_rad"] for item in own}) == 8


def test_another_number_of_teeth_has_the_same_spindle_or_the_same_line() -> None:
    """Two teeth at 15 Hz have the line of three at 10 Hz; each is tried at eight angles."""
    milling = effects.get("tooth_passing_force").typical(teeth=2.0, spindle_frequency_Hz=15.0)
    found = with_other_numbers(milling)
    assert [{vars(item)["teeth"] for item in own} for own in found] == [{1.0}, {3.0}, {4.0}]
    assert [len(own) for own in found] == [16] * 3
    frequencies = [{round(vars(item)["spindle_frequency_Hz"], 9) for item in own} for own in found]
    assert frequencies == [{15.0, 30.0}, {15.0, 10.0}, {15.0, 7.5}]
    assert with_other_numbers(effects.get("cogging").typical()) == []


def test_no_fit_moves_a_mode_beyond_what_samples_show() -> None:
    mode = effects.get("structural_mode").typical()
    (free,) = [item for item in adjustables(mode) if item.name == "natural_frequency_Hz"]
    covered = Covered(fastest_m_per_s=0.1, longest_s=5.0, period_s=5e-3)
    (seen,) = [item for item in adjustables(mode, covered) if item.name == "natural_frequency_Hz"]
    assert free.high > 400.0
    assert seen.high == pytest.approx(0.8 * 100.0)
    assert (covered.most("s"), covered.most("m"), Covered().most("Hz")) == (5.0, math.inf, math.inf)


def test_a_period_of_nothing_is_at_no_bound() -> None:
    """A lead that is too long all along, with next to nothing periodic, whatever the period of that is."""
    lead = effects.get("lead_error")
    assert at_bound(lead.typical(period_m=1.0)) == ["period_m"]
    assert at_bound(lead.typical(period_m=1.0, periodic_error_m=1e-12)) == []


def test_all_of_a_share_is_no_bound() -> None:
    drift = effects.get("friction_drift")
    assert at_bound(drift.typical(warm_up_time_s=0.1, share_of_motion=1.0)) == ["warm_up_time_s"]
