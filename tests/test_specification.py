"""The strict reader: whatever is done to a valid file, the answer is a SpecError that names the place."""

import copy
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fdbench.catalogue import scenario_files
from fdbench.diagnosis.model.nominal import Nominal, load_nominal
from fdbench.errors import SpecError
from fdbench.scenario import Scenario, extended
from fdbench.specification import bounded, check_bounds, load_toml, positive, read

TABLES = {path.stem: extended(path)[0] for path in scenario_files()}
WHERE = "File-v0.toml: scenario"
OTHER_TYPES: list[Any] = ["text", "", True, False, {}, {"kind": 3}, {"kind": "none of them"}, [], [[]], [1.0], ["text"]]
OTHER_NUMBERS = [math.nan, math.inf, -math.inf, -1, 0, 0.5, -1.5, 5, 1e-320, 1e308, 10**30, 10**400]

# Tables whose keys a scenario is free to choose.
FREE = {"hyperparameters", "columns", "reference_parameters"}


def places(table: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    for key, value in table.items() if isinstance(table, Mapping) else enumerate(table):
        yield (*at, key)
        if isinstance(value, dict | list):
            yield from places(value, (*at, key))


PLACES = [(name, place) for name, table in TABLES.items() for place in places(table)]


def changed(name: str, place: tuple[Any, ...]) -> tuple[dict[str, Any], Any]:
    """Return a copy of a table, and the part of it that holds the place."""
    table = copy.deepcopy(TABLES[name])
    parent: Any = table
    for key in place[:-1]:
        parent = parent[key]
    return table, parent


def path_of(place: tuple[Any, ...]) -> str:
    return "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in place)


def refusal(table: Any, cls: type[Any] = Scenario) -> str:
    """Return the message of the SpecError, or an empty text if the table is good; anything else fails the test."""
    try:
        read(cls, table, WHERE)
    except SpecError as error:
        return str(error)
    return ""


def test_every_scenario_is_good_as_it_is() -> None:
    assert {name: refusal(table) for name, table in TABLES.items()} == dict.fromkeys(TABLES, "")


@settings(max_examples=300, deadline=None)
@given(st.sampled_from(PLACES), st.text("abcdefgh_N", min_size=1, max_size=3))
def test_a_misspelt_key_is_named_with_its_path(choice: tuple[str, tuple[Any, ...]], added: str) -> None:
    name, place = choice
    if isinstance(place[-1], int) or FREE & set(place[:-1]):
        return
    table, parent = changed(name, place)
    wrong = place[-1] + added
    if wrong in parent:
        return
    parent[wrong] = parent.pop(place[-1])
    message = refusal(table)
    if place[-1] == "kind":
        assert f"{path_of(place)}: missing key" in message
    else:
        assert f"{WHERE}{path_of((*place[:-1], wrong))}: unknown key for " in message


@settings(max_examples=300, deadline=None)
@given(st.sampled_from(PLACES))
def test_a_missing_key_is_named_with_its_path(choice: tuple[str, tuple[Any, ...]]) -> None:
    name, place = choice
    table, parent = changed(name, place)
    del parent[place[-1]]
    message = refusal(table)
    assert not message or message.startswith(f"{WHERE}.")
    if "missing key" in message and isinstance(place[-1], str):
        assert f"{WHERE}{path_of(place)}: missing key" in message


@settings(max_examples=600, deadline=None)
@given(st.sampled_from(PLACES), st.sampled_from([*OTHER_TYPES, *OTHER_NUMBERS]))
def test_another_value_is_good_or_named_with_its_path(choice: tuple[str, tuple[Any, ...]], value: Any) -> None:
    name, place = choice
    table, parent = changed(name, place)
    old, parent[place[-1]] = parent[place[-1]], value
    message = refusal(table)
    assert not message or message.startswith(f"{WHERE}.")
    if isinstance(old, int | float) and not isinstance(old, bool) and isinstance(value, str | bool | dict | list):
        assert FREE & set(place) or f"{WHERE}{path_of(place)}: a " in message


@settings(max_examples=200, deadline=None)
@given(st.sampled_from(PLACES), st.recursive(st.none() | st.integers() | st.text(max_size=5), st.lists, max_leaves=5))
def test_what_no_toml_holds_is_refused_too(choice: tuple[str, tuple[Any, ...]], value: Any) -> None:
    name, place = choice
    table, parent = changed(name, place)
    parent[place[-1]] = value
    refusal(table)


@given(st.sampled_from(PLACES), st.sampled_from([*OTHER_TYPES, *OTHER_NUMBERS]))
@settings(max_examples=200, deadline=None)
def test_a_model_is_read_as_strictly(choice: tuple[str, tuple[Any, ...]], value: Any) -> None:
    name, place = choice
    if place[0] != "plant":
        return
    table, parent = changed(name, place)
    parent[place[-1]] = value
    message = refusal({"plant": table["plant"], "simulation": {"substeps": 10}}, Nominal)
    assert not message or message.startswith(f"{WHERE}.plant")


@dataclass(frozen=True, kw_only=True)
class Spring:
    """A specification of these tests."""

    stiffness_N_per_m: float = positive()
    preload_N: float = bounded(-5.0, 5.0, default=0.0)
    turns: int = bounded(1, 20, default=3)
    stops_m: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        check_bounds(self)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({}, r"^f: spring\.stiffness_N_per_m: missing key \[N/m\] of spring\.$"),
        ({"stiffness_N_per_mm": 1.0}, r"unknown key for spring\. Did you mean stiffness_N_per_m \[N/m\]\?$"),
        ({"Stiffness_n_per_M": 1.0}, r"Did you mean stiffness_N_per_m \[N/m\]\?$"),
        ({"stiffness_N_per_m": -1}, r"spring\.stiffness_N_per_m: -1 is outside \(0, inf\) N/m\.$"),
        ({"stiffness_N_per_m": math.nan}, r"stiffness_N_per_m: a finite number in N/m is expected, found nan\.$"),
        ({"stiffness_N_per_m": 10**400}, r"a finite number in N/m is expected, found 10{59}\.\.\.\.$"),
        ({"stiffness_N_per_m": True}, r"a number in N/m is expected, found true or false: True\.$"),
        ({"stiffness_N_per_m": "1 N/m"}, r"a number in N/m is expected, found the text '1 N/m'\.$"),
        ({"stiffness_N_per_m": 1.0, "preload_N": 9}, r"preload_N: 9 is outside \[-5, 5\] N\.$"),
        ({"stiffness_N_per_m": 1.0, "turns": 2.0}, r"turns: a whole number is expected, found 2\.0\.$"),
        ({"stiffness_N_per_m": 1.0, "turns": 10**400}, r"turns: 10{99,} \[\.\.\.\] 0+ is outside \[1, 20\]\.$"),
        ({"stiffness_N_per_m": 1.0, "stops_m": [0.0, "1"]}, r"stops_m\[1\]: a number in m is expected"),
        ({"stiffness_N_per_m": 1.0, "stops_m": 1.0}, r"stops_m: a list is expected, found 1\.0\.$"),
        (5, r"^f: spring: a table is expected, found 5\.$"),
    ],
)
def test_messages(table: Any, message: str) -> None:
    with pytest.raises(SpecError, match=message):
        read(Spring, table, "f: spring")


