"""The 1-segment coreset: insert, delete, merge, and the cost of any line (thesis, section 6.2).

A sketch holds the moments of a block of samples, which give the fitting cost of every line
exactly. Merged sketches are exact, too; only fewer block edges remain at which a function may
break.
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

#: A spread of times below this share of weight times squared duration is rounding.
_SINGULAR = 1e-24

#: Share of a block's weight that repeated deletions may lose by rounding.
_ROUNDING = 1e-6


def empty_sketch(dimension: int) -> Sketch:
    """Return the sketch of no samples.

    Examples
    --------
    >>> empty_sketch(2).weight
    0.0
    """
    zero = np.zeros(dimension)
    return Sketch(0.0, 0.0, zero, 0.0, zero, np.zeros((dimension, dimension)), inf, -inf, 0)


def build_sketch(track: Track, first: int = 0, last: int | None = None) -> Sketch:
    """Return the sketch of samples ``first`` to ``last - 1`` of a track; by default of all.

    Examples
    --------
    >>> block = build_sketch(Track("walk", [0, 1, 2], [[0], [1], [3]]))
    >>> block.weight, block.time, block.place.tolist(), block.spread, block.drift.tolist()
    (3.0, 1.0, [1.3333333333333333], 2.0, [3.0])
    """
    # Samples without weights count once each.
    times, positions = track.times[first:last], track.positions[first:last]
    if len(times) == 0:
        return empty_sketch(track.dimension)
    weights = np.ones(len(times)) if track.weights is None else track.weights[first:last]

    # Means relative to the first sample, then moments about the means.
    t, p = times - times[0], positions - positions[0]
    mean_time = np.average(t, weights=weights)
    mean_position = np.average(p, axis=0, weights=weights)
    x, r = t - mean_time, p - mean_position
    return Sketch(
        float(weights.sum()),
        float(times[0] + mean_time),
        positions[0] + mean_position,
        float(weights @ (x * x)),
        (weights * x) @ r,
        (weights[:, None] * r).T @ r,
        float(times[0]),
        float(times[-1]),
        len(times),
    )


def _sample_sketch(time: float, position: ArrayLike, weight: float) -> Sketch:
    """Return the sketch of one sample."""
    mean_position = np.array(position, dtype=np.float64)
    d = len(mean_position)
    return Sketch(
        float(weight),
        float(time),
        mean_position,
        0.0,
        np.zeros(d),
        np.zeros((d, d)),
        float(time),
        float(time),
        1,
    )


def insert_sample(block: Sketch, time: float, position: ArrayLike, weight: float = 1.0) -> Sketch:
    """Add a sample, in any order of time (thesis, 1_SEG_CORESET_INSERT).

    Examples
    --------
    >>> block = insert_sample(insert_sample(empty_sketch(1), 0.0, [1.0]), 2.0, [5.0])
    >>> block.time, block.place.tolist(), block.drift.tolist()
    (1.0, [3.0], [4.0])
    """
    return merge_sketches(block, _sample_sketch(time, position, weight))


def delete_sample(
    block: Sketch,
    time: float,
    position: ArrayLike,
    weight: float = 1.0,
    *,
    first: float | None = None,
    last: float | None = None,
) -> Sketch:
    """Remove a sample (thesis, 1_SEG_CORESET_DELETE).

    Parameters
    ----------
    block : Sketch
        A block that contains the sample.
    time, position, weight
        The sample, as it was inserted.
    first, last : float, optional
        Times in seconds of the first and the last remaining sample, if the first or the last one
        is removed; the moments don't contain them.

    Raises
    ------
    OptionError
        If the block has less weight than the sample.
    """
    # The block must hold the sample, and keep some weight for the samples that remain.
    remaining = block.weight - weight
    if (
        block.count < 1
        or remaining < -_ROUNDING * block.weight
        or (block.count > 1 and remaining <= 0)
    ):
        raise OptionError(
            f"a sample of weight {weight:g} can't be removed from a block "
            f"of weight {block.weight:g}"
        )
    if block.count == 1:
        return empty_sketch(block.dimension)

    # Chan's update backward
    share = weight / remaining
    dt, dp = time - block.time, np.asarray(position, dtype=np.float64) - block.place
    h = weight * block.weight / remaining
    return Sketch(
        remaining,
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
    """Return the sketch of two blocks together, in any order (Chan's update); exact.

    Examples
    --------
    >>> track = Track("walk", [0, 1, 2, 3], [[0], [1], [3], [3]])
    >>> merged = merge_sketches(build_sketch(track, 0, 2), build_sketch(track, 2, 4))
    >>> merged.spread == build_sketch(track).spread
    True
    """
    # An empty block changes nothing.
    if a.count == 0 or b.count == 0:
        return b if a.count == 0 else a

    # Differences of the means, weighted by h = W_a W_b / (W_a + W_b).
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
    """Return the fitting matrix D of a block against a line (definition 6.2.1).

    Its shape is (d, d), its unit m^2, and its trace the fitting cost.

    Parameters
    ----------
    block : Sketch
        The samples.
    start, end : array_like, shape (d,)
        Positions of the line at ``t0`` and ``t1``, in metres.
    t0, t1 : float
        Seconds. If both are equal, the line stays at ``start``.
    """
    starts, ends = np.array(start, dtype=np.float64)[None], np.array(end, dtype=np.float64)[None]
    (offset,), (velocity,) = _lines_about_mean(block, starts, ends, t0, t1)
    cross = np.outer(velocity, block.drift)
    matrix: NDArray[np.float64] = (
        block.weight * np.outer(offset, offset)
        + block.spread * np.outer(velocity, velocity)
        - cross
        - cross.T
        + block.scatter
    )
    return matrix


def line_cost(block: Sketch, start: ArrayLike, end: ArrayLike, t0: float, t1: float) -> float:
    """Return the exact fitting cost in m^2 of a block against a line.

    The line runs from ``start`` at time ``t0`` to ``end`` at time ``t1``.

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
    """Return the fitting costs in m^2 of a block against m lines, shape (m,).

    One matrix product (equations 6.13 and 6.14).

    Parameters
    ----------
    block : Sketch
        The samples.
    starts, ends : array_like, shape (m, d)
        Positions of the lines at ``t0`` and ``t1``, in metres.
    t0, t1 : float
        Seconds. If both are equal, the lines stay at their starts.
    """
    starts, ends = np.asarray(starts, dtype=np.float64), np.asarray(ends, dtype=np.float64)
    offsets, velocities = _lines_about_mean(block, starts, ends, t0, t1)

    # p_hat: moments of the block; s_hat: a column for each line
    p_hat = np.concatenate([[block.weight, block.spread], block.drift, [np.trace(block.scatter)]])
    s_hat = np.vstack(
        [
            (offsets * offsets).sum(axis=1),
            (velocities * velocities).sum(axis=1),
            -2 * velocities.T,
            np.ones(len(offsets)),
        ]
    )
    costs: NDArray[np.float64] = np.maximum(p_hat @ s_hat, 0.0)
    return costs


def _lines_about_mean(
    block: Sketch, starts: NDArray[np.float64], ends: NDArray[np.float64], t0: float, t1: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return offsets of lines from the mean position at the mean time, and velocities; (m, d)."""
    # About the means, moments of order 1 are 0, and drop out of the cost.
    velocities = (ends - starts) / (t1 - t0) if t1 != t0 else np.zeros_like(starts)
    return starts + (block.time - t0) * velocities - block.place, velocities


def best_line(block: Sketch) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the positions in metres of the best line at the first and the last time of a block.

    Both are the mean position if times have no spread.

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
    # The best line passes through the mean position at the mean time.
    velocity = _best_velocity(block)
    start = block.place + (block.first - block.time) * velocity
    end = block.place + (block.last - block.time) * velocity
    return start, end


def free_cost(block: Sketch) -> float:
    """Return the fitting cost in m^2 against the best line; it never falls as samples are added."""
    return float(max(np.trace(block.scatter) - _best_velocity(block) @ block.drift, 0.0))


def _best_velocity(block: Sketch) -> NDArray[np.float64]:
    """Return the velocity of the best line; 0 if times have no spread."""
    duration = block.last - block.first
    if block.count < 2 or block.spread <= _SINGULAR * block.weight * duration**2:
        return np.zeros(block.dimension)
    return block.drift / block.spread
