"""The estimator holds what every estimator has to hold."""

from fdbench.checks import check


def test_estimator_holds_the_shared_checks() -> None:
    assert all(line.endswith(": ok") for line in check("example"))
