"""The page of rows says of every estimator what it is told, how it reads, what it costs and where it fails."""

import re
from pathlib import Path

import pytest

from fdbench.estimator import OnlineEstimator, estimators

PAGE = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "rows.md"
ROWS = {
    found[1]: [cell.strip() for cell in found[2].split("|")]
    for found in re.finditer(
        r"^\| \[`(\w+)`\]\(\.\./reference/estimators\.md#\w+\) \|(.*)\|$", PAGE.read_text("utf-8"), re.M
    )
}


def test_every_estimator_has_a_row_and_nothing_else_has() -> None:
    assert list(ROWS) == sorted(estimators.modules())


@pytest.mark.parametrize("name", sorted(ROWS))
def test_a_row_is_whole(name: str) -> None:
    told, reads, time_per_row, time_of_fit, memory, fails = ROWS[name]
    assert len(told) >= len("the sheet")
    assert len(fails) > 25
    assert (reads == "online") == issubclass(estimators.get(name), OnlineEstimator)
    for numbers in (time_per_row, time_of_fit, memory):
        assert all(float(number) > 0.0 for number in numbers.split(" to "))
