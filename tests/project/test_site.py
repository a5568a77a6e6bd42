"""The documentation as pages for a browser: every page is there, no link leads nowhere, and nothing is fetched."""

import importlib.util
import re
from pathlib import Path

from conftest import REPOSITORY


def test_every_page_is_there_and_needs_no_network(tmp_path: Path) -> None:
    spec = importlib.util.spec_from_file_location("make_site", REPOSITORY / "docs" / "make_site.py")
    assert spec is not None
    assert spec.loader is not None
    make_site = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make_site)
    make_site.site(tmp_path / "site")
    written = {path.relative_to(tmp_path / "site") for path in (tmp_path / "site").rglob("*.html")}
    expected = {
        page.with_name("index.html") if page.name == "README.md" else page.with_suffix(".html")
        for page in make_site.pages()
    }
    assert len(expected) > 20
    assert expected <= written
    for page in expected:
        text = (tmp_path / "site" / page).read_text("utf-8")
        assert not re.findall(r'<(?:script|img|iframe)[^>]*src="(?:https?:)?//|<link[^>]*href="(?:https?:)?//', text)
        shown = re.sub(r"<(code|pre|script)\b.*?</\1>", "", text, flags=re.S)
        assert "$" not in re.sub(r"<[^>]*>", "", shown), page
