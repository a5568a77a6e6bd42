"""What the text of a diagnosis says agrees with itself: shares have a whole, and what they are of is said."""

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest
from conftest import REPOSITORY

from fdbench.diagnosis.answer.answer import Answer, read_answer
from fdbench.diagnosis.answer.cause import VALUE, Cause, ForceBalances, RivalReduction, Suspect
from fdbench.diagnosis.answer.gap import NoiseBand, NoiseFloor
from fdbench.diagnosis.answer.process_force import Course, ProcessForce
from fdbench.diagnosis.answer.quantity import Quantity
from fdbench.diagnosis.answer.recorded import Recorded
from fdbench.diagnosis.answer.shrinkage import Step
from fdbench.report._sections import cause_tables, sections
from fdbench.report.diagnosis_text import summary
from fdbench.report.verdict_text import verdict
from fdbench.trials.contradictions import contradictions_in_words

CAUSE = Cause(effect="cogging", probability=0.9, share=0.6, unique_share=0.6, parameters={})
FORCE = Quantity(value=39.9, ci95=None, unit="N")
OFFSET = replace(CAUSE, effect="constant_force", kind=VALUE, share=0.99, parameters={"change": FORCE})
FRICTION = replace(OFFSET, effect="coulomb_friction", share=0.7)


def answer(causes: Sequence[Cause] = (CAUSE,), after: float = 40.0, **changes: Any) -> Answer:
    """Return an answer of a gap of 400 floors that re-calibration takes to 100 and the effects to ``after``."""
    written = read_answer(REPOSITORY / "tests" / "golden" / "answer_before_kinds.json")
    reduction = 1.0 - after / 100.0
    step = Step(
        added="cogging", before=100.0, after=after, reduction=reduction, ci95=(reduction - 0.1, reduction + 0.1)
    )
    shrunk = replace(written.shrinkage, judged_on="held-out", on_paper=400.0, steps=(step,), total=reduction)
    plain = {
        **{"causes": tuple(causes), "suspects": (), "rest_depends_on": (), "warnings": (), "next_experiment": None},
        **{"nearest": None, "shrinkage": shrunk, "unknown_probability": 0.2, "no_gap_probability": 0.0},
    }
    return replace(written, **(plain | changes))


def said(found: Answer) -> str:
    return " ".join(summary(found).split())


def told(found: Answer) -> str:
    return " ".join(verdict(found))


@pytest.mark.parametrize("unknown", [0.2, 0.8])
def test_effects_that_make_the_gap_larger_explain_none_of_it(unknown: float) -> None:
    worse = answer(after=112.0, unknown_probability=unknown)
    assert worse.unexplained() == pytest.approx(0.99)
    assert "the effects make the mean squared gap after re-calibration 12 % larger in all on the records held" in told(
        worse
    )
    assert "neither explained nor noise" not in said(worse)
    name, channel = next(iter(worse.gap.channels.items()))
    fits, not_that = (replace(channel, recalibrated=2.0, repaired=size) for size in (1.0, 3.0))
    in_part = replace(worse, gap=replace(worse.gap, channels={name: fits, "motor_minus_table_position_m": not_that}))
    assert "records held out, as they do not fit motor minus table position" in told(in_part)
    assert answer(after=40.0).unexplained() == pytest.approx(0.39)
    assert "39 % of the mean squared gap after re-calibration is neither explained nor noise" in told(answer())


def test_what_was_seen_in_the_readings_is_explained() -> None:
    """The total counts the effects alone, the last step what is left of all."""
    own = answer()
    assert replace(own, shrinkage=replace(own.shrinkage, total=0.0)).unexplained() == pytest.approx(0.39)


def test_more_than_all_of_a_misfit_is_all() -> None:
    rival = RivalReduction(effect="backlash", reduction=0.79, reduction_of_named=1.1)
    assert "backlash would remove 79 % instead of all of the held-out misfit" in said(
        answer([replace(CAUSE, instead=rival)])
    )
    balances = ForceBalances(reduction=-0.1, instead=replace(rival, reduction=1.2))
    assert "(it removes all of their squares) rather than for cogging (0 %)" in said(
        answer([replace(CAUSE, force_balances=balances)])
    )
    nearest = RivalReduction(effect="backlash", reduction=1.3)
    assert "backlash, would remove all of it" in told(answer([], nearest=nearest, unknown_probability=0.9))


