"""The trial board: the score sheets of published trials as a part of leaderboard.md."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

SHEETS = Path(__file__).with_name("sheets")
OWN = "fdbench"
COLUMNS = {
    "top_1": "top-1",
    "type_top_1": "type first",
    "exact_set": "exact set",
    "probability_of_truth": "p of truth",
    "calibration_error": "calibration error",
    "false_alarms": "false alarms",
    "closure": "closure",
    "oracle_closure": "closure of the oracle",
    "auroc_unknown": "AUROC unknown",
    "confidently_wrong": "confidently wrong",
}
TIERS = {
    "A": "effects of the library's own forms, on the package's own simulator",
    "B": "a second implementation of axis and effects: other formulae, coloured noise, friction that changes",
    "C": "second implementation, effects that the library lacks, alone or with a listed one",
    "D": "second implementation, one production cycle in three repeats, one position signal",
    "F": "twelve foreign kinds of axis, a third of the cases with nothing injected, data sheets far off",
}


def published() -> list[dict[str, Any]]:
    """Return the score sheets that the package was shipped with."""
    return [json.loads(path.read_text(encoding="utf-8")) for path in sorted(SHEETS.glob("*.json"))]


def board(sheets: Sequence[Mapping[str, Any]]) -> str:
    """Return the trial board as Markdown, or an empty text where there are no sheets.

    A figure stands with its 95 % bootstrap interval over the cases.
    """
    return "\n".join(_lines(sheets)) + "\n" if sheets else ""


def _lines(sheets: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    yield ""
    yield "## Blind trials of the diagnosis"
    yield ""
    yield "Cases were drawn from a nonce that was made after the code was frozen; the sealed key was opened to score."
    yield "Each figure has its 95% interval over the cases. `fdbench trial make --nonce NONCE` makes a trial again."
    for tier in sorted({sheet["tier"] for sheet in sheets}):
        own = [sheet for sheet in sheets if sheet["tier"] == tier]
        yield ""
        yield f"### Tier {tier}: {TIERS.get(tier, 'its own')}"
        yield ""
        yield from _origin(own)
        yield ""
        yield from _table(own)
        for sheet in own:
            if sheet["diagnoser"] == OWN:
                yield ""
                yield from _by_effect(sheet)


def _origin(sheets: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    yield "; ".join(sorted({_made(sheet) for sheet in sheets})) + "."


def _made(sheet: Mapping[str, Any]) -> str:
    commit = sheet["made_by_commit"][:12]
    by = f", made by {commit}" if commit else ""
    return f"{sheet['cases']} cases{by}, nonce `{sheet['nonce']}`"


def _table(sheets: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    used = [name for name in COLUMNS if any(name in sheet["quantities"] for sheet in sheets)]
    yield f"| diagnoser | {' | '.join(COLUMNS[name] for name in used)} | failed | seconds |"
    yield f"| --- |{' ---: |' * (len(used) + 2)}"
    order = sorted(sheets, key=lambda sheet: -sheet["quantities"]["exact_set"]["value"])
    for sheet in order:
        cells = [_cell(sheet["quantities"].get(name)) for name in used]
        yield (
            f"| `{sheet['diagnoser']}` | {' | '.join(cells)} | {sheet['failed']} | {sheet['seconds_per_case']:.1f} |"
        )


def _cell(quantity: Mapping[str, Any] | None) -> str:
    if quantity is None:
        return ""
    low, high = quantity["ci95"]
    return f"{quantity['value']:.2f} ({low:.2f} to {high:.2f})"


def _by_effect(sheet: Mapping[str, Any]) -> Iterator[str]:
    yield f"What `{sheet['diagnoser']}` makes of each effect:"
    yield ""
    yield "| injected | cases | named | mean probability | named wrongly where it is missed |"
    yield "| --- | ---: | ---: | ---: | --- |"
    for item in sheet["effects"]:
        wrong = _words(item["mistaken_for"])
        chance = item["mean_probability"]
        yield f"| `{item['effect']}` | {item['cases']} | {item['recall']:.2f} | {chance:.2f} | {wrong} |"
    if sheet["unlisted"]:
        yield ""
        yield "| not in the library | cases | mean probability of unknown | named in its place |"
        yield "| --- | ---: | ---: | --- |"
    for item in sheet["unlisted"]:
        chance = item["mean_unknown_probability"]
        yield f"| {item['form']} | {item['cases']} | {chance:.2f} | {_words(item['mistaken_for'])} |"

    kinds = sheet.get("kinds", ())
    if kinds:
        yield ""
        yield "| kind of axis | cases | top-1 | exact set | false alarms | named wrongly |"
        yield "| --- | ---: | ---: | ---: | ---: | --- |"
    for item in kinds:
        shares = " | ".join(_share(item[name]) for name in ("top_1", "exact_set", "false_alarms"))
        yield f"| {item['kind']} | {item['cases']} | {shares} | {_words(item['named_wrongly'])} |"


def _share(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


def _words(counts: Mapping[str, int]) -> str:
    return ", ".join(f"`{name}` {count}" for name, count in counts.items())
