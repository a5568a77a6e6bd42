"""Shared fixtures: where the reference data lie, and registries that no module leaves a file in."""

import gc
import importlib.util
import os
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest
from threadpoolctl import threadpool_limits

# As on the command line. Threads of several tests at once would wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
threadpool_limits(1)

# Of each of its many attempts at a type that fails, numba would else colour the message: some per cent of compiling.
os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")

REPOSITORY = Path(__file__).resolve().parent.parent

# Estimators that are run by a test, and must not be imported by it.
collect_ignore_glob = ["sandbox/cheats/*", "sandbox/misbehaving/*", "sandbox/neighbours/*"]

# Files that take longest, which begin first: none of them is left to one process at the end.
LONGEST = (
    "estimators/test_every_estimator.py",
    "diagnosis/test_diagnosis.py",
    "diagnosis/test_emps.py",
    "project/test_readme.py",
    "envs/test_every_env.py",
    "commands/test_cli.py",
    "effects/test_every_effect.py",
    "sandbox/test_misbehaving.py",
    "trials/test_small_trials.py",
    "virtual_axes/test_foreign.py",
    "scenarios/test_every_scenario.py",
    "test_compilation.py",
    "checks/test_every_plugin.py",
    "trials/test_machine_calibration.py",
    "benchmark/test_benchmark.py",
    "plants/test_servo_stage.py",
    "benchmark/test_compare.py",
    "test_api.py",
    "plants/test_spindle_testbed.py",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the longest files first; the order within a file stays."""
    places = {REPOSITORY / "tests" / name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get(item.path, len(LONGEST)))


def pytest_collection_finish() -> None:
    """Look for cycles of objects rarely, and never among what was collected: to compile makes many that stay."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 20)


def shared_file(*parts: str) -> Path:
    """Return the path of a reference file, or skip the test with the reason that it is absent."""
    folder = Path(os.environ.get("FDBENCH_SHARED", REPOSITORY.parent / "shared"))
    path = folder.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"reference data {'/'.join(parts)} not present; set FDBENCH_SHARED to the folder that holds it")
    return path


def script_of_docs(name: str) -> ModuleType:
    """Import a script of the documentation, which is part of no package."""
    specification = importlib.util.spec_from_file_location(name, REPOSITORY / "docs" / f"{name}.py")
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.fixture(scope="session", autouse=True)
def measured_data() -> None:
    """Let measured scenarios find the reference data, unless the user has named a folder of their own."""
    folder = Path(os.environ.get("FDBENCH_SHARED", REPOSITORY.parent / "shared")) / "data"
    if folder.is_dir():
        os.environ.setdefault("FDBENCH_DATA", str(folder))


@pytest.fixture(scope="module", autouse=True)
def registries_of_the_module() -> Iterator[None]:
    """Let no plug-in file of one module be known to the next, which may differ with the load of the machine."""
    from fdbench.benchmark.provenance import SIMULATION
    from fdbench.estimator import estimators

    with pytest.MonkeyPatch.context() as patch:
        for registry in (*SIMULATION, estimators):
            patch.setattr(registry, "_files", {})
        yield


@pytest.fixture
def own_plugin_files(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no estimator file of one test be known to the next."""
    from fdbench.estimator import estimators

    monkeypatch.setattr(estimators, "_files", {})
