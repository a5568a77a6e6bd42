"""Write the documentation as pages for a browser that need no network: `make site`.

The pages are those of the repository. What a browser shows otherwise than they are written: equations become MathML,
and links to files that are no pages become their text. Search works where the pages are served, as by
`python -m http.server --directory build/site`.
"""

import argparse
import io
import logging
import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from urllib.parse import urlsplit

from latex2mathml.converter import convert
from mkdocs.commands.build import build
from mkdocs.config import load_config
from mkdocs.exceptions import MkDocsException

REPOSITORY = Path(__file__).resolve().parents[1]
SECTIONS = {
    "Tutorials": "docs/tutorials",
    "How to": "docs/how-to",
    "Papers": "docs/papers",
    "Reference": "docs/reference",
    "Examples": "examples",
}
STYLE_FILE = "fdbench.css"
STYLE = ".md-typeset td code { white-space: nowrap; }\n.equation { overflow-x: auto; padding-bottom: 0.5em; }\n"
SINGLE = {"Leaderboard": "leaderboard.md", "Changes": "CHANGELOG.md", "Contributing": "CONTRIBUTING.md"}

_BLOCK = re.compile(r"(^```.*?^```$)", re.M | re.S)
_CODE = re.compile(r"(^```.*?^```$|`[^`\n]+`)", re.M | re.S)
_EQUATION = re.compile(r"^```math\n(.*?)^```$", re.M | re.S)
_SYMBOL = re.compile(r"(?<![\\$\w])\$([^$\n]+(?:\n[^$\n]+)?)\$(?![$\w])")
_LINK = re.compile(r"\[((?:[^][]|\[[^][]*\])+)\]\(([^)\s]+)\)")


def pages() -> list[Path]:
    """Return the pages, relative to the repository, in the order in which docs/README.md names them."""
    index = (REPOSITORY / "docs" / "README.md").read_text("utf-8")
    every = [*(REPOSITORY / "docs").rglob("*.md"), *(REPOSITORY / "examples").rglob("*.md")]
    every += [REPOSITORY / "README.md", *(REPOSITORY / name for name in SINGLE.values())]
    found = [page.relative_to(REPOSITORY) for page in every if page.is_file()]
    named = {page: index.find(f"({page.relative_to('docs')})") if page.is_relative_to("docs") else -1 for page in found}
    return sorted(found, key=lambda page: (named[page] < 0, named[page], page))


def pictures() -> list[Path]:
    """Return the pictures beside the pages, relative to the repository."""
    every = (file for folder in ("docs", "examples") for file in (REPOSITORY / folder).rglob("*"))
    return [file.relative_to(REPOSITORY) for file in every if file.suffix in (".png", ".svg")]


def navigation(found: list[Path]) -> list[dict[str, str | list[str]]]:
    """Return titles and pages of the menu."""
    nav: list[dict[str, str | list[str]]] = [{"fdbench": "README.md"}, {"All pages": "docs/README.md"}]
    for title, folder in SECTIONS.items():
        nav.append({title: [str(page) for page in found if page.is_relative_to(folder)]})
    return nav + [{title: name} for title, name in SINGLE.items() if Path(name) in found]


def for_a_browser(page: Path, found: set[Path]) -> str:
    """Return the text of a page with equations as MathML and links to what is ``found`` alone, pages and pictures."""
    text = re.sub(r"\A<!--.*?-->\s*", "", (REPOSITORY / page).read_text("utf-8"), flags=re.S)
    text = _EQUATION.sub(lambda match: f'<div class="equation">{_math(match[1], "block", page)}</div>', text)

    def inline(match: re.Match[str]) -> str:
        return f"<span>{_math(match[1], 'inline', page)}</span>"

    text = _outside(_BLOCK, text, lambda part: _LINK.sub(lambda match: _linked(match, page, found), part))
    return _outside(_CODE, text, lambda part: _SYMBOL.sub(inline, part))


def _outside(kept: re.Pattern[str], text: str, change: Callable[[str], str]) -> str:
    """Return a text that is changed but for the parts that are kept."""
    return "".join(part if number % 2 else change(part) for number, part in enumerate(kept.split(text)))


def _math(latex: str, display: str, page: Path) -> str:
    """Return MathML that Markdown leaves alone."""
    found: str = convert(" ".join(latex.split()).replace(r"\arg", r"\operatorname{arg}"), display=display)
    left = re.search(r"\\[a-zA-Z]+", found)
    if left:
        raise ValueError(f"{page}: {left[0]} is no command that is known here: {latex.strip()}")
    return found.replace("*", "&#42;").replace("_", "&#95;")


def _linked(match: re.Match[str], page: Path, found: set[Path]) -> str:
    """Return a link to a page or picture, to the first page of a folder, or the text of a link to anything else."""
    path, _, anchor = match[2].partition("#")
    if urlsplit(path).scheme or not path:
        return match[0]
    target = (REPOSITORY / page.parent / path).resolve()
    if not target.is_relative_to(REPOSITORY):
        return match[1]
    target = target.relative_to(REPOSITORY)
    for candidate in (target, target / "README.md"):
        if candidate in found:
            to = Path(*[".."] * len(page.parent.parts), candidate)
            return f"[{match[1]}]({to}{'#' + anchor if anchor else ''})"
    return match[1]


def _slugs(text: str, separator: str) -> str:
    """Return the anchor that GitHub gives a title."""
    return re.sub(r"[^\w -]", "", text.lower()).replace(" ", separator)


def site(out: Path) -> None:
    """Write all pages to a folder.

    Raises
    ------
    MkDocsException
        If a link leads nowhere.
    """
    found, shown, source = pages(), pictures(), out.with_name(f"{out.name}-source")
    shutil.rmtree(source, ignore_errors=True)
    for page in found:
        (source / page).parent.mkdir(parents=True, exist_ok=True)
        (source / page).write_text(for_a_browser(page, {*found, *shown}), "utf-8")
    for picture in shown:
        (source / picture).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(REPOSITORY / picture, source / picture)
    (source / STYLE_FILE).write_text(STYLE, "utf-8")
    schemes = [
        {"media": f"(prefers-color-scheme: {name})", "scheme": scheme}
        for name, scheme in (("light", "default"), ("dark", "slate"))
    ]
    config = load_config(
        io.StringIO("site_name: fdbench"),
        config_file_path=str(source.with_suffix(".yml")),
        docs_dir=str(source),
        site_dir=str(out),
        nav=navigation(found),
        theme={
            "name": "material",
            "font": False,
            "palette": schemes,
            "features": ["navigation.sections", "navigation.top", "content.code.copy"],
        },
        plugins=["search"],
        use_directory_urls=False,
        extra_css=[STYLE_FILE],
        markdown_extensions=[
            "admonition",
            "md_in_html",
            "pymdownx.superfences",
            {"toc": {"slugify": _slugs, "permalink": True}},
            {"pymdownx.highlight": {"use_pygments": True}},
        ],
        validation={"links": {"anchors": "warn", "unrecognized_links": "warn"}, "nav": {"omitted_files": "warn"}},
        strict=True,
    )
    build(config)
    shutil.rmtree(source)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, default=REPOSITORY / "build" / "site", help="folder of the pages")
    logging.basicConfig(level=logging.WARNING, format="%(message)s")
    try:
        site(parser.parse_args().out)
    except (MkDocsException, ValueError) as error:
        sys.exit(f"make_site: {error}")
