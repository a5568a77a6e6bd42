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
from fdbench.trials.forms import KINDS, check_features
from fdbench.trials.make import read_manifest
from fdbench.trials.score import check_key
from fdbench.virtual_axes.cases import Tier

RIDGE = 1.0  # prior precision of a weight, per unit of standardised sign
TRUST = 4.0  # the same of bias and weights about those of a model that is learned further
UNLISTED_WEIGHT = 0.3  # of a case whose cause the library lacks, as far as named causes go: a stand-in looks the same
MANY_KINDS = Tier.G  # the tier whose axes are of many kinds
ONE_KIND_WEIGHT = 0.5  # of a case of another tier, whose axes are of one kind and mostly have a cause
UNLISTED = 0.2  # how often an axis is taken to have a cause that the library lacks
ITERATIONS = 50


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
    """One claim of a diagnosis: its kind and features, whether it is right, its weight in cases, what it may name."""

    kind: str
    features: Features
    right: bool
    weight: float = 1.0
    names: tuple[str, ...] = ()


def claims(
    features: Mapping[str, Mapping[str, Features]], truth: Mapping[str, Any], of_case: float = 1.0
) -> Iterator[Claim]:
    """Yield what a diagnosis claims of a case, judged by its truth, with the weight of the case."""
    listed = {item["name"] for item in truth["listed"]}
    unlisted = bool(truth["unlisted"])
    known = of_case * (UNLISTED_WEIGHT if unlisted else 1.0)
    for kind in ("effect", "suspect", "value"):
        for name, own in features[kind].items():
            names = tuple(name.split(OR))
            yield Claim(kind=kind, features=own, right=not listed.isdisjoint(names), weight=known, names=names)
    yield Claim(kind="unknown", features=features["unknown"]["unknown"], right=unlisted, weight=of_case)


def fitted(found: Sequence[Claim], prior: ProbabilityModel | None = None) -> ProbabilityModel:
    """Return the logistic model of claims of one kind: penalised maximum likelihood by Newton's method.

    The bias is not penalised, unless a model is learned further: then ``prior`` is the mean of bias and weights, and
    zero that of a feature which it lacks; what speaks for a name is always near that of ``prior``, or zero. See Bishop
    (2006), Pattern Recognition and Machine Learning, section 4.3.3.
    """
    learned, known = ({}, {}) if prior is None else (prior.features, prior.names)
    features = {**_spread(found), **learned}
    names = sorted({*known, *(name for claim in found for name in claim.names)})
    design = [
        [
            1.0,
            *((claim.features[name] - own.centre) / own.scatter for name, own in features.items()),
            *(claim.names.count(name) / max(len(claim.names), 1) for name in names),
        ]
        for claim in found
    ]
    before = np.array(
        [
            0.0 if prior is None else prior.bias,
            *(own.weight for own in features.values()),
            *(known.get(name, 0.0) for name in names),
        ]
    )
    trust = [1e-6 if prior is None else TRUST, *(TRUST if name in learned else RIDGE for name in features)]
    weights = newton(
        np.array(design),
        np.array([float(claim.right) for claim in found]),
        np.array([claim.weight for claim in found]),
        before,
        np.array([*trust, *[RIDGE] * len(names)]),
    ).tolist()
    of_features, of_names = weights[1 : 1 + len(features)], weights[1 + len(features) :]
    return ProbabilityModel(
        bias=weights[0],
        features={
            name: dataclasses.replace(own, weight=weight)
            for (name, own), weight in zip(features.items(), of_features, strict=True)
        },
        names=dict(zip(names, of_names, strict=True)),
        claims=len(found) + (0 if prior is None else prior.claims),
        right=sum(claim.right for claim in found) + (0 if prior is None else prior.right),
    )


def _spread(found: Sequence[Claim]) -> dict[str, Feature]:
    """Return the features of claims with their mean and scatter, and no weight."""
    values = {name: np.array([claim.features[name] for claim in found]) for name in found[0].features}
    return {
        name: Feature(centre=float(own.mean()), scatter=max(float(own.std()), 1e-6), weight=0.0)
        for name, own in values.items()
    }


def balanced(found: Sequence[Claim], share: float) -> list[Claim]:
    """Return the claims with their weights changed so that this share of them is right."""
    every = sum(claim.weight for claim in found)
    right = sum(claim.weight for claim in found if claim.right)
    factors = {True: share * every / right, False: (1.0 - share) * every / (every - right)}
    return [dataclasses.replace(claim, weight=claim.weight * factors[claim.right]) for claim in found]


def newton(
    design: FloatArray, right: FloatArray, share: FloatArray, before: FloatArray, trust: FloatArray
) -> FloatArray:
    """Return the weights of a logistic model; each claim counts by its share.

    Penalised is the squared distance of each weight from that ``before``, with its ``trust`` as a factor.
    """
    weights = before
    for _ in range(ITERATIONS):
        chance = 1.0 / (1.0 + np.exp(-design @ weights))
        gradient = design.T @ (share * (right - chance)) - trust * (weights - before)
        curvature = design.T @ (design * (share * chance * (1.0 - chance))[:, None]) + np.diag(trust)
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
        before = before if before is not None and before.features.keys() <= own[0].features.keys() else None
        model = fitted(balanced(own, UNLISTED) if kind == "unknown" else own, before)
        lines += ["", f"[{kind}]", f"bias = {model.bias:.4f}", f"claims = {model.claims}", f"right = {model.right}", ""]
        lines += [f"[{kind}.features]"]
        lines += [
            f"{name} = {{ centre = {own.centre:.4f}, scatter = {own.scatter:.4f}, weight = {own.weight:.4f} }}"
            for name, own in model.features.items()
        ]
        if model.names:
            lines += ["", f"[{kind}.names]", *(f"{name} = {weight:.4f}" for name, weight in model.names.items())]
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
    cases: list[tuple[str, Mapping[str, Any], float]] = []
    waiting: list[_Waiting] = []
    sources = []
    for folder, key in trials:
        manifest = read_manifest(folder)
        opened = seal.read_json(key, "the key of a trial")
        check_key(folder, manifest, opened, key)
        weight = 1.0 if manifest["tier"] == MANY_KINDS else ONE_KIND_WEIGHT
        for name, case in manifest["cases"].items():
            place = f"{opened['nonce']} {name}"
            cases.append((place, opened["cases"][name]["truth"], weight))
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
    every = [claim for place, truth, own in cases if place in done for claim in claims(done[place], truth, own)]
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
