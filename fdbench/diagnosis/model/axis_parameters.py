"""Nominal parameters of the axis itself: masses, viscous friction, its screw, and a force offset."""

import math
from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self, final

from fdbench.diagnosis.model.known_effects import OFFSET, amplitude_of, silent, with_amplitude
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.model.nominal_parameter import Changed, NominalParameter
from fdbench.diagnosis.settings import MODEL
from fdbench.effects import Effect
from fdbench.plants.feed_drive import FeedDrive, RotaryMotor
from fdbench.specification import declared_bounds
from fdbench.units import unit_of
from fdbench.wording import si_text


@dataclass(frozen=True, kw_only=True)
class _OfASide(NominalParameter):
    """A field of the motor or of the table; ``side`` says of which."""

    side: str

    @classmethod
    @abstractmethod
    def of_part(cls, part: Any) -> float:
        """Return the value of a motor or a table."""

    @classmethod
    def sides(cls, drive: FeedDrive) -> tuple[str, ...]:
        """Return the parts that move apart from each other; without a screw it is the one that has most of the value.

        Where all moves as one, a data sheet may write it down as the motor's or as the load's.
        """
        every = ("motor",) if drive.table is None else ("motor", "table")
        return every if drive.screw is not None else (max(every, key=lambda side: cls.of_part(getattr(drive, side))),)

    def part(self, drive: FeedDrive) -> Any:
        """Return the motor or the table."""
        return drive.motor if self.side == "motor" else drive.table

    def changed(self, drive: FeedDrive, **fields: float) -> Changed:
        """Return the drive with other values of the part."""
        return replace(drive, **{self.side: replace(self.part(drive), **fields)}), ()


@final
@dataclass(frozen=True, kw_only=True)
class Mass(_OfASide):
    """Mass of motor or table; its deviation is relative."""

    kind = "mass"
    unit = "kg"
    changes_from_run_to_run = False

    @classmethod
    def of(cls, nominal: Nominal) -> list[Self]:
        drive, sides = nominal.drive, cls.sides(nominal.drive)
        lever = drive.mass_kg / sum(cls.of_part(getattr(drive, side)) for side in sides)
        deviation = nominal.uncertainty.mass * lever
        return [cls(name=f"{side}_mass", side=side, deviation=deviation) for side in sides]

    @classmethod
    def of_part(cls, part: Any) -> float:
        return float(part.mass_kg)

    def apply(self, drive: FeedDrive, shift: float) -> Changed:
        part = self.part(drive)
        field = "inertia_kg_m2" if isinstance(part, RotaryMotor) else "mass_kg"
        ratio = max(1.0 + shift * self.deviation, MODEL.smallest_ratio)
        return self.changed(drive, **{field: getattr(part, field) * ratio})

    def text(self, drive: FeedDrive, shift: float) -> str:
        return si_text(self.of_part(self.part(self.apply(drive, shift)[0])), "kg")

    def size(self, drive: FeedDrive) -> float:
        return self.deviation * self.of_part(self.part(drive))


@final
@dataclass(frozen=True, kw_only=True)
class Viscous(_OfASide):
    r"""Viscous friction of motor or table; its deviation is in N s/m, ``relative`` to what is on paper in all.

    .. math:: \sigma = r d / \sqrt{n}

    with the share r, the friction d on paper and its n sides, so that of the whole friction it is r d on any axis: it
    may be on either side. It moves down to none of what its side has on paper, ``lowest``, and no further.
    """

    kind = "viscous"
    unit = "N s/m"
    field: ClassVar[str] = "viscous_friction_N_s_per_m"
    relative: float
    lowest: float

    @classmethod
    def of(cls, nominal: Nominal) -> list[Self]:
        drive, relative, covered = nominal.drive, nominal.uncertainty.viscous, nominal.covered
        on_paper = max(drive.viscous_friction_N_s_per_m, 1e-3 * drive.mass_kg)
        if drive.viscous_friction_N_s_per_m == 0.0 and covered.fastest_m_per_s > 0.0:
            # Nothing on paper is not known to be nothing.
            on_paper = max(on_paper, covered.force_N / covered.fastest_m_per_s)
        own = {side: cls.of_part(getattr(drive, side)) for side in cls.sides(drive)}
        deviation = on_paper * relative / math.sqrt(len(own))
        return [
            cls(name=f"{side}_viscous", side=side, deviation=deviation, relative=relative, lowest=-value / deviation)
            for side, value in own.items()
        ]

    @classmethod
    def of_part(cls, part: Any) -> float:
        return float(getattr(part, cls.field))

    @property
    def relative_deviation(self) -> float:
        return self.relative

    @property
    def room(self) -> tuple[float, float]:
        return self.lowest, math.inf

    def apply(self, drive: FeedDrive, shift: float) -> Changed:
        moved = self.of_part(self.part(drive)) + shift * self.deviation
        return self.changed(drive, **{self.field: max(moved, 0.0)})

    def text(self, drive: FeedDrive, shift: float) -> str:
        return si_text(self.of_part(self.part(self.apply(drive, shift)[0])), unit_of(self.field))


