"""The pages of docs/reference are what their script writes, and say what the code declares."""

import difflib
import inspect
import re
from pathlib import Path
from types import ModuleType

import pytest
from conftest import script_of_docs

import fdbench.api
from fdbench.catalogue import scenario_ids
from fdbench.diagnosis.settings import settings
from fdbench.effects import effects
from fdbench.envs.tasks import tasks
from fdbench.estimator import estimators
from fdbench.metrics import metrics
from fdbench.units import unit_of

REPOSITORY = Path(__file__).resolve().parents[2]
FILES = ("api.md", "effects.md", "estimators.md", "metrics.md", "model.md", "scenarios.md", "tasks.md")
MEASURED = ("settings.md",)  # by a benchmark, hours long


@pytest.fixture(scope="module")
def script() -> ModuleType:
    return script_of_docs("make_reference")


@pytest.fixture(scope="module")
def pages(script: ModuleType) -> dict[str, str]:
    found: dict[str, str] = script.pages()
    return found


@pytest.mark.parametrize("name", FILES)
def test_page_is_up_to_date(name: str, pages: dict[str, str]) -> None:
    written = (REPOSITORY / "docs" / "reference" / name).read_text("utf-8").splitlines()
    changes = [*difflib.unified_diff(written, pages[name].splitlines(), "written", "as the code is", lineterm="", n=0)]
    assert changes == [], "out of date: run python docs/make_reference.py\n" + "\n".join(changes[:20])


def test_no_other_page_is_there(pages: dict[str, str]) -> None:
    assert sorted(pages) == sorted(FILES)
    assert sorted(path.name for path in (REPOSITORY / "docs" / "reference").iterdir()) == sorted((*FILES, *MEASURED))


@pytest.mark.parametrize("name", settings())
def test_a_setting_has_a_row_with_its_value(name: str) -> None:
    setting = settings()[name]
    rows = (REPOSITORY / "docs" / "reference" / "settings.md").read_text("utf-8").splitlines()
    (row,) = (row for row in rows if row.startswith(f"| `{name}` |"))
    values = setting.value if isinstance(setting.value, tuple) else (setting.value,)
    said = f"{', '.join(f'{value:.6g}' for value in values)} {unit_of(setting.name)}".strip()
    assert row.split(" | ")[1:4] == [said, setting.meaning, setting.origin], (
        "out of date: run python benchmarks/settings_sensitivity.py --table"
    )


@pytest.mark.parametrize(
    ("page", "names"),
    [
        ("effects.md", sorted(effects.modules())),
        ("estimators.md", sorted(estimators.modules())),
        ("metrics.md", sorted(metrics.modules())),
        ("scenarios.md", scenario_ids()),
        ("tasks.md", sorted(tasks.modules())),
    ],
)
def test_everything_has_a_section(page: str, names: list[str], pages: dict[str, str]) -> None:
    assert names
    assert re.findall(r"^## (\S+)$", pages[page].partition("\n## Keys\n")[0], re.M) == names


@pytest.mark.parametrize("name", sorted(effects.modules()))
def test_effects_state_their_parameters(name: str, pages: dict[str, str]) -> None:
    section = pages["effects.md"].partition(f"\n## {name}\n")[2].partition("\n## ")[0]
    assert "```math" in section
    assert "Source:" in section
    for item in effects.get(name).parameters():
        row = (f"`{item.name}`", f"`{item.symbol}`", item.unit, f"{item.low:g}", f"{item.high:g}", f"{item.typical:g}")
        assert f"| {' | '.join(row)} |" in section


def test_the_face_of_the_package_is_described(pages: dict[str, str]) -> None:
    sections = re.findall(r"^## (\S+)$", pages["api.md"], re.M)
    assert {name for name in fdbench.__all__ if name != "__version__"} <= set(sections)
    assert {"Context", "Record", "Regression", "Estimate", "Plant", *fdbench.api.__all__} <= set(sections)
    for name, thing in (("diagnose", fdbench.diagnose), ("run", fdbench.run), ("compare", fdbench.compare)):
        section = pages["api.md"].partition(f"\n## {name}\n")[2].partition("\n## ")[0]
        for argument in inspect.signature(thing).parameters:
            assert re.search(rf"^\| `[^`]*\b{argument}\b[^`]*` \|", section, re.M), f"{name}: {argument}"


def test_keys_state_unit_and_bounds(pages: dict[str, str]) -> None:
    section = pages["scenarios.md"].partition("\n### screw\n")[2].partition("\n### ")[0]
    assert "| `stiffness_N_per_m` | N/m | number | above 0 |" in section
    assert "| `damping_N_s_per_m` | N s/m | number | at least 0 |" in section


def test_every_key_of_a_model_has_a_meaning(pages: dict[str, str]) -> None:
    rows = re.findall(r"^\| (`.+) \|$", pages["model.md"], re.M)
    assert len(rows) > 50
    assert [row for row in rows if row.rstrip().endswith("|")] == []
    keys = {key for row in rows for key in re.findall(r"`(\w+)`", row)}
    assert {"lead_m", "gear_ratio", "force_offset_N", "force_offset_Nm", "load", "shaft", "axis", "exclude"} <= keys


@pytest.mark.parametrize("name", FILES)
def test_markdown_is_whole(name: str, pages: dict[str, str]) -> None:
    text = pages[name]
    assert text.count("```") % 2 == 0
    for left in (":math:", ".. math::", "``math", "\n---\n"):
        assert left not in text.replace("```math", "")
    anchors = [
        re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in re.findall(r"^#+ (.+)$", text, re.M)
    ]
    assert len(anchors) == len(set(anchors)), "two sections of one name"
    assert set(re.findall(r"\]\(#([^)]+)\)", text)) <= set(anchors)


def test_docstrings_become_markdown(script: ModuleType) -> None:
    text = "A ``b`` and :math:`c`.\n\n.. math:: F =\n          G\n\nSource: none.\n\n>>> 1 + 1\n2\n\nEnd."
    assert script.markdown(text) == (
        "A `b` and $c$.\n\n```math\nF =\nG\n```\n\nSource: none.\n\n```python\n>>> 1 + 1\n2\n```\n\nEnd."
    )
