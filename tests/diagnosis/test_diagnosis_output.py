"""What a diagnosis says: terminal summary, repaired model, page, JSON; and what is said of bad records."""

import json
import math
import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import REPOSITORY
from html_page import Page

from fdbench import cli
from fdbench.catalogue import scenario_folder
from fdbench.diagnosis.answer.answer import from_json
from fdbench.diagnosis.answer.cause import VALUE, Cause, ForceBalances, RivalReduction
from fdbench.diagnosis.answer.experiment import ExpectedProbability, Experiment, Separation
from fdbench.diagnosis.diagnose import Diagnosis, diagnose
from fdbench.diagnosis.judge.localise import Gaps, Partition, where
from fdbench.diagnosis.model.as_nominal import as_nominal
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import Nominal, load_nominal
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.model.replay import Replay, Variant
from fdbench.diagnosis.records.noise_model import white
from fdbench.diagnosis.records.plausibility import check_alignment, check_record, clock_warnings, delay_of
from fdbench.diagnosis.records.runs import RecordedRun, prepare
from fdbench.diagnosis.repaired import model_text, table_of, toml_lines, write_repaired
from fdbench.effects import effects
from fdbench.errors import FdbenchError, RecordError
from fdbench.reading import read_record
from fdbench.record import Record
from fdbench.report._curves import Curves
from fdbench.report.diagnosis import write_diagnosis
from fdbench.report.diagnosis_text import summary
from fdbench.report.verdict_text import verdict
from fdbench.wording import percent, quantity, scaled, si_text

MODEL = REPOSITORY / "examples" / "emps" / "model.toml"
PERIOD_S = 1e-3
ASYMMETRY_N_S_PER_M = 60.0
FORCE_NOISE_N, POSITION_NOISE_M = 1.0, 1e-6


def strokes() -> np.ndarray:
    """Return 4 s of strokes of 0.1 m and 0.06 m, at five speeds, with rests."""
    parts, place = [], 0.0
    for target, duration_s in ((0.1, 0.9), (0.04, 0.6), (0.08, 0.4), (0.02, 1.0), (0.0, 0.5)):
        s = np.arange(round(duration_s / PERIOD_S)) * PERIOD_S / duration_s
        parts += [place + (target - place) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2), np.full(120, target)]
        place = target
    return np.concatenate(parts)


def simulated(nominal: Nominal, seed: int, *extra: Any) -> Record:
    """Return a record of the strokes of a machine that has effects beyond its model."""
    position = strokes()
    velocity = np.gradient(position, PERIOD_S)
    reference = np.column_stack((position, velocity, np.gradient(velocity, PERIOD_S)))
    names = ("motor_force_N", "position_m")
    run = RecordedRun(
        name="x", period_s=PERIOD_S, reference=reference, channels=dict.fromkeys(names, position), lap=None
    )
    replay = Replay(nominal.drive, nominal.library, nominal.simulation.substeps)
    channels = replay.simulate(run, [Variant(plant=nominal.drive, extra=extra)])
    rng = np.random.default_rng(seed)
    return Record(
        {
            "time_s": np.arange(len(position)) * PERIOD_S,
            "reference_position_m": position,
            "position_m": channels["position_m"][0] + POSITION_NOISE_M * rng.standard_normal(len(position)),
            "motor_force_N": channels["motor_force_N"][0] + FORCE_NOISE_N * rng.standard_normal(len(position)),
        },
        source=f"stroke {seed}",
    )


@pytest.fixture(scope="module")
def nominal() -> Nominal:
    return load_nominal(MODEL)


@pytest.fixture(scope="module")
def clean(nominal: Nominal) -> Record:
    return simulated(nominal, 0)


@pytest.fixture(scope="module")
def found(nominal: Nominal) -> Diagnosis:
    effect = effects.get("direction_dependent_friction").typical(
        viscous_asymmetry_N_s_per_m=ASYMMETRY_N_S_PER_M, coulomb_asymmetry_N=0.0
    )
    return diagnose(nominal, [simulated(nominal, seed, effect) for seed in (1, 2)])


def answered(found: Diagnosis, **changes: Any) -> Diagnosis:
    """Return the diagnosis with another answer; no causes means no effects and no steps."""
    answer = replace(found.answer, **changes)
    if not answer.causes:
        shrunk = replace(answer.shrinkage, steps=(), total=0.0, ci95=(0.0, 0.0))
        return replace(found, answer=replace(answer, shrinkage=shrunk), final=found.calibrated)
    return replace(found, answer=answer)


# ---- the answer ----


