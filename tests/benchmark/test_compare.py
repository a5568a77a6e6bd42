"""The gate: what is worse by more than chance and by more than matters is named, and nothing else is."""

import io
import json
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from conftest import REPOSITORY
from rich.console import Console
from scipy import stats
from short_scenario import short_scenario
from typer.testing import CliRunner

from fdbench.benchmark.compare import (
    EVEN,
    GAIN,
    LOSS,
    MISSING,
    NEW,
    NOT_JUDGED,
    ComparedRow,
    Comparison,
    compare,
    holm,
    paired_p_values,
    unpaired_p_values,
)
from fdbench.benchmark.compare_text import document, markdown, speed_ratios, summary, terminal
from fdbench.benchmark.run import run
from fdbench.benchmark.store import SCORE_COLUMNS
from fdbench.cli import app, main
from fdbench.errors import FdbenchError
from fdbench.estimator import estimators

TIME = "microseconds_per_sample"


def rows(
    estimator: str,
    metric: str,
    values: Sequence[float | str],
    scenario: str = "S-v0",
    first_seed: int = 0,
    **columns: str,
) -> pd.DataFrame:
    """Return score rows; a value that is a text is a status."""
    common = {name: name for name in SCORE_COLUMNS}
    lines = [
        {
            **common,
            "scenario": scenario,
            "estimator": estimator,
            "seed": first_seed + number,
            "metric": metric,
            "value": math.nan if isinstance(value, str) else value,
            "unit": "%",
            "status": value if isinstance(value, str) else "ok",
            "message": f"why {value}" if isinstance(value, str) else "",
            "seconds": 0.5,
            **columns,
        }
        for number, value in enumerate(values)
    ]
    return pd.DataFrame(lines)


def errors(*values: float | str, metric: str = "parameter_error", **columns: Any) -> pd.DataFrame:
    return rows("x", metric, values, **columns)


def only(comparison: Comparison) -> ComparedRow:
    (row,) = comparison.rows
    return row


def verdict(base: pd.DataFrame, new: pd.DataFrame) -> str:
    return only(compare(base, new)).verdict


# ---- chance ----


@pytest.mark.parametrize("n", [3, 10])
def test_p_values_are_those_of_the_t_tests(n: int) -> None:
    rng = np.random.default_rng(n)
    a, b = rng.normal(1.0, 0.2, n), rng.normal(1.1, 0.4, n + 2)
    expected = [stats.ttest_ind(b, a, equal_var=False, alternative=side).pvalue for side in ("greater", "less")]
    assert unpaired_p_values(a, b) == pytest.approx(expected, rel=1e-9)
    expected = [stats.ttest_rel(b[:n], a, alternative=side).pvalue for side in ("greater", "less")]
    assert paired_p_values(b[:n] - a) == pytest.approx(expected, rel=1e-9)


def test_without_spread_any_difference_is_certain() -> None:
    assert paired_p_values(np.full(5, 0.25)) == (0.0, 1.0)
    assert paired_p_values(np.zeros(5)) == (1.0, 1.0)
    assert unpaired_p_values(np.ones(3), np.full(4, 0.5)) == (1.0, 0.0)


def test_holm_by_hand() -> None:
    # In order 0.01, 0.012, 0.03, 0.04 times 4, 3, 2, 1, and never falling: 0.04, 0.04, 0.06, 0.06.
    assert holm([0.03, 0.01, 0.04, 0.012]) == pytest.approx([0.06, 0.04, 0.06, 0.04])
    assert holm([]) == []


# ---- the same records ----


def test_what_is_the_same_is_even() -> None:
    found = compare(errors(1.0, 2.0, 3.0), errors(1.0, 2.0, 3.0))
    assert only(found).verdict == EVEN
    assert (found.compared, only(found).paired, only(found).seeds, only(found).p_value) == (1, True, 3, 1.0)


