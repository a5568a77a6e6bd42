"""The benchmark: every run leaves a row with a status, finished runs are not repeated, and nothing stale is reused."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import REPOSITORY, shared_file
from scipy.io import loadmat, savemat
from short_scenario import short_scenario
from threadpoolctl import threadpool_limits

from fdbench.benchmark import job, provenance
from fdbench.benchmark import run as running
from fdbench.benchmark.run import Progress, Summary, run
from fdbench.benchmark.store import PARAMETER_COLUMNS, SCORE_COLUMNS, KeptRun, RunKey, Store
from fdbench.benchmark.validate import check_estimate
from fdbench.effects import effects
from fdbench.errors import FdbenchError, PluginError, SpecError, UnknownName
from fdbench.estimator import Estimate, estimators
from fdbench.regression import Regression
from fdbench.sandbox import WorkerLimits, terms
from fdbench.scenario import load_scenario

HEAD = "import numpy as np\nfrom fdbench.estimator import BatchEstimator, Estimate\n\n\nclass Fake(BatchEstimator):\n"
FIT = HEAD + "    def fit(self, context, record):\n        "
LIKE_NULL = "Estimate(parameters=dict.fromkeys(context.regression(record).names, 0.0))"
COUNTS = FIT + f"return {LIKE_NULL}\n"

# File name, body of fit, and the beginning of the message that a researcher must see.
FAILURES = [
    ("raises", "raise ValueError('no\\nidea')", "raises.py:7: ValueError: no idea"),
    ("exits", "raise SystemExit(3)", "exits.py:7: SystemExit: 3"),
    ("mutates", "record['velocity_m_per_s'][0] = 1.0", "mutates.py:7: ValueError: assignment destination is read-only"),
    ("returns_nothing", "return None", "returns_nothing.py:6: PluginError: fit returned None, expected an Estimate."),
    (
        "misspells",
        "return Estimate(parameters={'beta1': 0.83})",
        "misspells.py:6: PluginError: parameters['beta1']: the model has no such parameter. Did you mean beta_1?",
    ),
    (
        "not_finite",
        "return Estimate(parameters={'beta_1': np.nan})",
        "not_finite.py:6: PluginError: parameters['beta_1'] is nan",
    ),
    ("wrong_shape", "return Estimate(output=np.zeros(3))", "wrong_shape.py:6: PluginError: output has shape (3,)"),
]


@pytest.fixture(autouse=True)
def _own_plugin_files(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimators, "_files", {})


@pytest.fixture
def scenario(tmp_path: Path) -> str:
    return short_scenario(tmp_path, "Short-v0")


def estimator_file(folder: Path, name: str, text: str) -> str:
    path = folder / f"{name}.py"
    path.write_text(text, "utf-8")
    return str(path)


def rows(store: Store, estimator: str) -> Any:
    scores = store.scores()
    return scores[scores["estimator"] == estimator]


def key(estimator: str, seed: int = 0) -> RunKey:
    return RunKey("Short-v0", estimator, seed)


# ---- statuses ----


def test_good_runs_leave_scores_parameters_and_provenance(tmp_path: Path, scenario: str) -> None:
    summary = run([scenario], ["least_squares"], 2, tmp_path / "out")
    assert summary == Summary(reused=0, computed=6, statuses={"ok": 6, "failed": 0, "diverged": 0, "skipped": 0})
    store = Store(tmp_path / "out")
    scores, parameters = store.scores(), store.parameters()
    assert list(scores) == list(SCORE_COLUMNS)
    assert list(parameters) == list(PARAMETER_COLUMNS)
    assert not scores.duplicated(["scenario", "estimator", "seed", "metric"]).any()
    assert sorted(scores["estimator"].unique()) == ["least_squares", "null", "oracle"]
    good = scores[scores["status"] == "ok"]
    assert np.isfinite(good["value"]).all()
    assert (good["message"] == "").all()
    assert (scores["scenario_digest"] == load_scenario(scenario).digest).all()
    assert (scores["seconds"] > 0.0).all()
    for column in ("estimator_digest", "fdbench_version", "python", "numpy", "numba", "machine", "run_id", "utc"):
        assert (scores[column] != "").all(), column
    assert (scores["plant"] == "feed_drive").all()
    truth = load_scenario(scenario).observe(0)[1].parameters
    of_oracle = parameters[(parameters["estimator"] == "oracle") & (parameters["seed"] == 1)]
    estimates = dict(zip(of_oracle["parameter"], of_oracle["estimate"], strict=True))
    assert truth.items() <= estimates.items()
    assert (of_oracle["estimate"] == of_oracle["truth"]).all()
    document = json.loads((tmp_path / "out" / "run.json").read_text("utf-8"))
    assert document["seeds"] == 2
    assert document["estimators"] == ["least_squares", "null", "oracle"]
    assert document["scenarios"] == {"Short-v0": load_scenario(scenario).digest}


def test_oracle_predicts_all_but_the_noise(tmp_path: Path, scenario: str) -> None:
    run([scenario], [], 1, tmp_path)
    kept = Store(tmp_path).read_estimate(key("oracle"))
    assert kept is not None
    noise = load_scenario(scenario).reality.noise.equation_velocity_m_per_s
    residual = kept.target - np.asarray(kept.estimate.output)
    assert 0.9 * noise < np.std(residual) < 1.2 * noise  # 1.05: friction has no dead band in the axis


def test_every_failure_is_a_row_with_its_reason(tmp_path: Path, scenario: str) -> None:
    files = [estimator_file(tmp_path, name, FIT + body + "\n") for name, body, _ in FAILURES]
    summary = run([scenario], files, 1, tmp_path / "out")
    assert summary.statuses == {"ok": 2, "failed": len(FAILURES), "diverged": 0, "skipped": 0}
    store = Store(tmp_path / "out")
    expected = set(rows(store, "null")["metric"])
    for name, _, message in FAILURES:
        found = rows(store, name)
        assert set(found["metric"]) == expected
        assert set(found["status"]) == {"failed"}
        assert found["value"].isna().all()
        assert found["message"].iloc[0].startswith(message)
        assert store.read_estimate(key(name)) is None
    assert load_scenario(scenario).observe(0)[0] == store.read_record("Short-v0", 0)


def test_an_estimator_cannot_spoil_the_record_of_the_next(tmp_path: Path, scenario: str) -> None:
    body = "v = record['velocity_m_per_s'].base\n        v.flags.writeable = True\n        v[:] = 0.0\n"
    spoils = estimator_file(tmp_path, "a_spoiler", FIT + body + f"        return {LIKE_NULL}\n")
    run([scenario], [spoils, "least_squares"], 1, tmp_path / "out")
    run([scenario], ["least_squares"], 1, tmp_path / "alone")
    assert set(rows(Store(tmp_path / "out"), "a_spoiler")["status"]) == {"ok", "skipped"}
    spoilt, alone = (Store(tmp_path / name).read_estimate(key("least_squares")) for name in ("out", "alone"))
    assert spoilt is not None
    assert alone is not None
    assert spoilt.estimate.parameters == alone.estimate.parameters


def test_an_estimator_sees_no_seed_to_simulate_the_truth_with(tmp_path: Path, scenario: str) -> None:
    body = "raise ValueError(f'{record.provenance} {record.source}')\n"
    run([scenario], [estimator_file(tmp_path, "peeps", FIT + body)], 1, tmp_path / "out")
    store = Store(tmp_path / "out")
    assert rows(store, "peeps")["message"].iloc[0] == "peeps.py:7: ValueError: {} record"
    assert store.read_record("Short-v0", 0).provenance["seed"] == 0


def test_a_skip_has_a_reason(tmp_path: Path, scenario: str) -> None:
    text = FIT + f"return {LIKE_NULL}\n\n    def skip(self, context):\n        return 'not for ' + context.model\n"
    run([scenario], [estimator_file(tmp_path, "picky", text)], 1, tmp_path / "out")
    found = rows(Store(tmp_path / "out"), "picky")
    assert set(zip(found["status"], found["message"], strict=True)) == {("skipped", "not for velocity_loop")}


def test_unknown_argument_names_the_nearest(tmp_path: Path) -> None:
    scenario = short_scenario(tmp_path, "Short-v0", **{"sigma_1_s = 0.59": "sigma_1 = 0.59"})
    run([scenario], ["pl_lssvm"], 1, tmp_path / "out")
    found = rows(Store(tmp_path / "out"), "pl_lssvm")
    assert set(found["status"]) == {"failed"}
    assert found["message"].iloc[0] == "PluginError: pl_lssvm has no argument 'sigma_1'. Did you mean sigma_1_s?"


def test_arguments_of_the_scenario_are_used(tmp_path: Path) -> None:
    text = HEAD + (
        "    def __init__(self, beta=1.0):\n        self.beta = beta\n\n"
        "    def fit(self, context, record):\n        return Estimate(parameters={'beta_1': self.beta})\n"
    )
    head = "[estimation.hyperparameters.pl_lssvm]"
    scenario = short_scenario(
        tmp_path, "Short-v0", **{head: f"[estimation.hyperparameters.given]\nbeta = 7.0\n\n{head}"}
    )
    run([scenario], [estimator_file(tmp_path, "given", text)], 1, tmp_path / "out")
    kept = Store(tmp_path / "out").read_estimate(key("given"))
    assert kept is not None
    assert kept.estimate.parameters == {"beta_1": 7.0}


def test_divergence_is_a_status_of_every_run(tmp_path: Path) -> None:
    scenario = short_scenario(tmp_path, "Short-v0", **{"velocity_limit_m_per_s = 0.5": "velocity_limit_m_per_s = 0.05"})
    summary = run([scenario], ["least_squares"], 1, tmp_path / "out")
    assert summary.statuses == {"ok": 0, "failed": 0, "diverged": 3, "skipped": 0}
    assert set(Store(tmp_path / "out").scores()["status"]) == {"diverged"}


def test_missing_data_are_skipped_with_the_way_to_get_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FDBENCH_DATA", str(tmp_path))
    summary = run(["EMPS-v0"], ["least_squares"], 3, tmp_path / "out")
    assert summary.statuses == {"ok": 0, "failed": 0, "diverged": 0, "skipped": 3}  # one record: one seed
    messages = set(Store(tmp_path / "out").scores()["message"])
    assert len(messages) == 1
    assert "FDBENCH_DATA" in messages.pop()


def test_a_metric_that_fails_spoils_no_other(tmp_path: Path, scenario: str, monkeypatch: pytest.MonkeyPatch) -> None:
    from fdbench.metrics.parameter_error import ParameterError

    monkeypatch.setattr(ParameterError, "score", lambda self, outcome: float("nan"))
    summary = run([scenario], [], 1, tmp_path)
    assert summary.statuses["failed"] == 2
    scores = Store(tmp_path).scores().set_index(["estimator", "metric"])
    assert scores.loc[("null", "parameter_error"), "status"] == "failed"
    assert scores.loc[("null", "disturbance_error"), "status"] == "ok"


PUSH = """
from dataclasses import dataclass
from typing import final
from fdbench.effects import Effect, Port, kernel, parameter

