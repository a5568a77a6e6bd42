"""README does what it says: its blocks run in order as a newcomer would run them, and every link leads somewhere."""

import ast
import dataclasses
import doctest
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

from fdbench.catalogue import scenario_ids
from fdbench.effects import effects
from fdbench.estimator import Estimate, estimators
from fdbench.reproduce import papers

REPOSITORY = Path(__file__).resolve().parents[2]
README = REPOSITORY / "README.md"
PAGES = [
    README,
    REPOSITORY / "CONTRIBUTING.md",
    REPOSITORY / "CHANGELOG.md",
    *sorted((REPOSITORY / "docs").rglob("*.md")),
]
PAGES += sorted((REPOSITORY / "examples").rglob("*.md"))
BLOCK = re.compile(r"(?P<before>[^\n]*)\n+```(?P<language>\w*)\n(?P<text>.*?)^```$", re.M | re.S)
SLOW = "<!-- slow -->"
COMMANDS = (
    *("list", "import", "run", "verify", "reproduce", "leaderboard", "compare", "report", "record"),
    *("diagnose", "evaluate", "show", "plot", "trial", "check", "new"),
)


class Block(NamedTuple):
    before: str
    language: str
    text: str


def blocks(page: Path) -> list[Block]:
    """Return the fenced blocks of a page, each with the line before it."""
    return [Block(**match.groupdict()) for match in BLOCK.finditer(page.read_text("utf-8"))]


