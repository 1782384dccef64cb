"""Numbers of a report as people read them."""

from __future__ import annotations

from datetime import datetime

from gpszip.history.calendar import Calendar
from gpszip.model.text import count_text

__all__ = [
    "bytes_text",
    "duration_text",
    "join_words",
    "length_text",
    "share_text",
    "speed_text",
    "time_text",
]

#: Seconds of a day, an hour and a minute.
_DAY, _HOUR, _MINUTE = 86_400.0, 3600.0, 60.0

#: Share that would be rounded to all.
_NEARLY_ALL = 0.995

#: Days from which durations are told in days.
_IN_DAYS = 10


def length_text(metres: float | None) -> str:
    """Metres, or kilometres from one on.

    Examples
    --------
    >>> length_text(85.4), length_text(1510.0), length_text(948_200.0), length_text(None)
    ('85 m', '1.5 km', '948 km', 'unknown')
    """
    if metres is None:
        return "unknown"
    if metres < 1000:
        return f"{metres:.0f} m" if metres >= 10 else f"{metres:.1f} m"
    kilometres = metres / 1000
    return f"{kilometres:,.0f} km" if kilometres >= 100 else f"{kilometres:.1f} km"


def duration_text(seconds: float | None, *, in_days: bool = True) -> str:
    """Seconds in the two largest units that fit; ``in_days`` from ten days on.

    Examples
    --------
    >>> duration_text(53.7), duration_text(754), duration_text(7_000), duration_text(200_000)
    ('54 s', '13 min', '1 h 57 min', '56 h')
    >>> duration_text(4_482_000), duration_text(4_482_000, in_days=False)
    ('52 days', '1,245 h')
    """
    if seconds is None:
        return "unknown"
    if seconds < 2 * _MINUTE:
        return f"{seconds:.0f} s"
    if seconds < _HOUR:
        return f"{seconds / _MINUTE:.0f} min"
    if seconds < _DAY:
        hours, minutes = divmod(round(seconds / _MINUTE), 60)
        return f"{hours} h {minutes} min" if minutes else f"{hours} h"
    if in_days and seconds >= _IN_DAYS * _DAY:
        return f"{seconds / _DAY:,.0f} days"
    return f"{seconds / _HOUR:,.0f} h"


def share_text(share: float) -> str:
    """A share in percent; only all of it is 100 %.

    Examples
    --------
    >>> share_text(0.764), share_text(0.9962), share_text(1.0)
    ('76 %', 'over 99 %', '100 %')
    """
    return "over 99 %" if _NEARLY_ALL <= share < 1 else f"{share * 100:.0f} %"


def speed_text(speed: float | None, *, fast: bool) -> str:
    """Metres a second, or kilometres an hour where travel is fast.

    Examples
    --------
    >>> speed_text(8.5, fast=True), speed_text(0.42, fast=False)
    ('31 km/h', '0.4 m/s')
    """
    if speed is None:
        return "unknown"
    return f"{speed * 3.6:.0f} km/h" if fast else f"{speed:.1f} m/s"


def bytes_text(count: int) -> str:
    """Bytes, exact below 100,000.

    Examples
    --------
    >>> bytes_text(112), bytes_text(2_400_000)
    ('112 bytes', '2.4 MB')
    """
    if count < 100_000:
        return count_text(count, "byte")
    return f"{count / 1e6:.1f} MB" if count >= 1_000_000 else f"{count / 1e3:.0f} kB"


def time_text(seconds: float | None, calendar: Calendar, *, date_only: bool = False) -> str:
    """A time on local clocks; days and hours since the zero of a log whose times are no dates.

    Examples
    --------
    >>> from datetime import UTC
    >>> utc, log = Calendar(UTC, "UTC", "default"), Calendar(UTC, "", "log")
    >>> time_text(1.7e9, utc), time_text(1.7e9, utc, date_only=True), time_text(93_784.0, log)
    ('2023-11-14 22:13', '14 November 2023', 'day 2, 02:03:04')
    """
    # A log of less than a day needs no number of the day.
    if seconds is None:
        return "unknown"
    if not calendar.name:
        day, rest = divmod(int(seconds), int(_DAY))
        clock = f"{rest // 3600:02}:{rest // 60 % 60:02}:{rest % 60:02}"
        return f"day {day + 1}, {clock}" if day else clock
    try:
        local = datetime.fromtimestamp(seconds, calendar.zone)
    except (OverflowError, ValueError, OSError):
        return f"{seconds:.0f} s"
    if date_only:
        return f"{local.day} {local:%B %Y}"
    return f"{local:%Y-%m-%d %H:%M}"


def join_words(words: list[str]) -> str:
    """Words with commas, and an "and" before the last one.

    Examples
    --------
    >>> join_words(["a"]), join_words(["a", "b", "c"])
    ('a', 'a, b and c')
    """
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} and {words[-1]}"
