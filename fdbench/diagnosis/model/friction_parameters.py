"""Nominal parameters of effects that a drive is known to have: their size, and friction's width, form and side."""

import math
from abc import abstractmethod
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import ClassVar, Self, final

from fdbench.diagnosis.model.known_effects import (
    OFFSET,
    STIFFNESS,
    WIDTH,
    amplitude_of,
    is_friction,
    is_grid,
    known_friction,
    resized,
    silent,
    turns_sign,
    with_amplitude,
    with_known,
)
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.model.nominal_parameter import Changed, NominalParameter
from fdbench.diagnosis.settings import MODEL
from fdbench.effects import Effect, Port
from fdbench.plants.feed_drive import FeedDrive
from fdbench.units import unit_of
from fdbench.wording import percent, si_text


@dataclass(frozen=True, kw_only=True)
class _OfAKnownEffect(NominalParameter):
    """Of the known effect of the drive with this ``index``."""

    index: int

    @property
    def group(self) -> str:
        return f"{self.kind}_{self.index}"

    def known(self, drive: FeedDrive) -> Effect:
        """Return the effect."""
        return drive.effects[self.index]

    def gone_with(self, replaced: Collection[int]) -> bool:
        return self.index in replaced


@final
@dataclass(frozen=True, kw_only=True)
class KnownAmplitude(_OfAKnownEffect):
    """Size of a known effect; its deviation is relative. The step of an encoder's grid is as on paper."""

    kind = "known_effects"
    is_friction: bool

    @classmethod
    def of(cls, nominal: Nominal) -> list[Self]:
        return [
            cls(
                name=f"known_{item.name}",
                index=index,
                deviation=nominal.uncertainty.of_effect(item),
                is_friction=is_friction(item),
            )
            for index, item in enumerate(nominal.drive.effects)
            if item.calibrates not in (FrictionForm.kind, OFFSET) and not is_grid(item)
        ]

    @property
    def relative_deviation(self) -> float | None:
        return self.deviation if self.is_friction else None

    @property
    def room(self) -> tuple[float, float]:
        return -1.0 / self.deviation, math.inf

    def shift_of_replaced(self, effects: Sequence[Effect], drive: FeedDrive, shift: float) -> float:
        """Return by how much the effect in its place is larger: of another law, friction is as large as on paper."""
        for effect in effects:
            alike = effect.in_place_of(self.known(drive))
            if alike is not None:
                return (amplitude_of(effect) / amplitude_of(alike) - 1.0) / self.deviation
        return shift

    def apply(self, drive: FeedDrive, shift: float) -> Changed:
        return resized(drive, self.index, max(1.0 + shift * self.deviation, 0.0)), ()

    def text(self, drive: FeedDrive, shift: float) -> str:
        known = self.known(self.apply(drive, shift)[0])
        return si_text(amplitude_of(known), unit_of(type(known).amplitude))

    def size(self, drive: FeedDrive) -> float:
        return abs(amplitude_of(self.known(drive))) * self.deviation

    def unit_on(self, drive: FeedDrive) -> str:
        return unit_of(type(self.known(drive)).amplitude)

    def cause(self, nominal: Nominal) -> str:
        return self.known(nominal.drive).name


@dataclass(frozen=True, kw_only=True)
class _BesideItsSize(_OfAKnownEffect):
    """Value of one ``parameter`` of a known effect, within its bounds."""

    nuisance = True
    changes_from_run_to_run = False
    parameter: str

    @abstractmethod
    def value(self, drive: FeedDrive, shift: float) -> float:
        """Return the value at a shift, perhaps beyond the bounds."""

    def apply(self, drive: FeedDrive, shift: float) -> Changed:
        moved = self.known(drive).within(**{self.parameter: self.value(drive, shift)})
        return with_known(drive, self.index, moved), ()

    def text(self, drive: FeedDrive, shift: float) -> str:
        moved = self.known(self.apply(drive, shift)[0])
        return si_text(getattr(moved, self.parameter), unit_of(self.parameter))


@final
@dataclass(frozen=True, kw_only=True)
class KnownFurtherAmplitude(_BesideItsSize):
    """Another size of a known effect, in another unit than its own, such as the friction in a cable chain's spring.

    Its deviation is relative. What is in one unit is of one size together, such as the forces of a friction.
    """

    kind = "known_further_amplitude"

    @classmethod
    def of(cls, nominal: Nominal) -> list[Self]:
        doubt_of = nominal.uncertainty.of_effect
        return [
            cls(name=f"known_{item.name}_{name}", index=index, deviation=doubt_of(item), parameter=name)
            for index, item in enumerate(nominal.drive.effects)
            for name in type(item).further_amplitudes
            if getattr(item, name) != 0.0 and unit_of(name) != unit_of(type(item).amplitude)
        ]

    def value(self, drive: FeedDrive, shift: float) -> float:
        """Return the size, which never turns its sign."""
        return float(getattr(self.known(drive), self.parameter)) * max(1.0 + shift * self.deviation, 0.0)

    def size(self, drive: FeedDrive) -> float:
        return abs(float(getattr(self.known(drive), self.parameter))) * self.deviation

    def unit_on(self, drive: FeedDrive) -> str:
        return unit_of(self.parameter)


