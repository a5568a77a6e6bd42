"""What a trial needs of an implementation of axes: drawing imperfections, and recording motions with them."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import ClassVar, Protocol

import numpy as np

from fdbench.record import FloatArray

POSITION_NOISE_M, FORCE_NOISE_N, PROCESS_FORCE_N = 3e-8, 3.0, 3.0  # standard deviations of each sample

# Standard deviations of the errors of the nominal parameters, as shares; of the force offset in newtons.
ERRORS: Mapping[str, float] = MappingProxyType(
    {
        "motor_mass": 0.02,
        "table_mass": 0.02,
        "motor_viscous": 0.07,
        "table_viscous": 0.07,
        "known": 0.04,
        "offset_N": 1.5,
    }
)
NOTHING: Mapping[str, float] = MappingProxyType({})
# What an owner has read from the controller, measured in slow motions, and from the sheet of the screw.
KNOWN: Mapping[str, float] = MappingProxyType(
    {
        "stiffness": 0.02,
        "transition_velocity": 0.0,
        "friction_side": 0.0,
        "controller_gains": 0.0,
        "velocity_filter": 0.0,
        "loop_lag": 0.0,
    }
)

Injected = Mapping[str, Mapping[str, float]]
"""Parameters of each imperfection by its name."""


class VirtualAxis(Protocol):
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
    """One machine, whose values differ from its nominal model, and what may be injected in it.

    Class attributes
    ----------------
    nominal_errors : mapping of str to float
        Nominal parameters that may be off, and by what standard deviation.
    known : mapping of str to float
        What its owner knows better than one does of any machine, as values of
        `fdbench.diagnosis.model.nominal.Uncertainty`.
    """

    nominal_errors: ClassVar[Mapping[str, float]] = ERRORS
    known: ClassVar[Mapping[str, float]] = NOTHING

    @abstractmethod
    def names(self, listed: bool) -> list[str]:
        """Return what can be injected: effects that a diagnosis may name, or others."""

    @abstractmethod
    def draw(self, name: str, rng: np.random.Generator) -> dict[str, float]:
        """Return drawn parameters of an imperfection."""

    @abstractmethod
    def clash(self, name: str, other: str) -> bool:
        """Return whether two imperfections cannot be injected together."""

    @abstractmethod
    def is_nominal_parameter(self, name: str) -> bool:
        """Return whether an imperfection is a value of the nominal model that is off."""

    @abstractmethod
    def axis(self, injected: Injected, change: Mapping[str, float] = NOTHING) -> VirtualAxis:
        """Return the machine with imperfections, and ``change`` added to its errors; see `nominal_errors`."""

    @abstractmethod
    def add_background(self, detectability: "Detectability", rng: np.random.Generator) -> None:
        """Add what no diagnosis need find: traces that are below the noise, if the machine has no other."""

    @abstractmethod
    def without_background(self) -> "Bench":
        """Return the machine without what `add_background` added."""


class Detectability:
    """What counts as visible: signatures in units of the noise of a machine without imperfections.

    Parameters
    ----------
    bench : Bench
    motions : sequence of (n_samples, 3) array
    sides : tuple of str
        Columns of the positions that are recorded, first the one that closes the loop.
    rng : numpy Generator
    """

    def __init__(
        self, bench: Bench, motions: Sequence[FloatArray], sides: tuple[str, ...], rng: np.random.Generator
    ) -> None:
        self.motions = motions
        self.sides = sides
        self.noise = np.ones((1 + len(sides), 1))
        healthy = bench.axis({})
        self._last: tuple[VirtualAxis, list[FloatArray]] | None = None
        self.clean = self._quiet(healthy)
        self.noise = self.noise_amplification(healthy, rng)
        moved = [self._joined(bench.axis({}, {name: size})) for name, size in bench.nominal_errors.items()]
        self.nominal_changes, _ = np.linalg.qr(np.stack(moved, axis=1))

    def beside(self, axis: VirtualAxis) -> None:
        """Take a machine as it is, with its traces, so that no other counts as visible for these."""
        self.clean = self._quiet(axis)

    def noise_amplification(self, axis: VirtualAxis, rng: np.random.Generator) -> FloatArray:
        """Return what noise does to each channel as root mean square in units of that of the healthy axis."""
        noisy = [self._channels(axis.readings(motion, rng)) for motion in self.motions]
        differences = np.concatenate(noisy, axis=1) - np.concatenate(self._quiet(axis), axis=1)
        return np.asarray(np.sqrt(np.mean(differences**2, axis=1, keepdims=True)) / self.noise)

    def mean_square(self, axis: VirtualAxis, beside_nominal_errors: bool) -> float:
        """Return the largest mean square over the motions of the deviation from the machine as it is, without noise.

        Parameters
        ----------
        axis : VirtualAxis
        beside_nominal_errors : bool
            Whether what other nominal parameters could do as well does not count.
        """
        joined = self._joined(axis)
        if not np.isfinite(joined).all():
            return float("nan")
        if beside_nominal_errors:
            joined = joined - self.nominal_changes @ (self.nominal_changes.T @ joined)
        ends = np.cumsum([len(self.noise) * len(motion) for motion in self.motions])
        return max(float(np.mean(part**2)) for part in np.split(joined, ends[:-1]))

    def _quiet(self, axis: VirtualAxis) -> list[FloatArray]:
        """Return the channels of each motion without noise; those of the last axis are kept."""
        if self._last is None or self._last[0] is not axis:
            self._last = axis, [self._channels(axis.readings(motion, None)) for motion in self.motions]
        return self._last[1]

    def _joined(self, axis: VirtualAxis) -> FloatArray:
        found = zip(self._quiet(axis), self.clean, strict=True)
        return np.concatenate([((own - clean) / self.noise).ravel() for own, clean in found])

    def _channels(self, readings: Mapping[str, FloatArray]) -> FloatArray:
        """Return what the diagnosis compares: force, position of the loop, and the stretch where it is recorded."""
        positions = [readings[side] for side in self.sides]
        stretch = [positions[0] - other for other in positions[1:]]
        return np.stack((readings["motor_force_N"], positions[0], *stretch))


def between(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw log-uniformly where both bounds are above zero, else uniformly."""
    if low > 0.0:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))
    return float(rng.uniform(low, high))
