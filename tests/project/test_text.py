"""What may stand in the repository's text: no path of one machine, no host of a package registry."""

import re
from fnmatch import fnmatch
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
IGNORED = [".git", *((REPOSITORY / ".gitignore").read_text("utf-8").replace("/", "").split())]
FOLDERS = "|".join(["home", "root", "work", "Users"])
HOSTS = "|".join(["pypi", "pythonhosted", "anaconda", "npmjs", "ghcr"])
ABSOLUTE_PATH = rf"(?<!\w)/(?:{FOLDERS})/"
REGISTRY_HOST = rf"\b(?:{HOSTS})\.(?:org|com|io)\b"


def texts() -> dict[str, str]:
    """Return the text of every file that is not ignored and is not binary."""
    found = {}
    for path in sorted(REPOSITORY.rglob("*")):
        parts = path.relative_to(REPOSITORY).parts
        if path.is_file() and not any(fnmatch(part, pattern) for part in parts for pattern in IGNORED):
            content = path.read_bytes()
            if b"\0" not in content:
                found["/".join(parts)] = content.decode("utf-8", errors="replace")
    return found


@pytest.mark.parametrize("pattern", [ABSOLUTE_PATH, REGISTRY_HOST], ids=["absolute path", "registry host"])
def test_text_is_free_of(pattern: str) -> None:
    files = texts()
    assert "pyproject.toml" in files
    found = [
        f"{name}:{number}: {line.strip()[:120]}"
        for name, text in files.items()
        for number, line in enumerate(text.splitlines(), 1)
        if re.search(pattern, line)
    ]
    assert found == []


def test_patterns_find_what_they_look_for() -> None:
    assert re.search(ABSOLUTE_PATH, 'folder = "/' + 'home/me"')
    assert not re.search(ABSOLUTE_PATH, "https://example.net/" + "work/me and docs/" + "root/me")
    assert re.search(REGISTRY_HOST, "https://files." + "pythonhosted" + ".org/")


def test_every_scenario_file_is_versioned() -> None:
    names = [path.name for path in (REPOSITORY / "scenarios").iterdir()]
    assert names
    assert [name for name in names if not re.fullmatch(r"\w+-v\d+\.toml", name)] == []


def test_no_two_classes_have_one_name() -> None:
    places: dict[str, list[str]] = {}
    for folder in ("fdbench", "baselines"):
        for path in sorted((REPOSITORY / folder).rglob("*.py")):
            for name in re.findall(r"^class (\w+)", path.read_text("utf-8"), re.M):
                places.setdefault(name, []).append(str(path.relative_to(REPOSITORY)))
    assert len(places) > 300
    assert {name: files for name, files in places.items() if len(files) > 1} == {}
