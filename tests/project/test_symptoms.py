"""The page of symptoms leads to effects that exist, to each of them once, and sets look-alikes side by side."""

import re
from pathlib import Path

from fdbench.effects import effects

PAGE = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "symptoms.md"


def linked() -> list[tuple[str, str]]:
    return re.findall(r"\[`(\w+)`\]\(\.\./reference/effects\.md#(\w+)\)", PAGE.read_text("utf-8"))


def test_effects_are_linked_once() -> None:
    assert [text for text, anchor in linked() if text != anchor] == []
    names = [anchor for _, anchor in linked()]
    assert len(names) == len(set(names)) > 30
    assert set(names) <= set(effects.names())


def test_look_alikes_stand_in_one_section() -> None:
    sections, named = PAGE.read_text("utf-8").split("\n## "), {anchor for _, anchor in linked()}
    apart = [
        (name, other)
        for name in named
        for other in named & set(effects.get(name).confusable_with)
        if not any(f"`{name}`" in section and f"`{other}`" in section for section in sections)
    ]
    assert apart == []
