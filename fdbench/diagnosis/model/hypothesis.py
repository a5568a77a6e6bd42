"""A hypothesis: the nominal model, re-calibrated, with some effects added; and how it becomes a drive."""

import dataclasses
import functools
import inspect
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fdbench.diagnosis.model.friction_parameters import FrictionForm, KnownAmplitude
from fdbench.diagnosis.model.known_effects import WIDTH, first_friction, sliding_alike, with_known, without
from fdbench.diagnosis.model.nominal import Covered, Nominal
from fdbench.diagnosis.model.nominal_parameter import NominalParameter
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.model.replay import Variant
from fdbench.diagnosis.settings import MODEL, SEARCH
from fdbench.effects import Effect
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import FloatArray

Key = tuple[tuple[float, ...], tuple[Effect, ...], tuple[int, ...]]


@dataclass(frozen=True, kw_only=True)
class Adjustable:
    """One number of a hypothesis that a fit may move.

    Attributes
    ----------
    name : str
        A nominal parameter, or ``effect.parameter``.
    step : float
        Change that counts as 1: the standard deviation of a nominal parameter, or a share of an effect's typical size.
    low, high : float
        Bounds.
    prior : bool
        Whether a Gaussian prior holds it at its nominal value.
    above : str
        Another parameter of the effect; the number is by how much this one exceeds it.
    """

    name: str
    step: float
    low: float
    high: float
    prior: bool
    above: str = ""

    def of(self, effect: Effect) -> float:
        """Return the number as an effect has it."""
        return float(getattr(effect, self.name)) - (float(getattr(effect, self.above)) if self.above else 0.0)


