"""A package of a third party: installed by pip, found by its entry point, listed and run."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import REPOSITORY
from short_scenario import short_scenario

from fdbench.benchmark.store import Store


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder that the package is installed into, from its sources and without a network."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
    package = REPOSITORY / "examples" / "fdbench_example"
    done = subprocess.run([*command, "--target", folder, package], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


# Several commands in one process, as starting one costs seconds.
PROGRAM = """
import json, sys
from typer.testing import CliRunner
from fdbench.cli import app
for command in json.load(sys.stdin):
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.output
    print(done.output)
"""


def fdbench(site: Path, *commands: list[str]) -> str:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        input=json.dumps(commands),
        env={**os.environ, "PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_its_estimator_is_one_among_the_others(installed: Path, tmp_path: Path) -> None:
    scenario, out = short_scenario(tmp_path, "Short-v0"), tmp_path / "out"
    selection = ["--scenario", scenario, "--estimator", "example", "--estimator", "example[step=0.1]"]
    printed = fdbench(
        installed,
        ["list", "estimators"],
        ["run", *selection, "--seeds", "1", "--jobs", "1", "--no-report", "--out", str(out)],
    )
    assert {"example", "krls_t", "oracle"} <= {line.split()[0] for line in printed.splitlines() if line.strip()}
    scores = Store(out).scores()
    assert set(scores[scores["status"] == "ok"]["estimator"]) == {"example", "example[step=0.1]", "null", "oracle"}