def test_answer_keeps_the_contract(found: Diagnosis) -> None:
    answer = json.loads(json.dumps(found.answer.as_json(), allow_nan=False))
    assert from_json(answer) == found.answer
    assert answer.keys() >= {
        *("gap", "where", "causes", "unknown_probability", "no_gap_probability", "shrinkage", "next_experiment"),
        "warnings",
    }
    for channel in answer["gap"]["channels"].values():
        assert channel.keys() >= {"before", "noise_floor", "unit", "relative"}
    assert answer["where"].keys() >= {"motion", "frequency", "position", "velocity", "time", "channel"}
    intervals = answer["where"].pop("ci95")
    for name, cells in answer["where"].items():
        shares = list(cells.values()) if isinstance(cells, dict) else [cell["share"] for cell in cells]
        bounds = list(intervals[name].values()) if name in intervals else [cell["ci95"] for cell in cells]
        assert sum(shares) == pytest.approx(1.0, abs=1e-9)
        assert all(0.0 <= low <= high <= 1.0 for low, high in bounds)
        assert len(bounds) == len(shares)
        assert name not in intervals or list(intervals[name]) == list(cells)
    assert all({"band_Hz", "share"} <= cell.keys() for cell in answer["where"]["frequency"])
    for cause in answer["causes"]:
        assert cause.keys() >= {"effect", "probability", "share", "unique_share", "parameters"}
        assert isinstance(cause["indistinguishable_from"], list)
        for value in cause["parameters"].values():
            assert value.keys() >= {"value", "ci95", "unit"}
    assert sum(cause["share"] for cause in answer["causes"]) <= 1.0
    assert answer["shrinkage"].keys() >= {"judged_on", "steps", "total", "ci95", "reducible_left", "noise_floor"}
    for step in answer["shrinkage"]["steps"]:
        assert step.keys() >= {"added", "before", "after", "reduction", "ci95"}
        low, high = step["ci95"]
        assert low <= high


# ---- where the gap lies ----


def gaps_of(left: np.ndarray, velocity: np.ndarray) -> Gaps:
    """Return what is left of one channel in units of its floor, beside a command."""
    position = np.cumsum(velocity) * PERIOD_S
    reference = np.column_stack((position, velocity, np.gradient(velocity, PERIOD_S)))
    run = RecordedRun(name="x", period_s=PERIOD_S, reference=reference, channels={"position_m": position}, lap=None)
    return Gaps(runs=[run], scaled=[{"position_m": left}], noise_models={"position_m": white(1.0, measured=True)})


def test_shares_by_hand() -> None:
    """A sine of 1 in the first half in one band and of 3 in the second half in another: 0.5 - 1 < 0, and 4.5 - 1."""
    time = np.arange(4000) * PERIOD_S
    left = np.where(time < 2.0, np.sin(2.0 * np.pi * 10.0 * time), 3.0 * np.sin(2.0 * np.pi * 100.0 * time))
    found = where(gaps_of(left, np.where(time < 2.0, 0.1, -0.1)))
    assert found.motion["cruise_negative"] == pytest.approx(1.0, abs=0.05)
    assert found.motion["cruise_positive"] == 0.0
    assert [cell.share for cell in found.time] == pytest.approx([0.0] * 4 + [0.25] * 4)
    bands = {cell.band_Hz: cell.share for cell in found.frequency}
    low, high = 0.25 - 10.0 / 500.0, 2.25 - 100.0 / 500.0  # less the part of white noise of 1
    assert bands[5.0, 15.0] == pytest.approx(low / (low + high), abs=0.01)
    assert bands[50.0, 150.0] == pytest.approx(high / (low + high), abs=0.01)
    assert sum(bands.values()) == pytest.approx(1.0)


def test_nothing_beyond_the_noise_has_no_share() -> None:
    found = where(gaps_of(np.full(4000, 0.9), np.full(4000, 0.1)))
    assert sum(found.motion.values()) == sum(cell.share for cell in found.time) == 0.0
    assert found.ci95["channel"] == {"position_m": (0.0, 0.0)}


def test_intervals_hold_the_true_share() -> None:
    """Bursts of a quarter of a second, of one or another strength at random: forwards has twice the energy."""
    held, n_trials, n_stretches = 0, 100, 80
    rng = np.random.default_rng(0)
    for _ in range(n_trials):
        forwards = rng.random(n_stretches) < 0.5
        size = np.where(forwards, 2.0, 1.0) * rng.choice([10.0, 30.0], n_stretches)
        left = np.sqrt(np.repeat(size, 250)) * rng.choice([-1.0, 1.0], 250 * n_stretches)
        place = np.repeat(np.where(forwards, 0, 1), 250)
        cell = np.arange(len(left)) // 250 * 2 + place
        parts = np.bincount(cell, weights=left**2 - 1.0, minlength=2 * n_stretches)
        low, high = Partition(np.array(parts.reshape(-1, 2), dtype=np.float64)).ci95[0]
        held += low <= (2.0 * 20.0 - 1.0) / (3.0 * 20.0 - 2.0) <= high
    assert 0.88 <= held / n_trials <= 0.99


