"""Times of day and dates in words, as spreadsheets and data loggers write them."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError

_TIME_OF_DAY = re.compile(r"(\d{1,2}):(\d{2})(?::(\d{2}(?:[.,:]\d+)?))?\s*([AaPp][Mm])?")
_ISO_DATE = re.compile(r"(\d{4})[-/.](\d{1,2})[-/.](\d{1,2})")
_OTHER_DATE = re.compile(r"(\d{1,2})[-/.](\d{1,2})[-/.](\d{4})")
_DAY = 86400.0
"""Seconds of a day."""


def is_time_of_day(word: str) -> bool:
    """Whether a word holds a time of day."""
    return _TIME_OF_DAY.search(word) is not None


def seconds_of_words(where: str, words: Sequence[str]) -> Array:
    """Return (N,) s since midnight of the first row's day; NaN where a cell is empty.

    A date counts by its change only, so that it does not matter whether the day or the month comes
    first: a recording that runs over midnight has one more of one of them.

    Raises:
        BadInputError: a cell is no time of day.
    """
    seconds = np.full(len(words), np.nan)
    for k, word in enumerate(words):
        found = _TIME_OF_DAY.search(word)
        if found is None:
            if word.strip():
                raise BadInputError(
                    f"{where}, row {k + 1}: '{word}'; expected a time like 12:00:01.5"
                )
            continue
        hours, minutes, rest, half = found.groups()
        fraction = (rest or "0").replace(",", ".").replace(":", ".", 1)
        hour = int(hours) % 12 + 12 * (half.lower() == "pm") if half else int(hours)
        seconds[k] = 3600.0 * hour + 60.0 * int(minutes) + float(fraction)
    dates = [_date(word) for word in words]
    steps = np.array([0.0, *(a != b for a, b in zip(dates[1:], dates[:-1], strict=True))])
    over_midnight = np.diff(seconds, prepend=seconds[:1]) < -0.5 * _DAY
    return np.asarray(seconds + _DAY * np.cumsum((steps > 0) | over_midnight))


def _date(word: str) -> tuple[str, ...]:
    found = _ISO_DATE.search(word) or _OTHER_DATE.search(word)
    return found.groups() if found else ()
