"""Estimators that look for the truth, that change what is not theirs and that speak for others gain nothing by it."""

import re
import shutil
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fdbench
from fdbench.benchmark.run import run
from fdbench.benchmark.store import RunKey, Store
from fdbench.estimator import estimators
from fdbench.metrics import metrics
from fdbench.sandbox import Sandbox, Source, WorkerLimits, landlock, seccomp
from fdbench.sandbox.confine import common_reach
from fdbench.scenario import load_scenario
from fdbench.simulate.compose import cache_folder

CHEATS = sorted((Path(__file__).parent / "cheats").glob("*.py"))
SCENARIO = "ShakerConstant-v1"
PRIMARY = [name for name in metrics.names() if metrics.get(name).primary]


@pytest.fixture(scope="module")
def stores(tmp_path_factory: pytest.TempPathFactory) -> tuple[Store, Store]:
    """Return the results of a run without cheats, which lie beside the cheats' files, and of one with all of them."""
    folder = tmp_path_factory.mktemp("cheats")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(estimators, "_files", {})
        patch.chdir(folder)
        patch.setenv("PWD", str(folder))
        run([SCENARIO], ["least_squares"], 1, "results")
        (folder / "follow_link.weights").symlink_to("results")
        files = [str(shutil.copy(file, folder)) for file in CHEATS]
        run([SCENARIO], [*files, "least_squares"], 1, "with_cheats", time_limit_s=60.0)
    return Store(folder / "results"), Store(folder / "with_cheats")


def primary(scores: Any, estimator: str) -> dict[str, float]:
    """Return the primary metrics of one estimator; those that failed have their worst value."""
    rows = scores[(scores["estimator"] == estimator) & scores["metric"].isin(PRIMARY)]
    return {
        row.metric: row.value if row.status == "ok" else metrics.get(row.metric).worst
        for row in rows.itertuples()
        if row.status != "skipped"
    }


@pytest.mark.parametrize("cheat", [file.stem for file in CHEATS])
def test_a_cheat_is_no_better_than_having_learnt_nothing(cheat: str, stores: tuple[Store, Store]) -> None:
    if cheat == "native_read" and not landlock.version():
        pytest.skip("this system has no Landlock, and an audit hook does not see compiled code")
    scores = stores[1].scores()
    nothing, found = primary(scores, "null"), primary(scores, cheat)
    assert found
    assert all(found[name] >= nothing[name] for name in found)


def test_the_rows_of_others_are_the_same_to_the_bit(stores: tuple[Store, Store]) -> None:
    columns = ["estimator", "metric", "value", "status", "message"]
    without, beside = (
        store.scores().query("estimator in ['least_squares', 'null', 'oracle'] and metric != 'microseconds_per_sample'")
        for store in stores
    )
    assert without[columns].reset_index(drop=True).equals(beside[columns].reset_index(drop=True))
    for name in ("least_squares", "oracle"):
        kept = [store.read_estimate(RunKey(SCENARIO, name, 0)) for store in stores]
        np.testing.assert_array_equal(kept[0].estimate.output, kept[1].estimate.output)  # type: ignore[union-attr]


def test_a_link_beside_what_can_be_imported_is_out_of_reach(tmp_path: Path) -> None:
    truth, folder = tmp_path / "truth.parquet", tmp_path / "on_the_path"
    folder.mkdir()
    truth.touch()
    (folder / "helper.py").touch()
    (folder / "linked.py").symlink_to(truth)
    read = common_reach([str(folder)]).read
    assert str(folder / "helper.py") in read
    assert str(truth) not in read


def test_nothing_is_left_where_code_is_loaded_from(stores: tuple[Store, Store]) -> None:
    package = Path(fdbench.__file__).parent
    assert not list(package.rglob("poisoned_by_a_cheat"))
    assert not (Path.home() / ".cache" / "fdbench" / "poisoned_by_a_cheat").exists()
    assert not (cache_folder() / "poisoned_by_a_cheat").exists()
    assert not (stores[1].folder.parent / "poisoned_by_a_cheat").exists()