@final
@dataclass(frozen=True, kw_only=True)
class Push(Effect):
    port, amplitude = Port.TABLE_FORCE, "push_N"
    push_N: float = parameter("F", low=0.0, high=1e6, typical=1.0)

    @kernel
    def kernel(t, h, x, v, u, F):
        return F, 0.0
"""


def test_a_plugin_given_by_a_link_has_the_name_of_the_link(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for registry in (effects, estimators):
        monkeypatch.setattr(registry, "_files", {})
    place = tmp_path / "of_others"
    place.mkdir()
    (place / "weighed.txt").write_text("0.25", "utf-8")
    fit = "return Estimate(parameters={'beta_1': float(open(__file__[:-2] + 'txt').read())})"
    for link, name, text in (("mine", "weighed", FIT + fit), ("own_push", "push", PUSH), ("faulty", "broken", "1 / 0")):
        (tmp_path / f"{link}.py").symlink_to(estimator_file(place, name, text))
    own = '[[reality.effects]]\nkind = "own_push"\npush_N = 0.5\n\n'
    scenario = short_scenario(tmp_path, "Short-v0", **{"[[reality.effects]]": own + "[[reality.effects]]"})
    monkeypatch.chdir(tmp_path)
    effects.add_file("own_push.py")
    run([scenario], ["mine.py", "faulty.py", "least_squares"], 1, "out")
    kept = Store("out").read_estimate(key("mine"))
    assert kept is not None
    assert kept.estimate.parameters == {"beta_1": 0.25}
    reasons = {name: Store("out").read_run(key(name)).message for name in ("mine", "faulty", "least_squares")}  # type: ignore[union-attr]
    assert reasons.pop("faulty") == "faulty.py: cannot be imported: line 1: ZeroDivisionError: division by zero"
    assert set(reasons.values()) == {""}
    ((number, file),) = running._plugins()
    job.forget_plugins()  # as in another process
    job.load_plugin(number, file)
    assert load_scenario(scenario).reality.effects[0].name == "own_push"
    job.forget_plugins()


# ---- bad usage ----


def test_bad_usage_runs_nothing(tmp_path: Path, scenario: str) -> None:
    named_oracle = estimator_file(tmp_path, "oracle", FIT + f"return {LIKE_NULL}\n")
    cases: list[tuple[type[FdbenchError], str, list[str], list[str], int, int]] = [
        (UnknownName, "Did you mean least_squares", [scenario], ["least_square"], 1, 1),
        (UnknownName, "Did you mean ShakerConstant-v0", ["ShakerConstan-v0"], [], 1, 1),
        (SpecError, "cannot be read", [str(tmp_path / "none.toml")], [], 1, 1),
        (PluginError, "no such file", [scenario], [str(tmp_path / "none.py")], 1, 1),
        (PluginError, "the benchmark's own", [scenario], [named_oracle], 1, 1),
        (FdbenchError, "given 2 times", [scenario, scenario], [], 1, 1),
        (FdbenchError, "at least 1", [scenario], [], 0, 1),
        (FdbenchError, "at least 1", [scenario], [], 1, 0),
    ]
    for error, message, scenarios, names, seeds, jobs in cases:
        with pytest.raises(error, match=message):
            run(scenarios, names, seeds, tmp_path / "out", jobs=jobs)
        estimators._files.clear()
    with pytest.raises(FdbenchError, match="first seed -1: at least 0"):
        run([scenario], [], 1, tmp_path / "out", first_seed=-1)
    assert not (tmp_path / "out").exists()


def test_what_goes_wrong_in_writing_is_not_hidden_by_tidying_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(self: Path, *_: object, **__: object) -> None:
        raise OSError(30, "Read-only file system", str(self))

    for name in ("write_text", "unlink"):
        monkeypatch.setattr(Path, name, refuse)
    with pytest.raises(FdbenchError, match=r"run\.json: cannot be written: Read-only file system\.$"):
        Store(tmp_path).write_selection({})


def test_results_that_are_not_there_are_named(tmp_path: Path) -> None:
    with pytest.raises(FdbenchError, match=r"no scores\.parquet here"):
        Store(tmp_path).scores()


# ---- resuming ----


def test_finished_runs_are_reused_and_missing_ones_computed(tmp_path: Path, scenario: str) -> None:
    counting, out = estimator_file(tmp_path, "counting", COUNTS), tmp_path / "out"
    run([scenario], [counting], 2, out)
    before = Store(out).scores()
    assert run([scenario], [counting], 2, out) == Summary(
        reused=6, computed=0, statuses={"ok": 6, "failed": 0, "diverged": 0, "skipped": 0}
    )
    assert Store(out).scores().equals(before)
    Store(out).run_file(key("counting", 1)).unlink()
    assert run([scenario], [counting], 2, out).computed == 1
    again = Store(out).scores()
    assert list(again["utc"] != before["utc"]) == [
        run == ("counting", 1) for run in zip(again["estimator"], again["seed"], strict=True)
    ]
    assert run([scenario], [counting], 3, out).computed == 3  # one seed more


def test_an_interruption_loses_the_running_job_at_most(tmp_path: Path, scenario: str) -> None:
    def interrupt(progress: Progress) -> None:
        if progress.done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run([scenario], ["least_squares"], 4, tmp_path / "out", progress=interrupt)
    seen: list[KeptRun] = []
    summary = run([scenario], ["least_squares"], 4, tmp_path / "out", progress=lambda p: seen.extend(p.runs))
    assert summary.reused >= 2 * 3
    assert summary.reused + summary.computed == 4 * 3
    assert sum(summary.statuses.values()) == summary.statuses["ok"] == 4 * 3
    assert len(seen) == summary.computed
    assert {one.seed for one in seen} <= {2, 3}


def test_all_scenarios_have_their_first_seed_before_any_has_its_second(tmp_path: Path, scenario: str) -> None:
    scenarios, seen = [scenario, short_scenario(tmp_path, "Other-v0")], list[tuple[int, str]]()
    run(scenarios, ["null"], 2, tmp_path / "out", progress=lambda p: seen.extend((o.seed, o.scenario) for o in p.runs))
    assert list(dict.fromkeys(seen)) == [(seed, name) for seed in (0, 1) for name in ("Short-v0", "Other-v0")]


def test_a_skip_holds_until_something_changes(tmp_path: Path, scenario: str) -> None:
    text = FIT + f"return {LIKE_NULL}\n\n    def skip(self, context):\n        return 'never'\n"
    picky, out = estimator_file(tmp_path, "picky", text), tmp_path / "out"
    run([scenario], [picky], 2, out)
    assert run([scenario], [picky], 2, out).computed == 0
    Store(out).run_file(key("oracle")).unlink()  # then nothing tells whether the record was there
    assert run([scenario], [picky], 2, out).computed == 2
    estimator_file(tmp_path, "picky", text.replace("return 'never'", "return None"))
    assert run([scenario], [picky], 2, out).statuses["ok"] == 6


def test_missing_data_are_looked_for_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FDBENCH_DATA", str(tmp_path / "here"))
    run(["EMPS-v0"], ["least_squares"], 1, tmp_path / "out")
    assert run(["EMPS-v0"], ["least_squares"], 1, tmp_path / "out").computed == 0
    monkeypatch.setenv("FDBENCH_DATA", str(tmp_path / "there"))
    assert run(["EMPS-v0"], ["least_squares"], 1, tmp_path / "out").computed == 3
    assert "there" in Store(tmp_path / "out").scores()["message"].iloc[0]
    file = tmp_path / "there" / "emps" / "DATA_EMPS.mat"
    file.parent.mkdir(parents=True)
    file.write_bytes(b"")
    assert run(["EMPS-v0"], ["least_squares"], 1, tmp_path / "out").computed == 3


def test_a_measured_file_that_was_replaced_is_run_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = shutil.copy(shared_file("data", "emps", "DATA_EMPS.mat"), tmp_path / "DATA_EMPS.mat")
    place, out = tmp_path / "data" / "emps" / "DATA_EMPS.mat", tmp_path / "out"
    place.parent.mkdir(parents=True)
    monkeypatch.setenv("FDBENCH_DATA", str(tmp_path / "data"))
    place.write_bytes(file.read_bytes())
    run(["EMPS-v0"], [], 1, out)
    assert run(["EMPS-v0"], [], 1, out).computed == 0
    savemat(place, {name: value for name, value in loadmat(file).items() if not name.startswith("__")})
    assert run(["EMPS-v0"], [], 1, out).computed == 2


def test_a_damaged_run_is_repeated(tmp_path: Path, scenario: str) -> None:
    run([scenario], [], 1, tmp_path / "out")
    file = Store(tmp_path / "out").run_file(key("null"))
    file.write_text(file.read_text("utf-8")[:100], "utf-8")
    assert run([scenario], [], 1, tmp_path / "out").computed == 1


def test_a_file_that_is_another_run_or_no_estimate_is_refused(tmp_path: Path, scenario: str) -> None:
    store = Store(tmp_path / "out")
    run([scenario], [], 1, store.folder)
    store.run_file(key("null")).write_text(store.run_file(key("oracle")).read_text("utf-8"), "utf-8")
    with pytest.raises(FdbenchError, match=r"0\.json: not a run that this version can read \(it is another one\)"):
        store.read_run(key("null"))
    estimate = store.estimate_file(key("null"))
    for content in (b"x", (store.folder / "scores.parquet").read_bytes()):
        estimate.write_bytes(content)
        with pytest.raises(FdbenchError, match=r"0\.parquet: not an estimate .*Remove it"):
            store.read_estimate(key("null"))


def test_an_edited_estimator_or_scenario_is_run_again(tmp_path: Path, scenario: str) -> None:
    counting, out = estimator_file(tmp_path, "counting", COUNTS), tmp_path / "out"
    run([scenario], [counting], 2, out)
    estimator_file(tmp_path, "counting", COUNTS.replace("0.0", "0.5"))
    assert run([scenario], [counting], 2, out).computed == 2
    kept = Store(out).read_estimate(key("counting"))
    assert kept is not None
    assert set(kept.estimate.parameters.values()) == {0.5}
    short_scenario(tmp_path, "Short-v0", **{"force_amplitude_N = 1.2": "force_amplitude_N = 1.3"})
    assert run([scenario], [counting], 2, out).computed == 6


def test_a_failure_leaves_no_estimate_of_an_earlier_run(tmp_path: Path, scenario: str) -> None:
    edited, store = estimator_file(tmp_path, "edited", FIT + f"return {LIKE_NULL}\n"), Store(tmp_path / "out")
    run([scenario], [edited], 1, store.folder)
    assert store.read_estimate(key("edited")) is not None
    estimator_file(tmp_path, "edited", FIT + "raise ValueError\n")
    run([scenario], [edited], 1, store.folder)
    assert store.read_estimate(key("edited")) is None


def test_failures_and_skips_are_never_reused(tmp_path: Path, scenario: str) -> None:
    raises = estimator_file(tmp_path, "raises", FIT + "raise ValueError\n")
    for _ in range(2):
        summary = run([scenario], [raises], 2, tmp_path / "out")
        assert summary.statuses["failed"] == 2
    assert summary.computed == 2


def test_other_code_is_run_again(tmp_path: Path, scenario: str, monkeypatch: pytest.MonkeyPatch) -> None:
    run([scenario], [], 1, tmp_path / "out")
    monkeypatch.setattr(provenance, "code_digest", lambda: "another")
    assert run([scenario], [], 1, tmp_path / "out").computed == 2


def test_estimates_are_kept_on_request_and_for_seed_0(tmp_path: Path, scenario: str) -> None:
    store = Store(tmp_path / "out")
    run([scenario], ["least_squares"], 2, store.folder)
    assert store.read_estimate(key("least_squares", 0)) is not None
    assert store.read_estimate(key("least_squares", 1)) is None
    assert run([scenario], ["least_squares"], 2, store.folder, keep_estimates=True).computed == 3
    record, truth = load_scenario(scenario).observe(1)
    regression = load_scenario(scenario).context().regression(record)
    with threadpool_limits(1, user_api="blas"):
        expected = estimators.get("least_squares")().fit(load_scenario(scenario).context(), record)
    kept, of_oracle = (store.read_estimate(key(name, 1)) for name in ("least_squares", "oracle"))
    assert kept is not None
    assert of_oracle is not None
    assert kept.estimate.parameters == expected.parameters
    for name in ("covariance", "disturbance_N", "output", "output_variance"):
        np.testing.assert_array_equal(getattr(kept.estimate, name), getattr(expected, name))
    np.testing.assert_array_equal(kept.target, regression.target)
    np.testing.assert_array_equal(kept.time_s, regression.time_s)
    assert kept.target_name == regression.target_name
    assert truth.disturbance_N is not None
    np.testing.assert_array_equal(of_oracle.estimate.disturbance_N, truth.disturbance_N[regression.rows])
    assert store.read_record("Short-v0", 1) == record


def test_other_seeds_can_be_run(tmp_path: Path, scenario: str) -> None:
    run([scenario], ["least_squares"], 2, tmp_path / "out", first_seed=5)
    run([scenario], ["least_squares"], 6, tmp_path / "all")
    store = Store(tmp_path / "out")
    assert store.scores()["seed"].unique().tolist() == [5, 6]
    assert store.read_estimate(key("least_squares", 5)) is not None
    assert store.read_estimate(key("least_squares", 6)) is None
    tables = [Store(tmp_path / name).parameters().dropna() for name in ("out", "all")]
    kept, expected = (table[table["seed"] == 5]["estimate"].tolist() for table in tables)
    assert kept == expected != []


# ---- the rest of the folder ----


def test_results_beside_the_selection_are_kept(tmp_path: Path, scenario: str) -> None:
    out = tmp_path / "out"
    mine = estimator_file(tmp_path, "mine", FIT + f"return {LIKE_NULL}\n")
    first = run([scenario], ["least_squares"], 2, out)
    assert (first.others, first.stale) == (0, ())
    before = Store(out).scores()
    second = run([scenario], [mine], 1, out)
    assert (second.others, second.stale, sum(second.statuses.values())) == (2 + 2, (), 3)  # least_squares; references
    scores = Store(out).scores()
    assert scores[scores["estimator"] != "mine"].reset_index(drop=True).equals(before)
    assert set(Store(out).parameters()["estimator"]) == {"least_squares", "mine", "null", "oracle"}
    selected = Store(out).scores(second.keys)
    assert set(selected["estimator"]) == {"mine", "null", "oracle"}
    assert set(selected["seed"]) == {0}
    estimators._files.clear()  # a later start does not know the file
    assert run([scenario], ["least_squares"], 2, out).stale == ()
    assert Store(out).scores().equals(scores)


def test_results_of_what_has_changed_are_left_out(
    tmp_path: Path, scenario: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def seen() -> set[str]:
        return {f"{one.estimator} {one.seed}" for one in Store(out).scores().itertuples()}

    out, other = tmp_path / "out", short_scenario(tmp_path, "Other-v0")
    text = FIT + f"return {LIKE_NULL}\n"
    mine = estimator_file(tmp_path, "mine", text)
    run([scenario], [mine, "least_squares"], 2, out)
    references = {f"{name} {seed}" for name in ("null", "oracle") for seed in (0, 1)}

    # An estimator: of the other seed, even where the file is not known any more.
    estimator_file(tmp_path, "mine", text.replace("0.0", "0.5"))
    assert run([scenario], [mine], 1, out).stale == (key("mine", 1),)
    estimators._files.clear()
    assert run([other], [], 1, out).stale == (key("mine", 1),)
    assert seen() == {*references, "mine 0", "least_squares 0", "least_squares 1"}

    # One that is damaged, which no one asks for.
    damaged = Store(out).run_file(key("least_squares", 1))
    damaged.write_text("{", "utf-8")
    assert run([other], [], 1, out).stale == (key("least_squares", 1), key("mine", 1))

    # A scenario: of all other runs, even where the file is not known any more.
    short_scenario(tmp_path, "Short-v0", **{"force_amplitude_N = 1.2": "force_amplitude_N = 1.3"})
    for selected in (scenario, other):
        assert len(run([selected], [], 1, out).stale) == 2 + 2 + 2
        assert seen() == {"null 0", "oracle 0"}

    # The code: of all that is not run again.
    monkeypatch.setattr(provenance, "code_digest", lambda: "another")
    assert len(run([other], [], 1, out).stale) == 2 + 2 + 2 + 2
    assert set(Store(out).scores()["scenario"]) == {"Other-v0"}
    monkeypatch.undo()
    estimator_file(tmp_path, "mine", text)
    short_scenario(tmp_path, "Short-v0")
    assert run([scenario], [mine, "least_squares"], 2, out).stale == (
        RunKey("Other-v0", "null", 0),
        RunKey("Other-v0", "oracle", 0),
    )


def test_an_estimator_whose_weights_have_changed_is_run_again(tmp_path: Path, scenario: str) -> None:
    body = "value = float(open(__file__.replace('.py', '.weights')).read())\n        "
    mine = estimator_file(tmp_path, "mine", FIT + body + f"return {LIKE_NULL}\n".replace("0.0", "value"))
    weights, store = tmp_path / "mine.weights", Store(tmp_path / "out")
    for value in ("0.25", "0.75"):
        weights.write_text(value, "utf-8")
        assert run([scenario], [mine], 1, store.folder).computed > 0
        kept = store.read_estimate(key("mine"))
        assert kept is not None
        assert set(kept.estimate.parameters.values()) == {float(value)}
    assert run([scenario], [mine], 1, store.folder).computed == 0
    (tmp_path / "mine.link").symlink_to(weights)
    assert run([scenario], [mine], 1, store.folder).computed == 0


def test_an_estimator_whose_helper_has_changed_is_run_again(
    tmp_path: Path, scenario: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(job, "_kept", job._Kept())  # workers that are on this path
    body = f"return {LIKE_NULL}\n".replace("0.0", "a_helper.value")
    mine = estimator_file(tmp_path, "mine", "import a_helper\n" + FIT + body)
    (tmp_path / "a_helper.py").write_text("from below_a_helper import value\n", "utf-8")
    store = Store(tmp_path / "out")
    for value in (0.25, 0.75):
        (tmp_path / "below_a_helper.py").write_text(f"value = {value}\n", "utf-8")
        assert run([scenario], [mine], 1, store.folder).computed > 0
        kept = store.read_estimate(key("mine"))
        assert kept is not None
        assert set(kept.estimate.parameters.values()) == {value}
    job.sandbox(WorkerLimits()).close()


def test_this_package_is_no_helper(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "fdbench"
    package.mkdir()
    (package / "scenario.py").write_text("", "utf-8")
    for folder, imported in ((tmp_path, "fdbench.scenario"), (package, "scenario")):
        file = Path(estimator_file(folder, "mine", f"import {imported}\n"))
        monkeypatch.setattr(terms, "PACKAGE", package)
        assert terms.own_files(file) == (file,)
        monkeypatch.setattr(terms, "PACKAGE", tmp_path / "another")
        assert set(terms.own_files(file)) == {file, package / "scenario.py"}


def test_what_a_run_has_written_is_nobodys_own(tmp_path: Path) -> None:
    oracle = tmp_path / "estimates" / "Short-v0" / "oracle"
    oracle.mkdir(parents=True)
    (tmp_path / "run.json").touch()
    for folder, name, beside in (
        (tmp_path, "parameters", ".parquet"),
        (tmp_path, "seal", ".json"),
        (oracle, "0", ".parquet"),
    ):
        file = Path(estimator_file(folder, name, ""))
        weights = folder / f"{name}.weights"
        file.with_suffix(beside).touch()
        weights.touch()
        assert set(terms.own_files(file)) == ({file, weights} if folder == tmp_path else {file})


def test_of_two_runs_at_once_the_tables_hold_all(tmp_path: Path, scenario: str) -> None:
    out, other = tmp_path / "out", short_scenario(tmp_path, "Other-v0")

    def run_beside(progress: Progress) -> None:
        if not progress.runs:
            run([other], ["krls_t"], 1, out)

    assert run([scenario], ["least_squares"], 1, out, progress=run_beside).others == 3
    assert set(Store(out).scores()["estimator"]) == {"least_squares", "krls_t", "null", "oracle"}


def test_an_installed_estimator_that_has_changed_is_left_out(
    tmp_path: Path, scenario: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    run([scenario], ["least_squares"], 1, tmp_path / "out")
    edited = tmp_path / "edited.py"
    edited.write_text("")
    monkeypatch.setattr("fdbench.benchmark.selection.source_files", lambda module: [edited])
    assert key("least_squares") in run([scenario], [], 1, tmp_path / "out").stale


# ---- processes ----


def test_processes_use_one_thread_of_linear_algebra(tmp_path: Path, scenario: str) -> None:
    import fdbench.cli  # noqa: F401 (sets the variable)

    body = "import os\n        return Estimate(parameters={'beta_1': float(os.environ['OPENBLAS_NUM_THREADS'])})\n"
    run([scenario], [estimator_file(tmp_path, "counts_threads", FIT + body)], 2, tmp_path / "out", jobs=2)
    kept = Store(tmp_path / "out").read_estimate(key("counts_threads"))
    assert kept is not None
    assert kept.estimate.parameters == {"beta_1": 1.0}


def test_two_processes_give_the_same_scores(tmp_path: Path, scenario: str) -> None:
    text = COUNTS.replace("return", "return Estimate(output=np.array(context.regression(record).target)) #")
    files = [estimator_file(tmp_path, name, text) for name in ("copies", "copies_too")]
    seen: list[tuple[int, int]] = []
    for jobs, out in ((1, tmp_path / "one"), (2, tmp_path / "two")):
        run([scenario], files, 2, out, jobs=jobs, progress=lambda p: seen.append((p.done, p.total)))
    assert seen == [(0, 2), (1, 2), (2, 2)] * 2
    one, two = (Store(tmp_path / name).scores() for name in ("one", "two"))
    slow = one["metric"] == "microseconds_per_sample"
    columns = [name for name in one if name not in ("seconds", "peak_memory_MB", "utc", "run_id")]
    assert one[columns][~slow].equals(two[columns][~slow])
    assert Store(tmp_path / "one").parameters().equals(Store(tmp_path / "two").parameters())


def test_processes_that_live_on_run_an_edited_file_as_it_is_now(tmp_path: Path, scenario: str) -> None:
    store = Store(tmp_path / "out")
    for value in ("0.25", "0.75"):
        edited = estimator_file(tmp_path, "edited", FIT + f"return {LIKE_NULL}\n".replace("0.0", value))
        run([scenario], [edited], 2, store.folder, jobs=2)
        kept = store.read_estimate(key("edited"))
        assert kept is not None
        assert set(kept.estimate.parameters.values()) == {float(value)}


def test_the_global_random_state_is_left_alone(tmp_path: Path, scenario: str) -> None:
    before = np.random.get_state()[1].copy()  # type: ignore[index] # noqa: NPY002
    run([scenario], ["least_squares"], 1, tmp_path)
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # type: ignore[index] # noqa: NPY002


# ---- estimates ----


def regression(n: int = 4) -> Regression:
    return Regression(
        regressors=np.ones((n, 2)),
        target=np.arange(float(n)),
        names=("a", "b"),
        target_name="velocity_m_per_s",
        time_s=np.arange(float(n)),
        rows=np.arange(n),
        disturbance_gain=1.0,
    )


@pytest.mark.parametrize(
    ("claims", "message"),
    [
        ({"parameters": {"a": "1"}}, r"parameters\['a'\] is a str, expected a number"),
        ({"parameters": {"a": 1j}}, "is a complex, expected a number"),
        ({"parameters": {1: 1.0}}, "has the key 1, expected a name"),
        ({"parameters": {"mass_kg": 1.0}}, r"\['mass_kg'\]: the model has no such parameter\. Allowed: a, b\."),
        ({"parameters": [1.0]}, "parameters is a list, expected a mapping"),
        ({"parameters": {"a": float("inf")}}, r"\['a'\] is inf, expected a finite number"),
        ({"parameters": {"a": 1.0}, "covariance": np.eye(2)}, r"covariance has shape \(2, 2\), expected \(1, 1\)"),
        ({"parameters": {"a": 1.0}, "covariance": -np.eye(1)}, "diagonal of covariance holds -1.0 in row 0"),
        ({"disturbance_N": np.zeros((4, 1))}, r"disturbance_N has shape \(4, 1\), expected \(4,\), one value for each"),
        (
            {"output": np.array([0.0, 1.0, np.nan, np.inf])},
            r"output holds nan in row 2: not finite, or beyond .* \(2 of 4\)",
        ),
        ({"output": np.array(["a"] * 4)}, "expected real numbers"),
        ({"output_variance": np.array([1.0, 1.0, -1.0, 1.0])}, "output_variance holds -1.0 in row 2: no variance"),
        ({"disturbance_variance_N2": np.full(4, np.nan)}, "disturbance_variance_N2 holds nan in row 0"),
    ],
)
def test_estimates_that_break_the_contract_are_refused(claims: dict[str, Any], message: str) -> None:
    with pytest.raises(PluginError, match=message):
        check_estimate(Estimate(**claims), regression())


def test_sound_estimates_pass() -> None:
    check_estimate(Estimate(), regression())
    check_estimate(Estimate(parameters={"mass_kg": 1.0}), regression(), ["mass_kg"])
    check_estimate(
        Estimate(
            parameters={"a": 1, "b": np.float64(2.0)},
            covariance=np.eye(2),
            output=np.arange(4.0),
            output_variance=np.full(4, np.inf),
        ),
        regression(),
    )


# ---- provenance ----


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "plugins_of_a_test"
    folder.mkdir()
    files = {
        "__init__": "",
        "method": "import os\n\ndef late():\n    from plugins_of_a_test.helper import thing\n",
        "helper": "from . import deeper\nfrom .damaged import x\n",
        "deeper": "import plugins_of_a_test.method\n",
        "damaged": "def (\n",
        "other": "",
    }
    for name, text in files.items():
        (folder / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    return folder


def test_an_estimator_is_what_its_package_makes_of_it(package: Path) -> None:
    names = {path.stem for path in provenance.source_files("plugins_of_a_test.method")}
    assert names == {"__init__", "method", "helper", "deeper", "damaged"}


def test_the_digest_follows_sources_and_arguments(package: Path) -> None:
    def digest(**arguments: float) -> str:
        return provenance.estimator_digest(provenance.source_files("plugins_of_a_test.method"), arguments)

    before = digest(a=1.0, b=2.0)
    assert digest(b=2.0, a=1.0) == before
    assert digest(a=1.0, b=2.5) != before
    (package / "other.py").write_text("x = 1\n")
    assert digest(a=1.0, b=2.0) == before
    (package / "deeper.py").write_text("x = 1\n")
    assert digest(a=1.0, b=2.0) != before


def test_the_code_digest_covers_what_makes_scores_and_nothing_else() -> None:
    covered = {path.relative_to(provenance.PACKAGE).as_posix() for path in provenance._code_of_packages()}
    assert {"record.py", "simulate/integrator.py", "benchmark/job.py", "metrics/parameter_error.py"} <= covered
    assert not {"benchmark/leaderboard.py", "benchmark/compare.py", "cli.py", "commands/run.py"} & covered


def test_runs_belong_together_if_they_are_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("FDBENCH_RUN_ID", raising=False)
    assert provenance.provenance()["run_id"] != provenance.provenance()["run_id"]
    monkeypatch.setenv("FDBENCH_RUN_ID", "42")
    assert provenance.provenance()["run_id"] == "42"


def test_the_commit_is_that_of_the_checkout() -> None:
    head = subprocess.run(
        ["git", "rev-parse", "HEAD"], cwd=REPOSITORY, capture_output=True, text=True, check=False
    ).stdout.strip()
    tracked = subprocess.run(["git", "ls-files", "--error-unmatch", "fdbench/__init__.py"], cwd=REPOSITORY, check=False)
    assert provenance.commit().removesuffix("-dirty") == (head if tracked.returncode == 0 else "")
