"""JSON as it is written."""

import json
import math
from collections.abc import Mapping


def json_text(value: object) -> str:
    """Return a value as JSON; numbers that JSON lacks, which are infinite or none, become null."""
    return json.dumps(_finite(value), indent=2, ensure_ascii=False, allow_nan=False)


def _finite(value: object) -> object:
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
