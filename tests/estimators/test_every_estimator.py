"""Every registered estimator holds the shared checks."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from fdbench.benchmark.validate import plant_parameters
from fdbench.checks.check_estimator import CHECKS, CheckedEstimator, check_estimator, prepare
from fdbench.errors import PluginError
from fdbench.estimator import estimators
from fdbench.sandbox import Sandbox, WorkerLimits
from fdbench.scenario import load_scenario

NAMES = estimators.names()


@pytest.fixture(scope="module")
def sandbox() -> Iterator[Sandbox]:
    with closing(Sandbox(WorkerLimits())) as made:
        yield made


@pytest.fixture(scope="module")
def case_of() -> dict[str, CheckedEstimator]:
    return {}


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("name", NAMES)
def test_estimator(name: str, check: object, case_of: dict[str, CheckedEstimator], sandbox: Sandbox) -> None:
    if name not in case_of:
        case_of[name] = prepare(name, sandbox)
    case = case_of[name]
    expected = case.declaration.expected_failures
    if check.__name__ in expected:  # type: ignore[attr-defined]
        with pytest.raises(PluginError):
            check(case)  # type: ignore[operator]
    else:
        check(case)  # type: ignore[operator]


@pytest.mark.parametrize(
    ("name", "claim", "message"),
    [
        ("bad_shape", "output=np.zeros(3)", r"output has shape \(3,\)"),
        (
            "bad_name",
            "parameters={'coulomb_friction': 1.0}",
            r"\['coulomb_friction'\]: the model has no such parameter\. Did you mean coulomb_friction_N\?",
        ),
    ],
)
def test_a_bad_estimator_is_told_what_is_wrong(
    name: str, claim: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sandbox: Sandbox
) -> None:
    monkeypatch.setattr(estimators, "_files", {})
    file = tmp_path / f"{name}.py"
    file.write_text(
        "import numpy as np\n"
        "from fdbench.estimator import BatchEstimator, Estimate\n"
        "class Bad(BatchEstimator):\n"
        "    'Says too little.'\n"
        "    def fit(self, context, record):\n"
        f"        return Estimate({claim})\n"
    )
    with pytest.raises(PluginError, match=f"{name}: returns_estimate: .*{message}"):
        check_estimator(estimators.declare(str(file)), sandbox)


def test_parameters_may_have_the_names_of_the_model_and_of_what_follows_from_it() -> None:
    names = plant_parameters(load_scenario("ShakerConstant-v0").context())
    assert names == {
        *("beta_1", "beta_2", "beta_3", "beta_4"),
        *("mass_kg", "viscous_friction_N_s_per_m", "coulomb_friction_N"),
    }
