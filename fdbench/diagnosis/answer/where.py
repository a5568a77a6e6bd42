"""Where the gap lies, and what the rest of it depends on."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from fdbench.diagnosis.answer.quantity import Pair, Shares


@dataclass(frozen=True, kw_only=True)
class Cell:
    """Share of one cell of a partition, with its 95 % interval; the field that a kind adds holds its edges."""

    edges: ClassVar[str]

    share: float
    ci95: Pair | None = None

    @property
    def bounds(self) -> Pair:
        """Lower and upper edge."""
        low, high = getattr(self, self.edges)
        return low, high


@dataclass(frozen=True, kw_only=True)
class FrequencyCell(Cell):
    """Share of a band of frequency."""

    edges = "band_Hz"
    band_Hz: Pair


@dataclass(frozen=True, kw_only=True)
class PositionCell(Cell):
    """Share of a stretch of the way."""

    edges = "range_m"
    range_m: Pair


@dataclass(frozen=True, kw_only=True)
class VelocityCell(Cell):
    """Share of a range of commanded speed."""

    edges = "range_m_per_s"
    range_m_per_s: Pair


@dataclass(frozen=True, kw_only=True)
class TimeCell(Cell):
    """Share of a stretch of time."""

    edges = "range_s"
    range_s: Pair


@dataclass(frozen=True, kw_only=True)
class Where:
    """Partitions of the gap that re-calibration leaves, beyond the noise; the shares of each add up to 1, or to 0.

    Attributes
    ----------
    motion, channel : mapping of str to float
        Share of each phase of motion and of each channel.
    frequency, position, velocity, time : tuple of cells
    ci95 : mapping
        95 % intervals of the shares of ``motion`` and ``channel`` by name.
    """

    motion: Shares
    frequency: tuple[FrequencyCell, ...]
    position: tuple[PositionCell, ...]
    velocity: tuple[VelocityCell, ...]
    time: tuple[TimeCell, ...]
    channel: Shares
    ci95: Mapping[str, Mapping[str, Pair]] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Most:
    """Where the force differs most, and by how much the motor gives more there than the final model."""

    # "from" and "to" in JSON, which are no names in Python.
    low: float
    high: float
    unit: str
    force_N: float


@dataclass(frozen=True, kw_only=True)
class Dependence:
    """What the rest depends on, and the share of it that such a function removes."""

    function_of: str
    share: float
    most: Most | None = None
