"""Weights of the points of a log, from one of its columns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.model import Track

__all__ = ["weigh"]


def weigh(track: Track, column: str) -> Track:
    """Return a track whose attribute of this name has become its weights.

    Raises
    ------
    InputError
        If a weight is no number, or not above zero. Such points are not left out: a log with
        weights of zero may mean something else by them.

    Examples
    --------
    >>> times, positions = [0, 1], [[0.0], [1.0]]
    >>> track = Track("bus", times, positions, attributes={"w": np.array([1, 3])})
    >>> weighted = weigh(track, "w")
    >>> weighted.weights.tolist(), list(weighted.attributes)
    ([1.0, 3.0], [])
    """
    weights = _to_numbers(track.attributes[column])
    wrong = ~((weights > 0) & np.isfinite(weights))
    if wrong.any():
        first = int(wrong.argmax())
        value = track.attributes[column][first]
        raise InputError(
            f"{int(wrong.sum()):,} of {len(track):,} weights are not above 0, the first {value!s}",
            location=f"track {track.id!r}: point {first}: column {column!r}",
            remedy="leave out such points, or name another column",
        )
    attributes = {name: values for name, values in track.attributes.items() if name != column}
    return replace(track, weights=weights, attributes=attributes)


def _to_numbers(values: NDArray[np.generic]) -> NDArray[np.float64]:
    """Return values as floats, NaN where they are none."""
    try:
        return np.asarray(values).astype(np.float64)
    except (TypeError, ValueError):
        numbers = np.full(len(values), np.nan)
        for i, value in enumerate(values.tolist()):
            try:
                numbers[i] = float(value)
            except (TypeError, ValueError):
                continue
        return numbers
