"""Short texts for messages and the repr of values."""

from __future__ import annotations

import re

from gpszip.model.grid import Plane

__all__ = ["axes_text", "count_phrase", "count_text"]

#: Nouns with which descriptions of repairs begin, by their plurals.
_SINGULARS = {
    "bytes": "byte",
    "dropouts": "dropout",
    "entries": "entry",
    "features": "feature",
    "fixes": "fix",
    "lines": "line",
    "messages": "message",
    "outliers": "outlier",
    "points": "point",
    "positions": "position",
    "roads": "road",
    "rows": "row",
    "sentences": "sentence",
    "stamps": "stamp",
    "times": "time",
    "tracks": "track",
}

#: Such a plural at the start, and the verb that goes with it.
_PLURAL = re.compile(rf"^((?:repeated )?)({'|'.join(_SINGULARS)})\b( that are\b)?")


def count_text(count: int, noun: str, plural: str | None = None) -> str:
    """Number and noun.

    Examples
    --------
    >>> count_text(1, "edge"), count_text(1200, "edge"), count_text(2, "leg of a route", "legs")
    ('1 edge', '1,200 edges', '2 legs')
    """
    return f"{count:,} {noun if count == 1 else plural or noun + 's'}"


def count_phrase(count: int, phrase: str) -> str:
    """Number and a phrase that begins with a plural, in the singular if the number is 1.

    Examples
    --------
    >>> count_phrase(2, "messages that are cut short dropped")
    '2 messages that are cut short dropped'
    >>> count_phrase(1, "messages that are cut short dropped")
    '1 message that is cut short dropped'
    >>> count_phrase(1, "fixes dropped"), count_phrase(1, "entries dropped")
    ('1 fix dropped', '1 entry dropped')
    """
    return f"{count:,} {_PLURAL.sub(_to_singular, phrase) if count == 1 else phrase}"


def _to_singular(match: re.Match[str]) -> str:
    return f"{match[1]}{_SINGULARS[match[2]]}{' that is' if match[3] else ''}"


def axes_text(dimension: int, plane: Plane | None) -> str:
    """Names of the coordinates in which positions came.

    Examples
    --------
    >>> axes_text(2, None), axes_text(3, None), axes_text(2, Plane(((0, 0),)))
    ('x, y', 'x, y, z', 'lat, lon')
    """
    # A log in degrees is shown as it came, though its positions are in metres on the plane.
    if plane is not None:
        return "lat, lon"
    return ", ".join("xyz"[:dimension]) if dimension <= 3 else f"{dimension} coordinates"
