"""Parse and format lengths, durations and sizes: 5m, 2km, 30s, 10min, 64MiB."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from typing import Any

import click

__all__ = [
    "DURATION",
    "LENGTH",
    "SIZE",
    "Quantity",
    "format_bytes",
    "format_count",
    "format_duration",
    "format_length",
    "format_time",
    "is_date",
]

#: Seconds between these are dates since 1970 (1973 to 5138), as in a log's time column.
_EPOCH_SECONDS = (1e8, 1e11)

#: A number and a unit.
#: Sign, digits and exponent; then the unit, any word without digits and spaces.
_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([^\d\s]*)\s*")


class Quantity(click.ParamType):  # type: ignore[type-arg, unused-ignore]
    """A positive number with a unit.

    Parameters
    ----------
    name : str
        Name of the quantity in messages and help texts.
    units : dict of str to float
        Value of each unit in the first one, which a number without a unit has.
    hints : dict of str to str, optional
        Messages for units that people use by mistake.
    words : dict of str to float, optional
        Values of words.

    Examples
    --------
    >>> LENGTH.parse("2km"), DURATION.parse("1.5 min"), SIZE.parse("64MiB")
    (2000.0, 90.0, 67108864.0)
    >>> LENGTH.parse("7")
    7.0
    """

    def __init__(
        self,
        name: str,
        units: dict[str, float],
        hints: dict[str, str] | None = None,
        words: dict[str, float] | None = None,
    ) -> None:
        self.name = name
        self.units = units
        self.hints = hints or {}
        self.words = words or {}

    def parse(self, text: str) -> float:
        """Return the value in the first unit.

        Raises
        ------
        ValueError
            If the text is no positive number with a known unit. The message gives an example.
        """
        # Words have no number, so that they are looked up before the text is split.
        if text in self.words:
            return self.words[text]

        # Number and unit.
        match = _NUMBER.fullmatch(text)
        if match is None:
            raise ValueError(
                f"{text!r} is no {self.name}; write a number and a unit, such as {self._example()}"
            )
        number, unit = match.groups()
        # A hint says more than a list of units, so it comes first.
        if unit in self.hints:
            raise ValueError(f"{text!r}: {self.hints[unit]}")
        if unit and unit not in self.units:
            raise ValueError(
                f"{text!r}: {unit!r} is no unit of {self.name}; use {', '.join(self.units)}"
            )

        # Value.
        value = float(number) * (self.units[unit] if unit else 1.0)
        if not 0 < value < float("inf"):
            raise ValueError(
                f"{text!r}: a {self.name} must be greater than 0 and finite, "
                f"such as {self._example()}"
            )
        return value

    def _example(self) -> str:
        # The first and the last unit make the example, so their order in the tables below counts.
        first, *others = self.units
        return " or ".join([f"5{first}", f"2{others[-1]}", *self.words])

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Convert an option's text, for click."""
        # A default is a number already.
        if isinstance(value, float | int):
            return float(value)
        try:
            return self.parse(value)
        except ValueError as error:
            self.fail(str(error), param, ctx)


#: Lengths in metres.
LENGTH = Quantity(
    "length", {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "ft": 0.3048, "mi": 1609.344, "km": 1e3}
)
#: Durations in seconds.
DURATION = Quantity(
    "duration",
    {"s": 1.0, "ms": 1e-3, "h": 3600.0, "d": 86400.0, "min": 60.0},
    hints={"m": "'m' is metres; write min for minutes", "sec": "write s for seconds"},
)
#: Sizes in bytes.
SIZE = Quantity(
    "size",
    {"B": 1.0, "kB": 1e3, "MB": 1e6, "GB": 1e9, "KiB": 1024.0, "GiB": 1024.0**3, "MiB": 1024.0**2},
    hints={
        "b": "write B for bytes",
        "k": "write kB or KiB",
        "K": "write kB or KiB",
        "KB": "write kB or KiB",
        "M": "write MB or MiB",
    },
)


def format_length(metres: float) -> str:
    """Format metres with three digits; thousands are whole numbers.

    Examples
    --------
    >>> format_length(0.23614), format_length(12.345), format_length(48_000)
    ('0.236 m', '12.3 m', '48 km')
    >>> format_length(999.6), format_length(2345.6), format_length(2_345_600)
    ('1000 m', '2346 m', '2346 km')
    """
    number, unit = (metres / 1e3, "km") if metres >= 1e4 else (metres, "m")
    # Three digits of 1000 and more would have an exponent, as only absurd lengths may.
    text = f"{number:.0f}" if 999.5 <= number < 1e6 else f"{number:.3g}"
    return f"{text} {unit}"


def format_duration(seconds: float) -> str:
    """Format seconds with three digits.

    Examples
    --------
    >>> format_duration(2.5), format_duration(600), format_duration(90_000)
    ('2.5 s', '10 min', '25 h')
    >>> format_duration(float("inf"))
    'none'
    """
    if seconds == float("inf"):
        return "none"
    # A unit is used from 2 or 3 of it on, so that no number with one of these is below 2.
    for size, unit in ((86400 * 3, "d"), (3600 * 2, "h"), (120, "min")):
        if seconds >= size:
            return f"{seconds / DURATION.units[unit]:.3g} {unit}"
    return f"{seconds:.3g} s"


def format_bytes(count: float) -> str:
    """Format bytes: exactly below 100 kB, since every byte of a small archive counts.

    Examples
    --------
    >>> format_bytes(592), format_bytes(9_999), format_bytes(2_400_000)
    ('592 B', '9,999 B', '2.4 MB')
    """
    if count < 1e5:
        return f"{count:,.0f} B"
    unit = "GB" if count >= 1e9 else "MB" if count >= 1e6 else "kB"
    return f"{count / SIZE.units[unit]:.3g} {unit}"


def format_count(number: int, noun: str) -> str:
    """Format a number of things.

    Examples
    --------
    >>> format_count(1, "track"), format_count(2000, "point")
    ('1 track', '2,000 points')
    """
    return f"{number:,} {noun}" + ("" if number == 1 else "s")


def is_date(seconds: float) -> bool:
    """Whether a time of a log counts from 1970, so that it can be shown as a date.

    Examples
    --------
    >>> is_date(1714557600), is_date(12.5)
    (True, False)
    """
    return _EPOCH_SECONDS[0] <= seconds < _EPOCH_SECONDS[1]


def format_time(seconds: float) -> str:
    """Format seconds from a log's zero, with the date if that is 1970.

    Examples
    --------
    >>> format_time(12.5), format_time(1714557600)
    ('12.5 s', '1714557600 s (2024-05-01 10:00:00 UTC)')
    """
    plain = f"{seconds:.3f}".rstrip("0").rstrip(".")
    if not is_date(seconds):
        return f"{plain} s"
    return f"{plain} s ({datetime.fromtimestamp(seconds, UTC):%Y-%m-%d %H:%M:%S} UTC)"
