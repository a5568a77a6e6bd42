"""Learn: diagnose cases whose truth is known, and fit how often what the search shows turns out right."""

import dataclasses
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fdbench.cluster import in_processes
from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.judge.probability_models import Feature, Features, ProbabilityModel, ProbabilityModels
from fdbench.diagnosis.judge.verdict import OR
from fdbench.errors import FdbenchError, SpecError
from fdbench.files import write_text
from fdbench.record import FloatArray
from fdbench.trials import seal
from fdbench.trials.answer import read_case
from fdbench.trials.forms import check_features
from fdbench.trials.make import read_manifest
from fdbench.trials.score import check_key

RIDGE = 1.0  # prior precision of a weight, per unit of standardised sign
TRUST = 4.0  # the same of bias and weights about those of a model that is learned further
UNLISTED_WEIGHT = 0.1  # of a case whose cause the library lacks, as far as named causes go: a stand-in looks the same
UNLISTED = 1.0 / 3.0  # how often an axis is taken to have a cause that the library lacks
ITERATIONS = 50
KINDS = ("effect", "suspect", "value", "unknown", "none")


class _Waiting(NamedTuple):
    """A case that is to be diagnosed: what it is kept as, its folder and files."""

    place: str
    folder: Path
    files: list[str]


def _features(case: _Waiting) -> tuple[str, Mapping[str, Mapping[str, Features]] | str]:
    """Return the features of a case, or why it cannot be diagnosed; processes are started with this function."""
    try:
        return case.place, diagnose(*read_case(case.folder, case.files)).features
    except FdbenchError as error:
        return case.place, f"{case.folder}: {error}"


@dataclass(frozen=True, kw_only=True)
class Claim:
    """One claim of a diagnosis: its kind and features, whether it is right, and its weight in cases."""

    kind: str
    features: Features
    right: bool
    weight: float = 1.0


def claims(features: Mapping[str, Mapping[str, Features]], truth: Mapping[str, Any]) -> Iterator[Claim]:
    """Yield what a diagnosis claims of a case, judged by its truth."""
    listed = {item["name"] for item in truth["listed"]}
    unlisted = bool(truth["unlisted"])
    weight = UNLISTED_WEIGHT if unlisted else 1.0
    for kind in ("effect", "suspect", "value"):
        for name, own in features[kind].items():
            yield Claim(kind=kind, features=own, right=not listed.isdisjoint(name.split(OR)), weight=weight)
    yield Claim(kind="unknown", features=features["unknown"]["unknown"], right=unlisted)
    yield Claim(kind="none", features=features["none"]["none"], right=not listed and not unlisted, weight=weight)


def fitted(found: Sequence[Claim], prior: ProbabilityModel | None = None) -> ProbabilityModel:
    """Return the logistic model of claims of one kind: penalised maximum likelihood by Newton's method.

    The bias is not penalised, unless a model is learned further: then ``prior`` gives the features, and the mean of
    bias and weights. See Bishop (2006), Pattern Recognition and Machine Learning, section 4.3.3.
    """
    names = list(found[0].features if prior is None else prior.features)
    values = np.array([[claim.features[name] for name in names] for claim in found])
    right = np.array([float(claim.right) for claim in found])
    share = np.array([claim.weight for claim in found])
    before: FloatArray | None = None
    if prior is None:
        centre, scatter = values.mean(axis=0), np.maximum(values.std(axis=0), 1e-6)
    else:
        own = [prior.features[name] for name in names]
        centre, scatter = (np.array([getattr(feature, part) for feature in own]) for part in ("centre", "scatter"))
        before = np.array([prior.bias, *(feature.weight for feature in own)])
    design = np.column_stack((np.ones(len(found)), (values - centre) / scatter))
    weights = newton(design, right, share, before)
    features = {
        name: Feature(centre=float(c), scatter=float(d), weight=float(w))
        for name, c, d, w in zip(names, centre, scatter, weights[1:], strict=True)
    }
    claims_before, right_before = (0, 0) if prior is None else (prior.claims, prior.right)
    return ProbabilityModel(
        bias=float(weights[0]),
        features=features,
        claims=claims_before + len(found),
        right=right_before + int(right.sum()),
    )


def balanced(found: Sequence[Claim], share: float) -> list[Claim]:
    """Return the claims weighted so that this share of them is right."""
    right = sum(claim.right for claim in found)
    weights = {True: share * len(found) / right, False: (1.0 - share) * len(found) / (len(found) - right)}
    return [dataclasses.replace(claim, weight=weights[claim.right]) for claim in found]


