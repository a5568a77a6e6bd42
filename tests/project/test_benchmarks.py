"""What the scripts in benchmarks/ and docs/ take from the packages is there; running them takes minutes and peers."""

import ast
import importlib
from importlib.util import find_spec
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
SCRIPTS = sorted(
    [
        *(REPOSITORY / "benchmarks").glob("*.py"),
        *(REPOSITORY / "docs").glob("*.py"),
        *(REPOSITORY / "examples" / "learning").glob("*.py"),
    ]
)


def imported(script: Path) -> list[tuple[str, str]]:
    """Return module and name of each import from the packages of this repository."""
    return [
        (node.module, name.name)
        for node in ast.walk(ast.parse(script.read_text("utf-8")))
        if isinstance(node, ast.ImportFrom)
        and node.module
        and node.module.split(".")[0] in ("fdbench", "fdbench_baselines")
        for name in node.names
    ]


def is_there(module: str, name: str) -> bool:
    owner = importlib.import_module(module)
    return hasattr(owner, name) or (hasattr(owner, "__path__") and find_spec(f"{module}.{name}") is not None)


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_imports_are_there(script: Path) -> None:
    assert [(module, name) for module, name in imported(script) if not is_there(module, name)] == []


def test_a_name_that_moved_would_be_found() -> None:
    assert not is_there("fdbench.commands.run", "nothing_of_this_name")
    assert ("fdbench.benchmark.suite", "in_suite") in imported(REPOSITORY / "benchmarks" / "sandbox_cost.py")