def test_a_loss_is_named_with_its_numbers() -> None:
    row = only(compare(errors(1.0, 2.0, 3.0), errors(1.2, 2.2, 3.3)))
    assert (row.verdict, row.scenario, row.estimator, row.metric) == (LOSS, "S-v0", "x", "parameter_error")
    assert row.base == pytest.approx(2.0)
    assert row.new == pytest.approx(6.7 / 3)
    assert row.limit == pytest.approx(0.1)  # 5 % of 2
    assert row.p_value == pytest.approx(stats.ttest_1samp([0.2, 0.2, 0.3], 0.0, alternative="greater").pvalue)
    assert verdict(errors(1.2, 2.2, 3.3), errors(1.0, 2.0, 3.0)) == GAIN


def test_both_practical_limits_must_be_exceeded() -> None:
    assert verdict(errors(1.0, 2.0, 3.0), errors(1.04, 2.08, 3.12)) == EVEN  # 4 % in each
    decibels = {"metric": "psd_residual_broadband"}
    assert verdict(errors(1.0, 1.0, 1.0, **decibels), errors(1.4, 1.4, 1.41, **decibels)) == EVEN  # below 0.5 dB
    assert verdict(errors(1.0, 1.0, 1.0, **decibels), errors(1.6, 1.6, 1.61, **decibels)) == LOSS
    assert verdict(errors(20.0, 20.0, 20.0, **decibels), errors(20.9, 20.9, 20.91, **decibels)) == EVEN  # below 5 %


def test_beyond_the_ideal_nothing_is_lost() -> None:
    decibels = {"metric": "psd_residual_broadband"}
    assert verdict(errors(-30.0, -31.0, -30.0, **decibels), errors(-3.0, -4.0, -2.0, **decibels)) == EVEN
    assert verdict(errors(-30.0, -31.0, -30.0, **decibels), errors(3.0, 3.1, 3.0, **decibels)) == LOSS


def test_what_is_nothing_beside_null_is_no_loss() -> None:
    null = rows("null", "parameter_error", [100.0] * 3)
    for small, expected in ((1e-9, EVEN), (1e-3, LOSS)):
        base, new = (pd.concat([null, errors(*[factor * small] * 3)]) for factor in (1.0, 2.0))
        (found,) = [row for row in compare(base, new).rows if row.estimator == "x"]
        assert found.verdict == expected


def test_rounding_is_no_change_and_no_row_to_correct_for() -> None:
    moved = pd.concat([errors(1.0, 2.0, 3.0), *(rows(f"y{n}", "parameter_error", [5.0] * 3) for n in range(50))])
    other = moved.copy()
    other.loc[other["estimator"] != "x", "value"] *= 1.0 + 1e-13
    other.loc[other["estimator"] == "x", "value"] = [1.2, 2.2, 3.3]
    found = compare(moved, other)
    assert [row.estimator for row in found.of(LOSS)] == ["x"]
    assert found.compared == 51


def test_the_number_of_changed_rows_is_corrected_for() -> None:
    base = pd.concat([rows(f"y{n}", "parameter_error", [5.0, 6.0, 7.0]) for n in range(20)])
    new = base.copy()
    new["value"] += np.tile([0.6, 0.8, 1.4], 20)  # p = 0.03 in each of 20 rows, and no more evidence in all of them
    found = compare(base, new)
    assert {row.verdict for row in found.rows} == {EVEN}
    assert verdict(base[base["estimator"] == "y3"], new[new["estimator"] == "y3"]) == LOSS


def test_what_is_worse_on_some_seeds_and_better_on_others_is_even() -> None:
    assert verdict(errors(1.0, 2.0, 3.0), errors(2.0, 1.5, 3.2)) == EVEN


def test_one_or_two_records_speak_for_themselves() -> None:
    assert verdict(errors(1.0), errors(1.1)) == LOSS
    assert verdict(errors(1.0), errors(1.04)) == EVEN
    assert verdict(errors(1.0, 1.0), errors(1.1, 1.3)) == LOSS
    assert verdict(errors(1.0, 1.0), errors(0.9, 1.5)) == EVEN