@final
@dataclass(frozen=True, kw_only=True)
class KnownPhase(_BesideItsSize):
    """Phase of a known effect over the way, such as gravity of a joint; its deviation is in radians.

    A zero of the encoder that is set by hand, or a centre of mass beside the line of a link, shifts it.
    """

    kind = "known_phase"
    unit = "rad"

    @classmethod
    def of(cls, nominal: Nominal) -> list[Self]:
        deviation = nominal.uncertainty.known_phase
        return [
            cls(name=f"known_{item.name}_{own.name}", index=index, deviation=deviation, parameter=own.name)
            for index, item in enumerate(nominal.drive.effects)
            for own in item.parameters()
            if own.phase and deviation > 0.0 and _is_over_the_way(item)
        ]

    def value(self, drive: FeedDrive, shift: float) -> float:
        """Return the phase, within half a turn of zero."""
        return math.remainder(getattr(self.known(drive), self.parameter) + shift * self.deviation, 2.0 * math.pi)


def _is_over_the_way(effect: Effect) -> bool:
    return effect.needs_turn or any(item.locate and item.unit == "m" for item in effect.parameters())


@dataclass(frozen=True, kw_only=True)
class _InNoDataSheet(_BesideItsSize):
    """Parameter of a known friction beside its size; its deviation is that of the natural logarithm."""

    unit = ""
    stated = False
    of_friction: ClassVar[str]  # name of the parameter
    in_doubt: ClassVar[str]  # name of the uncertainty

    @classmethod
    def of(cls, nominal: Nominal) -> list[Self]:
        deviation = getattr(nominal.uncertainty, cls.in_doubt)
        return [
            cls(name=f"{cls.kind}_{item.name}", index=index, deviation=deviation, parameter=cls.of_friction)
            for index, item in enumerate(nominal.drive.effects)
            if hasattr(item, cls.of_friction) and deviation > 0.0
        ]

    def value(self, drive: FeedDrive, shift: float) -> float:
        return float(getattr(self.known(drive), self.parameter)) * math.exp(self.stretched(shift) * self.deviation)

    def stretched(self, shift: float) -> float:
        """Return by how many deviations the logarithm is moved."""
        return shift


@final
@dataclass(frozen=True, kw_only=True)
class TransitionVelocity(_InNoDataSheet):
    r"""Speed over which a known friction turns its sign.

    .. math:: v = v_0 e^{\sigma s} \quad (s \ge 0), \qquad v = v_0 e^{\sigma s - (\sigma s)^2 / 2} \quad (s < 0)

    with the shift s in deviations :math:`\sigma`. In no data sheet, it is a number of simulations alone, and exact
    Coulomb friction is not far from any; where it was measured, it is as known to be lower as to be higher.
    """

    kind = "width"
    of_friction = WIDTH
    in_doubt = "transition_velocity"

    def stretched(self, shift: float) -> float:
        return shift if shift >= 0.0 else shift - 0.5 * self.deviation * shift**2


@final
@dataclass(frozen=True, kw_only=True)
class BristleStiffness(_InNoDataSheet):
    """Stiffness of a known friction's bristles, and so the way over which they bend before it slides."""

    kind = "bristles"
    of_friction = STIFFNESS
    in_doubt = "bristle_stiffness"


@dataclass(frozen=True, kw_only=True)
class _FormOfFriction(NominalParameter):
    """Force of one ``amplitude`` of an ``effect`` that carries another form of a known friction; relative to that."""

    stated = False
    nuisance = True
    changes_from_run_to_run = False
    effect: Effect
    amplitude: str

    def apply(self, drive: FeedDrive, shift: float) -> Changed:
        return drive, (self.effect.changed(**{self.amplitude: shift * self.size(drive)}),)

    def text(self, drive: FeedDrive, shift: float) -> str:
        return si_text(shift * self.size(drive), unit_of(self.amplitude))


