"""One published figure beside ours."""

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, kw_only=True)
class Row:
    """A figure of a paper, what we get, and what a correct implementation must get.

    Attributes
    ----------
    paper, item : str
    paper_value : float or None
        As printed; None where the paper gives none.
    value : float
        Ours.
    target, tolerance : float
        The corrected figure and the largest accepted absolute difference to it.
    kind : str
        ``must``: has to hold; ``ranking``: an order or sign, where value and target are 1 for true;
        ``not reproducible``: shown with a reason.
    reason : str
        Why a figure cannot be reproduced, or what the target rests on.
    """

    paper: str
    item: str
    paper_value: float | None
    value: float
    target: float
    tolerance: float
    kind: Literal["must", "ranking", "not reproducible"]
    reason: str = ""

    @property
    def ok(self) -> bool:
        """Whether the figure holds; figures that cannot be reproduced never count as failed."""
        if self.kind == "not reproducible":
            return True
        return bool(math.isfinite(self.value) and abs(self.value - self.target) <= self.tolerance)

    def as_dict(self) -> dict[str, str | float | bool | None]:
        """Return the row with its verdict, for JSON."""
        paper = None if self.paper_value is None else float(self.paper_value)
        numbers = {"value": float(self.value), "target": float(self.target), "tolerance": float(self.tolerance)}
        return {**dataclasses.asdict(self), "paper_value": paper, **numbers, "ok": self.ok}


Parts = Mapping[str, Callable[[], Iterable[Row]]]


def rows_of(paper: str, parts: Parts) -> list[Row]:
    """Return the rows of all parts; what raises is a failed row with its message, and the next part goes on."""
    rows: list[Row] = []
    for title, figures in parts.items():
        try:
            rows.extend(figures())
        except Exception as error:  # noqa: BLE001 - one figure that fails must not lose the others
            rows.append(
                Row(
                    paper=paper,
                    item=f"{title}: this and its further figures failed",
                    paper_value=None,
                    value=math.nan,
                    target=math.nan,
                    tolerance=0.0,
                    kind="must",
                    reason=f"{type(error).__name__}: {error}",
                )
            )
    return rows