def test_common_seeds_are_paired_and_the_others_left_out() -> None:
    row = only(compare(errors(*[1.0] * 10), errors(1.5, 1.5, 1.5)))
    assert (row.verdict, row.seeds, row.paired) == (LOSS, 3, True)


# ---- other records ----


def test_other_seeds_are_compared_unpaired() -> None:
    base, new = errors(1.0, 1.2, 0.8), errors(1.3, 0.9, 1.1, first_seed=7)
    row = only(compare(base, new))
    assert (row.verdict, row.paired) == (EVEN, False)
    far = errors(4.0, 4.3, 4.1, first_seed=7)
    row = only(compare(base, far))
    assert row.verdict == LOSS
    expected = stats.ttest_ind([4.0, 4.3, 4.1], [1.0, 1.2, 0.8], equal_var=False, alternative="greater").pvalue
    assert row.p_value == pytest.approx(expected, rel=1e-9)


def test_the_same_seeds_of_another_simulation_are_no_pairs() -> None:
    base = pd.concat([rows("null", "prediction_error", [9.0, 8.0, 9.5]), errors(1.0, 2.0, 3.0)])
    new = pd.concat([rows("null", "prediction_error", [9.0, 8.0, 9.6]), errors(1.2, 2.2, 3.3)])
    found = compare(base, new)
    assert found.other_records == ("S-v0",)
    assert not any(row.paired for row in found.rows)
    assert found.of(LOSS) == []
    assert "Same seeds, other records: S-v0." in markdown(found)


def test_where_nothing_can_be_judged_there_is_no_answer() -> None:
    with pytest.raises(FdbenchError, match="0 rows can be compared"):
        compare(errors(1.0), errors(9.0, first_seed=3))
    with pytest.raises(FdbenchError, match="0 rows can be compared"):
        compare(errors("skipped", 1.0, scenario="A-v0")[:1], errors("skipped", scenario="A-v0"))


# ---- statuses ----


def test_a_run_that_fails_now_is_a_loss_with_its_reason() -> None:
    for status in ("failed", "diverged", "skipped"):
        row = only(compare(errors(1.0, 2.0, 3.0), errors(1.0, status, 3.0)))
        assert (row.verdict, row.reason) == (LOSS, f"{status} with seed 1: why {status}")


def test_a_run_that_failed_before_is_no_loss() -> None:
    good = rows("y", "parameter_error", [1.0] * 3)
    for base, new, expected in (
        (errors("failed", "failed"), errors("failed", "failed"), NOT_JUDGED),
        (errors("failed", "failed"), errors(1.0, "failed"), GAIN),
        (errors("skipped", "skipped"), errors(1.0, 1.0), NEW),
        (errors("failed", 1.0), errors("failed", 1.0), EVEN),
        (errors("failed", 1.0), errors(9.0, 1.0), EVEN),
    ):
        found = compare(pd.concat([good, base]), pd.concat([good, new]))
        assert [row.verdict for row in found.rows if row.estimator == "x"] == [expected]


def test_failures_on_other_seeds_are_a_loss_where_they_are_no_chance() -> None:
    base = errors(*[1.0, 1.1] * 5)
    assert verdict(base, errors(*["failed"] * 3, first_seed=20)) == LOSS
    assert verdict(base, errors(*["failed"] * 8, 1.0, 1.1, first_seed=20)) == LOSS
    assert verdict(base, errors("failed", *[1.0, 1.1] * 4, 1.0, first_seed=20)) == EVEN


# ---- rows that are not in both ----


def test_missing_rows_are_an_error_unless_allowed() -> None:
    never = rows("never", "parameter_error", ["skipped"])
    base = pd.concat([errors(1.0), rows("gone", "parameter_error", [1.0]), never])
    with pytest.raises(FdbenchError, match=r"NEW lacks 1 rows \(S-v0 gone\)"):
        compare(base, errors(1.0))
    found = compare(base, errors(1.0), allow_missing=True)
    assert [row.estimator for row in found.of(MISSING)] == ["gone"]
    assert found.compared == 1


