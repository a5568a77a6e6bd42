"""Tuned numbers: each says what it is and where it comes from, and one diagnosis may have others."""

import re
from pathlib import Path

import pytest

from fdbench.diagnosis.records.noise_model import white
from fdbench.diagnosis.settings import CHOSEN, RECORDS, SEARCH, changed, settings
from fdbench.errors import SpecError

ROOMS = ("records", "model", "evidence", "search", "judge", "experiment")
PACKAGE = Path(__file__).resolve().parents[2] / "fdbench"


@pytest.mark.parametrize("name", settings())
def test_a_number_has_a_meaning_an_origin_and_a_use(name: str) -> None:
    setting = settings()[name]
    assert setting.meaning
    assert setting.origin
    stage, _, number = name.partition(".")
    if stage == "baseline":  # as a whole: its names are those of the uncertainty in a model file
        return
    used = re.compile(rf"\b{stage.upper()}\.{number}\b")
    assert any(
        used.search(path.read_text("utf-8")) for room in ROOMS for path in (PACKAGE / "diagnosis" / room).glob("*.py")
    )


def test_an_unknown_origin_is_said_to_be_so() -> None:
    assert CHOSEN in {setting.origin for setting in settings().values()}


def test_changed_numbers_are_what_the_diagnosis_reads_and_return() -> None:
    before = {name: setting.value for name, setting in settings().items()}
    with changed({"records.piece_samples": 64, "search.smallest_gain": 0.5}):
        assert len(white(1.0, measured=True).spectrum) == 33
        assert (RECORDS.piece_samples, SEARCH.smallest_gain) == (64, 0.5)
    assert {name: setting.value for name, setting in settings().items()} == before


def test_changed_numbers_return_after_an_error() -> None:
    with pytest.raises(ZeroDivisionError), changed({"search.smallest_gain": 0.5}):
        raise ZeroDivisionError
    assert SEARCH.smallest_gain == 0.04


def test_a_number_that_is_not_there_is_refused_and_nothing_changes() -> None:
    with (
        pytest.raises(SpecError, match=r"search\.smalest_gain.*mean search\.smallest_gain\?"),
        changed({"search.reviews": 1, "search.smalest_gain": 0.1}),
    ):
        raise AssertionError
    assert SEARCH.reviews == 3