# ---- summary ----


def test_summary_names_the_injected_effect(found: Diagnosis) -> None:
    text = summary(found.answer)
    lines = text.splitlines()
    assert 15 <= len(lines) <= 45
    assert max(len(line) for line in lines) <= 110
    assert "Cause: direction_dependent_friction" in text
    (value,) = re.findall(r"viscous asymmetry (-?[\d.]+) N s/m", text)
    assert float(value) == pytest.approx(ASYMMETRY_N_S_PER_M, rel=0.1)
    assert "(measured)" in text
    assert "assumed" not in text
    assert re.search(r"transition velocity [\d.]+ mm/s(?! \(typical\))", text)  # that of the known friction
    for word in ("motion:", "frequency:", "position:", "nominal", "re-calibration alone", "95 %:", "not noise"):
        assert word in text


def test_no_number_is_more_certain_than_its_data(found: Diagnosis) -> None:
    cause = replace(found.answer.causes[0], probability=0.9999999)
    answer = replace(found.answer, causes=(cause,))
    assert "above 0.99" in summary(replace(answer, unknown_probability=1e-9))
    assert not re.search(r"0\.99\d|1\.00|100 %", " ".join(verdict(answer)))
    assert "No intervals of the parameters" in summary(replace(answer, causes=(without_interval(cause),)))


def without_interval(cause: Cause) -> Cause:
    return replace(cause, parameters={name: replace(value, ci95=None) for name, value in cause.parameters.items()})


def small(found: Diagnosis, on_paper: float, recalibrated: float) -> dict[str, Any]:
    """Return the parts of an answer with these mean squared gaps in units of the floor."""
    return {
        "causes": (),
        "shrinkage": replace(
            found.answer.shrinkage,
            **{"on_paper": on_paper, "recalibrated": recalibrated, "left": recalibrated},
            **{"steps": (), "total": 0.0, "ci95": (0.0, 0.0)},
        ),
        "parametric": replace(found.answer.parametric, closed_by_recalibration=1.0 - recalibrated / on_paper),
    }


def test_every_honest_answer_has_its_words(found: Diagnosis) -> None:
    cause = replace(found.answer.causes[0], probability=0.9, indistinguishable_from=())
    both = replace(cause, indistinguishable_from=("constant_force", "friction_drift"))
    weak = replace(cause, probability=0.3)
    cases = [
        ({"no_gap_probability": 0.99, **small(found, 1.02, 1.01)}, "No gap beyond the noise: these records"),
        ({"no_gap_probability": 0.99, **small(found, 9.0, 1.01)}, "once the nominal parameters are re-calibrated"),
        (
            {"no_gap_probability": 0.7, **small(found, 1.22, 1.22)},
            "Too small to attribute: the mean squared gap is 1.22",
        ),
        (
            {"no_gap_probability": 0.7, **small(found, 9.0, 4.5)},
            "4.50 times the noise of the mean of its repeats, which",
        ),
        (
            {"no_gap_probability": 0.0, "unknown_probability": 0.97, **small(found, 9.0, 8.0)},
            "None of the known effects",
        ),
        (
            {"causes": (both,)},
            "Cannot be distinguished on these data: direction_dependent_friction or constant_force or",
        ),
        (
            {**small(found, 9.0, 8.0), "causes": (cause,), "unknown_probability": 0.8},
            "Something else is missing too",
        ),
        ({"causes": (cause,), "unknown_probability": 0.8}, "Something else may be missing, too"),
        ({"causes": (cause,), "unknown_probability": 0.1}, "Cause: direction_dependent_friction, probability 0.90"),
        ({"causes": (weak,), "unknown_probability": 0.1}, "Perhaps direction_dependent_friction"),
        ({"causes": (replace(cause, kind=VALUE),)}, "Nominal parameter wrong"),
        ({"warnings": ("stroke 1: the force is late.",)}, "Read the warnings under Doubts first"),
    ]
    for changes, words in cases:
        answer = answered(found, **changes).answer
        text = " ".join(verdict(answer))
        assert words in text
        assert words.split()[0] in summary(answer)
        others = [other for _, other in cases if other != words and other in text]
        assert [other for other in others if not other.startswith(("Cause", "Something"))] == []
    how = "The controller seems to act 2 times between two samples of the log."
    assumed = answered(found, warnings=(how,), assumptions=(how,)).answer
    assert "Read the warnings" not in summary(assumed)
    assert how in " ".join(summary(assumed).split())