def newton(design: FloatArray, right: FloatArray, share: FloatArray, before: FloatArray | None = None) -> FloatArray:
    """Return the weights of a logistic model; each claim counts by its share.

    Penalised is the distance from the weights ``before``; without these that from zero, but not of the first weight.
    """
    n = design.shape[1]
    penalty = np.diag([1e-6] + [RIDGE] * (n - 1) if before is None else [TRUST] * n)
    mean = np.zeros(n) if before is None else before
    weights = mean
    for _ in range(ITERATIONS):
        chance = 1.0 / (1.0 + np.exp(-design @ weights))
        gradient = design.T @ (share * (right - chance)) - penalty @ (weights - mean)
        curvature = design.T @ (design * (share * chance * (1.0 - chance))[:, None]) + penalty
        step = np.linalg.solve(curvature, gradient)
        weights = weights + step / max(1.0, float(np.abs(step).max()))
        if np.abs(step).max() < 1e-9:
            break
    return weights


def write_models(found: Sequence[Claim], output: Path, source: str, further: ProbabilityModels | None = None) -> None:
    """Fit each kind of claim and write the file that `fdbench.diagnosis.judge.probability_models` reads.

    With ``further`` models those are learned further, instead of new ones, as far as they have the same features.
    """
    lines = [f'source = "{source}"']
    for kind in KINDS:
        own = [claim for claim in found if claim.kind == kind]
        before = None if further is None else getattr(further, kind)
        before = before if before is not None and before.features.keys() == own[0].features.keys() else None
        model = fitted(balanced(own, UNLISTED) if kind == "unknown" else own, before)
        lines += ["", f"[{kind}]", f"bias = {model.bias:.4f}", f"claims = {model.claims}", f"right = {model.right}", ""]
        lines += [f"[{kind}.features]"]
        lines += [
            f"{name} = {{ centre = {own.centre:.4f}, scatter = {own.scatter:.4f}, weight = {own.weight:.4f} }}"
            for name, own in model.features.items()
        ]
    write_text(output, "\n".join(lines) + "\n")


@dataclass(frozen=True, kw_only=True)
class Lessons:
    """The claims that were learned from, and what was said of each case that cannot be diagnosed."""

    claims: Sequence[Claim]
    left_out: Sequence[str]


def learn(
    trials: Sequence[tuple[Path, Path]],
    output: Path,
    progress: Callable[[str], None] | None = None,
    further: ProbabilityModels | None = None,
    jobs: int = 1,
) -> Lessons:
    """Diagnose every case of trials to learn from, fit the probability models on their opened keys, and write them.

    A case that cannot be diagnosed claims nothing and is left out.
    What each case gives is kept beside the output in ``<output>.claims.json`` until all are done, so that learning
    that was interrupted goes on.

    Parameters
    ----------
    trials : sequence of pairs of paths
        Folder of a trial and its key: of tier L, and of G, whose axes are of many kinds.
    output : path
    progress : callable, optional
    further : ProbabilityModels, optional
        What is learned further: weights stay near those of these models.
    jobs : int
        Processes.

    Raises
    ------
    SpecError
        If there is no trial in a folder, a key is not its key, or a kind of claim is always right or always wrong.
    """
    kept = output.with_name(f"{output.name}.claims.json")
    done: dict[str, Any] = seal.read_json(kept, "what was learned before") if kept.exists() else {}
    check_features(done.values(), f"{kept}: not what was learned before; remove it")
    cases: list[tuple[str, Mapping[str, Any]]] = []
    waiting: list[_Waiting] = []
    sources = []
    for folder, key in trials:
        manifest = read_manifest(folder)
        opened = seal.read_json(key, "the key of a trial")
        check_key(folder, manifest, opened, key)
        for name, case in manifest["cases"].items():
            place = f"{opened['nonce']} {name}"
            cases.append((place, opened["cases"][name]["truth"]))
            if place not in done:
                waiting.append(_Waiting(place, folder / name, sorted(case["files"])))
        sources.append(f"tier {manifest['tier']}, {len(manifest['cases'])} cases, nonce {opened['nonce']}")
    diagnosed = in_processes(_features, waiting, jobs) if min(jobs, len(waiting)) > 1 else map(_features, waiting)
    left_out = []
    for place, found in diagnosed:
        if isinstance(found, str):
            left_out.append(found)
        else:
            done[place] = found
            write_text(kept, json.dumps(done))
        if progress is not None:
            progress(f"{len(done) + len(left_out)} of {len(cases)} cases")
    every = [claim for place, truth in cases if place in done for claim in claims(done[place], truth)]
    for kind in KINDS:
        rights = {claim.right for claim in every if claim.kind == kind}
        if len(rights) < 2:
            folders = " and ".join(str(folder) for folder, _ in trials)
            raise SpecError(f"{folders}: claims of kind '{kind}' that are right and wrong are needed; make more cases.")
    if further is not None:
        sources = [further.source, *(f"further {source}" for source in sources)]
    write_models(every, output, "; ".join(sources), further)
    kept.unlink()
    return Lessons(claims=every, left_out=left_out)
