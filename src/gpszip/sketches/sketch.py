"""The 1-segment coreset: insert, delete, merge, and the cost against any line (thesis, section 6.2).

A sketch prices every line exactly. Merging sketches loses nothing but the places where a breakpoint may fall.
"""

from __future__ import annotations

from math import inf

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.errors import OptionError
from gpszip.model import Track
from gpszip.model.sketch import Sketch

__all__ = [
    "best_line",
    "build_sketch",
    "delete_sample",
    "empty_sketch",
    "fitting_matrix",
    "free_cost",
    "insert_sample",
    "line_cost",
    "line_costs",
    "merge_sketches",
]

#: Share of the weight times the squared duration below which the times have no spread to fit a slope to.
_SINGULAR = 1e-24

#: Share of a block's weight that repeated deletions may lose.
_ROUNDING = 1e-6


def empty_sketch(dimension: int) -> Sketch:
    """Sketch of no samples.

    Examples
    --------
    >>> empty_sketch(2).weight
    0.0
    """
    zero = np.zeros(dimension)
    return Sketch(0.0, 0.0, zero, 0.0, zero, np.zeros((dimension, dimension)), inf, -inf, 0)


def build_sketch(track: Track, first: int = 0, last: int | None = None) -> Sketch:
    """Sketch of the samples ``first`` to ``last - 1`` of a track; of all where left out.

    Examples
    --------
    >>> block = build_sketch(Track("walk", [0, 1, 2], [[0], [1], [3]]))
    >>> block.weight, block.time, block.place.tolist(), block.spread, block.drift.tolist()
    (3.0, 1.0, [1.3333333333333333], 2.0, [3.0])
    """
    times, positions = track.times[first:last], track.positions[first:last]
    if len(times) == 0:
        return empty_sketch(track.dimension)
    weights = np.ones(len(times)) if track.weights is None else track.weights[first:last]
    t, p = times - times[0], positions - positions[0]
    time, place = np.average(t, weights=weights), np.average(p, axis=0, weights=weights)
    x, r = t - time, p - place
    return Sketch(
        float(weights.sum()),
        float(times[0] + time),
        positions[0] + place,
        float(weights @ (x * x)),
        (weights * x) @ r,
        (weights[:, None] * r).T @ r,
        float(times[0]),
        float(times[-1]),
        len(times),
    )


def _point(time: float, position: ArrayLike, weight: float) -> Sketch:
    place = np.array(position, dtype=np.float64)
    zero = np.zeros(len(place))
    return Sketch(
        float(weight),
        float(time),
        place,
        0.0,
        zero,
        np.zeros((len(place), len(place))),
        float(time),
        float(time),
        1,
    )


def insert_sample(block: Sketch, time: float, position: ArrayLike, weight: float = 1.0) -> Sketch:
    """Add one sample, in any order of time (thesis, 1_SEG_CORESET_INSERT).

    Examples
    --------
    >>> block = insert_sample(insert_sample(empty_sketch(1), 0.0, [1.0]), 2.0, [5.0])
    >>> block.time, block.place.tolist(), block.drift.tolist()
    (1.0, [3.0], [4.0])
    """
    return merge_sketches(block, _point(time, position, weight))


def delete_sample(
    block: Sketch,
    time: float,
    position: ArrayLike,
    weight: float = 1.0,
    *,
    first: float | None = None,
    last: float | None = None,
) -> Sketch:
    """Take one sample out again (thesis, 1_SEG_CORESET_DELETE).

    Parameters
    ----------
    block : Sketch
        A block that holds the sample.
    time, position, weight
        The sample, as it was inserted.
    first, last : float, optional
        Times of the first and last sample left, in seconds, where it was the first or last that went; the moments
        can't tell them.

    Raises
    ------
    OptionError
        If the block holds less weight than is to be taken out.
    """
    left = block.weight - weight
    if block.count < 1 or left < -_ROUNDING * block.weight or (block.count > 1 and left <= 0):
        raise OptionError(
            f"a sample of weight {weight:g} can't be taken out of a block of weight {block.weight:g}"
        )
    if block.count == 1:
        return empty_sketch(block.dimension)
    share = weight / left
    dt, dp = time - block.time, np.asarray(position, dtype=np.float64) - block.place
    h = weight * block.weight / left
    return Sketch(
        left,
        block.time - share * dt,
        block.place - share * dp,
        max(block.spread - h * dt * dt, 0.0),
        block.drift - h * dt * dp,
        block.scatter - h * np.outer(dp, dp),
        block.first if first is None else first,
        block.last if last is None else last,
        block.count - 1,
    )