def test_too_is_said_beside_what_was_named_alone() -> None:
    suspect = Suspect(effect="backlash", probability=0.3)
    hidden = answer([replace(CAUSE, probability=0.05)], unknown_probability=0.9, suspects=(suspect,))
    text = told(hidden)
    assert "Perhaps backlash, probability 0.30: too little" in text
    assert "None of the known effects explains the gap (probability 0.90). Fitted, but improbable: cogging." in text
    assert "Something else" not in text
    named = told(replace(hidden, causes=(CAUSE,)))
    assert "Perhaps backlash too, probability 0.30" in named
    assert "Something else is missing too" in named


def test_what_is_in_doubt_is_said_as_such() -> None:
    undecided = told(answer([], unknown_probability=0.2, no_gap_probability=0.37))
    assert (
        "Undecided: no effect is missing (probability 0.37), or one that is not known (probability 0.20)." in undecided
    )
    assert "None of the known effects" not in undecided
    noise_is_left = replace(answer([CAUSE]).shrinkage.steps[-1], after=0.9)
    alone = answer([CAUSE], unknown_probability=0.75)
    text = told(replace(alone, shrinkage=replace(alone.shrinkage, steps=(noise_is_left,))))
    assert "Something else may be missing, too (probability 0.75), though no more than noise is left" in text
    assert "neither explained nor noise" not in text


def test_what_was_fitted_to_noise_is_not_called_little() -> None:
    text = said(answer([replace(FRICTION, probability=0.05)], no_gap_probability=0.9))
    assert "No cause is named: what was fitted, coulomb_friction, is less probable than that." in text
    assert list(contradictions_in_words(text)) == []


def test_no_gap_says_which_values_moved_far_for_it() -> None:
    """A dead time may hide behind the filter of a velocity, which has no name as a cause."""
    own = answer([], no_gap_probability=0.9)
    none = replace(own.shrinkage, recalibrated=0.4, left=0.4, steps=())
    moved = {"velocity_filter": 4.2, "motor_mass": 0.3}
    own = replace(
        own, shrinkage=none, parametric=replace(own.parametric, moved_in_standard_deviations=moved, values={})
    )
    hidden = ", unless what moved far stands in for one: velocity_filter by +4.2 standard deviations."
    assert f"no effect is missing{hidden}" in told(own)
    wrong = replace(own, causes=(replace(FRICTION, probability=0.9),))
    assert "no effect is missing." in told(wrong)
    steady = replace(own, parametric=replace(own.parametric, moved_in_standard_deviations={"velocity_filter": 2.0}))
    assert "no effect is missing." in told(steady)


def test_what_scales_every_value_is_told_beside_the_values_that_it_is_taken_for() -> None:
    own = answer([replace(CAUSE, effect="motor_constant", share=0.01)])
    values = {"inertia_mismatch": Quantity(value=3.6, ci95=None, unit="kg")}
    text = told(replace(own, parametric=replace(own.parametric, values=values)))
    assert "re-calibration alone takes it for another size of inertia_mismatch by +3.6 kg, beyond which it" in text


@pytest.mark.parametrize(("force_N", "is_one"), [(426.0, True), (-426.0, True), (300.0, False)])
def test_a_mass_and_its_weight_are_one_payload(force_N: float, is_one: bool) -> None:
    changes = {"inertia_mismatch": (44.0, "kg"), "constant_force": (force_N, "N")}
    causes = [
        replace(FRICTION, effect=name, parameters={"change": Quantity(value=value, ci95=None, unit=unit)})
        for name, (value, unit) in changes.items()
    ]
    assert ("A mass of +44 kg weighs 431 N: on a vertical axis both are one payload." in told(answer(causes))) is is_one