@dataclass(frozen=True, kw_only=True)
class Hypothesis:
    """Nominal parameters moved by ``shifts`` standard deviations, and effects beyond the model.

    Attributes
    ----------
    nominal : Nominal
    shifts : tuple of float
        In the order of `nominal_parameters`.
    effects : tuple of Effect
    replaced : tuple of int
        Known effects of the drive that one of ``effects`` takes the place of.
    """

    nominal: Nominal
    shifts: tuple[float, ...]
    effects: tuple[Effect, ...] = ()
    replaced: tuple[int, ...] = ()

    @property
    def key(self) -> Key:
        """What tells hypotheses about one nominal model apart."""
        return self.shifts, self.effects, self.replaced

    @functools.cached_property
    def variant(self) -> Variant:
        """The drive that is simulated."""
        drive, offsets, apart_m, late_s = _moved(self.nominal, self.shifts, self.replaced)
        for index in self.replaced:
            drive = without(drive, index)
        drive, apart = joined(drive, merged(offsets, self.effects))
        return Variant(
            plant=drive,
            extra=sliding_alike(drive, apart),
            zeros_apart_m=apart_m,
            force_read_late_s=late_s,
        )

    def as_it_acts(self) -> "Hypothesis":
        """Return it with its effects as they act, whose friction turns its sign as the known one does."""
        return dataclasses.replace(self, effects=sliding_alike(self.variant.plant, self.effects))

    def numbers(self, effect: Effect) -> list[Adjustable]:
        """Return what a fit may move in one of its effects.

        The speed over which friction turns its sign is that of the known one, else that of the first which is added:
        of one that machines have, and models usually know, it is fitted.
        """
        is_fitted = effect.usually_known and effect is first_friction((*self.nominal.drive.effects, *self.effects))
        return adjustables(effect, self.nominal.covered, (WIDTH,) if is_fitted else ())

    def room(self) -> list[tuple[float, float]]:
        """Return for each nominal parameter how far a fit may move it down and up, in standard deviations."""
        own = [item.room for item in nominal_parameters(self.nominal)]
        return [(low - shift, high - shift) for (low, high), shift in zip(own, self.shifts, strict=True)]

    def prior_penalty(self) -> float:
        r"""Return :math:`\sum_i (\nu + 1) \ln(1 + s_i^2 / \nu)`, minus twice the log prior of Student's t."""
        return float(sum(map(penalty, self.shifts)))

    def named_penalty(self) -> float:
        r"""Return `prior_penalty`, where what a value is off by may also be a cause of its own, for which it is named.

        .. math:: \sum_g \left[\sum_i p_i - \max(\max_i p_i - 2 \ln n, 0)\right]

        over the groups of values that one cause may change, with one of n effects of the library as likely as none. It
        changes one of them: a payload is no reason why the motor should be lighter.
        """
        return self.nameless_penalty() + self.cause_penalty()

    @property
    def cost_of_a_cause(self) -> float:
        """Minus twice the log odds of one effect of the library against none."""
        return 2.0 * math.log(max(len(self.nominal.library), 1))

    def nameless_penalty(self) -> float:
        """Return the part of `named_penalty` of values that no cause changes, such as the gains of the controller."""
        return float(sum(penalty(shift) for item, shift in self._scaled_shifts() if not item.cause(self.nominal)))

    def cause_penalty(self) -> float:
        """Return the part of `named_penalty` of values that a cause of their own may change."""
        most, of_causes = self.cost_of_a_cause, dict[str, list[float]]()
        for item, shift in self._scaled_shifts():
            if item.cause(self.nominal):
                of_causes.setdefault(item.group, []).append(penalty(shift))
        return sum(sum(own) - max(max(own) - most, 0.0) for own in of_causes.values())

    def _scaled_shifts(self) -> Iterator[tuple[NominalParameter, float]]:
        drive = self.nominal.drive
        for item, shift in zip(nominal_parameters(self.nominal), self.shifts, strict=True):
            gone = item.gone_with(self.replaced)
            yield item, item.shift_of_replaced(self.effects, drive, shift) if gone else shift

    def priors(self, weight: float) -> list[tuple[float, float]]:
        r"""Return for each nominal parameter where it stands and the weight w of its square in a linear fit.

        .. math:: w_i = \lambda (\nu + 1) / (\nu + s_i^2)

        with which a quadratic has the slope of :math:`\lambda` times `prior_penalty`.
        """
        freedom = MODEL.freedom
        return [(shift, weight * (freedom + 1.0) / (freedom + shift**2)) for shift in self.shifts]

    @functools.cached_property
    def far_fetched(self) -> float:
        """What nominal parameters beyond ``MODEL.far_fetched`` deviations add to the prior penalty.

        Only of those that a data sheet has: over which speed friction turns its sign, and where it acts, is in none.
        And what those add that are moved against one of these, see `contradiction`.
        """
        stated = (
            shift for item, shift in zip(nominal_parameters(self.nominal), self.shifts, strict=True) if item.stated
        )
        return self.contradiction + sum(max(0.0, penalty(shift) - penalty(MODEL.far_fetched)) for shift in stated)

    @functools.cached_property
    def contradiction(self) -> float:
        """What values beyond ``MODEL.changed`` deviations add that no cause moves against a far-fetched one.

        A payload is no reason why the motor should be lighter; both together are what a softer screw looks like.
        """
        groups = dict[str, list[float]]()
        for item, shift in zip(nominal_parameters(self.nominal), self.shifts, strict=True):
            if item.cause(self.nominal):
                groups.setdefault(item.group, []).append(shift)
        found = 0.0
        for own in groups.values():
            most = max(own, key=abs)
            against = (shift for shift in own if shift * most < 0.0 and abs(most) > MODEL.far_fetched)
            found += sum(max(0.0, penalty(shift) - penalty(MODEL.changed)) for shift in against)
        return found

    @functools.cached_property
    def implausible(self) -> float:
        """What of the prior penalty speaks against it: that of values which are `far_fetched`.

        Where the machine was well before, a changed value is a cause, and what no cause changes is as it was: there
        ``MODEL.changed`` deviations are far enough.
        """
        if not self.nominal.covered.before:
            return self.far_fetched
        scale = nominal_parameters(self.nominal)
        nameless = (
            shift
            for item, shift in zip(scale, self.shifts, strict=True)
            if item.nuisance or not item.cause(self.nominal)
        )
        return sum(max(0.0, penalty(shift) - penalty(MODEL.changed)) for shift in nameless)

    @property
    def strain(self) -> float:
        """Part of the prior penalty: of nominal parameters that are not both in a data sheet and an effect's size.

        The form of friction, gains of the controller and the like can stand in for a cause, and nobody else names them.
        """
        scale = nominal_parameters(self.nominal)
        own = (
            shift
            for item, shift in zip(scale, self.shifts, strict=True)
            if not (item.stated and item.cause(self.nominal))
        )
        return sum(map(penalty, own))

    @property
    def at_limits(self) -> int:
        """How many values of the loop are at the limit of what drives are off by, beyond which is a cause."""
        found = 0
        for item, shift in zip(nominal_parameters(self.nominal), self.shifts, strict=True):
            low, high = item.room
            bound = high if shift > 0.0 else max(high, -low)
            found += item.limited and abs(shift) >= (1.0 - MODEL.at_bound) * bound
        return found

    def change(self, places: Sequence[int]) -> tuple[float, float]:
        """Return by how much the nominal parameters at some places moved in all, and the deviation of that."""
        scale, drive = nominal_parameters(self.nominal), self.nominal.drive
        sizes = [scale[place].size(drive) for place in places]
        moved = sum(self.shifts[place] * size for place, size in zip(places, sizes, strict=True))
        return float(moved), math.hypot(*sizes)

    def on_one_side(self) -> "list[Hypothesis]":
        """Return it with a far-fetched change on both sides of a screw put on either side alone, if there is one.

        A load on the table is many deviations of its mass, so that a fit may stop at one of the motor's.
        """
        scale, drive = nominal_parameters(self.nominal), self.nominal.drive
        sides: dict[str, list[int]] = {}
        for place, item in enumerate(scale):
            if item.cause(self.nominal):
                sides.setdefault(item.group, []).append(place)
        found = []
        for places in sides.values():
            if len(places) > 1 and max(abs(self.shifts[place]) for place in places) > MODEL.far_fetched:
                change, _ = self.change(places)
                for place in places:
                    shifts = [0.0 if other in places else shift for other, shift in enumerate(self.shifts)]
                    shifts[place] = change / scale[place].size(drive)
                    found.append(dataclasses.replace(self, shifts=tuple(shifts)))
        return found

    def with_grown(self) -> "list[Hypothesis]":
        """Return it with each known effect that a fit from below stops short of as many times as large as it may start.

        Such as a play: from a few micrometres no step leads to tens of them.
        """
        found = []
        for place, item in enumerate(nominal_parameters(self.nominal)):
            if isinstance(item, KnownAmplitude):
                for start in item.known(self.nominal.drive).starts:
                    shifts = (*self.shifts[:place], (start - 1.0) / item.deviation, *self.shifts[place + 1 :])
                    found.append(dataclasses.replace(self, shifts=shifts))
        return found

    def as_on_paper(self) -> "Hypothesis":
        """Return it with nominal parameters as they are on paper."""
        return dataclasses.replace(self, shifts=(0.0,) * len(self.shifts))

    def apart_from(self, other: "Hypothesis") -> float:
        """Return by how many standard deviations the nominal parameter differs that does so most."""
        return max((abs(own - theirs) for own, theirs in zip(self.shifts, other.shifts, strict=True)), default=0.0)

    def is_nearer_to(self, other: "Hypothesis") -> bool:
        """Return whether nominal parameters are nearer to those of another one than to those on paper."""
        return self.apart_from(other) < self.apart_from(self.as_on_paper())

    def moved(self, change: Sequence[float] | FloatArray) -> "Hypothesis":
        """Return the hypothesis with its nominal parameters moved by the first numbers of ``change``, in deviations."""
        shifts = tuple(float(old + new) for old, new in zip(self.shifts, change, strict=False))
        return dataclasses.replace(self, shifts=shifts)

    def with_form_of(self, other: "Hypothesis") -> "Hypothesis":
        """Return it with the form of friction of another one, itself where the two are alike."""
        scale = nominal_parameters(self.nominal)
        shifts = tuple(
            theirs if isinstance(item, FrictionForm) else own
            for item, own, theirs in zip(scale, self.shifts, other.shifts, strict=True)
        )
        formed = dataclasses.replace(self, shifts=shifts)
        return formed if formed.apart_from(self) > SEARCH.other_form else self

    def moved_in_turn(self) -> "list[Hypothesis]":
        """Return for each nominal parameter the hypothesis with that one moved by a standard deviation."""
        return [self.moved(row) for row in np.eye(len(self.shifts))]

    def with_effect(self, effect: Effect, replaces: int | None = None) -> "Hypothesis":
        """Return the hypothesis with one more effect, or with another one of the same class."""
        others = tuple(item for item in self.effects if item.declared is not effect.declared)
        replaced = self.replaced if replaces is None else tuple(sorted({*self.replaced, replaces}))
        return dataclasses.replace(self, effects=(*others, effect), replaced=replaced)

    def has(self, kind: type[Effect]) -> bool:
        """Whether an effect of a class is added."""
        return any(type(item) is kind for item in self.effects)

    def effect_of(self, kind: type[Effect]) -> Effect:
        """Return the effect of a class that is added."""
        return next(item for item in self.effects if type(item) is kind)

    def without_effect(self, kind: type[Effect]) -> "Hypothesis":
        """Return the hypothesis without the effect of a class; a known effect that it replaced comes back."""
        effects = tuple(item for item in self.effects if item.declared is not kind.declared)
        replaced = tuple(
            index
            for index in self.replaced
            if any(item.in_place_of(self.nominal.drive.effects[index]) is not None for item in effects)
        )
        return dataclasses.replace(self, effects=effects, replaced=replaced)


