"""Shared fixtures: where the reference data lie, and a numba cache of the tests' own."""

import os
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent

# Estimators that are run by a test, and must not be imported by it.
collect_ignore_glob = ["sandbox/cheats/*", "sandbox/misbehaving/*"]


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
