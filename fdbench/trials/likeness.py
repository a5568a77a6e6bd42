"""What a calibration shows beside its probabilities: how often causes were named rightly, and for which machine."""

from collections.abc import Mapping, Sequence
from typing import Any

from fdbench.diagnosis.answer.virtual_machines import VirtualMachines
from fdbench.diagnosis.judge.probability_models import Features


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
    complete = [case for case in cases if not case["truth"]["unlisted"]]
    empty = [case for case in complete if not case["truth"]["listed"]]
    return VirtualMachines(
        cases=len(cases),
        with_cause=len(right),
        named_rightly=sum(right),
        rightly_ci95=interval(sum(right), len(right)),
        without_cause=len(empty),
        named_falsely=sum(bool(case["named"]) for case in empty),
        compared=len(complete),
        likeness=likeness([left_in(case["features"]) for case in complete], left_in(features)),
    )


def left_in(features: Mapping[str, Mapping[str, Features]]) -> float:
    """Return the logarithm of what is left of a gap beside all effects."""
    return features["unknown"]["unknown"]["misfit"]


def likeness(others: Sequence[float], own: float) -> float:
    r"""Return the conformal p-value of a score s among others, large ones being odd.

    .. math:: p = \frac{1 + \#\{i \le n: s_i \ge s\}}{n + 1}

    If the scores are exchangeable, p is at most :math:`\alpha` with a probability of at most :math:`\alpha` (Vovk,
    Gammerman and Shafer 2005, Algorithmic Learning in a Random World, proposition 2.3).

    Examples
    --------
    >>> likeness([0.1, 0.3, 0.2], 0.25), likeness([], 5.0)
    (0.5, 1.0)
    """
    return (1 + sum(score >= own for score in others)) / (len(others) + 1)


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
