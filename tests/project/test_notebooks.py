"""The notebooks are what their script writes; the blocks of their pages run in `test_readme`."""

import json
from pathlib import Path

from conftest import script_of_docs

NOTEBOOKS = Path(__file__).resolve().parents[2] / "docs" / "notebooks"


def test_notebooks_are_those_of_their_pages() -> None:
    script = script_of_docs("make_notebooks")
    assert {path.name for path in NOTEBOOKS.iterdir()} == {*script.PAGES}
    for name, page in script.PAGES.items():
        assert (NOTEBOOKS / name).read_text("utf-8") == script.notebook(page), f"python docs/make_notebooks.py: {name}"


def test_all_blocks_of_python_are_cells() -> None:
    found = json.loads((NOTEBOOKS / "from_python.ipynb").read_text("utf-8"))
    cells = ["".join(cell["source"]) for cell in found["cells"] if cell["cell_type"] == "code"]
    page = (NOTEBOOKS.parent / "how-to" / "python.md").read_text("utf-8")
    blocks = [part.split("```")[0].strip() for part in page.split("```python\n")[1:]]
    assert cells == blocks
