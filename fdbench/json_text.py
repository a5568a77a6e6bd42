"""JSON, and values of TOML, as they are written."""

import json
import math
from collections.abc import Mapping


def json_text(value: object) -> str:
    """Return a value as JSON; numbers that JSON lacks, which are infinite or none, become null."""
    return json.dumps(_finite(value), indent=2, ensure_ascii=False, allow_nan=False)


def toml_value(value: object) -> str:
    r"""Return a text, a number or a list of them in TOML, which writes them as JSON does but for one character.

    >>> toml_value("a\x7fb"), toml_value([0, 5])
    ('"a\\u007fb"', '[0, 5]')
    """
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _finite(value: object) -> object:
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
