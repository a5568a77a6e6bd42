"""What a calibration shows beside its probabilities: how often causes were named rightly, and for which machine."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fdbench.diagnosis.answer import VirtualMachines
from fdbench.diagnosis.judge.probability_models import Features
from fdbench.record import FloatArray

RIDGE = 1e-3  # of the variance of each feature, so that one that hardly varies tells little
# Claims and features that say how a diagnosis went, whatever it names.
COMPARED = {
    ("none", "misfit"): "the gap after re-calibration",
    ("none", "moved"): "how far nominal parameters had to move",
    ("none", "size"): "the size of the largest effect",
    ("unknown", "misfit"): "what is left beside all effects",
    ("unknown", "worst"): "what is left where that is most",
}


def outcome(cases: Sequence[Mapping[str, Any]], features: Mapping[str, Mapping[str, Features]]) -> VirtualMachines:
    """Return how virtual machines were diagnosed, and whether the measured one is like them.

    Parameters
    ----------
    cases : sequence of mappings
        Features, truth and the causes that were named, largest share first.
    features : mapping
        Of the measured machine; see `fdbench.diagnosis.judge.verdict.Verdict`.
    """
    truths = [{item["name"] for item in case["truth"]["listed"]} for case in cases]
    firsts = [set(case["named"][0]) if case["named"] else set() for case in cases]
    right = [not truth.isdisjoint(first) for truth, first in zip(truths, firsts, strict=True) if truth]
    empty = [case for case, truth in zip(cases, truths, strict=True) if not truth and not case["truth"]["unlisted"]]
    p_value, furthest = likeness([vector(case["features"]) for case in cases], vector(features))
    return VirtualMachines(
        cases=len(cases),
        with_cause=len(right),
        named_rightly=sum(right),
        rightly_ci95=interval(sum(right), len(right)),
        without_cause=len(empty),
        named_falsely=sum(bool(case["named"]) for case in empty),
        likeness=p_value,
        furthest=[*COMPARED.values()][furthest],
    )


def vector(features: Mapping[str, Mapping[str, Features]]) -> FloatArray:
    """Return the compared features of one diagnosis, (n_features,)."""
    return np.array([features[claim][claim][name] for claim, name in COMPARED])


def likeness(others: Sequence[FloatArray], own: FloatArray) -> tuple[float, int]:
    r"""Return the conformal p-value of one feature vector among others, and the place of its oddest feature.

    With the distance of Mahalanobis (1936) d from the mean of all n + 1 vectors,

    .. math:: p = \frac{1 + \#\{i \le n: d_i \ge d\}}{n + 1}

    If the vectors are exchangeable, p is at most :math:`\alpha` with a probability of at most :math:`\alpha` (Vovk,
    Gammerman and Shafer 2005, Algorithmic Learning in a Random World, proposition 2.3).

    Examples
    --------
    >>> import numpy as np
    >>> others = [*np.random.default_rng(0).standard_normal((39, 2))]
    >>> likeness(others, np.array([0.0, 9.0]))
    (0.025, 1)
    """
    every = np.vstack((own, *others))
    centred = every - every.mean(axis=0)
    covariance = centred.T @ centred / len(every)
    covariance += np.diag(RIDGE * np.diagonal(covariance) + 1e-12)
    distances = np.sum(centred * np.linalg.solve(covariance, centred.T).T, axis=1)
    odd = np.abs(centred[0]) / np.sqrt(np.diagonal(covariance))
    # Rounding must not make a vector more distant than one that is equal to it.
    return float(np.mean(distances >= distances[0] * (1.0 - 1e-9))), int(np.argmax(odd))


def interval(right: int, count: int) -> tuple[float, float]:
    """Return the exact 95 % interval of a proportion (Clopper and Pearson 1934).

    Examples
    --------
    >>> [round(bound, 3) for bound in interval(9, 10)]
    [0.555, 0.997]
    """
    from scipy.stats import binomtest

    if count == 0:
        return 0.0, 1.0
    found = binomtest(right, count).proportion_ci()
    return float(found.low), float(found.high)
