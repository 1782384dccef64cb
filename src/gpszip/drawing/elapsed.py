"""Axes of time: seconds, minutes, hours or days since the start."""

from __future__ import annotations

from contextlib import suppress
from datetime import UTC, datetime

from gpszip.model.timestamps import counts_from_1970

__all__ = ["time_unit"]

#: Seconds of each unit, and the span in seconds from which it is used.
_UNITS = (
    (86_400.0, "days", 3 * 86_400.0),
    (3_600.0, "hours", 3 * 3_600.0),
    (60.0, "minutes", 180.0),
    (1.0, "seconds", 0.0),
)


def time_unit(first: float, last: float) -> tuple[float, str]:
    """Return the seconds of a unit that suits a span, and the label of its axis.

    Parameters
    ----------
    first, last : float
        Span in seconds.

    Examples
    --------
    >>> time_unit(5.0, 605.0)
    (60.0, 'minutes since the start')
    >>> time_unit(1.4e9, 1.4e9 + 1e6)
    (86400.0, 'days since 2014-05-13 16:53 UTC')
    """
    seconds, name = next((size, name) for size, name, least in _UNITS if last - first >= least)
    start = "the start"
    if counts_from_1970(first):
        # Dates end with the year 9999.
        with suppress(OverflowError, ValueError, OSError):
            start = f"{datetime.fromtimestamp(first, UTC):%Y-%m-%d %H:%M} UTC"
    return seconds, f"{name} since {start}"
