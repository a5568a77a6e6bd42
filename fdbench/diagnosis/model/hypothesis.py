"""A hypothesis: the nominal model, re-calibrated, with some effects added; and how it becomes a drive."""

import dataclasses
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.model.replay import Variant
from fdbench.diagnosis.settings import MODEL
from fdbench.effects import Effect, Port
from fdbench.plants.feed_drive import Cascade, FeedDrive, RotaryMotor, Table
from fdbench.record import FloatArray

WIDTH = "transition_velocity_m_per_s"  # parameter that any friction turns its sign over
OFFSET = "force_offset"
LONGEST_DELAY_S = 0.1  # of a velocity's reference, that a model may have
UNSTATED = ("width", "friction_side", "friction_form", "reference_delay")  # kinds that no data sheet has


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
    """

    name: str
    step: float
    low: float
    high: float
    prior: bool


@dataclass(frozen=True, kw_only=True)
class Hypothesis:
    """Nominal parameters moved by ``shifts`` standard deviations, and effects beyond the model.

    Attributes
    ----------
    nominal : Nominal
    shifts : tuple of float
        In the order of `calibrations`.
    effects : tuple of Effect
    replaced : tuple of int
        Known effects of the drive that one of ``effects`` takes the place of.
    """

    nominal: Nominal
    shifts: tuple[float, ...]
    effects: tuple[Effect, ...] = ()
    replaced: tuple[int, ...] = ()

    @functools.cached_property
    def variant(self) -> Variant:
        """The drive that is simulated."""
        drive = self.nominal.drive
        offsets: tuple[Effect, ...] = ()
        for calibration, shift in zip(nominal_parameters(self.nominal), self.shifts, strict=True):
            if shift != 0.0:
                drive, extra = calibration.apply(drive, shift)
                offsets += extra
        for index in self.replaced:
            drive = without(drive, index)
        return Variant(plant=drive, extra=merged(offsets, self.effects))

    def room(self) -> list[tuple[float, float]]:
        """Return for each nominal parameter how far a fit may move it down and up, in standard deviations.

        The form of friction has a limit upwards: what resists at low speed beyond it is an effect, such as Stribeck's.
        Downwards it has none, as no effect takes friction away there. A reference that is a sampling time late or early
        is a matter of how a loop is written; what is later is an effect.
        """
        limits = {
            "friction_form": (-math.inf, MODEL.most_form),
            "reference_delay": (-MODEL.most_delay, MODEL.most_delay),
        }
        own = [limits.get(item.kind, (-math.inf, math.inf)) for item in nominal_parameters(self.nominal)]
        return [(low - shift, high - shift) for (low, high), shift in zip(own, self.shifts, strict=True)]

    def prior_penalty(self) -> float:
        r"""Return :math:`\sum_i (\nu + 1) \ln(1 + s_i^2 / \nu)`, minus twice the log prior of Student's t."""
        freedom = MODEL.freedom
        return float(sum((freedom + 1.0) * math.log1p(shift**2 / freedom) for shift in self.shifts))

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
        """
        freedom, limit = MODEL.freedom, 1.0 + MODEL.far_fetched**2 / MODEL.freedom
        stated = (
            shift
            for item, shift in zip(nominal_parameters(self.nominal), self.shifts, strict=True)
            if item.kind not in UNSTATED
        )
        return sum((freedom + 1.0) * max(0.0, math.log((1.0 + shift**2 / freedom) / limit)) for shift in stated)

    def moved(self, change: Sequence[float] | FloatArray) -> "Hypothesis":
        """Return the hypothesis with its nominal parameters moved by the first numbers of ``change``, in deviations."""
        shifts = tuple(float(old + new) for old, new in zip(self.shifts, change, strict=False))
        return dataclasses.replace(self, shifts=shifts)

    def moved_in_turn(self) -> "list[Hypothesis]":
        """Return for each nominal parameter the hypothesis with that one moved by a standard deviation."""
        return [self.moved(row) for row in np.eye(len(self.shifts))]

    def with_effect(self, effect: Effect, replaces: int | None = None) -> "Hypothesis":
        """Return the hypothesis with one more effect, or with another one of the same class."""
        others = tuple(item for item in self.effects if item.declared is not effect.declared)
        replaced = self.replaced if replaces is None else tuple(sorted({*self.replaced, replaces}))
        return dataclasses.replace(self, effects=(*others, effect), replaced=replaced)

    def without_effect(self, kind: type[Effect]) -> "Hypothesis":
        """Return the hypothesis without the effect of a class; a known effect that it replaced comes back."""
        effects = tuple(item for item in self.effects if item.declared is not kind.declared)
        replaced = tuple(
            index
            for index in self.replaced
            if any(item.in_place_of(self.nominal.drive.effects[index]) is not None for item in effects)
        )
        return dataclasses.replace(self, effects=effects, replaced=replaced)


def merged(offsets: Sequence[Effect], effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """Return the effects with the offsets of re-calibration added to those of the same class."""
    result = list(effects)
    for offset in offsets:
        kind = offset.declared
        place = next((index for index, item in enumerate(result) if item.declared is kind), None)
        if place is None:
            result.append(offset)
        else:
            names = (kind.amplitude, *kind.further_amplitudes)
            sums = {name: getattr(result[place], name) + getattr(offset, name) for name in names}
            result[place] = result[place].changed(**sums)
    return tuple(result)


def without(drive: FeedDrive, index: int) -> FeedDrive:
    """Return the drive with one of its known effects at zero amplitude."""
    return _with_known(drive, index, 0.0)


def _with_known(drive: FeedDrive, index: int, ratio: float) -> FeedDrive:
    known = drive.effects[index]
    changed = with_amplitude(known, amplitude_of(known) * ratio)
    return dataclasses.replace(drive, effects=(*drive.effects[:index], changed, *drive.effects[index + 1 :]))


def _with_width(drive: FeedDrive, index: int, ratio: float) -> FeedDrive:
    known = drive.effects[index]
    bounds = next(item for item in known.parameters() if item.name == WIDTH)
    width = min(max(getattr(known, WIDTH) * ratio, bounds.low), bounds.high)
    changed = known.changed(**{WIDTH: width})
    return dataclasses.replace(drive, effects=(*drive.effects[:index], changed, *drive.effects[index + 1 :]))


def _with_delay(drive: FeedDrive, change: float) -> FeedDrive:
    controller = drive.controller
    if not isinstance(controller, Cascade):
        return drive
    delay_s = min(max(controller.velocity_reference_delay_s + change, -LONGEST_DELAY_S), LONGEST_DELAY_S)
    return dataclasses.replace(drive, controller=dataclasses.replace(controller, velocity_reference_delay_s=delay_s))


@dataclass(frozen=True, kw_only=True)
class NominalParameter:
    """A nominal parameter that every hypothesis may move, with its standard deviation.

    Attributes
    ----------
    name : str
    kind : str
        ``mass``, ``viscous``, ``known_effects``, ``width`` (of the friction's turn), ``friction_side``,
        ``friction_form``, ``force_offset`` or ``reference_delay``.
    side : str
        ``motor`` or ``table`` for masses and viscous friction.
    index : int
        Of the known effect.
    deviation : float
        Relative, that of a form to the known friction; N s/m for viscous friction, N for the force offset and s for a
        delay.
    effect : Effect or None
        That carries a force offset, a bump of the friction's form or friction of the motor, without it.
    amplitude : str
        Name of the parameter of ``effect`` that is moved.
    """

    name: str
    kind: str
    deviation: float
    side: str = ""
    index: int = -1
    effect: Effect | None = None
    amplitude: str = ""

    def apply(self, drive: FeedDrive, shift: float) -> tuple[FeedDrive, tuple[Effect, ...]]:
        """Return the drive moved by ``shift`` standard deviations, and an effect that has to be added for it."""
        change = shift * self.deviation
        if self.kind == "friction_side" and self.effect is not None:
            change = min(max(change, -1.0), 1.0)
            moved = change * amplitude_of(drive.effects[self.index])
            return _with_known(drive, self.index, 1.0 - change), (self.effect.changed(**{self.amplitude: moved}),)
        if self.kind == "friction_form":
            change *= known_friction(drive)
        if self.effect is not None:
            return drive, (self.effect.changed(**{self.amplitude: change}),)
        if self.kind == "known_effects":
            return _with_known(drive, self.index, max(1.0 + change, 0.0)), ()
        if self.kind == "reference_delay":
            return _with_delay(drive, change), ()
        if self.kind == "width":
            return _with_width(drive, self.index, math.exp(change)), ()
        part = drive.motor if self.side == "motor" else drive.table
        if part is None:
            return drive, ()
        if self.kind == "mass":
            field = "inertia_kg_m2" if isinstance(part, RotaryMotor) else "mass_kg"
            changes = {field: getattr(part, field) * max(1.0 + change, MODEL.smallest_mass)}
        else:
            changes = {"viscous_friction_N_s_per_m": max(part.viscous_friction_N_s_per_m + change, 0.0)}
        part = dataclasses.replace(part, **changes)
        if isinstance(part, Table):
            return dataclasses.replace(drive, table=part), ()
        return dataclasses.replace(drive, motor=part), ()

    def size(self, drive: FeedDrive) -> float:
        """Return one standard deviation in the unit of the value: kg, N s/m or N."""
        if self.kind in ("known_effects", "friction_side"):
            known = drive.effects[self.index]
            return abs(amplitude_of(known)) * self.deviation
        if self.kind == "friction_form":
            return known_friction(drive) * self.deviation
        part = drive.motor if self.side == "motor" else drive.table
        return self.deviation * part.mass_kg if self.kind == "mass" and part is not None else self.deviation

    @property
    def unit(self) -> str:
        """Unit of `size`."""
        units = {"mass": "kg", "viscous": "N s/m", "width": "", "reference_delay": "s"}
        return units.get(self.kind, "N")

    @property
    def changes_from_run_to_run(self) -> bool:
        """Whether it may differ between repeats: friction and offsets do, masses and what is unstated do not."""
        return self.kind != "mass" and self.kind not in UNSTATED

    def cause(self, nominal: Nominal) -> str:
        """Return the name of the effect that a large change of this value is, or an empty text."""
        if self.kind == "known_effects":
            return nominal.drive.effects[self.index].name
        return next((kind.name for kind in nominal.library if kind.calibrates == self.kind), "")


@functools.lru_cache(maxsize=16)
def nominal_parameters(nominal: Nominal) -> tuple[NominalParameter, ...]:
    """Return what every hypothesis may re-calibrate: masses, viscous friction, known effects, a force offset."""
    drive, doubt = nominal.drive, nominal.uncertainty
    sides = ("motor", "table") if drive.screw is not None else ("motor",)
    viscous = max(drive.viscous_friction_N_s_per_m, 1e-3 * drive.mass_kg) * doubt.viscous
    lever = 1.0 if drive.screw is not None else drive.mass_kg / drive.motor.mass_kg
    found = [
        NominalParameter(name=f"{side}_mass", kind="mass", side=side, deviation=doubt.mass * lever) for side in sides
    ]
    found += [NominalParameter(name=f"{side}_viscous", kind="viscous", side=side, deviation=viscous) for side in sides]
    found += [
        NominalParameter(name=f"known_{known.name}", kind="known_effects", index=index, deviation=doubt.known_effects)
        for index, known in enumerate(drive.effects)
        if known.calibrates not in ("friction_form", OFFSET)
    ]
    found += [
        NominalParameter(name=f"width_{known.name}", kind="width", index=index, deviation=doubt.transition_velocity)
        for index, known in enumerate(drive.effects)
        if doubt.transition_velocity > 0.0 and _turns_sign(known)
    ]
    offsets = [kind for kind in nominal.library if kind.calibrates == OFFSET]
    # A known constant force is a weight, as uncertain as a mass.
    weight = sum(abs(amplitude_of(known)) for known in drive.effects if known.calibrates == OFFSET)
    found += [
        NominalParameter(
            name=OFFSET,
            kind=OFFSET,
            deviation=math.hypot(nominal.force_offset_N, doubt.mass * weight),
            effect=silent(kind),
            amplitude=kind.amplitude,
        )
        for kind in offsets[:1]
        if nominal.force_offset_N > 0.0
    ]
    return (*found, *_friction_form(nominal), *_friction_side(nominal), *_reference_delay(nominal))


def _reference_delay(nominal: Nominal) -> list[NominalParameter]:
    """Return by how much the velocity's reference of a cascade is late."""
    controller, period_s = nominal.drive.controller, nominal.covered.period_s
    deviation = nominal.uncertainty.reference_delay * period_s
    if not isinstance(controller, Cascade) or controller.velocity_feedforward == 0.0 or deviation == 0.0:
        return []
    return [NominalParameter(name="reference_delay", kind="reference_delay", deviation=deviation)]


def _friction_side(nominal: Nominal) -> list[NominalParameter]:
    """Return which part of the friction that is known acts on the motor side instead of the table."""
    drive, deviation = nominal.drive, nominal.uncertainty.friction_side
    kinds = [kind for kind in nominal.library if kind.calibrates == "friction_side"]
    known = [
        index for index, item in enumerate(drive.effects) if type(item).port is Port.TABLE_FORCE and _turns_sign(item)
    ]
    if (
        not kinds
        or not known
        or drive.screw is None
        or deviation == 0.0
        or any(item.declared is kinds[0].declared for item in drive.effects)
    ):
        return []
    effect = silent(kinds[0]).changed(**{WIDTH: getattr(drive.effects[known[0]], WIDTH)})
    return [
        NominalParameter(
            name="friction_side",
            kind="friction_side",
            index=known[0],
            deviation=deviation,
            effect=effect,
            amplitude=kinds[0].amplitude,
        )
    ]


def _friction_form(nominal: Nominal) -> list[NominalParameter]:
    """Return the bumps of a free friction curve, within a share of the friction that is known."""
    kinds = [kind for kind in nominal.library if kind.calibrates == "friction_form"]
    deviation, fastest = nominal.uncertainty.friction_form, nominal.covered.fastest_m_per_s
    if not kinds or deviation == 0.0 or fastest == 0.0 or known_friction(nominal.drive) == 0.0:
        return []
    effect = silent(kinds[0]).changed(fastest_m_per_s=fastest)
    return [
        NominalParameter(
            name=f"friction_{name}", kind="friction_form", deviation=deviation, effect=effect, amplitude=name
        )
        for name in (kinds[0].amplitude, *kinds[0].further_amplitudes)
    ]


def known_friction(drive: FeedDrive) -> float:
    """Return the friction that a drive is known to have whatever the speed, N."""
    frictions = (item for item in drive.effects if _turns_sign(item) or item.usually_known)
    return sum(abs(amplitude_of(item)) for item in frictions if item.calibrates != OFFSET)


def _turns_sign(effect: Effect) -> bool:
    """Return whether an effect is a friction that turns its sign over some speed."""
    return any(item.name == WIDTH for item in effect.parameters())


def silent(kind: type[Effect]) -> Effect:
    """Return an effect with all its amplitudes at zero."""
    return kind.typical(**dict.fromkeys((kind.amplitude, *kind.further_amplitudes), 0.0))


def amplitude_of(effect: Effect) -> float:
    """Return the size of an effect by the parameter that scales it."""
    return float(getattr(effect, type(effect).amplitude))


def with_amplitude(effect: Effect, value: float) -> Effect:
    """Return an effect of another size."""
    return effect.changed(**{type(effect).amplitude: value})


def start(nominal: Nominal) -> Hypothesis:
    """Return the nominal model as a hypothesis."""
    return Hypothesis(nominal=nominal, shifts=(0.0,) * len(nominal_parameters(nominal)))


def adjustables(effect: Effect, longest_s: float = math.inf) -> list[Adjustable]:
    """Return what a fit may move in an effect: its amplitude, phases, and the shape parameters that are searched.

    No time that is fitted is longer than the records: what takes longer is not told from what never changes.
    """
    found = []
    for item in type(effect).parameters():
        is_amplitude = item.name in (type(effect).amplitude, *type(effect).further_amplitudes)
        if item.whole or not (is_amplitude or item.phase or item.grid or item.locate):
            continue
        value = getattr(effect, item.name)
        share = MODEL.line_step if item.locate else MODEL.step
        step = MODEL.phase_step_rad if item.phase else share * (abs(value) or abs(item.typical))
        low, high = (-math.inf, math.inf) if item.phase else (item.low, item.high)
        high = min(high, max(longest_s, low)) if item.unit == "s" else high
        found.append(Adjustable(name=item.name, step=step, low=low, high=high, prior=False))
    return found