def test_a_scenario_that_cannot_be_run_any_more_is_missing() -> None:
    measured = {"scenario": "Measured-v0"}
    base = pd.concat([errors(1.0), errors(1.0, **measured), rows("null", "parameter_error", [2.0], **measured)])
    skipped = [errors("skipped", **measured), rows("null", "parameter_error", ["skipped"], **measured)]
    with pytest.raises(FdbenchError, match="Measured-v0 null, Measured-v0 x"):
        compare(base, pd.concat([errors(1.0), *skipped]))


def test_new_rows_are_told_and_not_judged() -> None:
    found = compare(errors(1.0), pd.concat([errors(1.0), rows("y", "parameter_error", ["failed"])]))
    assert [(row.estimator, row.verdict) for row in found.rows] == [("x", EVEN), ("y", NEW)]


def test_other_scenario_files_under_one_id_are_refused() -> None:
    with pytest.raises(FdbenchError, match="scenarios S-v0: BASE and NEW have different files"):
        compare(errors(1.0), errors(1.0, scenario_digest="other"))
    with pytest.raises(FdbenchError, match="rows of different code_digest"):
        compare(errors(1.0), pd.concat([errors(1.0), rows("y", "parameter_error", [1.0], code_digest="other")]))


# ---- speed ----


def times(*values: float, **columns: str) -> pd.DataFrame:
    return pd.concat([errors(*values), errors(*values, metric=TIME, **columns)])


def test_speed_is_told_and_not_judged() -> None:
    base, new = times(1.0, 1.01, 0.99), times(1.0, 1.01, 0.99)
    new.loc[new["metric"] == TIME, "value"] *= 2.0
    found = compare(base, new)
    assert [(row.metric, row.verdict) for row in found.rows] == [("parameter_error", EVEN), (TIME, NOT_JUDGED)]
    assert speed_ratios(found) == pytest.approx({"x": 2.0})
    assert "not judged: x 2.00." in markdown(found)
    assert [row.metric for row in compare(base, new, gate_speed=True).of(LOSS)] == [TIME]
    new.loc[new["metric"] == TIME, "value"] *= 0.55
    assert compare(base, new, gate_speed=True).of(LOSS) == []  # 10 %, of 20 % that matter


def test_speed_is_judged_within_one_run_only() -> None:
    for column in ("run_id", "machine"):
        with pytest.raises(FdbenchError, match=f"speed: rows of different {column}"):
            compare(times(1.0, 1.0), times(1.0, 1.0, **{column: "other"}), gate_speed=True)


# ---- how often it is right ----

# Relative spread over seeds and size of the baselines' errors in the shaker scenarios, and what an estimate that is too
# large by 1 % costs there: a mass follows from the difference of a parameter to 1.
SPREAD = {"parameter_error": 0.5, "physical_parameter_error": 0.8, "disturbance_error": 0.05, "prediction_error": 0.03}
LEVEL = {"parameter_error": 0.1, "physical_parameter_error": 0.5, "disturbance_error": 6.0, "prediction_error": 0.05}
COST = {"parameter_error": 1.0, "physical_parameter_error": 150.0, "disturbance_error": 0.0, "prediction_error": 0.0}


def suite(rng: np.random.Generator, n: int, first_seed: int) -> pd.DataFrame:
    """Return 6 scenarios x 5 estimators, log-normal with the spread over seeds that the baselines have."""
    names = [f"S{scenario}-v0" for scenario in range(6)], [f"e{number}" for number in range(5)], list(SPREAD)
    index = pd.MultiIndex.from_product([*names, range(first_seed, first_seed + n)])
    table = index.to_frame(index=False, name=["scenario", "estimator", "metric", "seed"])
    level = table["metric"].map(LEVEL) * (1 + table["estimator"].str[1].astype(int))
    table["value"] = level * np.exp(table["metric"].map(SPREAD) * rng.standard_normal(len(table)))
    template = errors(0.0)
    return table.assign(**{name: template[name].iloc[0] for name in template if name not in table})