@pytest.mark.skipif(not landlock.version(), reason="this system has no Landlock")
def test_the_rows_say_what_they_were_confined_by(stores: tuple[Store, Store]) -> None:
    scores = stores[1].scores()
    others = ", seccomp" if seccomp.is_available() else ""
    assert (scores["confinement"] == f"Landlock {landlock.version()}{others} and audit hook").all()
    assert (scores["time_limit_s"] == "60").all()
    assert (scores["memory_limit_MB"] == "4096").all()


def test_without_landlock_the_audit_hook_alone_refuses_and_the_rows_say_so(
    stores: tuple[Store, Store], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(stores[0].folder, tmp_path / "results")
    names = ("native_read", "poison_cache", "read_files", "replay_by_id")
    files = [str(shutil.copy(file, tmp_path)) for file in CHEATS if file.stem in names]
    prying = tmp_path / "prying.py"
    body = f"        open({str(tmp_path / 'results' / 'scores.parquet')!r}, 'rb')"
    text = (Path(__file__).parent / "misbehaving" / "raises_key_error.py").read_text("utf-8")
    prying.write_text(text[: text.index("    def fit")] + f"    def fit(self, context, record):\n{body}\n", "utf-8")
    monkeypatch.setattr(estimators, "_files", {})
    monkeypatch.setattr(landlock, "version", lambda: 0)
    monkeypatch.setattr(seccomp, "is_available", lambda: False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PWD", str(tmp_path))
    run([SCENARIO], [*files, str(prying)], 1, "without", time_limit_s=1003.0)
    store = Store(tmp_path / "without")
    scores = store.scores()
    assert (scores["confinement"] == "audit hook").all()
    refused = store.read_run(RunKey(SCENARIO, "prying", 0))
    assert refused is not None
    assert re.fullmatch(r"prying\.py:\d+: an estimator may not read .*scores\.parquet", refused.message)
    nothing = primary(scores, "null")
    for cheat in names[1:]:
        found = primary(scores, cheat)
        assert found
        assert all(found[name] >= nothing[name] for name in found)
    # Compiled code gets through, so that Landlock is indeed off.
    assert primary(scores, "native_read")["parameter_error"] < 0.1 * nothing["parameter_error"]


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not tell the memory of another process")
def test_the_peak_memory_of_a_fit_is_its_own_and_not_what_it_says(tmp_path: Path) -> None:
    file = tmp_path / "takes_once.py"
    file.write_text(TAKES_ONCE, "utf-8")
    scenario = load_scenario(SCENARIO)
    record, _ = scenario.observe(0)
    with closing(Sandbox(WorkerLimits())) as sandbox:
        worker = sandbox.worker(Source(name="takes_once", own=(file,), digest="", file=file))
        worker.load()
        worker.begin({}, scenario.context())
        peaks_MB = [worker.fit(record).peak_memory_MB or 0.0 for _ in range(2)]
    assert peaks_MB[0] > 400.0
    assert peaks_MB[1] < peaks_MB[0] - 300.0


def test_the_peak_memory_is_in_the_tables(stores: tuple[Store, Store]) -> None:
    scores = stores[0].scores().groupby("estimator")["peak_memory_MB"].max()
    assert 20.0 < scores["least_squares"] < 4096.0
    assert np.isnan(scores["oracle"])


TAKES_ONCE = """
import numpy as np
from contextlib import suppress
from pathlib import Path
from fdbench.estimator import BatchEstimator, Estimate
taken = []
class TakesOnce(BatchEstimator):
    'Takes 400 MB in the first fit alone, and would have it forgotten.'
    def fit(self, context, record):
        if not taken:
            taken.append(float(np.ones(50_000_000).sum()))
            with suppress(OSError):
                Path('/proc/self/clear_refs').write_bytes(b'5')
        return Estimate()
"""
