"""A number with its interval, and what shares and intervals are."""

from collections.abc import Mapping
from dataclasses import dataclass

Pair = tuple[float, float]
Shares = Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A number with its 95 % interval, where there is one, and its unit."""

    value: float
    ci95: Pair | None
    unit: str
