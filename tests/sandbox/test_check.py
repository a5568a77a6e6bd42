"""`fdbench check` names whatever an estimator does in any of its fits, and exits with 1."""

import re
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from fdbench.checks import check, check_declared, check_estimator, declare
from fdbench.checks.check_estimator import has_a_possible_covariance, has_right_examples
from fdbench.cli import app
from fdbench.errors import PluginError
from fdbench.estimator import Estimate
from fdbench.sandbox import Sandbox, WorkerLimits

pytestmark = pytest.mark.usefixtures("own_plugin_files")

ONLINE = """
import ctypes, os, time
import numpy as np
from fdbench.errors import PluginError
from fdbench.estimator import Estimate, OnlineEstimator

starts = []

class Counts(OnlineEstimator):
    'Does as it likes in the fit of some number.'

    started = False

    def start(self, context):
        self.started = True
        starts.append(1)
        if len(starts) == {number}:
            {fault}

    def update(self, sample):
        if not self.started:
            raise PluginError('start comes first.')

    def estimate(self):
        return Estimate()
"""

FAULTS = {
    "os._exit(0)": r"counts\.py:18: an estimator may not end its process \(os\._exit\(0\)\)",
    "ctypes.CDLL(None)._exit(0)": r"ended its process with status 0, without an answer",
    "time.sleep(1e6)": r"counts\.py:18: took longer than 5 s",
    "while True: pass": r"counts\.py:18: took longer than 5 s",
    "np.ones(2**37)": r"counts\.py:18: needed more than 1024 MB of memory",
    "raise SystemExit(0)": r"counts\.py:18: SystemExit: 0",
}

# The number of a start, and the check that it is in.
FITS = {2: "is_deterministic", 5: "fits_again", 6: "leaves_global_random_state", 8: "streams_as_it_fits"}


@pytest.fixture(scope="module")
def sandbox() -> Iterator[Sandbox]:
    """Return one for the tests in which nothing ends, as each costs seconds."""
    with closing(Sandbox(WorkerLimits())) as made:
        yield made


def written(folder: Path, number: int, fault: str) -> str:
    file = folder / "counts.py"
    file.write_text(ONLINE.format(number=number, fault=fault), "utf-8")
    return str(file)


@pytest.mark.parametrize("fault", FAULTS)
def test_whatever_a_later_fit_does_is_named(fault: str, tmp_path: Path) -> None:
    number = 8 - list(FAULTS).index(fault) % 2
    name = {7: "can_be_pickled", **FITS}[number]
    with pytest.raises(PluginError, match=f"counts: {name}: .*{FAULTS[fault]}"):
        check(written(tmp_path, number, fault), WorkerLimits(time_s=5.0, memory_MB=1024.0))


@pytest.mark.parametrize("number", FITS)
def test_no_fit_ends_the_check_without_a_word(number: int, tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["check", written(tmp_path, number, "os._exit(0)")])
    assert result.exit_code == 1
    assert re.search(f"counts: {FITS[number]}: .*{FAULTS['os._exit(0)']}", result.stderr)


def test_one_that_does_nothing_wrong_passes(tmp_path: Path) -> None:
    assert all(line.endswith(": ok") for line in check(written(tmp_path, 0, "pass")))


def test_one_that_returns_no_numbers_is_accused_of_that_alone(tmp_path: Path) -> None:
    file = tmp_path / "no_numbers.py"
    claims = "parameters=dict.fromkeys(context.nominal, float('nan')), output=[float('inf')] * len(record['time_s'])"
    file.write_text(
        "from fdbench.estimator import BatchEstimator, Estimate\n"
        "class NoNumbers(BatchEstimator):\n"
        "    'Nothing.'\n"
        "    def fit(self, context, record):\n"
        f"        return Estimate({claims})\n",
        "utf-8",
    )
    with pytest.raises(PluginError, match=r"returns_estimate: parameters\['beta_1'\] is nan") as caught:
        check(str(file))
    accused, _, passed = str(caught.value).partition("Passed: ")
    assert not re.search("deterministic|fits_again|pickled", accused)
    assert {"is_deterministic", "fits_again", "can_be_pickled"} <= set(passed.rstrip(".").split(", "))


