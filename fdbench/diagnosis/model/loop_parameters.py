"""Nominal parameters of a loop: a cascade's gains, how late its reference of the velocity is, and the force."""

import math
from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self, final

from fdbench.diagnosis.model.known_effects import silent, with_amplitude
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.model.nominal_parameter import Changed, NominalParameter
from fdbench.diagnosis.settings import MODEL
from fdbench.effects import Effect
from fdbench.plants.feed_drive import Cascade, FeedDrive, Following
from fdbench.specification import declared_bounds
from fdbench.units import unit_of
from fdbench.wording import si_text

MASS_FED_FORWARD = "acceleration_feedforward_kg"
GAINS = (
    "position_gain_per_s",
    "velocity_gain_N_s_per_m",
    "integral_gain_N_per_m",
    "velocity_feedforward",
    MASS_FED_FORWARD,
)


@dataclass(frozen=True, kw_only=True)
class _OfACascade(NominalParameter):
    """A field of a cascade, that which it is named after unless ``field`` says another."""

    changes_from_run_to_run = False
    field: ClassVar[str] = ""

    @abstractmethod
    def moved(self, drive: FeedDrive, shift: float) -> float:
        """Return the field moved by so many standard deviations, whatever a model may have."""

    def value(self, drive: FeedDrive, shift: float) -> float:
        """Return the field moved by so many standard deviations, as far as a model may have it."""
        low, high = declared_bounds(Cascade)[self.field or self.name]
        return min(max(self.moved(drive, shift), low), high)

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
    limited = True
    field = "velocity_reference_delay_s"

    @classmethod
    def of(cls, nominal: Nominal) -> list[Self]:
        controller, deviation = nominal.drive.controller, nominal.reference_delay * nominal.covered.period_s
        if not isinstance(controller, Cascade) or controller.velocity_feedforward == 0.0 or deviation == 0.0:
            return []
        return [cls(name=cls.kind, deviation=deviation)]

    @property
    def room(self) -> tuple[float, float]:
        return -MODEL.most_delay, MODEL.most_delay

    def moved(self, drive: FeedDrive, shift: float) -> float:
        """Return by how much the reference is late (s)."""
        return float(getattr(drive.controller, self.field)) + shift * self.deviation


@final
@dataclass(frozen=True, kw_only=True)
class VelocityFilter(_OfACascade):
    """Time constant of the filter of the velocity, ``given_s`` in the model; its deviation is in seconds.

    Drives smooth the velocity that they difference, and not every data sheet says so. What smooths by far more is a
    cause that no effect of the library is.
    """

    kind = "velocity_filter"
    unit = "s"
    stated = False
    field = "velocity_filter_s"
    given_s: float

    @classmethod
    def of(cls, nominal: Nominal) -> list[Self]:
        controller, deviation = nominal.drive.controller, nominal.uncertainty.velocity_filter * nominal.covered.period_s
        if not isinstance(controller, Cascade) or deviation == 0.0:
            return []
        return [cls(name=cls.kind, deviation=deviation, given_s=controller.velocity_filter_s)]

    @property
    def room(self) -> tuple[float, float]:
        return -self.given_s / self.deviation, math.inf

    def moved(self, drive: FeedDrive, shift: float) -> float:
        """Return the time constant (s)."""
        return self.given_s + shift * self.deviation


@final
@dataclass(frozen=True, kw_only=True)
class LoopLag(NominalParameter):
    """Time by which the force follows its command, carried by ``effect``; its deviation is in seconds.

    Sampling, computing and switching take a part of the sampling time on every drive, and no data sheet says which,
    whatever it says of the current loop: beside a lag that is known, the force is late by a dead time. Below 0 the
    force is read after the position: a logger may take either first, and a simulator that moves by the speed at the end
    of a step is half a step ahead of its force. A controller that is known reads one and writes the other: there it is
    never below 0.
    """

    kind = "loop_lag"
    unit = "s"
    stated = False
    nuisance = True
    limited = True
    changes_from_run_to_run = False
    effect: Effect
    most_early: float

    @classmethod
    def of(cls, nominal: Nominal) -> list[Self]:
        late, deviation = cls.unknown(nominal), nominal.uncertainty.loop_lag * nominal.covered.period_s
        if late is None or deviation == 0.0:
            return []
        most_early = MODEL.most_early if isinstance(nominal.drive.controller, Following) else 0.0
        return [cls(name=cls.kind, deviation=deviation, effect=silent(late), most_early=most_early)]

    @classmethod
    def unknown(cls, nominal: Nominal) -> type[Effect] | None:
        """Return the first effect that is such a time and that the model does not know."""
        known = [item.declared for item in nominal.drive.effects]
        kinds = (kind for kind in nominal.library if kind.trace_of == cls.kind and kind.declared not in known)
        return next(kinds, None)

    @property
    def room(self) -> tuple[float, float]:
        return -self.most_early, MODEL.most_lag

    def apply(self, drive: FeedDrive, shift: float) -> Changed:
        return drive, (with_amplitude(self.effect, self.lag_s(shift)),)

    def lag_s(self, shift: float) -> float:
        """Return by how much the force is late (s); it is never early."""
        return max(shift, 0.0) * self.deviation

    def force_read_late_s(self, shift: float) -> float:
        return max(-shift, 0.0) * self.deviation

    def text(self, drive: FeedDrive, shift: float) -> str:
        return si_text(shift * self.deviation, self.unit)


@final
@dataclass(frozen=True, kw_only=True)
class ControllerGain(_OfACascade):
    """A gain of the controller, in its own unit; its deviation is relative.

    That of a mass that is fed forward is relative to all that is moved where it is less: of a controller that feeds
    hardly any forward it is the part of the force that is in doubt.
    """

    kind = "controller_gain"
    unit = ""

    @classmethod
    def of(cls, nominal: Nominal) -> list[Self]:
        controller, deviation = nominal.drive.controller, nominal.uncertainty.controller_gains
        if not isinstance(controller, Cascade) or deviation == 0.0:
            return []
        given = {name: getattr(controller, name) for name in GAINS if getattr(controller, name) != 0.0}
        least = {MASS_FED_FORWARD: nominal.drive.mass_kg}
        return [
            cls(name=name, deviation=deviation * max(1.0, least.get(name, 0.0) / abs(value)))
            for name, value in given.items()
        ]

    def moved(self, drive: FeedDrive, shift: float) -> float:
        """Return the gain."""
        return float(getattr(drive.controller, self.name)) * max(1.0 + shift * self.deviation, MODEL.smallest_ratio)
