"""Tables that results are handed out as."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd


def frame(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> "pd.DataFrame":
    """Return rows as a DataFrame, which has its columns where there are no rows too."""
    import pandas as pd

    return pd.DataFrame([dict(zip(columns, row, strict=True)) for row in rows], columns=list(columns))
