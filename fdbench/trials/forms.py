"""The forms of manifest, key and answers of a trial: what a file must hold before anybody looks into it."""

import math
import re
from collections.abc import Iterable, Mapping
from pathlib import PurePosixPath
from typing import Any

from fdbench.errors import SpecError, printable
from fdbench.specification import convert

Table = Mapping[str, Any]

LONGEST_NAME = 200
MANIFEST = {
    "tier": str,
    "nonce_sha256": str,
    "commit": str,
    "effects": tuple[str, ...],
    "cases": Mapping[str, Table],
}
SEALED = {"truth_sha256": str, "files": Mapping[str, str]}
KEY = {"nonce": str, "cases": Mapping[str, Table]}
OPENED = {"salt": str, "truth": Table}
TRUTH = {"listed": tuple[Table, ...], "unlisted": tuple[Table, ...]}
ANSWERS = {"cases": Mapping[str, Table]}
GAPS = ("noise_floor", "on_paper", "oracle")
FEATURES = Mapping[str, Mapping[str, Mapping[str, float]]]
KINDS = ("effect", "suspect", "value", "unknown")
LARGEST = 1e100
_HEXADECIMAL = re.compile("([0-9a-f]{2})+")


def check_manifest(manifest: Table, where: str) -> None:
    """Raise a SpecError unless a file is a manifest, whose names are names and whose files lie in its folder."""
    _check(manifest, MANIFEST, where)
    for name in (manifest["tier"], *manifest["effects"], *manifest["cases"]):
        _check_name(name, where)
    for name, case in manifest["cases"].items():
        _check(case, SEALED, f"{where}: cases.{name}")
        for file in (name, *case["files"]):
            path = PurePosixPath(file)
            if path.is_absolute() or ".." in path.parts or "\0" in file:
                raise SpecError(f"{where}: cases.{name}: {file!r} does not lie in the folder of the trial.")


def check_key(key: Table, where: str) -> None:
    """Raise a SpecError unless a file is a key with a truth of each case."""
    _check(key, KEY, where)
    for name, case in key["cases"].items():
        here = f"{where}: cases.{name}"
        _check(case, OPENED, here)
        if not _HEXADECIMAL.fullmatch(case["salt"]):
            raise SpecError(f"{here}.salt: hexadecimal digits are expected.")
        truth = case["truth"]
        _check_truth(truth, f"{here}.truth")
        if "kind" in truth:
            _check_name(convert(str, truth["kind"], f"{here}.truth.kind"), here)
        if "held_out" in truth:
            _check_gaps(truth["held_out"], f"{here}.truth.held_out")


def check_answers(given: Table, where: str) -> None:
    """Raise a SpecError unless a file holds answers; what they say of effects is looked at elsewhere."""
    _check(given, ANSWERS, where)
    about: dict[str, type] = {"diagnoser": str, "commit": str, "constant": bool}
    of_case: dict[str, type] = {"status": str, "message": str, "seconds": float}
    for key, kind in about.items():
        if key in given:
            _check_name(str(convert(kind, given[key], f"{where}: {key}")), where)
    for name, case in given["cases"].items():
        for key, kind in of_case.items():
            if key in case:
                convert(kind, case[key], f"{where}: case {name}: {key}")


def check_features(found: Iterable[Any], where: str) -> None:
    """Raise a SpecError unless all are features of a diagnosis, with one set of names for each kind of claim."""
    names: dict[str, set[str]] = {}
    for features in found:
        _check(convert(FEATURES, features, where), dict.fromkeys(KINDS, Table), where)
        _check(features["unknown"], {"unknown": Table}, f"{where}: unknown")
        for kind in KINDS:
            for claim, own in features[kind].items():
                if names.setdefault(kind, {*own}) != {*own}:
                    raise SpecError(f"{where}: {kind}.{claim} has other features than those before.")


def check_learned(cases: Any, where: str) -> None:
    """Raise a SpecError unless a list holds features and truths of cases."""
    for case in convert(tuple[Table, ...], cases, where):
        _check(case, {"features": FEATURES, "truth": Table}, where)
        _check_truth(case["truth"], where)
    check_features((case["features"] for case in cases), where)


def _check_truth(truth: Table, where: str) -> None:
    _check(truth, TRUTH, where)
    for item in (*truth["listed"], *truth["unlisted"]):
        _check(item, {"name": str}, where)
        _check_name(item["name"], where)


def _check(table: Table, form: Table, where: str) -> None:
    for key, kind in form.items():
        if key not in table:
            raise SpecError(f"{where}: '{key}' is missing.")
        convert(kind, table[key], f"{where}: {key}")


def _check_name(name: str, where: str) -> None:
    if len(name) > LONGEST_NAME or printable(name) != name:
        raise SpecError(f"{where}: '{name}' is no name; it is too long or cannot be printed.")


def _check_gaps(gaps: Any, where: str) -> None:
    channels = convert(Mapping[str, Mapping[str, float]], gaps, where)
    for name, own in channels.items():
        sizes = [own.get(key, math.nan) for key in GAPS]
        if not all(0.0 <= size <= LARGEST for size in sizes) or sizes[0] < 1.0 / LARGEST:
            raise SpecError(f"{where}.{name}: {', '.join(GAPS)} are expected, the first of them above 0.")
    if not channels:
        raise SpecError(f"{where}: no channel.")