def test_nominal_parameters_stand_apart_with_what_their_share_is_of() -> None:
    found = answer([FRICTION, CAUSE])
    lines = summary(found).splitlines()
    causes, nominal = (
        next(place for place, line in enumerate(lines) if line.startswith(heading))
        for heading in (
            "Causes (share of the mean squared gap after",
            "Nominal parameters (share of the mean squared nom",
        )
    )
    assert lines[causes + 1].startswith("  cogging: probability 0.90, share 60 %, of which")
    assert lines[nominal + 1] == "  coulomb_friction: probability 0.90, share 70 %"
    assert lines[nominal + 2].strip() == "change 39.9 N"
    assert not any(line.startswith("Nominal parameters") for line in summary(answer()).splitlines())
    page = " ".join(map(str, cause_tables(found)))
    tables = [re.sub(r"<[^>]+>|\s+", " ", part) for part in page.split("<table")[2:]]
    assert "share after re-calibration" in tables[0]
    assert "60 %" in tables[0]
    assert "70 %" not in tables[0]
    assert "share of the nominal gap" in tables[1]
    assert "70 %" in tables[1]


def test_each_share_in_the_verdict_says_of_what_it_is() -> None:
    text = told(answer([FRICTION, CAUSE]))
    assert "its correction removes 70 % of the mean squared nominal gap." in text
    assert "it explains 60 % of the mean squared gap after re-calibration." in text
    assert "Not all: 39 % of the mean squared gap after re-calibration" in text


def test_a_constant_force_is_no_size_that_is_wrong() -> None:
    assert "A constant force of 39.9 N acts beyond what the model has, probability 0.90; its" in told(answer([OFFSET]))
    perhaps = told(answer([replace(OFFSET, probability=0.3)]))
    assert "Perhaps a constant force of 39.9 N acts beyond what the model has, probability 0.30" in perhaps
    assert "Nominal parameter wrong: size of coulomb_friction" in told(answer([FRICTION]))


def force(beside: str, largest_N: float) -> ProcessForce:
    return ProcessForce(
        record="cut.csv",
        beside=beside,
        rms_N=178.0,
        mean_N=0.0,
        largest_N=largest_N,
        standard_deviation_N=0.5,
        range_s=(12.5, 21.7),
        frequency_Hz=1.0,
        amplitude_N=227.0,
        course=Course(time_s=(0.0, 1.0), force_N=(0.0, 1.0)),
    )


def test_what_may_be_in_place_of_a_value_is_said_beside_it() -> None:
    doubted = replace(FRICTION, probability=0.52, alternatives={"lugre_friction": 0.46, "stribeck_friction": 0.001})
    words = "Or it is lugre_friction, probability 0.46, and the value as on paper."
    assert words in told(answer([doubted]))
    assert "stribeck_friction" not in told(answer([doubted]))
    assert "as on paper" not in told(answer([FRICTION]))


def test_a_force_is_said_once_with_what_its_line_is() -> None:
    twice = answer(process_forces=(force("repeats", -178.0), force("nominal", 187.0)))
    text = said(twice)
    assert text.count("a force acts that") == 1
    assert "does not repeat with the motion" not in text
    assert "from 12.5 to 21.7 s 178 N rms, 0 N on average, -178 N at most" in text
    assert "its strongest line a sine of 227 N amplitude (161 N rms) at 1 Hz" in text
    (shown,) = [section for section in sections(twice) if section.title == "Process forces"]
    assert len(shown.blocks) == 2
    assert "does not repeat with the motion" in said(answer(process_forces=(force("nominal", 187.0),)))


def test_what_moved_is_told_beside_what_is_named() -> None:
    moved = {"moved_in_standard_deviations": {"motor_mass": 10.6}, "moved_beside_effects": {"motor_mass": 0.8}}
    own = answer()
    own = replace(own, parametric=replace(own.parametric, **moved))
    assert "Re-calibration moved" not in said(own)
    doubted = replace(own, causes=(replace(CAUSE, probability=0.3),))
    assert "Re-calibration moved motor_mass by +10.6 standard deviations" in said(doubted)


def test_neither_noise_nor_a_cause_is_a_machine_that_changes() -> None:
    other = "Else the machine changes from one motion to another"
    assert other in told(answer([], unknown_probability=0.03, no_gap_probability=0.2))
    assert other not in told(answer([], unknown_probability=0.2, no_gap_probability=0.37))


def test_half_a_chance_names_nothing() -> None:
    assert "Perhaps cogging, probability 0.50" in told(answer([replace(CAUSE, probability=0.5)]))


