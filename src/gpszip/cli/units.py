"""Lengths, times and sizes as people write them: 5m, 2km, 30s, 10min, 64MiB."""

from __future__ import annotations

import re
from typing import Any

import click

__all__ = [
    "DURATION",
    "LENGTH",
    "SIZE",
    "Quantity",
    "format_bytes",
    "format_duration",
    "format_length",
]

_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([^\d\s]*)\s*")


class Quantity(click.ParamType):  # type: ignore[type-arg, unused-ignore]
    """A positive number with a unit.

    Parameters
    ----------
    name : str
        What is measured, as error messages and help say it.
    units : dict of str to float
        What each unit is worth; the first one is meant where none is given.
    hints : dict of str to str, optional
        What to say about a unit that people use by mistake.
    words : dict of str to float, optional
        Words that stand for a value.

    Examples
    --------
    >>> LENGTH.parse("2km"), DURATION.parse("1.5 min"), SIZE.parse("64MiB"), LENGTH.parse("7")
    (2000.0, 90.0, 67108864.0, 7.0)
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
        """Value in the first unit.

        Raises
        ------
        ValueError
            If the text is no positive number with a known unit; the message says what would be.
        """
        if text in self.words:
            return self.words[text]
        found = _NUMBER.fullmatch(text)
        if found is None:
            raise ValueError(
                f"{text!r} is no {self.name}; write a number and a unit, such as {self._example()}"
            )
        number, unit = found.groups()
        if unit in self.hints:
            raise ValueError(f"{text!r}: {self.hints[unit]}")
        if unit and unit not in self.units:
            raise ValueError(
                f"{text!r}: {unit!r} is no unit of {self.name}; use {', '.join(self.units)}"
            )
        value = float(number) * (self.units[unit] if unit else 1.0)
        if not 0 < value < float("inf"):
            raise ValueError(
                f"{text!r}: a {self.name} must be greater than 0 and finite, such as {self._example()}"
            )
        return value

    def _example(self) -> str:
        first, *others = self.units
        return " or ".join([f"5{first}", f"2{others[-1]}", *self.words])

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Parse what the user wrote, for click."""
        if isinstance(value, float | int):
            return float(value)
        try:
            return self.parse(value)
        except ValueError as error:
            self.fail(str(error), param, ctx)


LENGTH = Quantity(
    "length", {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "ft": 0.3048, "mi": 1609.344, "km": 1e3}
)
DURATION = Quantity(
    "duration",
    {"s": 1.0, "ms": 1e-3, "h": 3600.0, "d": 86400.0, "min": 60.0},
    hints={"m": "'m' is metres; write min for minutes", "sec": "write s for seconds"},
)
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
    """Metres for a person, with three digits.

    Examples
    --------
    >>> format_length(0.23614), format_length(12.345), format_length(48_000)
    ('0.236 m', '12.3 m', '48 km')
    """
    return f"{metres / 1e3:.3g} km" if metres >= 1e4 else f"{metres:.3g} m"


def format_duration(seconds: float) -> str:
    """Seconds for a person.

    Examples
    --------
    >>> format_duration(2.5), format_duration(600), format_duration(90_000), format_duration(float("inf"))
    ('2.5 s', '10 min', '25 h', 'none')
    """
    if seconds == float("inf"):
        return "none"
    for size, unit in ((86400 * 3, "d"), (3600 * 2, "h"), (120, "min")):
        if seconds >= size:
            return f"{seconds / DURATION.units[unit]:.3g} {unit}"
    return f"{seconds:.3g} s"


def format_bytes(count: float) -> str:
    """Bytes for a person; exact while small, as every byte of an archive counts.

    Examples
    --------
    >>> format_bytes(592), format_bytes(9_999), format_bytes(2_400_000)
    ('592 B', '9,999 B', '2.4 MB')
    """
    if count < 1e5:
        return f"{count:,.0f} B"
    unit = "GB" if count >= 1e9 else "MB" if count >= 1e6 else "kB"
    return f"{count / SIZE.units[unit]:.3g} {unit}"
