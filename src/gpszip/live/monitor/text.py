"""Short texts for the reasons of events."""

from __future__ import annotations

__all__ = ["duration_text"]

_MINUTE, _HOUR, _DAY = 60, 3_600, 86_400


def duration_text(seconds: float) -> str:
    """Return a duration in one or two units.

    Examples
    --------
    >>> duration_text(42.4), duration_text(330), duration_text(7500), duration_text(90000)
    ('42 s', '6 min', '2 h 5 min', '1 d 1 h')
    """
    whole = round(seconds)
    if whole < 2 * _MINUTE:
        return f"{whole} s"
    if whole < 2 * _HOUR:
        return f"{round(seconds / _MINUTE)} min"
    if whole < _DAY:
        minutes = round(seconds / _MINUTE)
        return f"{minutes // 60} h {minutes % 60} min"
    hours = round(seconds / _HOUR)
    return f"{hours // 24:,} d {hours % 24} h"
