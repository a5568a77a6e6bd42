"""Learn: diagnose cases whose truth is known, and fit how often what the search shows turns out right."""

import dataclasses
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fdbench.errors import SpecError
from fdbench.gap.confidence import Head, Sign, Signs
from fdbench.gap.diagnose import diagnose
from fdbench.gap.trial import seal
from fdbench.gap.trial.answer import read_case
from fdbench.gap.trial.make import read_manifest
from fdbench.gap.trial.score import check_key
from fdbench.gap.verdict import OR
from fdbench.record import FloatArray

RIDGE = 1.0  # prior precision of a weight, per unit of standardised sign
HIDDEN_WEIGHT = 0.1  # of a case whose cause the library lacks, as far as named causes go: a stand-in cannot be told
UNLISTED = 1.0 / 3.0  # how often an axis is taken to have a cause that the library lacks
ITERATIONS = 50
KINDS = ("effect", "suspect", "value", "unknown", "none")


@dataclass(frozen=True, kw_only=True)
class Claim:
    """One claim of a diagnosis: its kind, its signs, whether it is right, and how many cases like it count as one."""

    kind: str
    signs: Signs
    right: bool
    weight: float = 1.0


def claims(signs: Mapping[str, Mapping[str, Signs]], truth: Mapping[str, Any]) -> Iterator[Claim]:
    """Yield what a diagnosis claims of a case, judged by its truth."""
    listed = {item["name"] for item in truth["listed"]}
    hidden = bool(truth["unlisted"])
    weight = HIDDEN_WEIGHT if hidden else 1.0
    for kind in ("effect", "suspect", "value"):
        for name, own in signs[kind].items():
            yield Claim(kind=kind, signs=own, right=not listed.isdisjoint(name.split(OR)), weight=weight)
    yield Claim(kind="unknown", signs=signs["unknown"]["unknown"], right=hidden)
    yield Claim(kind="none", signs=signs["none"]["none"], right=not listed and not hidden, weight=weight)


def fitted(found: Sequence[Claim]) -> Head:
    """Return the logistic model of claims of one kind: penalised maximum likelihood by Newton's method.

    The bias is not penalised. See Bishop (2006), Pattern Recognition and Machine Learning, section 4.3.3.
    """
    names = list(found[0].signs)
    values = np.array([[claim.signs[name] for name in names] for claim in found])
    right = np.array([float(claim.right) for claim in found])
    share = np.array([claim.weight for claim in found])
    centre, scatter = values.mean(axis=0), np.maximum(values.std(axis=0), 1e-6)
    design = np.column_stack((np.ones(len(found)), (values - centre) / scatter))
    weights = newton(design, right, share)
    signs = {
        name: Sign(centre=float(c), scatter=float(d), weight=float(w))
        for name, c, d, w in zip(names, centre, scatter, weights[1:], strict=True)
    }
    return Head(bias=float(weights[0]), signs=signs, claims=len(found), right=int(right.sum()))


def balanced(found: Sequence[Claim], share: float) -> list[Claim]:
    """Return the claims weighted so that this share of them is right."""
    right = sum(claim.right for claim in found)
    weights = {True: share * len(found) / right, False: (1.0 - share) * len(found) / (len(found) - right)}
    return [dataclasses.replace(claim, weight=weights[claim.right]) for claim in found]


def newton(design: FloatArray, right: FloatArray, share: FloatArray) -> FloatArray:
    """Return the weights of a logistic model, the first of them without penalty; each claim counts by its share."""
    penalty = RIDGE * np.eye(design.shape[1])
    penalty[0, 0] = 1e-6
    weights = np.zeros(design.shape[1])
    for _ in range(ITERATIONS):
        chance = 1.0 / (1.0 + np.exp(-design @ weights))
        gradient = design.T @ (share * (right - chance)) - penalty @ weights
        curvature = design.T @ (design * (share * chance * (1.0 - chance))[:, None]) + penalty
        step = np.linalg.solve(curvature, gradient)
        weights = weights + step / max(1.0, float(np.abs(step).max()))
        if np.abs(step).max() < 1e-9:
            break
    return weights


def write_heads(found: Sequence[Claim], output: Path, source: str) -> None:
    """Fit each kind of claim and write the file that `fdbench.gap.confidence` reads."""
    lines = [f'source = "{source}"']
    for kind in KINDS:
        own = [claim for claim in found if claim.kind == kind]
        head = fitted(balanced(own, UNLISTED) if kind == "unknown" else own)
        lines += ["", f"[{kind}]", f"bias = {head.bias:.4f}", f"claims = {head.claims}", f"right = {head.right}", ""]
        lines += [f"[{kind}.signs]"]
        lines += [
            f"{name} = {{ centre = {sign.centre:.4f}, scatter = {sign.scatter:.4f}, weight = {sign.weight:.4f} }}"
            for name, sign in head.signs.items()
        ]
    output.write_text("\n".join(lines) + "\n", encoding="utf-8")


def learn(folder: Path, key: Path, output: Path, progress: Callable[[str], None] | None = None) -> Sequence[Claim]:
    """Diagnose every case of a trial of tier L, fit the heads on its opened key, and write them.

    What each case gives is kept beside the output in ``<output>.claims.json`` until all are done, so that learning
    that was interrupted goes on.

    Raises
    ------
    SpecError
        If there is no trial in the folder, the key is not its key, or a kind of claim is always right or always wrong.
    """
    manifest = read_manifest(folder)
    opened = seal.read_json(key, "the key of a trial")
    check_key(folder, manifest, opened, key)
    kept = output.with_name(f"{output.name}.claims.json")
    done: dict[str, Any] = json.loads(kept.read_text(encoding="utf-8")) if kept.exists() else {}
    for number, (name, case) in enumerate(manifest["cases"].items(), 1):
        if name in done:
            continue
        if progress is not None:
            progress(f"case {number} of {len(manifest['cases'])}")
        nominal, records, holdouts = read_case(folder / name, sorted(case["files"]))
        done[name] = diagnose(nominal, records, holdouts).signs
        kept.write_text(json.dumps(done), encoding="utf-8")
    found = [claim for name, signs in done.items() for claim in claims(signs, opened["cases"][name]["truth"])]
    for kind in KINDS:
        rights = {claim.right for claim in found if claim.kind == kind}
        if len(rights) < 2:
            raise SpecError(f"{folder}: claims of kind '{kind}' that are right and wrong are needed; make more cases.")
    source = f"tier {manifest['tier']}, {len(done)} cases, nonce {opened['nonce']}"
    write_heads(found, output, source)
    kept.unlink()
    return found