def test_doubts_are_said(found: Diagnosis) -> None:
    answer = found.answer
    moved = {"motor_mass": 4.4, "motor_viscous": 0.1}
    first, *others = answer.shrinkage.steps
    answer = replace(
        answer,
        noise_floor={name: replace(own, measured_from_repeats=False) for name, own in answer.noise_floor.items()},
        parametric=replace(answer.parametric, moved_beside_effects=moved),
        shrinkage=replace(answer.shrinkage, steps=(replace(first, ci95=(-0.02, 0.1)), *others)),
    )
    text = " ".join(summary(answer).split())
    assert "noise floor of motor_force_N, position_m is assumed" in text
    assert "three times" in text
    assert "motor_mass by +4.4 standard deviations" in text
    assert "motor_viscous by" not in text
    assert "may be chance" in text
    assert "which was not fitted: nothing is shown for other motions" in text
    assert "(assumed)" in text
    assert "a first guess, whatever the probabilities say" in text
    assert "a first guess" not in summary(found.answer)
    held_out = replace(answer.shrinkage, judged_on="held-out")
    assert "a first guess" not in summary(replace(answer, shrinkage=held_out))


def test_a_step_of_a_sure_cause_is_no_chance_where_others_follow_it(found: Diagnosis) -> None:
    answer = found.answer
    assert answer.causes[0].probability > 0.9
    step = replace(answer.shrinkage.steps[0], added=answer.causes[0].effect, ci95=(-0.02, 0.1))
    for steps, words in (
        ((step, replace(step, added="cogging", ci95=(0.1, 0.2))), "shows beside"),
        ((step,), "chance"),
    ):
        text = " ".join(summary(replace(answer, shrinkage=replace(answer.shrinkage, steps=steps))).split())
        assert words in text


def test_friction_within_the_doubt_of_the_known_one_is_said_to_be_no_cause(found: Diagnosis) -> None:
    causes = [replace(cause, probability=0.005, within_known=True) for cause in found.answer.causes]
    assert "no cause: how the known friction turns" in summary(replace(found.answer, causes=tuple(causes)))
    assert "no cause: how" not in summary(found.answer)


def test_forces_doubt_the_controller_for_causes_that_are_named_alone(found: Diagnosis) -> None:
    first = found.answer.causes[0]
    balances = ForceBalances(reduction=0.1, instead=RivalReduction(effect="structural_mode", reduction=0.9))
    for probability, is_said in ((0.95, True), (0.01, False)):
        causes = (replace(first, probability=probability, force_balances=balances),)
        assert ("the controller may not" in " ".join(summary(replace(found.answer, causes=causes)).split())) is is_said


def test_it_is_said_how_seldom_axes_without_a_cause_are_given_one(found: Diagnosis) -> None:
    alarms = found.answer.false_alarms
    assert alarms is not None
    assert alarms.at_most == pytest.approx((1 + alarms.as_sure) / (1 + alarms.axes))
    text = " ".join(summary(replace(found.answer, false_alarms=replace(alarms, exchangeable=True))).split())
    assert f"Of {alarms.axes} simulated axes without a cause {alarms.as_sure} were given one as sure" in text
    unlike = " ".join(summary(replace(found.answer, false_alarms=replace(alarms, exchangeable=False))).split())
    assert "says nothing of this axis" in unlike
    assert "as sure as the surest" not in unlike


def test_it_is_said_what_the_cause_is_among_if_there_is_one(found: Diagnosis) -> None:
    causes = found.answer.cause_set
    assert causes is not None
    assert "direction_dependent_friction" in causes.causes
    like = replace(causes, causes=("backlash", "dead_time"), everything=False, exchangeable=True)

    def said(**changed: Any) -> str:
        return " ".join(summary(replace(found.answer, cause_set=replace(like, **changed))).split())

    assert "If one effect of the library is the cause, it is among backlash, dead_time with" in said()
    assert "is among backlash, dead_time with a probability of 90 % at least, on axes like" in said()
    assert "the cause, it is backlash with a probability of 90 % at least, on axes like" in said(causes=("backlash",))
    assert "No effect can be left out" in said(everything=True)
    assert "would be among those named or suspected" in said(causes=())
    assert "no set of causes is promised" in said(exchangeable=False)


# ---- repaired model ----


def test_repaired_model_is_read_back(found: Diagnosis, tmp_path: Path) -> None:
    path = tmp_path / "repaired.toml"
    write_repaired(found, path)
    again = load_nominal(path)
    assert again == as_nominal(found.final)
    assert [type(effect).name for effect in again.drive.effects] == [
        *("coulomb_friction", "constant_force", "direction_dependent_friction", "friction_curve", "current_loop_lag"),
    ]
    assert again.drive.mass_kg == found.final.variant.plant.mass_kg


