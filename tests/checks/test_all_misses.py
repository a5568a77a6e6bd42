"""A check names all that it finds, the checks after it still run, and a crash is named once."""

import numpy as np
import pytest

from fdbench.benchmark.validate import check_estimate
from fdbench.checks._report import run_checks
from fdbench.errors import PluginError, SpecError, raise_all
from fdbench.estimator import Estimate, Regression
from fdbench.sandbox import Misbehaved
from fdbench.worked_examples import as_written

REGRESSION = Regression(
    regressors=np.ones((4, 2)),
    target=np.ones(4),
    names=("beta_1", "beta_2"),
    target_name="velocity_m_per_s",
    time_s=np.arange(4.0),
    rows=np.arange(4),
    disturbance_gain=1.0,
)


def test_all_misses_of_an_estimate_are_named() -> None:
    claims = {"output": np.zeros(3), "output_variance": -np.ones(4), "covariance": np.full((2, 2), np.inf)}
    with pytest.raises(PluginError) as caught:
        check_estimate(Estimate(parameters={"beta_1": np.nan, "beta1": 1.0}, **claims), REGRESSION)
    assert str(caught.value).splitlines() == [
        "parameters['beta_1'] is nan, expected a finite number up to 1e+100. "
        "parameters['beta1']: the model has no such parameter. Did you mean beta_1? "
        "output has shape (3,), expected (4,), one value for each row of the regression. "
        "output_variance holds -1.0 in row 0: no variance; a variance is at least 0 (4 of 4). "
        "covariance holds inf in row (0, 0): not finite, or beyond 1e+100 (4 of 4)."
    ]


def test_of_very_many_misses_the_first_are_named() -> None:
    with pytest.raises(PluginError, match=r"^0\. 1\. 2\. 3\. 4\. 5\. 6\. 7\. And 12 more\.$"):
        raise_all(f"{number}." for number in range(20))


def test_checks_go_on_after_a_finding_and_end_with_a_crash() -> None:
    done: list[str] = []

    def finds(error: Exception) -> None:
        done.append(str(error))
        raise error

    every = [PluginError("one"), SpecError("two"), Misbehaved("three"), PluginError("never")]
    with pytest.raises(PluginError, match=r"x: a: one\nb: two\nc: three$"):
        run_checks("x", [(name, lambda error=error: finds(error)) for name, error in zip("abcd", every, strict=True)])
    assert done == ["one", "two", "three"]


@pytest.mark.parametrize(
    ("want", "got", "is_right"),
    [
        ("3.14", "3.1415926", True),
        ("3.15", "3.1415926", True),
        ("3.16", "3.1415926", False),
        ("[1.0, 2.50]", "[1.04, 2.501]", True),
        ("2", "3", False),
        ("2.", "2.9", True),
        ("1e3", "1400.0", True),
        ("1e-3", "0.00149", True),
        ("1e-3", "0.0021", False),
        ("0.1 N", "0.1 m", False),
        ("0.1", "0.1 0.1", False),
    ],
)
def test_numbers_are_right_in_the_digits_that_are_written(want: str, got: str, is_right: bool) -> None:
    """The same cases by pytest's own checker."""
    from _pytest.doctest import _get_checker

    from fdbench.worked_examples import NUMBER

    assert (as_written(want, got) == want) is is_right
    assert _get_checker().check_output(f"{want}\n", f"{got}\n", NUMBER) is is_right
