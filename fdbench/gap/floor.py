"""The noise floor: what repeats of one command differ by, so that nobody explains noise."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fdbench.gap.runs import Run, differences

ASSUMED_QUANTILE = 0.25
PIECE = 128
SMALLEST = 1e-12


@dataclass(frozen=True, kw_only=True)
class Floor:
    """Noise of one channel.

    Attributes
    ----------
    rms : float
        Standard deviation of a sample, in the unit of the channel.
    measured : bool
        Whether it comes from repeats; else it is assumed from the quietest parts of the records.
    """

    rms: float
    measured: bool


def noise_floor(runs: Sequence[Run], channel: str) -> Floor:
    """Return the floor of a channel.

    With repeats (of records, or of laps within one) it is the root mean square of their differences over the root of
    two, drift from repeat to repeat included. Without, second differences remove the motion and enlarge white noise
    by the root of six; their quietest quarter counts.
    """
    found = differences(runs, channel)
    if found:
        mean_square = float(np.mean(np.concatenate(found) ** 2)) / 2.0
        return Floor(rms=max(np.sqrt(mean_square), SMALLEST), measured=True)
    pieces = []
    for run in runs:
        rough = np.diff(run.channels[channel], 2)
        n = len(rough) // PIECE * PIECE
        pieces.append(np.mean(rough[:n].reshape(-1, PIECE) ** 2, axis=1) / 6.0)
    level = float(np.quantile(np.concatenate(pieces), ASSUMED_QUANTILE))
    return Floor(rms=max(np.sqrt(level), SMALLEST), measured=False)


def floors(runs: Sequence[Run]) -> Mapping[str, Floor]:
    """Return the floor of each channel."""
    return {channel: noise_floor(runs, channel) for channel in runs[0].channels}


def raised(found: Mapping[str, Floor], energy: Mapping[str, float]) -> Mapping[str, Floor]:
    """Return floors that mean squares are added to, of what cannot be simulated sample by sample."""
    return {
        name: Floor(rms=float(np.sqrt(floor.rms**2 + energy[name])), measured=floor.measured)
        for name, floor in found.items()
    }
