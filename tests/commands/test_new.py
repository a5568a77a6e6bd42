"""`fdbench new`: what it writes works, is in the house's form, and overwrites nothing."""

import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import REPOSITORY
from typer.testing import CliRunner, Result

from fdbench.checks import check_effect
from fdbench.cli import app
from fdbench.commands.new import kinds, written
from fdbench.effects import effects
from fdbench.estimator import estimators
from fdbench.trials.diagnoser import diagnosers

NAMES = {"scenario": "TriedOut", "package": "example"}


@pytest.fixture(autouse=True)
def _own_plugins(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for registry in (estimators, effects, diagnosers):
        monkeypatch.setattr(registry, "_files", {})
    monkeypatch.chdir(tmp_path)


def fdbench(*arguments: object) -> Result:
    result = CliRunner().invoke(app, [str(item) for item in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def is_named_first(cls: object) -> None:
    """Stand in for a check."""


def refused(*arguments: object) -> str:
    result = fdbench(*arguments)
    assert (result.exit_code, result.stdout) == (2, ""), result.output
    assert result.stderr.count("\n") == 1
    return result.stderr


# The package is checked where it is installed.
@pytest.mark.parametrize("kind", [kind for kind in kinds() if kind != "package"])
def test_what_is_written_passes_its_check(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """All of the checks but, of an effect, those that simulate an axis and diagnose it, which take half a minute."""
    monkeypatch.setattr(check_effect, "CHECKS", check_effect.CHECKS[:7])
    monkeypatch.setattr(check_effect, "is_named_first", is_named_first)
    done = fdbench("new", kind, NAMES.get(kind, "tried_out"), "-o", "folder")
    assert done.exit_code == 0, done.output
    file = done.stdout.rpartition("fdbench check ")[2].strip()
    assert Path(file).is_file()
    checked = fdbench("check", file)
    assert checked.exit_code == 0, checked.output
    lines = checked.stdout.splitlines()
    assert len(lines) >= 4
    assert {line.partition(": ")[2] for line in lines} == {"ok"}


def test_what_is_written_is_in_the_form_of_the_house() -> None:
    for kind in kinds():
        fdbench("new", kind, NAMES.get(kind, f"own_{kind}"), "-o", "folder")
    settings = ["--config", str(REPOSITORY / "pyproject.toml"), "--config", f'src = ["{REPOSITORY}"]', "--no-cache"]
    settings += ["--exclude", "tests"]
    for command in (["check"], ["format", "--check"]):
        done = subprocess.run(
            [sys.executable, "-m", "ruff", *command, *settings, "."], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr


def test_the_package_of_the_examples_is_what_is_written() -> None:
    folder = REPOSITORY / "examples"
    for path, text in written("package", "example").items():
        assert (folder / path).read_text("utf-8") == text, f"{path}: run fdbench new package example -o examples"


def test_nothing_is_overwritten() -> None:
    Path("mine.py").write_text("kept", "utf-8")
    assert "mine.py: is there already, and nothing is overwritten" in refused("new", "estimator", "mine")
    assert Path("mine.py").read_text("utf-8") == "kept"
    place = Path("fdbench_mine", "tests")
    place.mkdir(parents=True)
    (place / "test_mine.py").write_text("kept", "utf-8")
    assert "test_mine.py: is there already" in refused("new", "package", "mine")
    assert [path.name for path in Path("fdbench_mine").iterdir()] == ["tests"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("estimatr mine", r"kind 'estimatr'. Did you mean estimator?"),
        (
            "estimator My-Own",
            "name 'My-Own' is no name: small letters, digits and _, a letter first, are expected. Did you mean my_own?",
        ),
        ("estimator 3d", "name '3d' is no name: small letters, digits and _, a letter first, are expected."),
        ("estimator ../mine", "is no name"),
        ("effect lambda", "name 'lambda' is a word of Python."),
        ("scenario my_axis", "a capital first, are expected. Did you mean MyAxis?"),
        ("estimator krls_t", "name 'krls_t' belongs to the estimator fdbench_baselines.krls_t. Choose another."),
        ("effect krls_t", "belongs to the estimator"),
        ("estimator oracle", "belongs to the row of the truth"),
        ("package baselines", "belongs to the package fdbench_baselines"),
        ("scenario ShakerConstant", "belongs to the scenario ShakerConstant-v"),
        ("diagnoser fdbench", "belongs to the diagnoser"),
    ],
)
def test_a_bad_name_is_told_in_one_message(arguments: str, message: str) -> None:
    assert message in refused("new", *arguments.split())
    assert list(Path().iterdir()) == []


def test_the_command_that_is_proposed_can_be_typed() -> None:
    result = fdbench("new", "estimator", "my_own", "-o", "a folder (1)")
    assert result.exit_code == 0, result.output
    *_, command = result.output.splitlines()
    assert shlex.split(command.removeprefix("Next: ")) == ["fdbench", "check", "a folder (1)/my_own.py"]
