"""Score the answers to a trial: open the key, check every seal, and print the score sheet with intervals."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fdbench.effects import effects
from fdbench.errors import SpecError, did_you_mean
from fdbench.nonce import check_nonce
from fdbench.record import FloatArray
from fdbench.statistics import drawn_rows, percentile_interval
from fdbench.trials import forms, seal
from fdbench.trials.answer import FAILED
from fdbench.trials.make import MANIFEST, read_manifest
from fdbench.virtual_axes.oracle import oracle_closure

NAMED = 0.5  # probability above which an effect counts as named
WORTH_CALIBRATING = 0.05
BINS = 10
RESAMPLES = 1000


@dataclass(frozen=True, kw_only=True, eq=False)
class AnswerTable:
    """Answers beside truths; rows are cases.

    Attributes
    ----------
    effects, types : list of str
        What may be claimed, and of which type of cause each is.
    chances, present : (n_cases, n_effects) arrays
        Probability of each effect, and 1 where it is injected.
    unknown, none, has_unknown : (n_cases,) arrays
        Probabilities of an unknown cause and of none, and 1 where an unlisted effect is injected.
    closure, oracle_closure : (n_cases,) arrays
        Of the answer and of the oracle; not a number where it is not given.
    """

    effects: list[str]
    types: list[str]
    chances: FloatArray
    present: FloatArray
    unknown: FloatArray
    none: FloatArray
    has_unknown: FloatArray
    closure: FloatArray
    oracle_closure: FloatArray

    def rows(self, index: NDArray[np.intp]) -> "AnswerTable":
        """Return a table of chosen cases."""
        names = ("chances", "present", "unknown", "none", "has_unknown", "closure", "oracle_closure")
        return AnswerTable(
            effects=self.effects, types=self.types, **{name: getattr(self, name)[index] for name in names}
        )

    @property
    def named(self) -> NDArray[np.bool_]:
        """Which effects are named, (n_cases, n_effects)."""
        return self.chances > NAMED

    @property
    def is_empty(self) -> NDArray[np.bool_]:
        """Which cases have nothing injected."""
        return np.asarray(self.present.sum(axis=1) + self.has_unknown == 0.0)

    @property
    def is_single(self) -> NDArray[np.bool_]:
        """Which cases have one listed effect and nothing else."""
        return np.asarray((self.present.sum(axis=1) == 1.0) & (self.has_unknown == 0.0))


# ---- the quantities of the score sheet; each is not a number where no case bears on it ----


def top(table: AnswerTable, depth: int) -> float:
    """Return how often the injected effect is among the ``depth`` most probable; ties count as the worst order."""
    single = table.is_single
    if not single.any():
        return float("nan")
    chances = table.chances[single]
    own = np.sum(chances * table.present[single], axis=1, keepdims=True)
    others = np.sum(chances >= own, axis=1) - 1
    return float(np.mean((others < depth) & (own[:, 0] > 0.0)))


def type_top(table: AnswerTable) -> float:
    """Return how often the type of the injected effect is most probable: the sum over its effects; ties are wrong."""
    single = table.is_single
    if not single.any():
        return float("nan")
    member = np.array([[float(kind == own) for kind in dict.fromkeys(table.types)] for own in table.types])
    chances, present = table.chances[single] @ member, table.present[single] @ member
    own = np.sum(chances * present, axis=1, keepdims=True)
    return float(np.mean((np.sum(chances >= own, axis=1) == 1) & (own[:, 0] > 0.0)))


def exact_set(table: AnswerTable) -> float:
    """Return how often exactly the injected effects are named, and an unknown cause where there is one.

    An unknown cause beside listed effects is not held against an answer: there are background effects in every case.
    """
    same = (table.named == (table.present > 0.0)).all(axis=1)
    return float(np.mean(same & ((table.unknown > NAMED) | (table.has_unknown == 0.0))))


def micro_f1(table: AnswerTable) -> float:
    """Return the harmonic mean of precision and recall over all effects of all cases."""
    hits = float(np.sum(table.named * table.present))
    total = float(table.named.sum() + table.present.sum())
    return 2.0 * hits / total if total > 0.0 else float("nan")


def probability_of_truth(table: AnswerTable) -> float:
    """Return the mean over cases of the mean probability of what is injected; of none where nothing is."""
    sums = np.sum(table.chances * table.present, axis=1) + table.unknown * table.has_unknown
    counts = table.present.sum(axis=1) + table.has_unknown
    return float(np.mean(np.where(counts > 0.0, sums / np.maximum(counts, 1.0), table.none)))


def brier(table: AnswerTable) -> float:
    """Return the mean squared error of the probabilities of effects."""
    return float(np.mean((table.chances - table.present) ** 2))


def brier_skill(table: AnswerTable) -> float:
    """Return the share of the Brier score of the base rate of all effects that is gone."""
    rate = float(table.present.mean())
    return 1.0 - brier(table) / (rate * (1.0 - rate)) if 0.0 < rate < 1.0 else float("nan")


def calibration_error(table: AnswerTable) -> float:
    """Return the expected calibration error over probabilities above ``WORTH_CALIBRATING``, in ten bins."""
    chances, present = table.chances.ravel(), table.present.ravel()
    worth = chances > WORTH_CALIBRATING
    if not worth.any():
        return float("nan")
    chances, present = chances[worth], present[worth]
    place = np.minimum((chances * BINS).astype(int), BINS - 1)
    gaps = np.abs(np.bincount(place, weights=chances - present, minlength=BINS))
    return float(gaps.sum() / len(chances))


def false_alarms(table: AnswerTable) -> float:
    """Return how often an effect is named where nothing is injected."""
    empty = table.is_empty
    return float(np.mean(table.named[empty].any(axis=1))) if empty.any() else float("nan")


def confidently_wrong(table: AnswerTable) -> float:
    """Return how often an effect that is not there is named beside or in place of an unlisted one, nothing doubted."""
    open_ = table.has_unknown > 0.0
    if not open_.any():
        return float("nan")
    wrong = (table.named & (table.present == 0.0)).any(axis=1) & (table.unknown <= NAMED)
    return float(np.mean(wrong[open_]))


def median_closure(closure: FloatArray) -> float:
    """Return the median share of the held-out gap beyond the noise that is closed, over the cases that have it."""
    given = closure[np.isfinite(closure)]
    return float(np.median(given)) if len(given) else float("nan")


def known_against_unknown(table: AnswerTable) -> float:
    """Return the area under the curve of the unknown probability, unlisted effects against listed ones alone."""
    unknown = table.unknown[table.has_unknown > 0.0]
    known = table.unknown[(table.has_unknown == 0.0) & ~table.is_empty]
    if not len(unknown) or not len(known):
        return float("nan")
    above = unknown[:, None] > known[None, :]
    level = unknown[:, None] == known[None, :]
    return float(np.mean(above + 0.5 * level))


QUANTITIES: Mapping[str, tuple[str, Callable[[AnswerTable], float]]] = {
    "top_1": ("top-1, one effect", lambda table: top(table, 1)),
    "top_3": ("top-3, one effect", lambda table: top(table, 3)),
    "type_top_1": ("type of cause first, one effect", type_top),
    "exact_set": ("exact set", exact_set),
    "micro_f1": ("micro F1", micro_f1),
    "probability_of_truth": ("mean probability on the true set", probability_of_truth),
    "brier": ("Brier score per effect", brier),
    "brier_skill": ("Brier skill against the base rate", brier_skill),
    "calibration_error": ("calibration error, p > 0.05, ten bins", calibration_error),
    "false_alarms": ("false alarms on none, p > 0.5", false_alarms),
    "closure": ("closure, median, held-out, as reported", lambda table: median_closure(table.closure)),
    "oracle_closure": ("closure of the oracle, median, held-out", lambda table: median_closure(table.oracle_closure)),
    "auroc_unknown": ("AUROC known against unknown", known_against_unknown),
    "confidently_wrong": ("confidently wrong on unknown", confidently_wrong),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class OpenedTrial:
    """A trial whose key is opened, and the answers to it.

    Attributes
    ----------
    manifest, key, answers : mapping
        As they are read from their files.
    table : AnswerTable
    """

    manifest: Mapping[str, Any]
    key: Mapping[str, Any]
    answers: Mapping[str, Any]
    table: AnswerTable


def open_trial(folder: Path, answers: Path, key: Path) -> OpenedTrial:
    """Open the key of a trial and check every seal.

    Raises
    ------
    SpecError
        If a file changed after it was sealed, the key is not that of the trial, or the probabilities do not vary.
    """
    manifest = read_manifest(folder)
    own_key = seal.read_json(key, "the key of a trial")
    given = seal.read_json(answers, "answers to a trial")
    check_key(folder, manifest, own_key, key)
    seal.check_digest(answers)
    forms.check_answers(given, f"{answers}: not answers to a trial")
    if given.get("manifest_sha256") != seal.file_digest(folder / MANIFEST):
        raise SpecError(f"{answers}: answers to another trial than the one in {folder}.")
    table = table_of(manifest, own_key, given, answers)
    check_varies(table, bool(given.get("constant")), answers)
    return OpenedTrial(manifest=manifest, key=own_key, answers=given, table=table)


def score(folder: Path, answers: Path, key: Path) -> dict[str, Any]:
    """Return the score sheet of answers as JSON; it raises what `open_trial` does."""
    trial = open_trial(folder, answers, key)
    manifest, given, table = trial.manifest, trial.answers, trial.table
    cases = given["cases"].values()
    return {
        "diagnoser": str(given.get("diagnoser", answers.stem)),
        "constant_reference": bool(given.get("constant")),
        "tier": manifest["tier"],
        "cases": len(table.none),
        "failed": sum(case.get("status") == FAILED for case in cases),
        "seconds_per_case": float(np.median([case.get("seconds", np.nan) for case in cases])),
        "nonce": trial.key["nonce"],
        "made_by_commit": manifest["commit"],
        "answered_by_commit": given.get("commit", ""),
        "quantities": sheet(table),
        "effects": per_effect(table),
        "unlisted": per_unlisted(table, manifest, trial.key),
        "kinds": per_kind(table, manifest, trial.key),
    }


def check_key(folder: Path, manifest: Mapping[str, Any], opened: Mapping[str, Any], key: Path) -> None:
    """Raise a SpecError unless each truth is the one that was committed to."""
    forms.check_key(opened, f"{key}: not a key of a trial")
    if manifest["nonce_sha256"] != seal.commitment(check_nonce(opened["nonce"]), "nonce"):
        raise SpecError(f"{key}: not the key of the trial in {folder}; its nonce has another SHA-256.")
    if set(opened["cases"]) != set(manifest["cases"]):
        raise SpecError(f"{key}: holds other cases than the trial in {folder}.")
    for name, case in manifest["cases"].items():
        sealed = opened["cases"][name]
        if seal.commitment(sealed["salt"], sealed["truth"]) != case["truth_sha256"]:
            raise SpecError(f"{key}: the truth of case {name} is not the one that was sealed.")


def table_of(
    manifest: Mapping[str, Any], opened: Mapping[str, Any], given: Mapping[str, Any], answers: Path
) -> AnswerTable:
    """Return answers beside truths.

    Raises
    ------
    SpecError
        If a case is missing, or a probability is not between 0 and 1.
    """
    names, listed = list(manifest["cases"]), list(manifest["effects"])
    missing = sorted(set(names) ^ set(given.get("cases", ())))
    if missing:
        raise SpecError(f"{answers}: case {missing[0]} is missing or not one of the trial; every case is answered.")
    truths = [opened["cases"][name]["truth"] for name in names]
    cases = [checked(given["cases"][name], listed, f"{answers}: case {name}") for name in names]
    present = [
        [float(any(item["name"] == effect for item in truth["listed"])) for effect in listed] for truth in truths
    ]
    return AnswerTable(
        effects=listed,
        types=[effects.get(name).type_of() for name in listed],
        chances=np.array([[case["effects"].get(effect, 0.0) for effect in listed] for case in cases]),
        present=np.array(present),
        unknown=np.array([case["unknown"] for case in cases]),
        none=np.array([case["none"] for case in cases]),
        has_unknown=np.array([float(bool(truth["unlisted"])) for truth in truths]),
        closure=np.array([case.get("closure") for case in cases], dtype=np.float64),
        oracle_closure=np.array([oracle_closure(truth) for truth in truths], dtype=np.float64),
    )


def checked(case: Any, effects: Sequence[str], where: str) -> dict[str, Any]:
    """Return the answer to a case, or raise a SpecError where it has not the form that is asked."""
    if not isinstance(case, dict) or not isinstance(case.get("effects"), dict):
        raise SpecError(f'{where}: "effects", "unknown" and "none" are expected.')
    for name, value in {**case["effects"], "unknown": case.get("unknown"), "none": case.get("none")}.items():
        if name not in (*effects, "unknown", "none"):
            raise SpecError(f"{where}: '{name}' is not an effect of this trial.{did_you_mean(name, effects)}")
        if not isinstance(value, int | float) or not 0.0 <= value <= 1.0:
            raise SpecError(f"{where}: the probability of {name} is {value!r}, outside [0, 1].")
    if not isinstance(case.get("closure", 0.0), int | float | None):
        raise SpecError(f"{where}: closure: a number or null is expected.")
    return case


def check_varies(table: AnswerTable, constant: bool, answers: Path) -> None:
    """Raise a SpecError where probabilities take one value beside 0, or are the same in each case.

    Reference diagnosers that are constant on purpose say so, and their sheet says it too.
    """
    if constant:
        return
    every = np.column_stack((table.chances, table.unknown, table.none))
    rounded = np.unique(np.round(every[every > 0.0], 9))
    if len(rounded) < 2 or (len(every) > 1 and (every == every[0]).all()):
        raise SpecError(
            f"{answers}: the probabilities do not vary, so nothing can be said of their calibration; refused. "
            "Give what is more probable a higher probability."
        )


def sheet(table: AnswerTable) -> dict[str, dict[str, Any]]:
    """Return each quantity with its 95 % bootstrap interval over cases."""
    draws = [table.rows(rows) for rows in drawn_rows(np.zeros(len(table.none)), RESAMPLES)]
    found: dict[str, dict[str, Any]] = {}
    for name, (words, function) in QUANTITIES.items():
        value = function(table)
        if not np.isfinite(value):
            continue
        values = np.array([function(draw) for draw in draws])
        values = values[np.isfinite(values)]
        low, high = percentile_interval(values).tolist() if len(values) else (value, value)
        found[name] = {"quantity": words, "value": value, "ci95": [low, high], "cases": bearing(table, name)}
    return found


def bearing(table: AnswerTable, name: str) -> int:
    """Return how many cases bear on a quantity."""
    if name in ("top_1", "top_3", "type_top_1"):
        return int(table.is_single.sum())
    if name == "false_alarms":
        return int(table.is_empty.sum())
    if name == "confidently_wrong":
        return int((table.has_unknown > 0.0).sum())
    if name in ("closure", "oracle_closure"):
        return int(np.isfinite(getattr(table, name)).sum())
    return int((~table.is_empty).sum()) if name == "auroc_unknown" else len(table.none)


def per_effect(table: AnswerTable) -> list[dict[str, Any]]:
    """Return recall, mean probability and what it is mistaken for, for each effect that is injected."""
    found = []
    for index, effect in enumerate(table.effects):
        there = table.present[:, index] > 0.0
        if not there.any():
            continue
        missed = there & ~table.named[:, index]
        wrong = table.named & (table.present == 0.0)
        mistaken = Counter(
            table.effects[other] for row in np.flatnonzero(missed) for other in np.flatnonzero(wrong[row])
        )
        found.append(
            {
                "effect": effect,
                "cases": int(there.sum()),
                "recall": float(table.named[there, index].mean()),
                "mean_probability": float(table.chances[there, index].mean()),
                "mistaken_for": dict(mistaken.most_common(3)),
            }
        )
    return found


def per_unlisted(table: AnswerTable, manifest: Mapping[str, Any], opened: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the mean unknown probability and what is named in its place, for each unlisted effect."""
    rows: dict[str, list[int]] = {}
    for row, name in enumerate(manifest["cases"]):
        for item in opened["cases"][name]["truth"]["unlisted"]:
            rows.setdefault(item["name"], []).append(row)
    wrong = table.named & (table.present == 0.0)
    return [
        {
            "form": form,
            "cases": len(own),
            "mean_unknown_probability": float(table.unknown[own].mean()),
            "mistaken_for": dict(
                Counter(table.effects[other] for row in own for other in np.flatnonzero(wrong[row])).most_common(3)
            ),
        }
        for form, own in sorted(rows.items())
    ]


