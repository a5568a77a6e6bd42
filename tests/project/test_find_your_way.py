"""The stranger's test: from the README's tour each question of CONTRIBUTING is three steps from its line."""

import importlib
import re
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
TOUR = (REPOSITORY / "README.md").read_text("utf-8").split("## Tour", 1)[1].split("\n## ", 1)[0]
SECTION = (REPOSITORY / "CONTRIBUTING.md").read_text("utf-8").split("## Find your way", 1)[1].split("\n## ", 1)[0]
ROWS = [[cell.strip() for cell in line.strip("|").split("|")] for line in SECTION.splitlines() if line.startswith("| ")]


def found(module: str, name: str) -> object:
    """Return what a dotted name stands for in a module, or from the package on."""
    parts = name.split(".")
    if parts[0] == "fdbench":
        module, parts = ".".join(parts[:-1]), parts[-1:]
    thing: object = importlib.import_module(module)
    for part in parts:
        thing = getattr(thing, part)
    return thing


def test_the_five_questions_of_a_stranger_are_there() -> None:
    questions = " ".join(row[0] for row in ROWS[2:])
    assert all(word in questions for word in ("cogging", "unknown cause", "check", "share", "cascade"))


@pytest.mark.parametrize("row", ROWS[2:], ids=lambda row: row[0])
def test_three_steps_lead_from_the_tour_to_the_line(row: list[str]) -> None:
    _, folder, link, names = row
    folder = folder.strip("`")
    assert f"`{folder}`" in TOUR or f"`{folder.removeprefix('fdbench/')}`" in TOUR
    text, target = re.fullmatch(r"\[(.+)\]\((.+)\)", link).groups()  # type: ignore[union-attr]
    assert target == folder + text
    assert (REPOSITORY / target).is_file()
    module = target.removesuffix(".py").replace("/", ".")
    wanted = re.findall(r"`([\w.]+)`", names)
    assert wanted
    for name in wanted:
        assert found(module, name) is not None
