"""Shared fixtures: where the reference data lie, and a numba cache of the tests' own."""

import os
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent


def shared_file(*parts: str) -> Path:
    """Return the path of a reference file, or skip the test with the reason that it is absent."""
    folder = Path(os.environ.get("FDBENCH_SHARED", REPOSITORY.parent / "shared"))
    path = folder.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"reference data {'/'.join(parts)} not present; set FDBENCH_SHARED to the folder that holds it")
    return path