def per_kind(table: AnswerTable, manifest: Mapping[str, Any], opened: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return top-1, exact set, false alarms and what is named wrongly for each kind of axis, where truths have one.

    A share that no case bears on is None.
    """
    rows: dict[str, list[int]] = {}
    for row, name in enumerate(manifest["cases"]):
        kind = opened["cases"][name]["truth"].get("kind")
        if kind is not None:
            rows.setdefault(kind, []).append(row)
    found = []
    for kind, own in sorted(rows.items()):
        part = table.rows(np.array(own))
        shares = {"top_1": top(part, 1), "exact_set": exact_set(part), "false_alarms": false_alarms(part)}
        wrong = (part.named & (part.present == 0.0)).sum(axis=0)
        found.append(
            {
                "kind": kind,
                "cases": len(own),
                **{name: value if np.isfinite(value) else None for name, value in shares.items()},
                "named_wrongly": {table.effects[index]: int(wrong[index]) for index in np.flatnonzero(wrong)},
            }
        )
    return found


def text(scores: Mapping[str, Any]) -> str:
    """Return a score sheet for the terminal."""
    reference = " (constant reference)" if scores["constant_reference"] else ""
    lines = [
        f"{scores['diagnoser']}{reference}, tier {scores['tier']}: {scores['cases']} cases, {scores['failed']} failed, "
        f"median {scores['seconds_per_case']:.1f} s",
        "",
        f"{'quantity':42} {'value':>7}  {'95 % interval':>16}  {'cases':>5}",
    ]
    for item in scores["quantities"].values():
        low, high = item["ci95"]
        interval = f"{low:.3f} to {high:.3f}"
        lines.append(f"{item['quantity']:42} {item['value']:7.3f}  {interval:>16}  {item['cases']:5d}")
    if scores["effects"]:
        lines += ["", f"{'effect':32} {'cases':>5} {'recall':>7} {'mean p':>7}  mistaken for"]
    for item in scores["effects"]:
        words = _counts(item["mistaken_for"])
        chance = item["mean_probability"]
        lines.append(f"{item['effect']:32} {item['cases']:5d} {item['recall']:7.2f} {chance:7.2f}  {words}".rstrip())
    if scores["unlisted"]:
        lines += ["", f"{'not in the library':32} {'cases':>5} {'unknown':>7}  mistaken for"]
    for item in scores["unlisted"]:
        words = _counts(item["mistaken_for"])
        lines.append(f"{item['form']:32} {item['cases']:5d} {item['mean_unknown_probability']:7.2f}  {words}".rstrip())
    if scores["kinds"]:
        lines += ["", f"{'kind of axis':32} {'cases':>5} {'top-1':>7} {'exact':>7} {'alarms':>7}  named wrongly"]
    for item in scores["kinds"]:
        words = _counts(item["named_wrongly"])
        shares = " ".join(f"{_share(item[name]):>7}" for name in ("top_1", "exact_set", "false_alarms"))
        lines.append(f"{item['kind']:32} {item['cases']:5d} {shares}  {words}".rstrip())
    return "\n".join(lines)


def _share(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _counts(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{name} ({count})" for name, count in counts.items())
