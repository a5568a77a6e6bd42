"""A nominal parameter: how it changes a drive, what it is called, and how far it may move."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Any, ClassVar, final

from fdbench.diagnosis.model.known_effects import (
    OFFSET,
    WIDTH,
    amplitude_of,
    known_friction,
    resized,
    with_amplitude,
    with_known,
)
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.settings import MODEL
from fdbench.effects import Effect
from fdbench.plants.feed_drive import FeedDrive, RotaryMotor
from fdbench.units import unit_of
from fdbench.wording import percent, si_text

LONGEST_DELAY_S = 0.1  # of a velocity's reference, that a model may have

Changed = tuple[FeedDrive, tuple[Effect, ...]]
"""A drive, and the effects that have to be added to it."""


@dataclass(frozen=True, kw_only=True)
class NominalParameter(ABC):
    """A nominal parameter that every hypothesis may move, with its standard deviation.

    Attributes
    ----------
    name : str
    deviation : float
        Standard deviation, in the unit that the class says.
    kind : str
        What effects are called by that are a large change of it; see `fdbench.effects.Effect.calibrates`.
    unit : str
        Of `size`.
    stated : bool
        Whether a data sheet has it, so that a large change is far-fetched.
    nuisance : bool
        Whether a large change says nothing of the machine.
    changes_from_run_to_run : bool
        Whether it may differ between repeats, as friction and offsets do.
    """

    name: str
    deviation: float
    kind: ClassVar[str]
    unit: ClassVar[str] = "N"
    stated: ClassVar[bool] = True
    nuisance: ClassVar[bool] = False
    changes_from_run_to_run: ClassVar[bool] = True

    @abstractmethod
    def apply(self, drive: FeedDrive, shift: float) -> Changed:
        """Return the drive moved by ``shift`` standard deviations, and an effect that has to be added for it."""

    @abstractmethod
    def text(self, drive: FeedDrive, shift: float) -> str:
        """Return its value, moved by so many standard deviations, with its unit."""

    def size(self, drive: FeedDrive) -> float:
        """Return one standard deviation in ``unit``."""
        return self.deviation

    @property
    def relative_deviation(self) -> float | None:
        """Standard deviation relative to the friction that it changes; None where it changes none."""
        return None

    @property
    def room(self) -> tuple[float, float]:
        """How far a fit may move it down and up, in standard deviations."""
        return -math.inf, math.inf

    @property
    def group(self) -> str:
        """What is judged as one value: both sides of a screw."""
        return self.kind

    def cause(self, nominal: Nominal) -> str:
        """Return the name of the effect that a large change of this value is, or an empty text."""
        return next((kind.name for kind in nominal.library if kind.calibrates == self.kind), "")


@dataclass(frozen=True, kw_only=True)
class _OfASide(NominalParameter):
    """A field of the motor or of the table; ``side`` says of which."""

    side: str

    def part(self, drive: FeedDrive) -> Any:
        return drive.motor if self.side == "motor" else drive.table

    def changed(self, drive: FeedDrive, **fields: float) -> Changed:
        return replace(drive, **{self.side: replace(self.part(drive), **fields)}), ()


@final
@dataclass(frozen=True, kw_only=True)
class Mass(_OfASide):
    """Mass of motor or table; its deviation is relative."""

    kind = "mass"
    unit = "kg"
    changes_from_run_to_run = False

    def apply(self, drive: FeedDrive, shift: float) -> Changed:
        part = self.part(drive)
        field = "inertia_kg_m2" if isinstance(part, RotaryMotor) else "mass_kg"
        ratio = max(1.0 + shift * self.deviation, MODEL.smallest_ratio)
        return self.changed(drive, **{field: getattr(part, field) * ratio})

    def text(self, drive: FeedDrive, shift: float) -> str:
        return si_text(self.part(self.apply(drive, shift)[0]).mass_kg, "kg")

    def size(self, drive: FeedDrive) -> float:
        return self.deviation * float(self.part(drive).mass_kg)


@final
@dataclass(frozen=True, kw_only=True)
class Viscous(_OfASide):
    """Viscous friction of motor or table; its deviation is in N s/m, ``relative`` to what is on paper."""

    kind = "viscous"
    unit = "N s/m"
    field: ClassVar[str] = "viscous_friction_N_s_per_m"
    relative: float

    @property
    def relative_deviation(self) -> float:
        return self.relative

    def apply(self, drive: FeedDrive, shift: float) -> Changed:
        moved = getattr(self.part(drive), self.field) + shift * self.deviation
        return self.changed(drive, **{self.field: max(moved, 0.0)})

    def text(self, drive: FeedDrive, shift: float) -> str:
        return si_text(getattr(self.part(self.apply(drive, shift)[0]), self.field), unit_of(self.field))


@dataclass(frozen=True, kw_only=True)
class _OfAKnownEffect(NominalParameter):
    """Of the known effect of the drive with this ``index``."""

    index: int

    @property
    def group(self) -> str:
        return f"{self.kind}_{self.index}"

    def known(self, drive: FeedDrive) -> Effect:
        return drive.effects[self.index]


@final
@dataclass(frozen=True, kw_only=True)
class KnownAmplitude(_OfAKnownEffect):
    """Size of a known effect; its deviation is relative."""

    kind = "known_effects"
    is_friction: bool

    @property
    def relative_deviation(self) -> float | None:
        return self.deviation if self.is_friction else None

    def apply(self, drive: FeedDrive, shift: float) -> Changed:
        return resized(drive, self.index, max(1.0 + shift * self.deviation, 0.0)), ()

    def text(self, drive: FeedDrive, shift: float) -> str:
        known = self.known(self.apply(drive, shift)[0])
        return si_text(amplitude_of(known), unit_of(type(known).amplitude))

    def size(self, drive: FeedDrive) -> float:
        return abs(amplitude_of(self.known(drive))) * self.deviation

    def cause(self, nominal: Nominal) -> str:
        return self.known(nominal.drive).name


@final
@dataclass(frozen=True, kw_only=True)
class TransitionVelocity(_OfAKnownEffect):
    """Speed over which a known friction turns its sign; its deviation is that of the natural logarithm."""

    kind = "width"
    unit = ""
    stated = False
    nuisance = True
    changes_from_run_to_run = False

    def apply(self, drive: FeedDrive, shift: float) -> Changed:
        known = self.known(drive)
        bounds = next(item for item in known.parameters() if item.name == WIDTH)
        width = min(max(getattr(known, WIDTH) * math.exp(shift * self.deviation), bounds.low), bounds.high)
        return with_known(drive, self.index, known.changed(**{WIDTH: width})), ()

    def text(self, drive: FeedDrive, shift: float) -> str:
        return si_text(getattr(self.known(self.apply(drive, shift)[0]), WIDTH), unit_of(WIDTH))


@final
@dataclass(frozen=True, kw_only=True)
class FrictionSide(_OfAKnownEffect):
    """Which part of a known friction acts on the motor, by ``effect``, instead of the table."""

    kind = "friction_side"
    stated = False
    changes_from_run_to_run = False
    effect: Effect

    def part(self, shift: float) -> float:
        return min(max(shift * self.deviation, -1.0), 1.0)

    def apply(self, drive: FeedDrive, shift: float) -> Changed:
        part = self.part(shift)
        moved = with_amplitude(self.effect, part * amplitude_of(self.known(drive)))
        return resized(drive, self.index, 1.0 - part), (moved,)

    def text(self, drive: FeedDrive, shift: float) -> str:
        return f"{percent(self.part(shift) if amplitude_of(self.known(drive)) else 0.0)} on the motor"

    def size(self, drive: FeedDrive) -> float:
        return abs(amplitude_of(self.known(drive))) * self.deviation


@final
@dataclass(frozen=True, kw_only=True)
class ForceOffset(NominalParameter):
    """Constant force, carried by ``effect``; its deviation is in newtons."""

    kind = OFFSET
    effect: Effect

    def apply(self, drive: FeedDrive, shift: float) -> Changed:
        return drive, (with_amplitude(self.effect, shift * self.deviation),)

    def text(self, drive: FeedDrive, shift: float) -> str:
        return si_text(shift * self.deviation, "N")


@final
@dataclass(frozen=True, kw_only=True)
class FrictionForm(NominalParameter):
    """Height of a bump of a free friction curve, carried by ``effect``; its deviation is relative to the friction.

    It has a limit upwards: what resists at low speed beyond it is an effect, such as Stribeck's. Downwards it has none,
    as no effect takes friction away there.
    """

    kind = "friction_form"
    stated = False
    nuisance = True
    changes_from_run_to_run = False
    effect: Effect
    amplitude: str

    @property
    def room(self) -> tuple[float, float]:
        return -math.inf, MODEL.most_form

    def apply(self, drive: FeedDrive, shift: float) -> Changed:
        return drive, (self.effect.changed(**{self.amplitude: shift * self.size(drive)}),)

    def text(self, drive: FeedDrive, shift: float) -> str:
        return si_text(shift * self.size(drive), unit_of(self.amplitude))

    def size(self, drive: FeedDrive) -> float:
        return known_friction(drive) * self.deviation


@dataclass(frozen=True, kw_only=True)
class _OfACascade(NominalParameter):
    """A field of a cascade, that which it is named after unless ``field`` says another."""

    changes_from_run_to_run = False
    field: ClassVar[str] = ""

    @abstractmethod
    def value(self, drive: FeedDrive, shift: float) -> float:
        """Return the field moved by so many standard deviations."""

    def apply(self, drive: FeedDrive, shift: float) -> Changed:
        controller: Any = drive.controller
        moved = replace(controller, **{self.field or self.name: self.value(drive, shift)})
        return replace(drive, controller=moved), ()

    def text(self, drive: FeedDrive, shift: float) -> str:
        return si_text(self.value(drive, shift), unit_of(self.field or self.name))


@final
@dataclass(frozen=True, kw_only=True)
class ReferenceDelay(_OfACascade):
    """By how much the velocity's reference is late; its deviation is in seconds.

    A reference that is a sampling time late or early is a matter of how a loop is written; what is later is an effect.
    """

    kind = "reference_delay"
    unit = "s"
    stated = False
    nuisance = True
    field = "velocity_reference_delay_s"

    @property
    def room(self) -> tuple[float, float]:
        return -MODEL.most_delay, MODEL.most_delay

    def value(self, drive: FeedDrive, shift: float) -> float:
        moved = float(getattr(drive.controller, self.field)) + shift * self.deviation
        return min(max(moved, -LONGEST_DELAY_S), LONGEST_DELAY_S)


@final
@dataclass(frozen=True, kw_only=True)
class ControllerGain(_OfACascade):
    """A gain of the controller, in its own unit; its deviation is relative."""

    kind = "controller_gain"
    unit = ""

    @property
    def group(self) -> str:
        return self.name

    def value(self, drive: FeedDrive, shift: float) -> float:
        return float(getattr(drive.controller, self.name)) * max(1.0 + shift * self.deviation, MODEL.smallest_ratio)
