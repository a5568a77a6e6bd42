"""The workflows, our own and those that users copy, are what the hosting service takes, and call what there is."""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

REPOSITORY = Path(__file__).resolve().parents[2]
OWN = REPOSITORY / ".github" / "workflows" / "ci.yml"
WORKFLOWS = [OWN, *sorted((REPOSITORY / "examples" / "ci").glob("*.yml"))]


def steps(workflow: Path) -> list[dict[str, Any]]:
    jobs = yaml.safe_load(workflow.read_text("utf-8"))["jobs"]
    return [step for job in jobs.values() for step in job["steps"]]


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda path: path.name)
def test_a_workflow_is_whole(workflow: Path) -> None:
    content = yaml.safe_load(workflow.read_text("utf-8"))
    assert {"name", True, "permissions", "jobs"} <= set(content)  # YAML 1.1 takes the key `on` for true
    assert content["permissions"] == {"contents": "read"}
    for name, job in content["jobs"].items():
        assert {"runs-on", "timeout-minutes", "steps"} <= set(job), name
        assert set(job.get("needs", "").split()) <= set(content["jobs"]), name
    for step in steps(workflow):
        assert ("uses" in step) != ("run" in step), step
        assert re.fullmatch(r"[\w-]+/[\w-]+@\S+", step.get("uses", "a/b@c")), step


def test_all_use_the_same_version_of_an_action() -> None:
    versions: dict[str, set[str]] = {}
    for workflow in WORKFLOWS:
        for step in steps(workflow):
            action, _, version = step.get("uses", "").partition("@")
            versions.setdefault(action, set()).add(version)
    assert {"actions/checkout", "actions/cache"} <= set(versions)
    assert [action for action, found in versions.items() if len(found) > 1] == []


def test_ours_runs_what_contributors_run_on_the_oldest_python() -> None:
    job = yaml.safe_load(OWN.read_text("utf-8"))["jobs"]["check"]
    oldest = tomllib.loads((REPOSITORY / "pyproject.toml").read_text("utf-8"))["project"]["requires-python"]
    assert job["container"].startswith(f"python:{oldest.removeprefix('>=')}-")
    commands = [step["run"] for step in steps(OWN) if "run" in step]
    (script,) = re.findall(r"^bash (\S+)$", commands[-1])
    text = (REPOSITORY / script).read_text("utf-8")
    (target,) = re.findall(r"^make (\w+)", text, re.MULTILINE)
    assert re.search(rf"^{target}:", (REPOSITORY / "Makefile").read_text("utf-8"), re.MULTILINE)


def test_ours_installs_a_browser_that_the_tests_look_for() -> None:
    (browsers,) = re.findall(r"^BROWSERS = \((.*)\)$", (REPOSITORY / "tests/report/test_browser.py").read_text(), re.M)
    installed = [word for step in steps(OWN) for word in step.get("run", "").split() if f'"{word}"' in browsers]
    assert installed == ["chromium"]
