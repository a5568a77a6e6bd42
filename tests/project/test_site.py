"""The documentation as pages for a browser: every page is there, no link leads nowhere, and nothing is fetched."""

import re
from pathlib import Path

from conftest import script_of_docs


def test_every_page_is_there_and_needs_no_network(tmp_path: Path) -> None:
    make_site = script_of_docs("make_site")
    make_site.site(tmp_path / "site")
    written = {path.relative_to(tmp_path / "site") for path in (tmp_path / "site").rglob("*.html")}
    expected = {
        page.with_name("index.html") if page.name == "README.md" else page.with_suffix(".html")
        for page in make_site.pages()
    }
    assert len(expected) > 20
    assert expected <= written
    drawn = set()
    for page in expected:
        text = (tmp_path / "site" / page).read_text("utf-8")
        assert not re.findall(r'<(?:script|img|iframe)[^>]*src="(?:https?:)?//|<link[^>]*href="(?:https?:)?//', text)
        drawn |= {(page.parent / source) for source in re.findall(r'<img[^>]*src="([^"]+)"', text)}
        shown = re.sub(r"<(code|pre|script)\b.*?</\1>", "", text, flags=re.S)
        assert "$" not in re.sub(r"<[^>]*>", "", shown), page
    assert drawn == set(make_site.pictures()) != set()
    assert all((tmp_path / "site" / picture).is_file() for picture in drawn)
