"""Imports flow one way, and no module outside ``fdbench/effects`` names an effect."""

import ast
import re
from pathlib import Path

import pytest
from importlinter.cli import lint_imports

REPOSITORY = Path(__file__).resolve().parents[2]
PACKAGE = REPOSITORY / "fdbench"
EFFECTS = PACKAGE / "effects"
EFFECT_NAMES = sorted(path.stem for path in EFFECTS.glob("[!_]*.py"))


def code_only(source: str) -> str:
    """Return Python source without comments and docstrings."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            node.value = ast.Constant(value=...)
    return ast.unparse(tree)


def effects_named_in(source: str) -> list[str]:
    """Return the effects whose name is a whole word of the code."""
    words = set(re.findall(r"\w+", code_only(source)))
    return sorted(words.intersection(EFFECT_NAMES))


def test_import_contracts(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(REPOSITORY)
    status = lint_imports(no_cache=True, no_logo=True)
    assert status == 0, capsys.readouterr().out


def test_every_folder_of_code_is_a_package() -> None:
    folders = {path.parent for root in (PACKAGE, REPOSITORY / "baselines") for path in root.rglob("*.py")}
    without = [str(folder.relative_to(REPOSITORY)) for folder in folders if not (folder / "__init__.py").is_file()]
    assert without == [], "the import contracts and mypy see only folders with an __init__.py"


def test_effects_are_named_in_their_folder_only() -> None:
    assert EFFECT_NAMES
    modules = [path for path in PACKAGE.rglob("*.py") if not path.is_relative_to(EFFECTS)]
    found = {str(path.relative_to(REPOSITORY)): effects_named_in(path.read_text("utf-8")) for path in modules}
    assert {path: names for path, names in found.items() if names} == {}


def test_effect_names_are_found_in_code_and_not_in_prose() -> None:
    name = EFFECT_NAMES[0]
    assert effects_named_in(f'"""About {name}."""\nx = 1  # {name}\n') == []
    assert effects_named_in(f"{name}_N = 1.0") == []
    assert effects_named_in(f'kind = "{name}"') == [name]
    assert effects_named_in(f'text = f"{{x}} of {name}"') == [name]
    assert effects_named_in(f"from fdbench.effects.{name} import Thing") == [name]
    assert effects_named_in(f"from fdbench.effects import {name}") == [name]