def test_repaired_model_moves_as_the_final_hypothesis(found: Diagnosis) -> None:
    model = as_nominal(found.final)
    run = found.split.runs[0]
    alone = Replay(model.drive, (), model.simulation.substeps).simulate(run, [Variant(plant=model.drive)])
    nominal = found.final.nominal
    final = Replay(nominal.drive, nominal.library, nominal.simulation.substeps)
    expected = final.simulate(run, [found.final.variant])
    assert np.ptp(expected["motor_force_N"]) > 50.0
    for name, tolerance in (("motor_force_N", 1e-6), ("position_m", 1e-12)):
        np.testing.assert_allclose(alone[name], expected[name], rtol=0.0, atol=tolerance)


def test_sums_and_replacements(nominal: Nominal) -> None:
    paper = start(nominal)
    names = [item.name for item in nominal_parameters(nominal)]
    shifts = tuple(2.0 if name == "force_offset" else 0.0 for name in names)
    offset = as_nominal(replace(paper, shifts=shifts)).drive.effects
    forces = [effect.constant_force_N for effect in offset if type(effect).name == "constant_force"]
    deviation = math.hypot(nominal.force_offset_N, nominal.uncertainty.mass * 3.1648)
    assert forces == [pytest.approx(-3.1648 + 2.0 * deviation)]
    lugre = effects.get("lugre_friction").typical()
    replaced = as_nominal(paper.with_effect(lugre, replaces=0)).drive.effects
    assert [type(effect).name for effect in replaced] == ["constant_force", "lugre_friction"]


def test_every_model_is_written_as_it_is_read(tmp_path: Path) -> None:
    models = [load_nominal(path) for path in (MODEL, *sorted(scenario_folder().glob("*.toml")))]
    assert len(models) > 20
    for model in models:
        path = tmp_path / "model.toml"
        path.write_text("\n".join(toml_lines(table_of(model, Nominal))), encoding="utf-8")
        assert load_nominal(path) == model


def test_example_model_is_the_plant_of_the_scenario() -> None:
    example, scenario = load_nominal(MODEL), load_nominal(scenario_folder() / "EMPS-v0.toml")
    assert replace(scenario, plant=replace(scenario.drive, inverse_dynamics=None)) == example


def test_how_to_is_right(tmp_path: Path) -> None:
    text = (MODEL.parents[2] / "docs" / "how-to" / "diagnose.md").read_text("utf-8")
    mapping, model, rotary = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    (rows,) = re.findall(r"```\n(t,set.*?)```", text, re.DOTALL)
    (tmp_path / "stroke_1.csv").write_text(rows + "0.002,10.000,10.001,0.33\n")
    (tmp_path / "stroke_1.toml").write_text(mapping)
    (tmp_path / "axis.toml").write_text(model)
    record, nominal = read_record(tmp_path / "stroke_1.toml"), load_nominal(tmp_path / "axis.toml")
    assert record["position_m"][0] == pytest.approx(0.010002)
    force_N = prepare(record, nominal.drive).channels["motor_force_N"]
    assert force_N[0] == pytest.approx(0.31 * 2.0 * np.pi / 0.01)
    assert nominal.simulation.substeps == 10
    (tmp_path / "rotary.toml").write_text(rotary)
    assert load_nominal(tmp_path / "rotary.toml").drive.mass_kg == pytest.approx(0.12)


def test_unwritable_files_are_said(found: Diagnosis, tmp_path: Path) -> None:
    with pytest.raises(FdbenchError, match="cannot be written"):
        write_repaired(found, tmp_path / "nowhere" / "model.toml")


def test_a_written_model_says_how_well_it_predicts(found: Diagnosis) -> None:
    gap = found.answer.gap.channels["motor_force_N"]
    (line,) = [line for line in model_text(found).splitlines() if line.startswith("#   motor_force_N")]
    for word, error in (("nominal", gap.before), ("re-calibrated", gap.recalibrated), ("repaired", gap.repaired)):
        value, unit = re.findall(rf"{word} (\S+) (m?N)", line)[0]
        assert float(value) * (1e-3 if unit == "mN" else 1.0) == pytest.approx(error, rel=6e-3)


def test_a_model_that_predicts_worse_is_not_written(found: Diagnosis, tmp_path: Path) -> None:
    channels = {
        name: replace(gap, recalibrated=gap.noise_floor, repaired=3.0 * gap.noise_floor)
        for name, gap in found.answer.gap.channels.items()
    }
    worse = replace(found, answer=replace(found.answer, gap=replace(found.answer.gap, channels=channels)))
    path = tmp_path / "worse.toml"
    with pytest.raises(FdbenchError, match=r"not written.*predicts worse.*\(3 against 1 times the noise"):
        write_repaired(worse, path)
    assert not path.exists()
    unnamed = [replace(cause, probability=0.3) for cause in found.answer.causes]
    for alone in (
        replace(worse, final=found.calibrated),
        replace(worse, answer=replace(worse.answer, causes=unnamed)),
    ):
        path.unlink(missing_ok=True)
        write_repaired(alone, path)
        text = path.read_text("utf-8")
        assert "re-calibrated; no effect was added" in text
        assert ", repaired " not in text
        assert load_nominal(path) == as_nominal(found.calibrated)


