"""What a trial needs of an implementation of axes: drawing imperfections, and recording motions with them."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np

from fdbench.record import FloatArray

POSITION_NOISE_M, FORCE_NOISE_N, PROCESS_FORCE_N = 3e-8, 3.0, 3.0  # standard deviations of each sample

Planted = Mapping[str, Mapping[str, float]]
"""Parameters of each imperfection by its name."""


class Axis(Protocol):
    """An axis on which motions are recorded."""

    def readings(self, reference: FloatArray, rng: np.random.Generator | None) -> dict[str, FloatArray]:
        """Return motor and table position (m) and motor force (N); without noise if there is no generator.

        Parameters
        ----------
        reference : (n_samples, 3) array
            Commanded position (m), velocity (m/s) and acceleration (m/s^2).
        rng : numpy Generator or None
        """
        ...


class Bench(ABC):
    """One machine, whose values differ from its model on paper, and what may be planted in it."""

    @abstractmethod
    def names(self, listed: bool) -> list[str]:
        """Return what can be planted: effects that a diagnosis may name, or others."""

    @abstractmethod
    def draw(self, name: str, rng: np.random.Generator) -> dict[str, float]:
        """Return drawn parameters of an imperfection."""

    @abstractmethod
    def clash(self, name: str, other: str) -> bool:
        """Return whether two imperfections cannot be planted together."""

    @abstractmethod
    def axis(self, planted: Planted) -> Axis:
        """Return the machine with imperfections."""

    @abstractmethod
    def add_clutter(self, yardstick: "Yardstick", rng: np.random.Generator) -> None:
        """Add what no diagnosis need find: traces that are below the noise, if the machine has no other."""


class Yardstick:
    """What counts as visible: signatures are measured in units of the noise of a healthy axis.

    Parameters
    ----------
    healthy : Axis
    motions : sequence of (n_samples, 3) array
    rng : numpy Generator
    """

    def __init__(self, healthy: Axis, motions: Sequence[FloatArray], rng: np.random.Generator) -> None:
        self.motions = motions
        self.clean = [channels(healthy.readings(motion, None)) for motion in motions]
        self.noise = np.ones((3, 1))
        self.noise = self.unrest(healthy, rng)

    def unrest(self, axis: Axis, rng: np.random.Generator) -> FloatArray:
        """Return what noise does to each channel as root mean square in units of that of the healthy axis, (3, 1)."""
        pairs = [(axis.readings(motion, rng), axis.readings(motion, None)) for motion in self.motions]
        differences = np.concatenate([channels(noisy) - channels(clean) for noisy, clean in pairs], axis=1)
        return np.asarray(np.sqrt(np.mean(differences**2, axis=1, keepdims=True)) / self.noise)

    def mean_squares(self, axis: Axis) -> list[float]:
        """Return the mean square of what differs from the healthy axis, noise apart, in each motion."""
        found = [channels(axis.readings(motion, None)) for motion in self.motions]
        return [float(np.mean(((own - clean) / self.noise) ** 2)) for own, clean in zip(found, self.clean, strict=True)]


def channels(readings: Mapping[str, FloatArray]) -> FloatArray:
    """Return force, table position and stretch, (3, n_samples)."""
    motor, table = readings["motor_position_m"], readings["table_position_m"]
    return np.stack((readings["motor_force_N"], table, motor - table))


def between(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw log-uniformly where both bounds are above zero, else uniformly."""
    if low > 0.0:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))
    return float(rng.uniform(low, high))
