"""The page of a diagnosis from its answer as JSON: all that `fdbench.report.diagnosis` shows but what needs records."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

from fdbench.diagnosis.diagnose import Diagnosis
from fdbench.effects import Effect, effects
from fdbench.errors import FdbenchError
from fdbench.report._page import Block, Section, note, paragraph, table, write_page
from fdbench.report._sections import lead, noise_floors, sections

# Larger numbers, and those that are none, can be neither drawn nor computed with.
LARGEST = 1e100


class _Or(NamedTuple):
    """What may be null."""

    shape: Any


# What the page reads. A list of one shape may have any length, a table of "*" any keys; a "?" marks what may be absent.
_PAIR, _SHARES = (float, float), {"*": float}
_SHAPE: dict[str, Any] = {
    "gap": {
        "channels": {
            "*": {
                "before": float,
                "recalibrated": float,
                "repaired": float,
                "reduction": float,
                "noise_floor": float,
                "unit": str,
            }
        }
    },
    "where": {
        "motion": _SHARES,
        "frequency": [{"band_Hz": _PAIR, "share": float, "ci95?": _PAIR}],
        "position": [{"range_m": _PAIR, "share": float, "ci95?": _PAIR}],
        "velocity": [{"range_m_per_s": _PAIR, "share": float, "ci95?": _PAIR}],
        "time": [{"range_s": _PAIR, "share": float, "ci95?": _PAIR}],
        "channel": _SHARES,
        "ci95?": {"*": {"*": _PAIR}},
    },
    "causes": [
        {
            "effect": str,
            "probability": float,
            "share": float,
            "unique_share": float,
            "parameters": {"*": {"value": float, "ci95": _Or(_PAIR), "unit": str}},
            "indistinguishable_from": [str],
        }
    ],
    "suspects": [{"effect": str, "probability": float}],
    "unknown_probability": float,
    "no_gap_probability": float,
    "probabilities_from?": str,
    "shrinkage": {
        "judged_on": str,
        "on_paper": float,
        "steps": [{"added": str, "before": float, "after": float, "reduction": float, "ci95": _PAIR}],
        "total": float,
        "ci95": _PAIR,
        "reducible_left": float,
    },
    "next_experiment": _Or(
        {
            "to_separate": [str],
            "trajectory": str,
            "motion?": str,
            "position_m?": _PAIR,
            "amplitude_m?": float,
            "velocity_m_per_s?": float,
            "acceleration_m_per_s2?": float,
            "duration_s?": float,
            "expected_probability?": {"now": float, "after": float},
            "expected_gain_per_s?": float,
            "separates?": [{"effects": [str], "expected_log_odds": float}],
        }
    ),
    "warnings": [str],
    "parametric": {"closed_by_recalibration": float, "moved_in_standard_deviations": _SHARES},
    "noise_floor": {
        "*": {
            "value": float,
            "unit": str,
            "measured_from_repeats": bool,
            "within_a_run?": float,
            "from_run_to_run?": float,
            "frequency?": [{"band_Hz": _PAIR, "value": float}],
        }
    },
}
_WORDS = {float: "a number", str: "a text", bool: "true or false", dict: "a table", list: "a list", tuple: "a pair"}


def write_answer(source: Path, output: Path) -> None:
    """Write the answer of a diagnosis, a file of ``fdbench diagnose --json``, as one HTML page that works offline.

    Raises
    ------
    FdbenchError
        If the file holds no such answer, or the page cannot be written.
    """
    found = read_answer(source)
    remark = (
        f"Written from {source.name} alone: for curves over time, position and frequency, and for the rivals, diagnose "
        "the records again with --html."
    )
    try:
        first = [*lead(found), note(remark)]
        parts = [*sections(found), Section("Noise floor and re-calibration", list(_basis(found.answer)))]
    except KeyError as error:
        raise FdbenchError(f"{source}: {error} is missing; another version of fdbench wrote this answer.") from error
    write_page(output, "fdbench: diagnosis of a gap", first, parts)


def read_answer(source: Path) -> Diagnosis:
    """Return the answer in a JSON file as what pages are made of; runs, rivals and shifts are not known.

    Raises
    ------
    FdbenchError
        If the file cannot be read or lacks something that the page needs; the message says what.
    """
    try:
        answer = json.loads(source.read_text("utf-8"))
        _check(answer, _SHAPE, "")
        final = SimpleNamespace(effects=list(_effects(answer)), shifts=())
    except (ValueError, RecursionError, FdbenchError) as error:
        raise FdbenchError(
            f"{source}: neither a folder of results nor an answer of `fdbench diagnose --json`: {error}"
        ) from error
    calibrated = SimpleNamespace(effects=(), shifts=())
    return cast(Diagnosis, SimpleNamespace(answer=answer, stages=(), calibrated=calibrated, final=final))


def _check(value: Any, shape: Any, where: str) -> None:
    if isinstance(shape, _Or):
        if value is not None:
            _check(value, shape.shape, where)
        return
    kind = shape if isinstance(shape, type) else type(shape)
    if not _is(value, kind) or (kind is tuple and len(value) != len(shape)):
        raise FdbenchError(f"{where or 'the whole'} is {_described(value)}, expected {_WORDS[kind]}.")
    if kind is list:
        for number, item in enumerate(value):
            _check(item, shape[0], f"{where}[{number}]")
    elif kind is tuple:
        for number, (item, inner) in enumerate(zip(value, shape, strict=True)):
            _check(item, inner, f"{where}[{number}]")
    elif kind is dict:
        for name, inner in (dict.fromkeys(value, shape["*"]) if "*" in shape else shape).items():
            key = name if "*" in shape else name.removesuffix("?")
            place = f"{where}.{key}".lstrip(".")
            if key in value:
                _check(value[key], inner, place)
            elif key == name:
                raise FdbenchError(f"{place} is missing.")


def _is(value: Any, kind: type) -> bool:
    if kind is float:
        return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST
    return isinstance(value, list if kind is tuple else kind)


def _described(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else f"{text[:40]}..."


def _effects(answer: Mapping[str, Any]) -> Iterator[Effect]:
    """Yield the effects that are named with all their parameters, but those of files, which are not known here."""
    for cause in answer["causes"]:
        if cause["effect"] in effects.names():
            kind = effects.get(cause["effect"])
            if cause["parameters"].keys() == {item.name for item in kind.parameters()}:
                yield kind(**{name: value["value"] for name, value in cause["parameters"].items()})


def _basis(answer: Mapping[str, Any]) -> Iterator[Block]:
    yield noise_floors(answer)
    moved = answer["parametric"]["moved_in_standard_deviations"].items()
    yield paragraph("What re-calibration alone moved, in standard deviations of the values on paper:")
    yield table(["value on paper", "moved by"], [[name.replace("_", " "), f"{by:+.2f}"] for name, by in moved], "lr")
