"""What a diagnosis says."""

from collections.abc import Mapping
from typing import Any

JUDGED = {
    "held-out": "the records held out",
    "held-out repeats": "the last repeat of each motion, which was not fitted",
    "held-out laps": "the later laps, which were not fitted",
    "held-out last third of each record": "the last third of each record, which was not fitted",
}


def judged_on(answer: Mapping[str, Any]) -> str:
    """Return in words what the gap is judged on."""
    judged = str(answer["shrinkage"]["judged_on"])
    return JUDGED.get(judged, judged)