@dataclass(frozen=True)
class Ratio:
    """A specification that cannot be computed with."""

    by: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "inverse", 1.0 / self.by)


def test_numbers_that_cannot_be_computed_with_are_refused() -> None:
    with pytest.raises(SpecError, match=r"^f: ratio: these values cannot be computed with: float division by zero"):
        read(Ratio, {"by": 0.0}, "f: ratio")


@pytest.mark.parametrize("kind", [3, True, {}, []])
def test_a_kind_is_a_text(kind: Any) -> None:
    table = copy.deepcopy(TABLES["ShakerConstant-v0"])
    table["plant"]["kind"] = kind
    assert f"{WHERE}.plant.kind: a text is expected" in refusal(table)


def test_files_that_are_no_toml(tmp_path: Path) -> None:
    (tmp_path / "axis.toml").write_text("[plant]\n")
    (tmp_path / "binary.toml").write_bytes(bytes(range(128, 256)))
    (tmp_path / "broken.toml").write_text("a = 1\nb = \n")
    (tmp_path / "deep.toml").write_text("a = " + "[" * 100_000)
    (tmp_path / "folder.toml").mkdir()
    for name, message in (
        ("axes.toml", r"axes\.toml: cannot be read: no such file\. Did you mean axis\.toml\?"),
        ("none/axis.toml", r"axis\.toml: cannot be read: no such file\.$"),
        ("binary.toml", r"binary\.toml: not valid TOML: 'utf-8' codec"),
        ("broken.toml", r"broken\.toml: not valid TOML: .*line 2"),
        ("deep.toml", r"deep\.toml: not valid TOML: "),
        ("folder.toml", r"folder\.toml: cannot be read: "),
    ):
        with pytest.raises(SpecError, match=message):
            load_toml(tmp_path / name)
        with pytest.raises(SpecError, match=message):
            load_nominal(tmp_path / name)