def run(block: Block, folder: Path) -> str:
    """Run a block in a folder and return what it prints; a file is written if the line before names one."""
    named = re.search(r"`([\w-]+\.(?:py|toml))`:$", block.before)
    if named:
        (folder / named[1]).write_text(block.text, "utf-8")
        return ""
    program = [sys.executable, "-c"] if block.language == "python" else ["bash", "-euo", "pipefail", "-c"]
    scripts = Path(sys.executable).parent
    environment = {**os.environ, "PATH": f"{scripts}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run(
        [*program, block.text], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{block.text}\n{done.stdout}{done.stderr}"
    return done.stdout


def check_text(expected: str, printed: str) -> None:
    """Compare what a page shows with what was printed; three dots stand for anything."""
    options = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    checker, example = doctest.OutputChecker(), doctest.Example("", expected)
    assert checker.check_output(expected, printed, options), checker.output_difference(example, printed, options)


def run_in_order(found: list[Block], folder: Path) -> int:
    """Run blocks as a newcomer would, hold each text against what the block before it printed; return how many.

    A block after a line of ``SLOW`` is not run, and what it prints not compared.
    """
    printed, compared = "", 0
    is_run = False
    for block in found:
        if block.language in ("python", "sh", "toml"):
            is_run = block.before != SLOW
            printed = run(block, folder) if is_run else ""
        elif block.language == "text" and is_run:
            check_text(block.text, printed)
            compared += 1
    return compared


@pytest.mark.pages
def test_blocks_of_readme_do_what_they_say(tmp_path: Path) -> None:
    for entry in REPOSITORY.iterdir():
        if not entry.name.startswith(".") and entry.name not in ("results", "leaderboard.md"):
            (tmp_path / entry.name).symlink_to(entry)
    assert run_in_order(blocks(README), tmp_path) >= 3


@pytest.mark.pages
def test_blocks_of_the_first_hour_do_what_they_say(tmp_path: Path) -> None:
    (tmp_path / "scenarios").symlink_to(REPOSITORY / "scenarios")
    assert run_in_order(blocks(REPOSITORY / "docs" / "tutorials" / "first_hour.md"), tmp_path) == 5


@pytest.mark.pages
def test_blocks_on_environments_run(tmp_path: Path) -> None:
    (tmp_path / "scenarios").symlink_to(REPOSITORY / "scenarios")
    found = [
        block for block in blocks(REPOSITORY / "docs" / "how-to" / "environments.md") if block.language == "python"
    ]
    assert len(found) >= 3
    for block in found:
        run(block, tmp_path)


@pytest.mark.pages
def test_blocks_on_python_do_what_they_say(tmp_path: Path) -> None:
    """One program, as in a notebook: later blocks use what earlier ones made."""
    found = blocks(REPOSITORY / "docs" / "how-to" / "python.md")
    program, expected = ("".join(b.text for b in found if b.language == kind) for kind in ("python", "text"))
    check_text(expected, run(Block("", "python", program), tmp_path))


@pytest.mark.pages
def test_blocks_on_evaluation_do_what_they_say(tmp_path: Path) -> None:
    (tmp_path / "scenarios").symlink_to(REPOSITORY / "scenarios")
    written, typed, expected = blocks(REPOSITORY / "docs" / "how-to" / "evaluate.md")
    run(written, tmp_path)
    printed = run(typed, tmp_path)
    check_text(expected.text, printed)
    assert (tmp_path / "evaluation.html").is_file()


@pytest.mark.pages
def test_blocks_on_logs_do_what_they_say(tmp_path: Path) -> None:
    (tmp_path / "scenarios").symlink_to(REPOSITORY / "scenarios")
    assert run_in_order(blocks(REPOSITORY / "docs" / "how-to" / "logs.md"), tmp_path) == 3


def test_slow_blocks_are_targets_of_make() -> None:
    targets = re.findall(r"^(\w+):", (REPOSITORY / "Makefile").read_text("utf-8"), re.M)
    lines = [line for block in blocks(README) if block.before == SLOW for line in block.text.splitlines()]
    assert lines
    assert {line.split()[0] for line in lines} == {"make"}
    assert {line.split()[1] for line in lines} <= set(targets)


def test_the_environment_of_make_has_pip(tmp_path: Path) -> None:
    for name in ("Makefile", "pyproject.toml", "fdbench"):
        (tmp_path / name).symlink_to(REPOSITORY / name)
    planned = subprocess.run(
        ["make", "-n", ".venv/.installed"], cwd=tmp_path, capture_output=True, text=True, check=True
    ).stdout
    assert "-m venv --without-pip .venv" in planned
    assert re.search(r"-m pip --python \.venv/bin/python install --quiet pip --editable", planned)


def test_fragments_are_right(tmp_path: Path) -> None:
    effect, estimate = (block.text for block in blocks(README) if block.language == "py")
    (tmp_path / "end_stop_spring.py").write_text(effect, "utf-8")
    cls = effects.get(effects.add_file(tmp_path / "end_stop_spring.py"))
    cls.check_signature()
    assert cls.kernel(0.0, 1e-4, 0.75, 0.0, 0.0, *cls.typical(contact_position_m=0.25).values()) == (1000.0, 0.2)
    (call,) = (node for node in ast.walk(ast.parse(estimate)) if isinstance(node, ast.Call))
    assert {keyword.arg for keyword in call.keywords} == {field.name for field in dataclasses.fields(Estimate)}


def anchors(page: Path) -> set[str]:
    """Return what a link into a page may name."""
    titles = re.findall(r"^#+ (.+)$", re.sub(r"^```.*?^```$", "", page.read_text("utf-8"), flags=re.M | re.S), re.M)
    return {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(REPOSITORY)))
def test_links_lead_somewhere(page: Path) -> None:
    wrong = []
    for link in re.findall(r"\]\(([^)\s]+)\)", re.sub(r"```.*?```", "", page.read_text("utf-8"), flags=re.S)):
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        if "://" not in link and not (target.exists() and (not anchor or anchor in anchors(target))):
            wrong.append(link)
    assert wrong == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(REPOSITORY)))
def test_commands_name_what_exists(page: Path) -> None:
    text = page.read_text("utf-8").replace("\\\n", " ")
    text = "\n".join(re.findall(r"`+([^`]+)`+", text))
    assert set(re.findall(r"(?:^|(?<!from)\s)fdbench ([a-z]+)\b(?!:)", text)) <= set(COMMANDS)
    assert set(re.findall(r"--scenario (?:fdbench/)?([A-Z]\w+-v\d+)(?!\.toml)\b", text)) <= {*scenario_ids()}
    assert set(re.findall(r"--estimator (\w+)(?!\.py)\b", text)) <= {*estimators.names()}
    assert set(re.findall(r"fdbench reproduce (\w+)", text)) <= {*papers()}
    scripts = set(re.findall(r"python ((?:benchmarks|docs|examples)/\S+\.py)", text))
    assert {script for script in scripts if not (REPOSITORY / script).is_file()} == set()
