"""The pictures of docs/papers: the script names them all, every page shows its own, the files are fit to be shown."""

import re
from pathlib import Path
from types import ModuleType
from xml.etree import ElementTree

import pytest
from conftest import script_of_docs

from fdbench import reproduce

REPOSITORY = Path(__file__).resolve().parents[2]
PAPERS = REPOSITORY / "docs" / "papers"
PAGES = sorted(page.name for page in PAPERS.glob("*.md"))
FILES = sorted(file.name for file in (PAPERS / "pictures").iterdir())
LARGEST_BYTES = 60_000
LINK = re.compile(r"^!\[(.*)\]\((.*)\)$", re.M)


@pytest.fixture(scope="module")
def script() -> ModuleType:
    """Import the script, which must not need matplotlib for that."""
    return script_of_docs("make_pictures")


def links(page: str) -> list[str]:
    """Return the files that a page shows."""
    return [path for _, path in LINK.findall((PAPERS / page).read_text("utf-8"))]


def test_every_file_is_drawn_by_the_script(script: ModuleType) -> None:
    assert sorted(f"{draw.__name__}.svg" for drawn in script.PICTURES.values() for draw in drawn) == FILES


def test_every_paper_has_pictures_of_its_own_name(script: ModuleType) -> None:
    assert sorted(script.PICTURES) == reproduce.papers()
    for paper, drawn in script.PICTURES.items():
        assert 2 <= len(drawn) <= 4
        assert all(draw.__name__.startswith(f"{paper}_") for draw in drawn)


def test_every_picture_is_shown_once() -> None:
    assert sorted(path for page in PAGES for path in links(page)) == [f"pictures/{file}" for file in FILES]


@pytest.mark.parametrize("page", PAGES)
def test_page_shows_and_explains_one_paper(page: str) -> None:
    shown = links(page)
    assert len({path.partition("_")[0] for path in shown}) == 1
    paragraphs = (PAPERS / page).read_text("utf-8").split("\n\n")
    for place, paragraph in enumerate(paragraphs):
        if "](pictures/" in paragraph:
            found = LINK.fullmatch(paragraph)
            assert found is not None, f"not a paragraph of its own: {paragraph}"
            assert len(found[1]) > 20, f"no text for those who do not see it: {paragraph}"
            assert paragraphs[place + 1][0].isupper(), f"no caption: {paragraph}"
            assert len(paragraphs[place + 1]) > 100, f"no caption: {paragraph}"


@pytest.mark.parametrize("file", FILES)
def test_file_is_fit_to_be_shown(file: str) -> None:
    content = (PAPERS / "pictures" / file).read_bytes()
    assert len(content) < LARGEST_BYTES
    root = ElementTree.fromstring(content)
    svg = "{http://www.w3.org/2000/svg}"
    background = root.find(f".//{svg}g[@id='patch_1']/{svg}path")
    assert background is not None
    assert "fill: #ffffff" in background.get("style", ""), "on a dark page it needs a ground of its own"
    assert any(re.search(r", \S", text.text or "") for text in root.iter(f"{svg}text")), "no axis states its unit"
    assert b"dc:date" not in content, "it would change from day to day"


def test_coordinates_are_shortened(script: ModuleType) -> None:
    assert (
        script.SHORTER.sub(script.shorter, ' d="M 1.23999 -20.5 \nL 3 4.001 \nL 5 6z"')
        == ' d="M 1.23 -20.5 3 4.00 5 6z"'
    )
