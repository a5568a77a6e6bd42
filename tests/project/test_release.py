"""What a release says of itself agrees with the package: its citation, and its changelog."""

import re
from pathlib import Path

from fdbench.catalogue import scenario_ids
from fdbench.version import __version__

REPOSITORY = Path(__file__).resolve().parents[2]
CHANGELOG = (REPOSITORY / "CHANGELOG.md").read_text("utf-8")


def test_citation_is_of_this_version() -> None:
    citation = (REPOSITORY / "CITATION.cff").read_text("utf-8")
    assert re.findall(r"^version: (\S+)$", citation, re.M) == [__version__]
    assert re.findall(r"^cff-version: (\S+)$", citation, re.M) == ["1.2.0"]


def test_changelog_begins_with_what_is_unreleased_and_has_this_version() -> None:
    versions = re.findall(r"^## \[(.+?)\]", CHANGELOG, re.M)
    assert versions[0] == "Unreleased"
    assert versions[1] == __version__


def test_changelog_says_what_differs_between_versions_of_each_scenario() -> None:
    newest: dict[str, int] = {}
    for name in scenario_ids():
        family, _, version = name.rpartition("-v")
        newest[family] = max(newest.get(family, 0), int(version))
    section = CHANGELOG.split("## Scenarios: versions and errata", 1)[1].split("### Errata", 1)[0]
    told = {
        family: int(version)
        for families, version in re.findall(r"^\| (`.+?`) \| -v(\d+) \| \S", section, re.M)
        for family in re.findall(r"`(\w+)`", families)
    }
    assert told == {family: version for family, version in newest.items() if version > 0}
