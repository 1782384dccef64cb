"""Times in the state of a monitor, as JSON has no infinite numbers."""

from __future__ import annotations

import math

__all__ = ["time_from_json", "time_to_json"]


def time_to_json(time: float) -> float | None:
    """Return a time in seconds; None for an infinite one."""
    return time if math.isfinite(time) else None


def time_from_json(value: float | None, none: float = -math.inf) -> float:
    """Return what :func:`time_to_json` was given.

    Parameters
    ----------
    value : float or None
        Seconds, or None.
    none : float, default -inf
        The infinite time that None stands for.

    Examples
    --------
    >>> time_from_json(time_to_json(7.0)), time_from_json(time_to_json(math.inf), math.inf)
    (7.0, inf)
    """
    return none if value is None else value
