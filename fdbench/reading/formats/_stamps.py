"""Dates and times of day in place of numbers of seconds."""

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fdbench.record import FloatArray

if TYPE_CHECKING:
    import pandas as pd

    Texts = pd.Series[str]

_DATE = r"\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{1,2}[-/.]\d{1,2}[-/.]\d{4}"
_TIME = r"\d{1,2}:\d{2}:\d{2}([.,:]\d{1,9})?"
_STAMP = re.compile(rf"(({_DATE})(T|\s+))?{_TIME}(\s?(Z|[+-]\d{{2}}:?\d{{2}}))?")
_FRACTION = r"(:\d{2}:\d{2})[,:](\d+)"
_YEAR_FIRST = r"^(\d{4})[/.](\d{1,2})[/.](\d{1,2})"
_YEAR_LAST = r"^(\d{1,2})([-/.])(\d{1,2})[-/.](\d{4})"
_DAY_S = 86400.0


def is_stamp(cell: str) -> bool:
    """Return whether a cell holds a time of day, with a date or without.

    >>> is_stamp("2026-03-12T10:11:12.001Z"), is_stamp("12.03.2026 10:11:12,001"), is_stamp("10:11")
    (True, True, False)
    """
    return _STAMP.fullmatch(cell.strip()) is not None


def seconds_of(cells: Sequence[Any]) -> FloatArray:
    """Return the seconds from the first stamp, not a number where a cell is none; times of day go over midnight.

    Raises
    ------
    ValueError
        If the dates change, and the day cannot be told from the month.

    >>> seconds_of(["12.03.2026 23:59:59,999", "13.03.2026 00:00:00,001"]).round(9).tolist()
    [0.0, 0.002]
    >>> seconds_of(["23:59:59.5", "00:00:00.5", None]).tolist()
    [0.0, 1.0, nan]
    """
    import pandas as pd

    texts = pd.Series(cells, dtype="object").str.strip().str.replace(_FRACTION, r"\1.\2", regex=True)
    texts = texts.where(texts.str.fullmatch(_STAMP) == True)  # noqa: E712 (a missing cell is no stamp)
    stamps = texts.dropna()
    if not len(stamps):
        return np.full(len(cells), np.nan)
    if re.match(_TIME, stamps.iloc[0]):
        return over_midnight(_from_first(pd.to_timedelta(texts, errors="coerce")))
    return _of_dates(texts)


def over_midnight(seconds: FloatArray) -> FloatArray:
    """Return times of day that go on over midnight.

    >>> over_midnight(np.array([0.0, 1.0, -86398.0])).tolist()
    [0.0, 1.0, 2.0]
    """
    going = seconds.copy()
    known = np.isfinite(going)
    going[known] += _DAY_S * np.cumsum(np.diff(going[known], prepend=0.0) < -0.5 * _DAY_S)
    return going


def _of_dates(texts: "Texts") -> FloatArray:
    import pandas as pd

    texts = texts.str.replace(_YEAR_FIRST, r"\1-\2-\3", regex=True)
    has_dots = bool(re.match(r"\d{1,2}\.", texts.dropna().iloc[0]))
    readings: list[FloatArray] = []
    for order in (r"\4-\3-\1", r"\4-\1-\3")[: 1 if has_dots else 2]:
        dates = pd.to_datetime(
            texts.str.replace(_YEAR_LAST, order, regex=True), format="ISO8601", utc=True, errors="coerce"
        )
        readings.append(_from_first(dates))
    best = min(readings, key=lambda seconds: int(np.isnan(seconds).sum()))
    alike = [seconds for seconds in readings if np.isnan(seconds).sum() == np.isnan(best).sum()]
    if not all(np.array_equal(seconds, best, equal_nan=True) for seconds in alike):
        raise ValueError("whether the day or the month comes first cannot be told. Write dates as 2026-03-12")
    return best


def _from_first(times: Any) -> FloatArray:
    passed = times - times.bfill().iloc[0]
    return np.asarray(passed.dt.total_seconds(), dtype=np.float64)
