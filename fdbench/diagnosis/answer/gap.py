"""The gap of each channel before and after, and the noise floor it is beside."""

from collections.abc import Mapping
from dataclasses import dataclass

from fdbench.diagnosis.answer.quantity import Pair


@dataclass(frozen=True, kw_only=True)
class ChannelGap:
    """Held-out gap of a channel, root mean square in its unit.

    Attributes
    ----------
    before, recalibrated, repaired : float
        Of the nominal model, with re-calibrated parameters, and with the named effects.
    reduction : float
        By which share the repaired mean square is below the re-calibrated one, noise included.
    noise_floor : float
    unit : str
    relative : float
        Of the nominal gap, to the standard deviation of the channel.
    """

    before: float
    recalibrated: float
    repaired: float
    reduction: float
    noise_floor: float
    unit: str
    relative: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Gap:
    """Gaps of all channels by name."""

    channels: Mapping[str, ChannelGap]


@dataclass(frozen=True, kw_only=True)
class NoiseBand:
    """Noise in a band of frequency, root mean square."""

    band_Hz: Pair
    value: float


@dataclass(frozen=True, kw_only=True)
class NoiseFloor:
    """Noise of a channel, root mean square: in all, within a run, and what changes from run to run."""

    value: float
    unit: str
    measured_from_repeats: bool
    within_a_run: float | None = None
    from_run_to_run: float | None = None
    frequency: tuple[NoiseBand, ...] = ()