@dataclass(frozen=True, kw_only=True)
class _OfTheScrew(NominalParameter):
    """A ``field`` of the screw or the shaft, above 0; another day does not change it."""

    nuisance = True
    changes_from_run_to_run = False
    field: ClassVar[str]

    @classmethod
    def of(cls, nominal: Nominal) -> list[Self]:
        deviation = getattr(nominal.uncertainty, cls.kind)
        return [cls(name=cls.kind, deviation=deviation)] if cls.value(nominal.drive) > 0.0 and deviation > 0.0 else []

    @classmethod
    def value(cls, drive: FeedDrive) -> float:
        """Return the value, 0 where nothing is elastic."""
        return 0.0 if drive.screw is None else float(getattr(drive.screw, cls.field))

    @abstractmethod
    def ratio(self, shift: float) -> float:
        """Return by which factor a shift moves the value."""

    def apply(self, drive: FeedDrive, shift: float) -> Changed:
        if drive.screw is None:
            return drive, ()
        return replace(drive, screw=replace(drive.screw, **{self.field: self.value(drive) * self.ratio(shift)})), ()

    def text(self, drive: FeedDrive, shift: float) -> str:
        moved = self.value(self.apply(drive, shift)[0])
        return "none" if drive.screw is None else si_text(moved, self.unit)

    def size(self, drive: FeedDrive) -> float:
        return self.deviation * self.value(drive)


@final
@dataclass(frozen=True, kw_only=True)
class Stiffness(_OfTheScrew):
    """Stiffness of the screw or the shaft, as far as a data sheet may have it wrong; its deviation is relative.

    It moves no further: a screw that lost more of it is a cause.
    """

    kind = "stiffness"
    unit = "N/m"
    field = "stiffness_N_per_m"

    def ratio(self, shift: float) -> float:
        return max(1.0 + shift * self.deviation, MODEL.smallest_ratio)

    @property
    def room(self) -> tuple[float, float]:
        return -MODEL.most_stiffness, MODEL.most_stiffness


@final
@dataclass(frozen=True, kw_only=True)
class Damping(_OfTheScrew):
    """Damping of the screw or the shaft, which no data sheet says; its deviation is that of the natural logarithm."""

    kind = "damping"
    unit = "N s/m"
    stated = False
    field = "damping_N_s_per_m"

    def ratio(self, shift: float) -> float:
        return math.exp(shift * self.deviation)

    @property
    def room(self) -> tuple[float, float]:
        return -MODEL.most_damping, MODEL.most_damping


@final
@dataclass(frozen=True, kw_only=True)
class ForceOffset(NominalParameter):
    """Constant force, carried by ``effect``; its deviation is in newtons."""

    kind = OFFSET
    effect: Effect

    @classmethod
    def of(cls, nominal: Nominal) -> list[Self]:
        kinds = [kind for kind in nominal.library if kind.calibrates == cls.kind]
        if not kinds or nominal.force_offset_N == 0.0:
            return []
        # A known constant force is a weight, as uncertain as a mass.
        weight = sum(abs(amplitude_of(known)) for known in nominal.drive.effects if known.calibrates == cls.kind)
        deviation = math.hypot(nominal.force_offset_N, nominal.uncertainty.mass * weight)
        return [cls(name=cls.kind, deviation=deviation, effect=silent(kinds[0]))]

    def apply(self, drive: FeedDrive, shift: float) -> Changed:
        return drive, (with_amplitude(self.effect, shift * self.deviation),)

    def text(self, drive: FeedDrive, shift: float) -> str:
        return si_text(shift * self.deviation, "N")


@dataclass(frozen=True, kw_only=True)
class _BetweenEncoders(NominalParameter):
    """What is between the readings of two encoders on either side of a screw."""

    stated = False
    changes_from_run_to_run = False

    @classmethod
    @abstractmethod
    def doubt(cls, nominal: Nominal) -> float:
        """Return the standard deviation, in the unit that the class says."""

    @classmethod
    def of(cls, nominal: Nominal) -> list[Self]:
        seen, deviation = nominal.covered.two_positions and nominal.drive.screw is not None, cls.doubt(nominal)
        return [cls(name=cls.kind, deviation=deviation)] if seen and deviation > 0.0 else []


@final
@dataclass(frozen=True, kw_only=True)
class EncoderZeros(_BetweenEncoders):
    """What the zeros of both encoders are apart, beside what `with_common_zeros` takes out; its deviation in metres."""

    kind = "encoder_zeros"
    unit = "m"
    nuisance = True

    @classmethod
    def doubt(cls, nominal: Nominal) -> float:
        return nominal.scale.length * MODEL.zeros_apart_m

    def apply(self, drive: FeedDrive, shift: float) -> Changed:
        return drive, ()

    def text(self, drive: FeedDrive, shift: float) -> str:
        return si_text(self.zeros_apart_m(shift), self.unit)

    def zeros_apart_m(self, shift: float) -> float:
        return shift * self.deviation


@final
@dataclass(frozen=True, kw_only=True)
class EncoderDelay(_BetweenEncoders):
    """By how much later than on paper the table's position is read after the motor's; its deviation is in seconds.

    Two encoders come by two ways, and no data sheet says how long either takes. What is later by far is a cause that no
    effect of the library is.
    """

    kind = "encoder_delay"
    unit = "s"

    @classmethod
    def doubt(cls, nominal: Nominal) -> float:
        return nominal.uncertainty.encoder_delay * nominal.covered.period_s

    def apply(self, drive: FeedDrive, shift: float) -> Changed:
        low, high = declared_bounds(FeedDrive)["table_read_late_s"]
        moved = drive.table_read_late_s + shift * self.deviation
        return replace(drive, table_read_late_s=min(max(moved, low), high)), ()

    def text(self, drive: FeedDrive, shift: float) -> str:
        return si_text(self.apply(drive, shift)[0].table_read_late_s, self.unit)
