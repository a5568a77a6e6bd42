"""What a release says of itself agrees with the package: citation, changelog, and the workflows in examples/ci."""

import re
import subprocess
import sys
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


def test_users_install_the_tag_of_this_version() -> None:
    workflow = (REPOSITORY / "examples" / "ci" / "fdbench.yml").read_text("utf-8")
    assert re.findall(r"FDBENCH_TAG: (\S+)$", workflow, re.M) == [f"v{__version__}"]
    (checkout,) = re.findall(
        r"path: (\w+)\n +repository: \$.*\n +ref: refs/tags/\$\{\{ env\.FDBENCH_TAG \}\}$", workflow, re.M
    )
    assert re.findall(r"pip install (\S+)$", workflow, re.M) == [f"./{checkout}"]


def test_a_release_is_refused_unless_its_tag_is_the_version() -> None:
    workflow = (REPOSITORY / "examples" / "ci" / "release.yml").read_text("utf-8")
    (step,) = re.findall(r"name: The tag is the version\n +run: \|\n((?: {10}.+\n)+)", workflow)
    script = step.replace("python -c", f"{sys.executable} -c")
    for tag, code in ((f"v{__version__}", 0), (__version__, 1), (f"v{__version__}.1", 1)):
        environment = {"GITHUB_REF_NAME": tag, "PATH": "/usr/bin:/bin"}
        command = ["bash", "-e", "-c", script]
        done = subprocess.run(command, cwd=REPOSITORY, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == code, done.stderr


def test_only_the_job_that_builds_nothing_may_publish() -> None:
    workflow = (REPOSITORY / "examples" / "ci" / "release.yml").read_text("utf-8")
    build, publish = workflow.split("\n  publish:\n")
    assert "id-token" not in build
    assert "id-token: write" in publish
    assert "run:" not in publish
    assert "secrets." not in workflow
