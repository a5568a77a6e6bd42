"""Workers have what was compiled before they were forked, and reach nothing that others load."""

import shutil
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from fdbench.benchmark.provenance import estimator_source
from fdbench.estimator import estimators
from fdbench.record import FloatArray, Record
from fdbench.sandbox import Sandbox, Source, WorkerLimits
from fdbench.scenario import Scenario, load_scenario
from fdbench.simulate.compose import cache_folder

PLANTS = """
import os
from pathlib import Path
from fdbench.estimator import BatchEstimator, Estimate


class Plants(BatchEstimator):
    \"\"\"Writes where others load from.\"\"\"

    def fit(self, context, record):
        own = Path(os.environ["FDBENCH_CACHE"], "planted")
        own.write_text("planted")
        cache, files = own.parents[3], FILES
        attempts = [lambda file=file: open(file).read() for file in files]
        attempts += [lambda file=file: open(file, "w") for file in files]
        attempts += [lambda file=file: os.replace(own, file) for file in files]
        attempts += [lambda: os.symlink(own, cache / "planted"), lambda: (cache / "planted").mkdir()]
        refused = 0
        for attempt in attempts:
            try:
                attempt()
            except OSError:
                refused += 1
        return Estimate(parameters={"attempts": float(len(attempts)), "refused": float(refused)})
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
    """Return a copy of the cache, which holds what simulated ``expected``."""
    folder = tmp_path_factory.mktemp("copy") / "cache"
    shutil.copytree(cache_folder(), folder, ignore=shutil.ignore_patterns("sandbox"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FDBENCH_CACHE", str(folder))
        yield folder


@pytest.fixture(scope="module")
def sandbox(cache: Path) -> Iterator[Sandbox]:
    """Return a sandbox, the server of which has loaded the nominal machines when it has a worker."""
    with closing(Sandbox(WorkerLimits())) as sandbox:
        sandbox.worker(estimator_source("least_squares")).load()
        yield sandbox


def machine_code(cache: Path) -> dict[Path, bytes]:
    """Return what lies beside the folders of the workers."""
    files = (file for file in cache.rglob("*") if file.is_file())
    return {file: file.read_bytes() for file in files if cache / "sandbox" not in file.parents}


def test_a_worker_predicts_with_what_was_compiled_for_all(
    sandbox: Sandbox, cache: Path, scenario: Scenario, record: Record, expected: FloatArray
) -> None:
    command = scenario.command()
    assert command is not None
    assert any(file.match("stepper_*.advance*.nbc") for file in machine_code(cache))
    worker = sandbox.worker(estimator_source("least_squares"))
    worker.begin({}, scenario.context())
    worker.fit(record)
    response = worker.predict(command)
    assert not list((cache / "sandbox").rglob("stepper_*"))
    assert response is not None
    np.testing.assert_array_equal(response, expected)


def test_a_plugin_reaches_nothing_that_others_load(
    sandbox: Sandbox, cache: Path, scenario: Scenario, record: Record, tmp_path: Path
) -> None:
    file, before = tmp_path / "plants.py", machine_code(cache)
    file.write_text(PLANTS.replace("FILES", str([str(path) for path in before])), "utf-8")
    worker = sandbox.worker(Source(name="plants", own=(file,), digest="planted", file=file))
    worker.load()
    worker.begin({}, scenario.context())
    claimed = worker.fit(record).estimate.parameters
    assert claimed["attempts"] > 3 * len(before) > 6
    assert claimed["refused"] == claimed["attempts"]
    assert machine_code(cache) == before