# ---- page ----


@pytest.fixture(scope="module")
def page(found: Diagnosis, tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("page") / "diagnosis.html"
    write_diagnosis(found, path)
    return path.read_text("utf-8")


def test_page_has_every_part_and_needs_nothing_else(page: str, found: Diagnosis) -> None:
    headings = re.findall(r"<h2>(.*?)</h2>", page)
    assert headings == [
        *("direction_<wbr>dependent_<wbr>friction", "The gap", "Where the gap lies", "Causes"),
        *("How far the gap shrinks", "All curves", "Rivals", "Records, noise floor and re-calibration"),
        "Repaired model",
    ]
    assert not re.search(r'(?:src|href)="(?!#)', page)
    assert re.findall(r"default-src \S+", page) == ["default-src 'none';"]
    for sentence in verdict(found.answer):
        assert sentence in page
    assert model_text(found).splitlines()[0] in page
    assert len(page.encode()) < 2_000_000


def test_the_worst_gap_is_drawn_first(page: str, found: Diagnosis) -> None:
    """The channel with most of the gap, in the record in which it is largest, and with its extremes."""
    shares = found.answer.where.channel
    worst = max(shares, key=lambda name: shares[name])
    title, (panel,) = next(iter(Page(page).figures.items()))
    assert title.startswith(f"Gap of the {quantity(worst)[0]}, which has ")
    gaps = [run.channels[worst] - own[worst] for run, own in zip(found.split.runs, found.simulated, strict=True)]
    gap = max(gaps, key=lambda values: float(np.mean(values**2)))
    drawn = panel.curve("simulated, re-calibrated")[1]
    factor = scaled(quantity(worst)[1], np.percentile(np.abs(gap), 99.5))[0]
    shown = np.clip(factor * gap, *panel.bounds[2:4])
    np.testing.assert_allclose(
        np.clip([drawn.min(), drawn.max()], *panel.bounds[2:4]), [shown.min(), shown.max()], atol=panel.resolution
    )


def test_bars_are_the_shares_of_the_answer(page: str, found: Diagnosis) -> None:
    bars, where = Page(page).bars, found.answer.where
    longest = max(high for _, high in where.ci95["motion"].values())
    lengths = [row.bar[0] for row in bars["Phase of motion"]]
    assert lengths == pytest.approx([100.0 * share / longest for share in where.motion.values()], abs=0.01)
    assert [row.text for row in bars["Frequency"]] == [percent(cell.share) for cell in where.frequency]
    parts = bars["What the mean squared gap after re-calibration consists of"]
    assert [row.name for row in parts][:3] == ["direction_dependent_friction", "not explained", "noise"]
    gains = [max(found.stages[0].gain(rival), 0.0) for rival in found.stages[0].rivals]
    drawn = [row.bar[0] for row in bars["Share removed"]]
    assert drawn == pytest.approx([100.0 * min(gain, 1.0) for gain in gains[:8]], abs=0.01)
    assert max(gains) > 1.0  # more than all that is beyond the noise
    assert [row.text for row in bars["Share removed"]] == [percent(min(gain, 1.0)) for gain in gains[:8]]


def test_shares_have_their_intervals_drawn(page: str, found: Diagnosis) -> None:
    where, bars = found.answer.where, Page(page).bars
    for title, bounds in (
        ("Phase of motion", list(where.ci95["motion"].values())),
        ("Time", [cell.ci95 for cell in where.time]),
    ):
        longest = max(high for _, high in bounds)
        drawn = [(start, start + length) for start, length in (row.interval for row in bars[title])]
        np.testing.assert_allclose(drawn, 100.0 * np.array(bounds) / longest, atol=0.02)


def test_an_answer_without_intervals_is_drawn(found: Diagnosis, tmp_path: Path) -> None:
    older = found.answer.as_json()
    del older["where"]["ci95"]
    for cells in older["where"].values():
        for cell in cells if isinstance(cells, list) else ():
            del cell["ci95"]
    write_diagnosis(replace(found, answer=from_json(older)), tmp_path / "older.html")
    bars = Page((tmp_path / "older.html").read_text("utf-8")).bars
    assert bars["Time"]
    assert not [row for row in (*bars["Time"], *bars["Phase of motion"]) if row.interval]


def test_recalibrated_values_have_their_units(page: str, found: Diagnosis) -> None:
    """Nominal mass, and what re-calibration made of it, in kg."""
    (mass,) = [item for item in nominal_parameters(found.final.nominal) if item.name == "motor_mass"]
    drive, place = found.final.nominal.drive, nominal_parameters(found.final.nominal).index(mass)
    moved = drive.motor.mass_kg * (1.0 + mass.deviation * found.calibrated.shifts[place])
    row = re.findall(r"<td[^>]*>motor mass</td>(.*?)</tr>", page)[0]
    cells = re.findall(r"<td[^>]*>(.*?)</td>", row)
    assert cells[:2] == [si_text(drive.motor.mass_kg, "kg"), si_text(moved, "kg")]
    assert cells[3] == f"{found.calibrated.shifts[place]:+.2f} σ"


def test_next_experiment_is_on_the_page(found: Diagnosis, tmp_path: Path) -> None:
    experiment = Experiment(
        to_separate=("backlash", "dead_time"),
        trajectory="next.csv",
        file="next.csv",
        expected_log_odds=6.0,
        separates=(Separation(effects=("backlash", "dead_time"), expected_log_odds=6.0),),
        expected_probability=ExpectedProbability(now=0.5, after=0.97),
        expected_gain_per_s=0.094,
        kind="multisine",
        motion="multisine: 1 to 60 Hz, 2.03 mm rms",
        position_m=(0.05, 0.07),
        amplitude_m=0.01,
        velocity_m_per_s=0.4,
        acceleration_m_per_s2=9.0,
        duration_s=5.0,
    )
    write_diagnosis(answered(found, next_experiment=experiment), tmp_path / "next.html")
    text = (tmp_path / "next.html").read_text("utf-8")
    for words in ("to separate backlash from dead_time", "multisine: 1 to 60 Hz", "(next.csv)", "50 mm to 70 mm"):
        assert words in text
    for words in ("400 mm/s", "0.50 now, 0.97 after", "0.094"):
        assert words in text


def test_spectrum_is_that_of_the_gap(found: Diagnosis) -> None:
    """The density over all frequencies is the variance (Parseval); the segment's mean is left out."""
    channel = Curves(found).spectrum("motor_force_N")
    (curve,) = [item for item in channel.curves() if item.name == "simulated, re-calibrated"]
    density = 10.0 ** (curve.y / 10.0)
    runs, simulations = found.split.runs, found.simulated
    gaps = [run.channels["motor_force_N"] - own["motor_force_N"] for run, own in zip(runs, simulations, strict=True)]
    step_Hz = 0.5 / PERIOD_S / len(density)
    assert density.sum() * step_Hz == pytest.approx(np.mean([gap.var() for gap in gaps]), rel=0.35)


def test_page_of_nothing_found(found: Diagnosis, tmp_path: Path) -> None:
    empty = answered(found, no_gap_probability=0.99, **small(found, 1.02, 1.01))
    write_diagnosis(empty, tmp_path / "nothing.html")
    text = (tmp_path / "nothing.html").read_text("utf-8")
    assert "No gap beyond the noise" in text
    assert "No effect is named." in text


# ---- bad records ----


def changed(record: Record, **columns: np.ndarray) -> Record:
    return Record({name: np.array(values) for name, values in record.items()} | columns, source="bad.csv")


def later(column: np.ndarray, n_samples: int) -> np.ndarray:
    """Return a column that comes late: its first value is held."""
    return np.concatenate((np.full(n_samples, column[0]), column[:-n_samples]))


def checked(nominal: Nominal, record: Record) -> list[str]:
    run = prepare(record, nominal.drive)
    check_record(run, nominal.drive)
    replay = Replay(nominal.drive, nominal.library, nominal.simulation.substeps)
    on_paper = replay.simulate(run, [start(nominal).variant])
    simulated = {name: column[0] for name, column in on_paper.items()}
    return [*check_alignment(run, simulated), *clock_warnings(run, simulated)]


def flawed(record: Record) -> Iterator[tuple[Record, str]]:
    """Yield records that cannot be used, each with what has to be said of it."""
    time, command, position, force = (
        np.array(record[name]) for name in ("time_s", "reference_position_m", "position_m", "motor_force_N")
    )
    yield changed(record, motor_force_N=-force), "sign of the force is probably swapped|sign of the force is swapped"
    yield changed(record, motor_force_N=1e-3 * force), "0.001.* times the simulated one.*kilonewtons.*gain"
    yield changed(record, motor_force_N=force / 35.15), "its gain .* is wrong"
    yield changed(record, position_m=-position), "sign of one of them is swapped"
    yield changed(record, position_m=1e3 * position), "a thousand: millimetres"
    yield changed(record, position_m=position + 0.4), "different zero points; offset = -0.4"
    yield changed(record, position_m=1e3 * position, reference_position_m=1e3 * command), "travel_m is 0.3.*unit"
    yield changed(record, time_s=1e3 * time), "time_s is in seconds"
    yield changed(record, time_s=1e-3 * time), "is time_s in another unit"
    yield changed(record, reference_velocity_m_per_s=60.0 * np.gradient(command, PERIOD_S)), "reference_velocity"
    acceleration = np.gradient(np.gradient(command, PERIOD_S), PERIOD_S)
    for factor, words in ((1e3, "is 1000 times.*a thousand: milli"), (-1.0, "is -1 times.*sign")):
        yield changed(record, reference_acceleration_m_per_s2=factor * acceleration), words
    yield Record({name: column[:200] for name, column in record.items()}), "200 samples"
    yield Record({name: column[::10] for name, column in record.items()}), "every cycle of the controller"


def test_bad_records_get_a_sentence(nominal: Nominal, clean: Record) -> None:
    for record, words in flawed(clean):
        with pytest.raises(RecordError, match=words):
            checked(nominal, record)


def test_clean_record_gets_no_warning(nominal: Nominal, clean: Record, found: Diagnosis) -> None:
    assert checked(nominal, clean) == []
    assert found.answer.warnings == ()


def test_wrong_gain_is_warned_of(nominal: Nominal, clean: Record) -> None:
    (warning,) = checked(nominal, changed(clean, motor_force_N=3.0 * clean["motor_force_N"]))
    factor = float(re.findall(r"measured force is ([\d.]+) times", warning)[0])
    assert factor == pytest.approx(3.0, rel=0.02)
    assert checked(nominal, changed(clean, motor_force_N=1.5 * clean["motor_force_N"])) == []


@pytest.mark.parametrize("n_samples", [3, 40])
def test_shifted_clock_is_warned_of(nominal: Nominal, clean: Record, n_samples: int) -> None:
    names = ("motor_force_N", "position_m")
    late = {name: later(clean[name], n_samples) for name in names}
    (both,) = checked(nominal, changed(clean, **late))
    assert "motor_force_N and position_m together" in both
    (delay,) = re.findall(r"([\d.]+) samples .* after the simulation", both)
    assert float(delay) == pytest.approx(n_samples, abs=0.5)
    (alone,) = checked(nominal, changed(clean, motor_force_N=late["motor_force_N"]))
    assert "bad.csv: motor_force_N: " in alone
    (early,) = checked(nominal, changed(clean, reference_position_m=later(clean["reference_position_m"], n_samples)))
    assert "before the simulation" in early


def test_delay_is_found_between_samples(nominal: Nominal, clean: Record) -> None:
    run = prepare(clean, nominal.drive)
    t = np.arange(run.n_samples, dtype=np.float64)
    model = {name: np.asarray(column) for name, column in run.channels.items()}
    shifted = replace(run, channels={name: np.interp(t - 2.5, t, column) for name, column in model.items()})
    for name in model:
        assert delay_of(shifted, model, name) == pytest.approx(2.5, abs=0.2)
        assert delay_of(run, model, name) == pytest.approx(0.0, abs=1e-9)


def test_records_of_nothing_are_said(nominal: Nominal, clean: Record) -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(RecordError, match="not the force that moved the axis"):
        checked(nominal, changed(clean, motor_force_N=rng.standard_normal(clean.n_samples)))
    still = np.zeros(clean.n_samples)
    (standing,) = checked(nominal, changed(clean, reference_position_m=still, position_m=still))
    assert "never changes" in standing


def test_different_clocks_and_missing_columns(nominal: Nominal, clean: Record) -> None:
    with pytest.raises(RecordError, match="one clock"):
        diagnose(nominal, [clean, changed(clean, time_s=2.0 * clean["time_s"])])
    columns = {name: column for name, column in clean.items() if name != "motor_force_N"}
    with pytest.raises(RecordError, match=r"no column motor_force_N or .*; log the controller's output"):
        diagnose(nominal, [Record(columns)])


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda lines: lines[:900] + lines[950:], "samples of 0.001 s seem to be missing"),
        (
            lambda lines: [line.replace("motor_force_N", "feedrate_m_per_s") for line in lines],
            "no column motor_force_N",
        ),
    ],
)
def test_command_line_says_what_is_wrong(
    clean: Record,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    spoil: Any,
    words: str,
) -> None:
    path = tmp_path / "axis.csv"
    clean.save(path)
    path.write_text("\n".join(spoil(path.read_text().splitlines())) + "\n")
    monkeypatch.setattr(sys, "argv", ["fdbench", "diagnose", "--model", str(MODEL), str(path)])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    assert stop.value.code == 2
    assert words in capsys.readouterr().err
