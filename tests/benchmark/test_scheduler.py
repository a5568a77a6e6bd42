"""`--scheduler`: two workers of a real scheduler do the same, bit for bit, without the folder of the results."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from conftest import shared_file
from short_scenario import short_scenario

from fdbench.benchmark.provenance import provenance
from fdbench.benchmark.run import Progress, run
from fdbench.benchmark.store import RunKey, Store
from fdbench.commands.new import written
from fdbench.errors import FdbenchError
from fdbench.estimator import estimators
from fdbench.scenario import load_scenario
from fdbench.trials import seal
from fdbench.trials.answer import answer
from fdbench.trials.diagnoser import diagnosers
from fdbench.trials.make import MANIFEST, MODEL
from fdbench.virtual_axes.cases import AXIS

pytest.importorskip("distributed", reason="Dask is not installed: pip install 'fdbench[dask]'")

START_S = 60.0

# Reads a file of its own, and says in which process it was.
OWN = """
from pathlib import Path
from fdbench.estimator import BatchEstimator, Estimate

class Own(BatchEstimator):
    'Says what its weights are.'

    def fit(self, context, record):
        return Estimate(parameters={"beta_1": float(Path(__file__).with_suffix(".weights").read_text())})
"""


@dataclass
class Cluster:
    """A scheduler with workers, each a process on this machine with a folder of its own."""

    folder: Path
    processes: list["subprocess.Popen[bytes]"] = field(default_factory=list)

    @property
    def address(self) -> str:
        file = self.folder / "scheduler.json"
        deadline = time.monotonic() + START_S
        while not file.is_file():
            assert time.monotonic() < deadline, "no scheduler"
            time.sleep(0.05)
        return str(json.loads(file.read_text("utf-8"))["address"])

    def start(self, what: str, *arguments: str) -> "subprocess.Popen[bytes]":
        place = self.folder / f"{what}-{len(self.processes)}"
        place.mkdir()
        command = [sys.executable, "-m", "distributed.cli.dask_" + what, *arguments]
        with (place / "log").open("wb") as log:
            process = subprocess.Popen(command, cwd=place, stdout=log, stderr=log, start_new_session=True)
        self.processes.append(process)
        return process

    def worker(self) -> "subprocess.Popen[bytes]":
        return self.start("worker", self.address, "--nthreads", "1", "--no-dashboard", "--no-nanny")


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    made = Cluster(tmp_path_factory.mktemp("cluster"))
    file = str(made.folder / "scheduler.json")
    made.start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", file)
    for _ in range(2):
        made.worker()
    yield made
    for process in made.processes:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait(START_S)


@pytest.fixture(autouse=True)
def _own_plugin_files(monkeypatch: pytest.MonkeyPatch) -> None:
    for registry in (estimators, diagnosers):
        monkeypatch.setattr(registry, "_files", {})


def contents(folder: Path) -> dict[str, object]:
    """Return all that runs leave, but times, versions of one run and memory."""
    found: dict[str, object] = {}
    for path in sorted(folder.rglob("*.parquet")):
        if path.parent != folder:
            found[str(path.relative_to(folder))] = path.read_bytes()
    for key in Store(folder).run_keys():
        kept = Store(folder).read_run(key)
        assert kept is not None
        values = [
            (s.metric, s.value, s.status, s.message) for s in kept.scores if s.metric != "microseconds_per_sample"
        ]
        origin = {name: text for name, text in kept.provenance.items() if name not in ("utc", "run_id")}
        found[str(key)] = (kept.status, kept.message, values, kept.parameters, origin)
    return found


def test_results_are_those_of_a_run_here(cluster: Cluster, tmp_path: Path) -> None:
    place = tmp_path / "mine"
    place.mkdir()
    scenario, own = short_scenario(place, "Short-v0"), place / "own.py"
    own.write_text(OWN, "utf-8")
    (place / "own.weights").write_text("0.125", "utf-8")
    selection = [str(own), "least_squares", "least_squares[window_s=0.1]"]
    run([scenario], selection, 3, tmp_path / "here", keep_estimates=True)
    seen: list[int] = []
    out = tmp_path / "there"
    summary = run(
        [scenario], selection, 3, out, scheduler=cluster.address, keep_estimates=True,
        progress=lambda told: seen.append(len(Store(out).run_keys())),
    )  # fmt: skip
    assert summary.statuses == {"ok": 15, "failed": 0, "diverged": 0, "skipped": 0}
    assert seen == [0, 5, 10, 15]  # each job's runs are there when it is told
    assert contents(out) == contents(tmp_path / "here")
    estimate = Store(out).read_estimate(RunKey("Short-v0", "own", 2))
    assert estimate is not None
    assert estimate.estimate.parameters == {"beta_1": 0.125}


def test_an_edited_file_is_another_one_on_the_workers_too(cluster: Cluster, tmp_path: Path) -> None:
    scenario, own, out = short_scenario(tmp_path, "Short-v0"), tmp_path / "own.py", tmp_path / "out"
    own.write_text(OWN, "utf-8")
    for value in (0.25, 0.5):
        (tmp_path / "own.weights").write_text(str(value), "utf-8")
        run([scenario], [str(own)], 1, out, scheduler=cluster.address)
        kept = Store(out).read_estimate(RunKey("Short-v0", "own", 0))
        assert kept is not None
        assert kept.estimate.parameters == {"beta_1": value}


def test_a_worker_with_other_code_says_so(cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other = {**provenance(), "code_digest": "other"}
    monkeypatch.setattr("fdbench.benchmark.run.provenance", lambda: other)
    with pytest.raises(FdbenchError, match=r"code: the worker on \S+ has another version of fdbench"):
        run([short_scenario(tmp_path, "Short-v0")], [], 1, tmp_path / "out", scheduler=cluster.address)
    assert Store(tmp_path / "out").run_keys() == []


def test_a_worker_with_other_measured_data_says_so(
    cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shared_file("data", "emps", "DATA_EMPS.mat")
    monkeypatch.setenv("FDBENCH_DATA", str(tmp_path))
    with pytest.raises(FdbenchError, match=r"scenario EMPS-v1: .* has another version of it or of its measured data"):
        run(["EMPS-v1"], [], 1, tmp_path / "out", scheduler=cluster.address)


def test_a_trial_is_answered_as_here(cluster: Cluster, tmp_path: Path) -> None:
    """By a diagnoser of a file, which says something else of each case."""
    folder, own = tmp_path / "trial", tmp_path / "mean_force.py"
    own.write_text(written("diagnoser", "mean_force")[Path("mean_force.py")], "utf-8")
    diagnosers.add_file(own)
    cases = {}
    for seed, name in enumerate(("first", "second")):
        place = folder / name / "records"
        place.mkdir(parents=True)
        load_scenario("LinearMotorAxis-v0").record(seed).save(place / "run.parquet")
        (place.parent / MODEL).write_bytes(AXIS.read_bytes())
        files = {file: seal.file_digest(place.parent / file) for file in ("records/run.parquet", MODEL)}
        cases[name] = {"files": files, "truth_sha256": ""}
    manifest = {"cases": cases, "commit": "", "effects": ["constant_force"], "nonce_sha256": "", "tier": "A"}
    seal.write_json(folder / MANIFEST, manifest)
    here = answer(folder, "mean_force", tmp_path / "here.json")
    there = answer(folder, "mean_force", tmp_path / "there.json", scheduler=cluster.address)
    for found in (here, there):
        assert all(case.pop("seconds") > 0.0 for case in found["cases"].values())
        assert {case["status"] for case in found["cases"].values()} == {"ok"}
    assert list(there["cases"]) == list(here["cases"])
    assert there == here


def test_a_worker_that_is_killed_loses_nothing(cluster: Cluster, tmp_path: Path) -> None:
    from distributed import Client

    scenario = short_scenario(tmp_path, "Short-v0")
    lost: list[int] = []
    with Client(cluster.address, set_as_default=False) as client:
        victim = cluster.processes[-1]
        pids = client.run(os.getpid)
        (address,) = (worker for worker, pid in pids.items() if pid == victim.pid)

        def kill(told: Progress) -> None:
            if told.done == 2:
                lost.append(len(client.processing()[address]))
                os.killpg(victim.pid, signal.SIGKILL)

        summary = run([scenario], [], 16, tmp_path / "there", scheduler=cluster.address, progress=kill)
        assert address not in client.nthreads()
    assert lost[0] > 0
    assert summary.statuses["ok"] == summary.computed == 16 * 2
    run([scenario], [], 16, tmp_path / "here")
    assert contents(tmp_path / "there") == contents(tmp_path / "here")


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nowhere"])
def test_no_scheduler_is_told(address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fdbench.cluster.CONNECT_S", 1.0)
    with pytest.raises(FdbenchError, match=rf"--scheduler {address}: no Dask scheduler answers there"):
        run([short_scenario(tmp_path, "Short-v0")], [], 1, tmp_path / "out", scheduler=address)


def test_processes_and_a_scheduler_exclude_each_other(tmp_path: Path) -> None:
    with pytest.raises(FdbenchError, match="leave out one of the two"):
        run(["ShakerConstant-v0"], [], 1, tmp_path / "out", scheduler="tcp://127.0.0.1:1", jobs=2)
    assert not (tmp_path / "out").exists()
