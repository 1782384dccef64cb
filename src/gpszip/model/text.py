"""Short texts for the repr of values."""

from __future__ import annotations

from gpszip.model.grid import Plane

__all__ = ["axes_text", "count_text"]


def count_text(count: int, noun: str, plural: str | None = None) -> str:
    """Number and noun.

    Examples
    --------
    >>> count_text(1, "edge"), count_text(1200, "edge"), count_text(2, "leg of a route", "legs")
    ('1 edge', '1,200 edges', '2 legs')
    """
    return f"{count:,} {noun if count == 1 else plural or noun + 's'}"


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
