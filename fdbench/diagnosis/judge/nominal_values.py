"""Nominal parameters that moved further than they should be wrong."""

import dataclasses
import math

from fdbench.diagnosis.answer import VALUE, Cause, Quantity
from fdbench.diagnosis.judge import probability_models as confidence
from fdbench.diagnosis.judge.probability_models import Features, ProbabilityModels
from fdbench.diagnosis.judge.reduction import channel_gaps
from fdbench.diagnosis.model.hypothesis import Hypothesis
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.search.search import Search
from fdbench.diagnosis.settings import JUDGE, MODEL, SEARCH
from fdbench.rotary import spoken_unit


@dataclasses.dataclass(frozen=True, kw_only=True)
class Deviating:
    """Nominal parameters that moved further than their uncertainty.

    Attributes
    ----------
    causes : list of Cause
        Effects whose size is such a parameter.
    features : mapping of str to mapping
        What their probabilities are predicted from.
    furthest : float
        Largest distance that any parameter moved, in standard deviations.
    nameless : float
        Probability that one is wrong that no effect stands for, such as the gains of the controller.
    """

    causes: list[Cause]
    features: dict[str, Features]
    furthest: float
    nameless: float


def deviating_parameters(
    search: Search, final: Hypothesis, recalibrated: float, models: ProbabilityModels
) -> Deviating:
    """Return the nominal parameters that moved further than their uncertainty.

    A kind of value that is corrected on both sides of the screw counts once, with the sum of its changes: as far off as
    that sum, or as the side that is further off, where the records tell the sides. The share of the gap that
    re-calibration closes, ``recalibrated``, is divided in proportion to what each correction closes beside all others.
    """
    scale = nominal_parameters(final.nominal)
    groups: dict[str, list[int]] = {}
    for place, calibration in enumerate(scale):
        if not calibration.nuisance:
            groups.setdefault(calibration.group, []).append(place)
    shifts = [[0.0 if n in places else shift for n, shift in enumerate(final.shifts)] for places in groups.values()]
    lacking = [dataclasses.replace(final, shifts=tuple(item)) for item in shifts]
    gaps = channel_gaps(search.readings, search.split.plain, [final, *lacking])
    closed, *left = gaps.mean(axis=1).tolist()
    moves: list[tuple[str, float, float, float, str]] = []
    furthest = 0.0
    for places, without in zip(groups.values(), left, strict=True):
        sizes = [scale[place].size(final.nominal.drive) for place in places]
        change = sum(final.shifts[place] * size for place, size in zip(places, sizes, strict=True))
        name = scale[places[0]].cause(final.nominal)
        # Without an effect that stands for them they are values of their own, whose changes do not add up.
        own = [abs(final.shifts[place]) for place in places]
        together = abs(change) / max(math.hypot(*sizes), 1e-30)
        distance = max(together, *own) if name else math.hypot(*own)
        furthest = max(furthest, distance if name else max(own))
        moves.append((name, change, distance, without, scale[places[0]].unit))
    total = max(sum(max(without - closed, 0.0) for _, _, _, without, _ in moves), 1e-12)
    present = {item.name for item in final.effects}
    found: list[Cause] = []
    all_features: dict[str, Features] = {}
    nameless = 0.0
    for name, change, distance, without, unit in moves:
        if distance <= JUDGE.beyond_doubt or name in present:
            continue
        if without - closed < SEARCH.smallest_gain * without:
            continue
        features = confidence.value_features(distance, without - closed, closed)
        if not name:
            # In a quiet record a gain that is a little off closes much, and is no wonder.
            nameless = max(nameless, models.value.probability(features) if distance > MODEL.far_fetched else 0.0)
            continue
        share = recalibrated * (without - closed) / total
        all_features[name] = features
        found.append(
            Cause(
                effect=name,
                kind=VALUE,
                probability=models.value.probability(features, [name]),
                share=share,
                unique_share=share,
                parameters={"change": Quantity(value=change, ci95=None, unit=spoken_unit(unit))},
            )
        )
    return Deviating(causes=found, features=all_features, furthest=furthest, nameless=nameless)