@functools.lru_cache(maxsize=16)
def _moved(
    nominal: Nominal, shifts: tuple[float, ...], replaced: tuple[int, ...]
) -> tuple[FeedDrive, tuple[Effect, ...], float, float]:
    """Return what values make of a drive: it, what has to be added for them, and by how much its readings are off.

    Those are the zeros of the encoders (m) and how late the force is read (s). All candidates beside a base share it.
    """
    drive = nominal.drive
    offsets: tuple[Effect, ...] = ()
    apart_m = late_s = 0.0
    for calibration, shift in zip(nominal_parameters(nominal), shifts, strict=True):
        if shift != 0.0 and not calibration.gone_with(replaced):
            drive, extra = calibration.apply(drive, shift)
            offsets += extra
            apart_m += calibration.zeros_apart_m(shift)
            late_s += calibration.force_read_late_s(shift)
    return drive, offsets, apart_m, late_s


def merged(offsets: Sequence[Effect], effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """Return the effects with the offsets of re-calibration added to those of the same class, within its bounds."""
    result = list(effects)
    for offset in offsets:
        kind = offset.declared
        place = next((index for index, item in enumerate(result) if item.declared is kind), None)
        if place is None:
            result.append(offset)
        else:
            own, names = result[place], (kind.amplitude, *kind.further_amplitudes)
            result[place] = own.within(**{name: getattr(own, name) + getattr(offset, name) for name in names})
    return tuple(result)


def joined(drive: FeedDrive, effects: Sequence[Effect]) -> tuple[FeedDrive, list[Effect]]:
    """Return the drive with what is a part of one of its known effects, and the effects that act by themselves."""
    apart = []
    for effect in effects:
        for index, known in enumerate(drive.effects):
            if (whole := effect.joined_to(known)) is not None:
                drive = with_known(drive, index, whole)
                break
        else:
            apart.append(effect)
    return drive, apart


def start(nominal: Nominal) -> Hypothesis:
    """Return the nominal model as a hypothesis."""
    return Hypothesis(nominal=nominal, shifts=(0.0,) * len(nominal_parameters(nominal)))


def adjustables(effect: Effect, covered: Covered | None = None, also: Sequence[str] = ()) -> list[Adjustable]:
    """Return what a fit may move in an effect: its amplitude, phases, the shape parameters that are searched, and more.

    No time that is fitted is longer than the records, as what takes longer is not told from what never changes, and no
    frequency higher than what samples show: a mode beyond is a mass.
    """
    found = []
    for item in type(effect).parameters():
        is_amplitude = item.name in (type(effect).amplitude, *type(effect).further_amplitudes)
        if item.whole or not (is_amplitude or item.phase or item.grid or item.locate or item.name in also):
            continue
        value = getattr(effect, item.name)
        share = MODEL.line_step if item.locate else MODEL.step
        step = MODEL.phase_step_rad if item.phase else share * (abs(value) or abs(item.typical))
        low, high = (-math.inf, math.inf) if item.phase else (item.low, item.high)
        high = high if covered is None or item.phase else min(high, max(covered.most(item.unit), low))
        low = 0.0 if item.at_least else low
        found.append(Adjustable(name=item.name, step=step, low=low, high=high, prior=False, above=item.at_least))
    return found


def at_bound(effect: Effect, within: float | None = None) -> list[str]:
    """Return the fitted parameters that lie on a bound of what the library allows; beyond 0, or all of it, is nothing.

    They are as near as a relative distance ``within`` of it, without as ``MODEL.at_bound``.

    The period of an effect that has next to nothing periodic of it is none of them.
    """
    found, share = [], MODEL.at_bound if within is None else within
    unseen = {item.name for item in effect.parameters() if item.locate} if _lacks_amplitude(effect) else set()
    for item in adjustables(effect):
        value = item.of(effect)
        limits = () if (item.low, item.high) == (0.0, 1.0) else (item.low, item.high)
        bounds = (bound for bound in limits if math.isfinite(bound) and bound != 0.0)
        if item.name not in unseen and any(abs(value - bound) <= share * abs(bound) for bound in bounds):
            found.append(item.name)
    return found


def is_beyond_its_form(effect: Effect) -> bool:
    """Return whether it is at a bound of a parameter that it cannot be without; one with a default only refines it."""
    arguments = inspect.signature(type(effect)).parameters
    refining = {name for name, item in arguments.items() if item.default is not item.empty}
    return not refining.issuperset(at_bound(effect))


def is_hollow(effect: Effect) -> bool:
    """Return whether an effect that needs its amplitude has next to nothing of it: further parts stand for another."""
    return type(effect).needs_amplitude and _lacks_amplitude(effect)


def _lacks_amplitude(effect: Effect) -> bool:
    """Return whether an effect has next to nothing of its amplitude beside its further ones."""
    kind = type(effect)
    typical = kind.typical()
    own, *further = (
        abs(getattr(effect, name)) / max(abs(getattr(typical, name)), 1e-30)
        for name in (kind.amplitude, *kind.further_amplitudes)
    )
    return bool(own < MODEL.hollow * max(further, default=0.0))


def is_corner(effect: Effect, known_N: float) -> bool:
    r"""Return whether a friction only bends where it turns its sign, as it does by another law of rounding.

    It falls at such a speed, and what resists together falls nowhere from above the known friction F_c:

    .. math:: F_c \tanh(v / v_0) + F(v) \le (1 + \epsilon) F_c

    Parameters
    ----------
    effect : Effect
    known_N : float
        F_c, N.
    """
    speeds = [item.name for item in type(effect).parameters() if item.unit == "m/s" and item.grid]
    width = getattr(effect, WIDTH, 0.0)
    if not any(getattr(effect, name) < MODEL.corner * width for name in speeds):
        return False
    at = np.linspace(0.0, 3.0 * MODEL.corner, 61)[1:]
    added = [type(effect).kernel.py_func(0.0, 1e-3, 0.0, speed * width, 0.0, *effect.values())[0] for speed in at]
    return bool(np.max(known_N * np.tanh(at) + added) <= (1.0 + MODEL.falls) * known_N)


def penalty(shift: float) -> float:
    """Return minus twice the log prior of a nominal parameter that moved by so many standard deviations."""
    return (MODEL.freedom + 1.0) * math.log1p(shift**2 / MODEL.freedom)
