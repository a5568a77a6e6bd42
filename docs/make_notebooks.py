"""Write the pages that are one program as notebooks: `python docs/make_notebooks.py`.

Blocks of Python become cells of code, the text between them cells of text; what a page says that a block prints is left
out, for a notebook prints it. Links lead from the folder of the notebooks.
"""

import re
from pathlib import Path

import jupytext
import nbformat

DOCS = Path(__file__).resolve().parent
PAGES = {"from_python.ipynb": DOCS / "how-to" / "python.md"}
KERNEL = {"display_name": "Python 3", "language": "python", "name": "python3"}

_PRINTED = re.compile(r"^```text\n.*?^```\n+", re.M | re.S)
_LINK = re.compile(r"\]\((?!\w+://|#|\.\./)([^)\s]+)\)")


def notebook(page: Path) -> str:
    """Return the text of the notebook of a page."""
    text = _PRINTED.sub("", page.read_text("utf-8"))
    found = jupytext.reads(_LINK.sub(rf"](../{page.parent.name}/\1)", text), fmt="md")
    found.metadata = nbformat.from_dict({"kernelspec": KERNEL})
    for number, cell in enumerate(found.cells):
        cell.id, cell.metadata = f"cell-{number}", nbformat.from_dict({})
    nbformat.validate(found)
    return str(nbformat.writes(found)) + "\n"


if __name__ == "__main__":
    folder = DOCS / "notebooks"
    folder.mkdir(exist_ok=True)
    for name, page in PAGES.items():
        (folder / name).write_text(notebook(page), "utf-8")
