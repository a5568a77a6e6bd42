"""Shares of a gap: of what is closed in its channels, and of each effect among several."""

import numpy as np

from fdbench.diagnosis.judge.reduction import Reductions, shapley
from fdbench.diagnosis.settings import JUDGE
from fdbench.record import FloatArray


class Shares:
    """Shares of a gap; a channel counts by the root mean square of its gap beyond the noise.

    Parameters
    ----------
    gaps : (n_channels,) array
        Mean squared held-out gap in units of the floor.
    interpolated : (n_channels,) array
        What was taken out of the readings beforehand.
    """

    def __init__(self, gaps: FloatArray, interpolated: FloatArray) -> None:
        self.total = gaps + interpolated
        weights = np.sqrt(np.maximum(self.total - 1.0, 0.0))
        self.weights = weights / weights.sum() if weights.sum() > 0.0 else np.full(len(weights), 1.0 / len(weights))

    def of(self, closed: FloatArray) -> float:
        """Return the share of mean squares that are closed in the channels, between 0 and 1."""
        return float(np.clip(np.sum(self.weights * self.by_channel(closed)), 0.0, 1.0))

    def by_channel(self, closed: FloatArray) -> FloatArray:
        """Return the share in each channel."""
        return np.asarray(np.clip(closed / np.maximum(self.total, 1e-12), 0.0, 1.0))


class Parts:
    """What each effect of the final hypothesis explains of the gap that re-calibration leaves.

    Parameters
    ----------
    reductions : Reductions
    shares : Shares
    channels : list of str
    """

    def __init__(self, reductions: Reductions, shares: Shares, channels: list[str]) -> None:
        self.shares, self.channels = shares, channels
        self.left_of_channel = [
            dict(zip(reductions.subsets, reductions.of_channel(place).tolist(), strict=True))
            for place in range(len(channels))
        ]
        self.everything = reductions.subsets[-1]
        self.closed = [reductions.closed_in_channel(place) for place in range(len(channels))]
        self.parts = [shapley(own, len(self.everything)) for own in self.closed]

    def share(self, index: int) -> float:
        """Return the share of an effect, divided fairly where several explain the same."""
        return self.shares.of(self._own(index))

    def by_channel(self, index: int) -> dict[str, float]:
        """Return the share of an effect in each channel."""
        return dict(zip(self.channels, self.shares.by_channel(self._own(index)).tolist(), strict=True))

    def unique(self, index: int) -> float:
        """Return the share that no other effect explains."""
        without = self._without(index)
        return self.shares.of(np.array([values[self.everything] - values[without] for values in self.closed]))

    def is_worse_in_a_channel(self, index: int) -> bool:
        """Whether the gap of a channel is far larger with an effect than without it, and no noise."""
        without = self._without(index)
        return any(left[self.everything] > JUDGE.worse * max(left[without], 1.0) for left in self.left_of_channel)

    def _own(self, index: int) -> FloatArray:
        return np.array([part[index] for part in self.parts])

    def _without(self, index: int) -> tuple[int, ...]:
        return tuple(other for other in self.everything if other != index)