@final
@dataclass(frozen=True, kw_only=True)
class FrictionForm(_FormOfFriction):
    """Height of a bump of a free friction curve, carried by ``effect``; its deviation is relative to the friction.

    It has a limit upwards: what resists at low speed beyond it is an effect, such as Stribeck's; the tighter, the
    faster its bump is, as a friction whose sign is rounded in another way differs in the slowest ones. Downwards it has
    none, as no effect takes friction away there.
    """

    kind = "friction_form"
    most: float

    @classmethod
    def of(cls, nominal: Nominal) -> list[Self]:
        every = [kind for kind in nominal.library if kind.calibrates == cls.kind]
        kinds = [kind for kind in every if not BristleForm.is_carried_by(kind)]
        deviation, fastest = nominal.uncertainty.friction_form, nominal.covered.fastest_m_per_s
        if not kinds or deviation == 0.0 or fastest == 0.0 or known_friction(nominal.drive) == 0.0:
            return []
        effect = silent(kinds[0]).changed(fastest_m_per_s=fastest)
        names = (kinds[0].amplitude, *kinds[0].further_amplitudes)
        return [
            cls(name=f"friction_{name}", deviation=deviation, effect=effect, amplitude=name, most=most)
            for name, most in zip(names, MODEL.most_form, strict=True)
        ]

    @property
    def room(self) -> tuple[float, float]:
        return -math.inf, self.most

    def size(self, drive: FeedDrive) -> float:
        return known_friction(drive) * self.deviation


@final
@dataclass(frozen=True, kw_only=True)
class BristleForm(_FormOfFriction):
    """Force of slips in place of bristles of a known friction, carried by ``effect``; relative to it.

    No law by which a friction bends is that of a real contact; in steady sliding nothing is left of it.
    """

    kind = "bristle_form"
    friction_N: float

    @classmethod
    def of(cls, nominal: Nominal) -> list[Self]:
        kinds, deviation = [*filter(cls.is_carried_by, nominal.library)], nominal.uncertainty.bristle_form
        bristles = [item for item in nominal.drive.effects if item.bend_m > 0.0]
        if not kinds or deviation == 0.0 or not bristles:
            return []
        effect = silent(kinds[0]).changed(way_m=bristles[0].bend_m)
        force_N = amplitude_of(bristles[0])
        names = (kinds[0].amplitude, *kinds[0].further_amplitudes)
        return [
            cls(name=f"bristle_{name}", deviation=deviation, effect=effect, amplitude=name, friction_N=force_N)
            for name in names
        ]

    @staticmethod
    def is_carried_by(kind: type[Effect]) -> bool:
        """Whether an effect is the form of a friction over the way, which has internal states, and not over speed."""
        return kind.calibrates == FrictionForm.kind and bool(kind.states)

    @property
    def room(self) -> tuple[float, float]:
        return -MODEL.most_bristles / self.deviation, MODEL.most_bristles / self.deviation

    def size(self, drive: FeedDrive) -> float:
        return self.friction_N * self.deviation


@final
@dataclass(frozen=True, kw_only=True)
class FrictionSide(_OfAKnownEffect):
    """Which part of a known friction acts on the motor, by ``effect``, instead of the table."""

    kind = "friction_side"
    stated = False
    changes_from_run_to_run = False
    effect: Effect

    @classmethod
    def of(cls, nominal: Nominal) -> list[Self]:
        drive, deviation = nominal.drive, nominal.uncertainty.friction_side
        kinds = [kind for kind in nominal.library if kind.calibrates == cls.kind]
        on_table = [index for index, item in enumerate(drive.effects) if type(item).port is Port.TABLE_FORCE]
        known = [index for index in on_table if turns_sign(drive.effects[index]) or drive.effects[index].bend_m > 0.0]
        if not kinds or not known or drive.screw is None or deviation == 0.0:
            return []
        if any(item.declared is kinds[0].declared for item in drive.effects):
            return []
        return [cls(name=cls.kind, index=known[0], deviation=deviation, effect=silent(kinds[0]))]

    def gone_with(self, replaced: Collection[int]) -> bool:
        return False  # what is not known of the side is not of the form either

    def part(self, shift: float) -> float:
        """Return the part that acts on the motor."""
        return min(max(shift * self.deviation, -1.0), 1.0)

    def apply(self, drive: FeedDrive, shift: float) -> Changed:
        part = self.part(shift)
        moved = with_amplitude(self.effect, part * amplitude_of(self.known(drive)))
        return resized(drive, self.index, 1.0 - part), (moved,)

    def text(self, drive: FeedDrive, shift: float) -> str:
        return f"{percent(self.part(shift) if amplitude_of(self.known(drive)) else 0.0)} on the motor"

    def size(self, drive: FeedDrive) -> float:
        return abs(amplitude_of(self.known(drive))) * self.deviation