@pytest.mark.parametrize(("slow_N", "is_told"), [(12.5, True), (4.0, False)])
def test_slow_noise_within_the_runs_is_said_to_be_something_that_acts(slow_N: float, is_told: bool) -> None:
    bands = (NoiseBand(band_Hz=(0.0, 5.0), value=slow_N), NoiseBand(band_Hz=(5.0, 15.0), value=5.0))
    floor = NoiseFloor(
        value=15.0, unit="N", measured_from_repeats=True, within_a_run=14.2, from_run_to_run=4.9, frequency=bands
    )
    text = said(answer(noise_floor={**answer().noise_floor, "motor_force_N": floor}))
    assert ("repeats of motor_force_N differ by is slower than 5 Hz" in text) is is_told


def test_beside_a_baseline_far_changes_have_their_units() -> None:
    own = answer(recorded=Recorded(records=2, samples=100, sampling_time_s=1e-3, baseline=2))
    moved = {"motor_mass": 946.8, "motor_viscous": 30.0, "force_offset": -25.0, "table_mass": 4.0}
    changes = {
        "motor_mass": Quantity(value=0.0123, ci95=None, unit="kg"),
        "force_offset": Quantity(value=-0.07, ci95=None, unit=""),
    }
    own = replace(own, parametric=replace(own.parametric, moved_in_standard_deviations=moved, changes=changes))
    text = said(own)
    assert "motor_mass by +0.0123 kg, motor_viscous by more than 20 standard deviations, force_offset by -7 %" in text
    assert "Re-calibration moved table_mass by +4.0 standard deviations from one day to another" in text
    assert "946.8" not in text
    assert "motor_mass by +946.8" in said(replace(own, recorded=None))


def test_beside_a_baseline_sizes_that_changed_are_told_where_no_cause_is() -> None:
    own = answer([], recorded=Recorded(records=2, samples=100, sampling_time_s=1e-3, baseline=2))
    values = {"coulomb_friction": Quantity(value=133.0, ci95=None, unit="N")}
    own = replace(own, parametric=replace(own.parametric, values=values, closed_by_recalibration=0.82))
    words = (
        "Most of what has changed is a size: coulomb_friction by +133 N. Re-calibration alone closes 82 % of the gap."
    )
    assert words in told(own)
    assert "has changed is a size" not in told(replace(own, recorded=None))
    assert "has changed is a size" not in told(replace(own, causes=(CAUSE,)))
    less = replace(own, parametric=replace(own.parametric, closed_by_recalibration=0.3))
    assert "has changed is a size" not in told(less)


def test_beside_a_baseline_a_value_has_changed_and_was_not_wrong() -> None:
    since = Recorded(records=2, samples=100, sampling_time_s=1e-3, baseline=2)
    text = told(answer([FRICTION], recorded=since))
    assert "Changed since the baseline: size of coulomb_friction" in text
    assert "Nominal parameter wrong" not in text


def test_warnings_of_several_records_in_the_same_words_stand_once() -> None:
    text = said(answer(warnings=("a.csv: late by 1.2 ms.", "b.csv: late by 3 ms.", "c.csv: stands still.")))
    assert "a.csv: late by 1.2 ms. The same of 1 other record. c.csv: stands still." in text
    assert "b.csv" not in text


def test_a_small_force_is_said_to_be_small() -> None:
    recorded = Recorded(records=2, samples=100, sampling_time_s=1e-3, force=Quantity(value=90.0, ci95=None, unit="N"))

    def of(force_N: float) -> str:
        own = Quantity(value=force_N, ci95=None, unit="N")
        return told(answer([replace(CAUSE, parameters={"cogging_force_N": own})], recorded=recorded))

    assert "It is small, 0.5 N beside 90 N of the motor" in of(0.5)
    assert "small" not in of(5.0)


def test_a_wrong_value_is_told_with_its_size() -> None:
    assert "wrong: size of coulomb_friction, off by +39.9 N, probability 0.90" in told(answer([FRICTION]))


def test_what_removes_nothing_is_not_called_near() -> None:
    none = answer([], unknown_probability=0.9, nearest=RivalReduction(effect="cogging", reduction=0.001))
    assert "None of them would remove any of it." in told(none)
    assert "cogging" not in told(none)
