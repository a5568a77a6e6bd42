"""Nominal parameters that moved further than they should be wrong."""

import dataclasses
import math

from scipy.special import expit

from fdbench.diagnosis.answer.cause import VALUE, Cause
from fdbench.diagnosis.answer.quantity import Quantity
from fdbench.diagnosis.judge import probability_models as confidence
from fdbench.diagnosis.judge.probability_models import Features, ProbabilityModels
from fdbench.diagnosis.judge.reduction import channel_gaps
from fdbench.diagnosis.model.axis_parameters import Mass
from fdbench.diagnosis.model.friction_parameters import FrictionSide, KnownAmplitude
from fdbench.diagnosis.model.hypothesis import Hypothesis, penalty
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
    nameless : float
        Probability that one is wrong that no effect stands for, such as the gains of the controller.
    """

    causes: list[Cause]
    features: dict[str, Features]
    nameless: float


def deviating_parameters(
    search: Search, final: Hypothesis, recalibrated: float, models: ProbabilityModels
) -> Deviating:
    """Return the nominal parameters that moved further than their uncertainty.

    A kind of value that is corrected on both sides of the screw counts once, with the sum of its changes: as far off as
    that sum, or as the side that is further off, where the records tell the sides. What a mode carries is no mass that
    the axis lacks. The share of the gap that re-calibration closes, ``recalibrated``, is divided in proportion to what
    each correction closes beside all others.
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
    on_motor, carried = _on_motor(final), sum(effect.carried_mass_kg for effect in final.effects)
    sides: dict[str, _OnMotor] = {}
    for (group, places), without in zip(groups.items(), left, strict=True):
        change, deviation = final.change(places)
        name = scale[places[0]].cause(final.nominal)
        # Without an effect that stands for them they are values of their own, whose changes do not add up.
        own = [abs(final.shifts[place]) for place in places]
        deviation = max(deviation, 1e-30)
        distance = max(abs(change) / deviation, *own) if name else math.hypot(*own)
        if scale[places[0]].kind == Mass.kind and change < 0.0 < carried:
            # The mass that is known has what a mode carries in it; slowly, the axis is as heavy as both.
            change = min(change + carried, 0.0)
            distance = min(distance, abs(change) / deviation)
        if group in on_motor:
            sides[name] = on_motor[group]
        is_grease = final.nominal.covered.before and scale[places[0]].kind != Mass.kind
        if len(own) > 1 and sorted(own)[-2] > MODEL.far_fetched and not is_grease:
            name = ""  # but for friction of one day and another, no cause changes both sides of a screw that far
        moves.append((name, change, distance, without, scale[places[0]].unit_on(final.nominal.drive)))
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
        if any(name in cause.alternatives or name == cause.effect for cause in found):
            continue  # a side of a friction of which it was said on which side it is more
        share = recalibrated * (without - closed) / total
        chances = {name: models.value.probability(features, [name])}
        if name in sides:
            side = sides[name]
            chances = {side.name: side.odds * chances[name], name: (1.0 - side.odds) * chances[name]}
            if side.odds > 0.5:
                name, change = side.name, side.change
        all_features[name] = features
        found.append(
            Cause(
                effect=name,
                kind=VALUE,
                probability=chances.pop(name),
                share=share,
                unique_share=share,
                parameters={"change": Quantity(value=change, ci95=None, unit=spoken_unit(unit))},
                alternatives=chances,
            )
        )
    return Deviating(causes=found, features=all_features, nameless=nameless)


def with_mass_of(told: Deviating, recalibrated: Deviating, final: Hypothesis) -> Deviating:
    """Return what is told, and the mass that is off in the re-calibrated model, where an improbable mode carries it."""
    masses = {item.cause(final.nominal) for item in nominal_parameters(final.nominal) if item.kind == Mass.kind}
    others = [
        cause for cause in recalibrated.causes if cause.effect in masses - {cause.effect for cause in told.causes}
    ]
    features = {cause.effect: recalibrated.features[cause.effect] for cause in others}
    return dataclasses.replace(told, causes=[*told.causes, *others], features={**told.features, **features})


@dataclasses.dataclass(frozen=True, kw_only=True)
class _OnMotor:
    """Friction of the motor: the effect's name, how probable it is as what is off, and its force in N."""

    name: str
    odds: float
    change: float


def _on_motor(final: Hypothesis) -> dict[str, _OnMotor]:
    r"""Return for each known friction whether what it is off by acts on the motor, by the name of its group.

    .. math:: \frac{p(M)}{p(T)} = \frac{t(s_F) / (\sigma_F F_0)}{t(s_p) / (\sigma_p F)}

    M: friction of the motor came on top, and that of the table F (1 - p) is within its doubt, s_F standard deviations
    from the F_0 that is known. T: the known friction has another size F, and its part p of the motor is within its
    doubt. t is the prior of Student.
    """
    drive, scale = final.nominal.drive, nominal_parameters(final.nominal)
    shift_of = dict(zip((item.name for item in scale), final.shifts, strict=True))
    found = {}
    for item in scale:
        if isinstance(item, FrictionSide):
            (size,) = (other for other in scale if isinstance(other, KnownAmplitude) and other.index == item.index)
            part, growth = item.part(shift_of[item.name]), 1.0 + shift_of[size.name] * size.deviation
            table = ((1.0 - part) * growth - 1.0) / size.deviation
            log_motor = -0.5 * penalty(table) - math.log(size.deviation)
            log_table = -0.5 * penalty(part / item.deviation) - math.log(item.deviation * growth)
            change = part * growth * size.size(drive) / size.deviation
            odds = float(expit(log_motor - log_table))
            found[size.group] = _OnMotor(name=item.effect.name, odds=odds, change=change)
    return found
