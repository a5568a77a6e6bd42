"""Workers load what was compiled without any plug-in, and cannot change it."""

import pickle
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from fdbench.benchmark.provenance import estimator_source
from fdbench.estimator import estimators
from fdbench.record import FloatArray, Record
from fdbench.sandbox import Sandbox, Source, WorkerLimits
from fdbench.sandbox.server import _OwnUnpickler
from fdbench.scenario import Scenario, load_scenario

PLANTS = """
import os
from pathlib import Path
from fdbench import compilation
from fdbench.estimator import BatchEstimator, Estimate


class Plants(BatchEstimator):
    \"\"\"Writes where others load from.\"\"\"

    def fit(self, context, record):
        shared, own = compilation._trusted[0], Path(os.environ["FDBENCH_CACHE"], "planted")
        own.write_text("planted")
        files = [file for file in shared.rglob("*") if file.is_file()]
        attempts = [lambda file=file: file.write_text("planted") for file in files]
        attempts += [lambda file=file: os.replace(own, file) for file in files]
        attempts += [lambda: os.symlink(own, shared / "planted"), lambda: (shared / "planted").mkdir()]
        refused = 0
        for attempt in attempts:
            try:
                attempt()
            except OSError:
                refused += 1
        return Estimate(parameters={"attempts": float(len(attempts)), "refused": float(refused), "files": len(files)})
"""


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return load_scenario("BallScrewAxis-v1")


@pytest.fixture(scope="module")
def record(scenario: Scenario) -> Record:
    return scenario.observe(0)[0]


@pytest.fixture(scope="module")
def expected(scenario: Scenario, record: Record) -> FloatArray:
    """Return the prediction of this process."""
    context, command = scenario.context(), scenario.command()
    assert command is not None
    own = estimators.get("least_squares")()
    found: FloatArray = own.predict(context, own.fit(context, record), command)
    return found


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory, expected: FloatArray) -> Iterator[Path]:
    """Return an empty cache; this process has compiled before what it needs."""
    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FDBENCH_CACHE", str(folder))
        yield folder


@pytest.fixture(scope="module")
def prepared(cache: Path, scenario: Scenario) -> Iterator[Sandbox]:
    """Return a sandbox in which the predictions of a scenario are prepared."""
    command = scenario.command()
    assert command is not None
    with closing(Sandbox(WorkerLimits())) as sandbox:
        sandbox.prepare(scenario.id, pickle.dumps(scenario.context()), command)
        yield sandbox


def contents(folder: Path) -> dict[Path, bytes]:
    return {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}


def test_a_worker_predicts_with_what_was_compiled_for_all(
    prepared: Sandbox, cache: Path, scenario: Scenario, record: Record, expected: FloatArray
) -> None:
    command = scenario.command()
    assert command is not None
    assert list((cache / "sandbox" / "shared").rglob("stepper_*.advance*.nbc"))
    worker = prepared.worker(estimator_source("least_squares"))
    worker.load()
    worker.begin({}, scenario.context())
    worker.fit(record)
    response = worker.predict(command)
    assert not list((cache / "sandbox" / "installed").rglob("stepper_*"))
    assert response is not None
    np.testing.assert_array_equal(response, expected)


def test_a_plugin_cannot_change_what_others_load(
    prepared: Sandbox, cache: Path, scenario: Scenario, record: Record, tmp_path: Path
) -> None:
    file = tmp_path / "plants.py"
    file.write_text(PLANTS, "utf-8")
    before = contents(cache / "sandbox" / "shared")
    worker = prepared.worker(Source(name="plants", own=(file,), digest="planted", file=file))
    worker.load()
    worker.begin({}, scenario.context())
    claimed = worker.fit(record).estimate.parameters
    assert claimed["files"] == len(before) > 2
    assert claimed["refused"] == claimed["attempts"]
    assert contents(cache / "sandbox" / "shared") == before


def test_the_process_that_compiles_for_all_unpickles_no_plugin(tmp_path: Path) -> None:
    file = tmp_path / "context.pickle"
    file.write_bytes(pickle.dumps(contents))
    with file.open("rb") as stream, pytest.raises(pickle.UnpicklingError, match="neither of this package nor of NumPy"):
        _OwnUnpickler(stream).load()