@pytest.mark.parametrize("use", ["np.random.seed(0)", "np.random.seed(0); np.random.rand()", "np.random.rand()"])
def test_who_seeds_or_draws_from_the_global_generator_is_refused(
    use: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sandbox: Sandbox
) -> None:
    monkeypatch.setattr(check_estimator, "CHECKS", (check_estimator.leaves_global_random_state,))
    file = tmp_path / "draws.py"
    text = "import numpy as np\nfrom fdbench.estimator import BatchEstimator, Estimate\n"
    text += "class Draws(BatchEstimator):\n    'Draws.'\n    def fit(self, context, record):\n"
    file.write_text(f"{text}        {use}\n        return Estimate()\n", "utf-8")
    with pytest.raises(PluginError, match=r"draws: leaves_global_random_state: fit seeds NumPy's global generator"):
        check_declared(declare(str(file), sandbox), sandbox)


def test_a_wrong_example_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sandbox: Sandbox) -> None:
    monkeypatch.setattr(check_estimator, "CHECKS", (has_right_examples,))
    file = tmp_path / "shows.py"
    text = "from fdbench.estimator import BatchEstimator, Estimate\n"
    text += "class Shows(BatchEstimator):\n"
    text += "    '''Shows.\n\n    >>> dict(Shows().fit(None, None).parameters)\n    {}\n    '''\n"
    text += "    def fit(self, context, record):\n        return Estimate()\n"
    file.write_text(text, "utf-8")
    assert check_declared(declare(str(file), sandbox), sandbox) == ["has_right_examples: ok"]
    file.write_text(text.replace("{}", "{1: 2}"), "utf-8")
    with pytest.raises(PluginError, match=r"shows: has_right_examples: an example .* is wrong: .*\{1: 2\} Got: \{\}"):
        check_declared(declare(str(file), sandbox), sandbox)


def test_a_published_estimator_shows_an_example() -> None:
    case = SimpleNamespace(source=SimpleNamespace(file=None), declaration=SimpleNamespace(has_example=False))
    with pytest.raises(PluginError, match="no worked example"):
        has_right_examples(case)  # type: ignore[arg-type]


def case(covariance: Any) -> Any:
    parameters = {f"p{n}": 1.0 for n in range(len(covariance))}
    return SimpleNamespace(first=Estimate(parameters=parameters, covariance=np.array(covariance, dtype=float)))


@pytest.mark.parametrize(
    ("covariance", "message"),
    [
        ([[1.0, 0.5], [0.4, 1.0]], r"not symmetric: 0\.5 of p0 and p1, 0\.4 of p1 and p0"),
        ([[1e-20, 5e-11], [4e-11, 1.0]], "not symmetric"),
        ([[1.0, 2.0], [2.0, 1.0]], r"not positive semidefinite: .* eigenvalue -1"),
        ([[0.0, 0.1], [0.1, 1.0]], "not positive semidefinite"),
        ([[-1.0, 0.0], [0.0, 1.0]], r"not positive semidefinite: .* eigenvalue -1"),
        ([[1e-20, 2e-10], [2e-10, 1.0]], r"not positive semidefinite: .* eigenvalue -1"),
    ],
)
def test_a_matrix_that_is_no_covariance_is_refused(covariance: Any, message: str) -> None:
    with pytest.raises(PluginError, match=message):
        has_a_possible_covariance(case(covariance))


@pytest.mark.parametrize(
    "covariance", [[], [[0.0]], [[1.0, 1.0], [1.0, 1.0]], [[0.0, 0.0], [0.0, 1.0]], [[1e-20, 9e-11], [9e-11, 1.0]]]
)
def test_a_matrix_that_is_a_covariance_is_accepted(covariance: Any) -> None:
    has_a_possible_covariance(case(covariance))