def worsened(table: pd.DataFrame, percent: float) -> pd.DataFrame:
    """Return the errors of e2 on one scenario as they are with parameters that are too large by some per cent."""
    own = (table["estimator"] == "e2") & (table["scenario"] == "S3-v0")
    return table.assign(value=np.hypot(table["value"], own * percent * table["metric"].map(COST)))


@pytest.mark.parametrize(("n", "repeats"), [(3, 20), (10, 10)])
def test_the_same_code_on_other_seeds_is_not_caught(n: int, repeats: int) -> None:
    rng = np.random.default_rng(100 + n)
    caught = sum(bool(compare(suite(rng, n, 0), suite(rng, n, n)).of(LOSS)) for _ in range(repeats))
    assert caught <= 0.1 * repeats


@pytest.mark.parametrize(("n", "paired"), [(1, True), (3, True), (10, True), (3, False), (10, False)])
def test_an_estimate_that_is_off_by_three_per_cent_is_caught(n: int, paired: bool) -> None:
    rng = np.random.default_rng(200 + n)
    repeats = 10
    caught = 0
    for _ in range(repeats):
        base = suite(rng, n, 0)
        new = worsened(base if paired else suite(rng, n, n), 3.0)
        found = {(row.scenario, row.estimator) for row in compare(base, new).of(LOSS)}
        caught += ("S3-v0", "e2") in found
    assert caught >= 0.9 * repeats


# ---- from the command line ----

