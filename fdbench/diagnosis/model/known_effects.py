"""The effects that a drive is known to have: their sizes, and the drive with another one."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

from fdbench.effects import Effect, Port
from fdbench.plants.feed_drive import FeedDrive

WIDTH = "transition_velocity_m_per_s"  # parameter that any friction turns its sign over
STIFFNESS = "bristle_stiffness_N_per_m"  # parameter that says over which way any friction bends before it slides
OFFSET = "force_offset"  # what a constant force calibrates


def known_friction(drive: FeedDrive) -> float:
    """Return the friction that a drive is known to have whatever the speed, N."""
    return sum(abs(amplitude_of(item)) for item in drive.effects if is_friction(item))


def is_friction(effect: Effect) -> bool:
    """Return whether a known effect is friction, whatever the speed."""
    return (turns_sign(effect) or effect.usually_known) and effect.calibrates != OFFSET


def turns_sign(effect: Effect) -> bool:
    """Return whether an effect is a friction that turns its sign over some speed."""
    return any(item.name == WIDTH for item in effect.parameters())


def first_friction(effects: Iterable[Effect]) -> Effect | None:
    """Return the first that turns its sign over some speed."""
    return next((item for item in effects if turns_sign(item)), None)


def sliding_alike(drive: FeedDrive, added: Sequence[Effect]) -> tuple[Effect, ...]:
    """Return added effects, of which friction turns its sign over one speed: they share a contact.

    It is that of the known friction, and of the first one that is added where none is known.
    """
    first = first_friction((*drive.effects, *added))
    if first is None:
        return tuple(added)
    width = {WIDTH: getattr(first, WIDTH)}
    return tuple(item.within(**width) if turns_sign(item) else item for item in added)


def is_grid(effect: Effect) -> bool:
    """Return whether an effect moves what an encoder reads to a grid: applied once more, it changes nothing."""
    if effect.port not in (Port.MOTOR_ENCODER, Port.TABLE_SCALE) or effect.states or effect.random:
        return False

    def after(reading: float) -> float:
        return float(type(effect).kernel.py_func(0.0, 1e-3, 0.0, 0.0, reading, *effect.values())[0])

    readings = [share * amplitude_of(effect) for share in (0.3, 1.6, -2.7)]
    once = [after(reading) for reading in readings]
    return once != readings and all(math.isclose(after(reading), reading, rel_tol=1e-9) for reading in once)


def without(drive: FeedDrive, index: int) -> FeedDrive:
    """Return the drive with one of its known effects at zero amplitude."""
    return resized(drive, index, 0.0)


def resized(drive: FeedDrive, index: int, ratio: float) -> FeedDrive:
    """Return the drive with one of its known effects of another size, all its amplitudes alike."""
    return with_known(drive, index, drive.effects[index].scaled(ratio))


def with_known(drive: FeedDrive, index: int, effect: Effect) -> FeedDrive:
    """Return the drive with another effect in place of one of its known ones."""
    return replace(drive, effects=(*drive.effects[:index], effect, *drive.effects[index + 1 :]))


def silent(kind: type[Effect]) -> Effect:
    """Return an effect with all its amplitudes at zero."""
    return kind.typical(**dict.fromkeys((kind.amplitude, *kind.further_amplitudes), 0.0))


def amplitude_of(effect: Effect) -> float:
    """Return the size of an effect by the parameter that scales it."""
    return float(getattr(effect, type(effect).amplitude))


def with_amplitude(effect: Effect, value: float) -> Effect:
    """Return an effect of another size."""
    return effect.changed(**{type(effect).amplitude: value})
