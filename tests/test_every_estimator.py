"""Every registered estimator holds the shared checks."""

import pytest

from fdbench.checks.check_estimator import CHECKS, Case, prepare
from fdbench.errors import PluginError
from fdbench.estimator import estimators

NAMES = estimators.names()


@pytest.fixture(scope="module")
def case_of() -> dict[str, Case]:
    return {}


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("name", NAMES)
def test_estimator(name: str, check: object, case_of: dict[str, Case]) -> None:
    if name not in case_of:
        case_of[name] = prepare(estimators.get(name))
    case = case_of[name]
    expected = case.cls.expected_failures
    if check.__name__ in expected:  # type: ignore[attr-defined]
        with pytest.raises(PluginError):
            check(case)  # type: ignore[operator]
    else:
        check(case)  # type: ignore[operator]


def test_a_bad_estimator_is_told_what_is_wrong(tmp_path, capsys) -> None:
    file = tmp_path / "bad_shape.py"
    file.write_text(
        "import numpy as np\n"
        "from fdbench.estimator import BatchEstimator, Estimate\n"
        "class BadShape(BatchEstimator):\n"
        "    'Says too little.'\n"
        "    def fit(self, context, record):\n"
        "        return Estimate(output=np.zeros(3))\n"
    )
    from fdbench.checks.check_estimator import check_estimator

    name = estimators.add_file(file)
    with pytest.raises(PluginError, match=r"bad_shape: returns_estimate: output has shape \(3,\)"):
        check_estimator(name)
