"""Docstrings are data sheets: their sections, what they say of each argument, and how a terminal shows them."""

import inspect
import re
from typing import Any

HEADING = re.compile(r"^(Parameters|Attributes|Returns|Raises|Validity|References|Examples)\n-+\n", re.M)


def sections(thing: Any) -> dict[str, str]:
    """Return the sections of a docstring; the one before the first heading is named ''."""
    parts = HEADING.split(inspect.cleandoc(thing.__doc__ or ""))
    return {"": parts[0], **dict(zip(parts[1::2], parts[2::2], strict=True))}


def described(cls: type) -> dict[str, str]:
    """Return the described constructor arguments; a class says what its base leaves open, and the reverse."""
    found: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        section = sections(base).get("Parameters", "") if base is not object else ""
        for names, body in re.findall(r"^(\w+(?:, \w+)*)(?: : .+)?\n((?:[ ]+.*\n?)*)", section, re.M):
            text = " ".join(body.split())
            found |= {name: text for name in names.split(", ") if not text.startswith("See ")}
    return found


def plain(text: str) -> str:
    r"""Return a text in reStructuredText without its marks; formulas stay as they are written.

    >>> plain("The mass :math:`m`, see ``Plant``:\n\n.. math:: F = m a")
    'The mass m, see Plant:\n\n    F = m a'
    """
    text = re.sub(r":math:`([^`]*)`", r"\1", text).replace("``", "").replace("`", "")
    return re.sub(r"^\.\. math:: *\n?\s*", "    ", text, flags=re.M).strip()
