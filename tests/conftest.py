"""Shared fixtures: where the reference data lie, and registries that no module leaves a file in."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent

# Estimators that are run by a test, and must not be imported by it.
collect_ignore_glob = ["sandbox/cheats/*", "sandbox/misbehaving/*", "sandbox/neighbours/*"]


def shared_file(*parts: str) -> Path:
    """Return the path of a reference file, or skip the test with the reason that it is absent."""
    folder = Path(os.environ.get("FDBENCH_SHARED", REPOSITORY.parent / "shared"))
    path = folder.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"reference data {'/'.join(parts)} not present; set FDBENCH_SHARED to the folder that holds it")
    return path


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