def merge_sketches(a: Sketch, b: Sketch) -> Sketch:
    """Sketch of two blocks together, exact and in any order (Chan's update).

    Examples
    --------
    >>> track = Track("walk", [0, 1, 2, 3], [[0], [1], [3], [3]])
    >>> merge_sketches(build_sketch(track, 0, 2), build_sketch(track, 2, 4)).spread == build_sketch(track).spread
    True
    """
    if a.count == 0 or b.count == 0:
        return b if a.count == 0 else a
    weight = a.weight + b.weight
    h, share = a.weight * b.weight / weight, b.weight / weight
    dt, dp = b.time - a.time, b.place - a.place
    return Sketch(
        weight,
        a.time + share * dt,
        a.place + share * dp,
        a.spread + b.spread + h * dt * dt,
        a.drift + b.drift + h * dt * dp,
        a.scatter + b.scatter + h * np.outer(dp, dp),
        min(a.first, b.first),
        max(a.last, b.last),
        a.count + b.count,
    )


def fitting_matrix(
    block: Sketch, start: ArrayLike, end: ArrayLike, t0: float, t1: float
) -> NDArray[np.float64]:
    """Fitting matrix D of the block against a line, shape (d, d), in m^2 (definition 6.2.1); its trace is the cost.

    Parameters
    ----------
    block : Sketch
        The samples.
    start, end : array_like, shape (d,)
        Positions of the line at ``t0`` and ``t1``, in metres.
    t0, t1 : float
        Seconds. Where both are the same, the line stays at ``start``.
    """
    starts, ends = np.array(start, dtype=np.float64)[None], np.array(end, dtype=np.float64)[None]
    (away,), (speed,) = _lines_about_mean(block, starts, ends, t0, t1)
    cross = np.outer(speed, block.drift)
    matrix: NDArray[np.float64] = (
        block.weight * np.outer(away, away)
        + block.spread * np.outer(speed, speed)
        - cross
        - cross.T
        + block.scatter
    )
    return matrix


def line_cost(block: Sketch, start: ArrayLike, end: ArrayLike, t0: float, t1: float) -> float:
    """Fitting cost in m^2 of the block against the line from ``start`` at ``t0`` to ``end`` at ``t1``, exactly.

    Examples
    --------
    >>> block = build_sketch(Track("walk", [0, 1, 2], [[0], [1], [3]]))
    >>> round(line_cost(block, [0], [2], 0, 2), 12)
    1.0
    """
    return float(line_costs(block, np.atleast_2d(start), np.atleast_2d(end), t0, t1)[0])


def line_costs(
    block: Sketch, starts: ArrayLike, ends: ArrayLike, t0: float, t1: float
) -> NDArray[np.float64]:
    """Fitting costs in m^2 of the block against m lines, shape (m,), as one matrix product (equations 6.13 and 6.14).

    Parameters
    ----------
    block : Sketch
        The samples.
    starts, ends : array_like, shape (m, d)
        Positions of the lines at ``t0`` and ``t1``, in metres.
    t0, t1 : float
        Seconds. Where both are the same, the lines stay at their starts.
    """
    away, speed = _lines_about_mean(
        block, np.asarray(starts, dtype=np.float64), np.asarray(ends, dtype=np.float64), t0, t1
    )
    p_hat = np.concatenate([[block.weight, block.spread], block.drift, [np.trace(block.scatter)]])
    s_hat = np.vstack(
        [(away * away).sum(axis=1), (speed * speed).sum(axis=1), -2 * speed.T, np.ones(len(away))]
    )
    product: NDArray[np.float64] = np.maximum(p_hat @ s_hat, 0.0)
    return product


def _lines_about_mean(
    block: Sketch, starts: NDArray[np.float64], ends: NDArray[np.float64], t0: float, t1: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How far the lines pass from the block's mean at its mean time, and their speeds, both of shape (m, d)."""
    speed = (ends - starts) / (t1 - t0) if t1 != t0 else np.zeros_like(starts)
    return starts + (block.time - t0) * speed - block.place, speed


def best_line(block: Sketch) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Positions in metres of the block's best line at its first and last times; a point where time has no spread.

    Raises
    ------
    OptionError
        If the block is empty.

    Examples
    --------
    >>> start, end = best_line(build_sketch(Track("walk", [0, 1, 2], [[0], [1], [2]])))
    >>> start.round(12).tolist(), end.round(12).tolist()
    ([0.0], [2.0])
    """
    if block.count == 0:
        raise OptionError("an empty block has no best line; insert a sample first")
    speed = _best_velocity(block)
    return block.place + (block.first - block.time) * speed, block.place + (
        block.last - block.time
    ) * speed


def free_cost(block: Sketch) -> float:
    """Fitting cost in m^2 of the block against its own best line; never falls when samples are added."""
    return float(max(np.trace(block.scatter) - _best_velocity(block) @ block.drift, 0.0))


def _best_velocity(block: Sketch) -> NDArray[np.float64]:
    flat = (
        block.count < 2
        or block.spread <= _SINGULAR * block.weight * (block.last - block.first) ** 2
    )
    return np.zeros(block.dimension) if flat else block.drift / block.spread