SCALED = """
from dataclasses import replace

from fdbench.estimator import BatchEstimator
from fdbench_baselines.pl_lssvm import PLLSSVM


class Mine(BatchEstimator):
    def fit(self, context, record):
        estimate = PLLSSVM().fit(context, record)
        return replace(estimate, parameters={name: SCALE * value for name, value in estimate.parameters.items()})
"""


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with results ``base``, ``worse`` (estimates times 1.03) and ``other`` (as base, other seeds)."""
    folder = tmp_path_factory.mktemp("compare")
    scenario = short_scenario(folder, "Short-v0")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(estimators, "_files", {})
        for name, scale, first_seed in (("base", "1.0", 0), ("worse", "1.03", 0), ("other", "1.0", 3)):
            (folder / name).mkdir()
            (folder / name / "mine.py").write_text(SCALED.replace("SCALE", scale), "utf-8")
            run([scenario], [str(folder / name / "mine.py")], 3, folder / name / "out", first_seed=first_seed)
    return folder


def command(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr("sys.argv", ["fdbench", *map(str, arguments)])
    with pytest.raises(SystemExit) as stopped:
        main()
    return int(stopped.value.code or 0)


def test_a_real_estimator_made_worse_is_caught(
    folders: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    note = folders / "note.md"
    base, worse = folders / "base" / "out", folders / "worse" / "out"
    assert command(monkeypatch, "compare", base, worse, "--json", "--markdown", note) == 1
    found = json.loads(capsys.readouterr().out)
    losses = [row for row in found["rows"] if row["verdict"] == LOSS]
    assert {(row["scenario"], row["estimator"]) for row in losses} == {("Short-v0", "mine")}
    assert "parameter_error" in {row["metric"] for row in losses}
    assert found["verdict"] == LOSS
    assert found["counts"][LOSS] == len(losses)
    assert found["compared"] > 20
    assert "| loss | Short-v0 | mine | parameter_error |" in note.read_text("utf-8")


def test_the_same_estimator_is_not_caught_on_any_seeds(
    folders: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    base, other = folders / "base" / "out", folders / "other" / "out"
    for new, paired in ((base, True), (other, False)):
        assert command(monkeypatch, "compare", base, new) == 0
        text = " ".join(capsys.readouterr().out.split())
        number = re.search(r"Losses: 0, gains: 0; (\d+) rows compared, (\d+) of them on the same records", text)
        assert number is not None
        assert int(number[1]) > 20
        assert int(number[2]) == (int(number[1]) if paired else 0)
    worse = folders / "worse" / "out"
    assert command(monkeypatch, "compare", other, worse) == 1


def test_bad_usage_is_one_message(
    folders: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    base = folders / "base" / "out"
    assert command(monkeypatch, "compare", base, tmp_path) == 2
    assert "no scores.parquet in this folder" in capsys.readouterr().err
    assert command(monkeypatch, "compare", base, folders / "worse" / "out", "--gate-speed") == 2
    assert "speed: rows of different run_id" in capsys.readouterr().err


# ---- the text ----


def test_the_comment_has_every_part_and_well_formed_tables() -> None:
    base = pd.concat([errors(1.0, 2.0, 3.0), rows("y", "parameter_error", [1.0]), rows("z", "prediction_error", [3.0])])
    base = pd.concat([base, rows("d", "disturbance_delay", [2e-5], unit="s")])
    new = pd.concat(
        [
            rows("d", "disturbance_delay", [0.25], unit="s"),
            errors(1.2, 2.2, 3.3),
            errors(1.0, metric="prediction_error"),
            rows("y", "parameter_error", ["failed"], message="a|b of /data/of/me/data.csv"),
        ]
    )
    text = markdown(compare(base, new, allow_missing=True))
    assert "### fdbench: Losses: 3, gains: 0; 3 rows compared, 2 of them on the same records." in text
    assert "| disturbance_delay | 20 us → 250 ms |" in text
    assert "| loss | S-v0 | x | parameter_error | 2 → 2.23 % | +11.7% |" in text
    assert r"failed with seed 0: a\|b of data.csv" in text
    assert "| missing | S-v0 | z | prediction_error |" in text
    assert "<details><summary>Gains and new rows</summary>" in text
    assert "| new | S-v0 | x | prediction_error |" in text
    for block in text.split("\n\n"):
        if block.startswith("|"):
            assert len({line.replace(r"\|", "").count("|") for line in block.splitlines() if line[0] == "|"}) == 1


def test_rows_with_one_reason_are_one_line_and_long_tables_are_cut() -> None:
    names = ("parameter_error", "prediction_error", "disturbance_error", "disturbance_delay")
    base = pd.concat([rows(f"e{n}", metric, [1.0]) for n in range(60) for metric in names])
    new = pd.concat([rows(f"e{n}", metric, ["failed"]) for n in range(60) for metric in names])
    found = compare(base, new)
    assert len(found.of(LOSS)) == 240
    text = markdown(found)
    assert text.count("| loss |") == 50
    assert "| 4 metrics |" in text
    assert "... and 10 more." in text
    assert "Losses: 240" in summary(found)
    assert json.loads(json.dumps(document(found), allow_nan=False))["counts"][LOSS] == 240


def test_names_are_whole_in_a_narrow_terminal() -> None:
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(terminal(compare(errors(1.0), errors(2.0))))
    assert "S-v0 x parameter_error" in " ".join(console.export_text().split())


def test_the_workflow_calls_commands_that_exist() -> None:
    text = (REPOSITORY / "examples" / "ci" / "fdbench.yml").read_text("utf-8")
    calls = re.findall(r"fdbench (run|compare)\b(.*)", text)
    assert [name for name, _ in calls] == ["run", "run", "compare"]
    for name, arguments in calls:
        described = CliRunner().invoke(app, [name, "--help"], env={"COLUMNS": "200"}).output
        for option in re.findall(r"--[a-z-]+", arguments):
            assert option in described, f"fdbench {name} {option}"
    for comments in re.findall(r"(?:^ *#.*\n)+", text, flags=re.MULTILINE):
        assert comments.count("\n") <= 2
