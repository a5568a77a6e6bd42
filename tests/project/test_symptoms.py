"""The page of symptoms leads to every effect of the package, and to each of them once."""

import re
from pathlib import Path

from fdbench.effects import effects

PAGE = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "symptoms.md"
OWN = [name for name in effects.names() if effects.get(name).__module__.startswith("fdbench.effects.")]


def test_every_effect_is_linked_once() -> None:
    linked = re.findall(r"\[`(\w+)`\]\(\.\./reference/effects\.md#(\w+)\)", PAGE.read_text("utf-8"))
    assert len(OWN) > 30
    assert [text for text, anchor in linked if text != anchor] == []
    assert sorted(anchor for _, anchor in linked) == sorted(OWN)


def test_look_alikes_stand_in_one_section() -> None:
    sections = PAGE.read_text("utf-8").split("\n## ")
    apart = [
        (name, other)
        for name in OWN
        for other in effects.get(name).confusable_with
        if not any(f"`{name}`" in section and f"`{other}`" in section for section in sections)
    ]
    assert apart == []
