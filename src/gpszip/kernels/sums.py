"""Moments of any segment of a track in constant time, exact wherever its clock and plane start.

Times and positions become whole ticks, counted from the first sample. Prefix sums of ticks and of
their products are kept in 64-bit integers that wrap around. The moments of a segment are re-centred
on its own first sample while they are still integers. The result fits in 63 bits, so the wrapping
cancels and no bit is lost. Where it would not fit, and for weighted tracks, moments are added up
from blocks of samples, each in floats about the block's first sample.

Rows of moments are ``[W, X1, X2, Q, M_1..M_d, N_1..N_d]``. With x the time, r the position (both
since the segment's first sample) and w the weight of each sample:

    W = sum w,  X1 = sum w x,  X2 = sum w x^2,  Q = sum w |r|^2,  M = sum w r,  N = sum w x r
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner_uncounted, jit, jit_uncounted
from gpszip.model import Track

__all__ = [
    "BLOCK_SIZE",
    "PrefixSums",
    "add_moments",
    "add_sample",
    "best_line_cost",
    "build_prefix_sums",
    "normalised_moments",
    "segment_moments",
    "tick_moments",
    "track_sums",
]

#: Samples in a block of moments.
BLOCK_SIZE = 256

#: Largest value that re-centred integers may reach; a quarter of what signed 64-bit integers hold.
_MAX_EXACT = float(1 << 61)

#: Most ticks from the first sample; floats count integers one by one up to 2^53.
_MAX_TICKS = float(1 << 51)

#: Offset of the tick boundaries, in ticks. It keeps them off every decimal grid, so that noise in
#: the last digit of a coordinate doesn't move a sample to another tick.
_TICK_OFFSET = 0.5037

#: Coarsest tick of times, in seconds.
_COARSEST_TIME_TICK = 1e-3

#: Coarsest tick of positions, in metres.
_COARSEST_POSITION_TICK = 1e-3

#: A time tick is at least this many orders of magnitude below the shortest interval of the track.
_TIME_DIGITS = 2.5

#: A position tick is at least this many orders of magnitude below the extent of the track.
_POSITION_DIGITS = 7.3


class PrefixSums(NamedTuple):
    """A track in ticks, with its prefix sums.

    Parameters
    ----------
    t : float64 array, shape (n,)
        Whole time ticks since the first sample.
    p : float64 array, shape (n, d)
        Whole position ticks from the first sample.
    w : float64 array, shape (n,)
        Weights.
    prefix : int64 array, shape (n + 1, 2 d + 3)
        Wrapping prefix sums of t, t^2, |p|^2, p and t p; no rows for a weighted track.
    blocks : float64 array, shape (ceil(n / 256), 2 d + 4)
        Moments of each block of samples about its first sample.
    extent : float
        Diagonal of the bounding box in position ticks: an upper bound on distances.
    time_tick, position_tick : float
        Sizes of the ticks in seconds and metres.
    first_time : float
        Time of the first sample in seconds.
    first_position : float64 array, shape (d,)
        Position of the first sample in metres.
    """

    t: NDArray[np.float64]
    p: NDArray[np.float64]
    w: NDArray[np.float64]
    prefix: NDArray[np.int64]
    blocks: NDArray[np.float64]
    extent: float
    time_tick: float
    position_tick: float
    first_time: float
    first_position: NDArray[np.float64]


def build_prefix_sums(
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    weights: NDArray[np.float64] | None = None,
) -> PrefixSums:
    """Convert a track to ticks and compute its prefix sums.

    Ticks are powers of ten that suit the track's own resolution: 1 ms and 1 mm, or finer.

    Parameters
    ----------
    times : float64 array, shape (n,)
        Increasing times in seconds; at least one.
    positions : float64 array, shape (n, d)
        Positions in metres.
    weights : float64 array, shape (n,), optional
        Weight of each sample; by default 1. Weighted tracks use blocks of samples only.
    """
    # Count from the first sample.
    seconds, metres = times - times[0], positions - positions[0]
    time_tick = _time_tick(seconds)
    position_tick = _position_tick(metres)
    t, p = _ticks(seconds, time_tick), _ticks(metres, position_tick)
    # A copy, as the weights of a track can't be written to: kernels are compiled for one kind.
    w = np.ones(len(t)) if weights is None else np.array(weights, dtype=np.float64)

    # Sum up.
    extent = float(np.sqrt(np.square(np.ptp(p, axis=0)).sum()))
    prefix = _prefix(t, p) if weights is None else np.empty((0, 2 * p.shape[1] + 3), dtype=np.int64)
    return PrefixSums(
        t,
        p,
        w,
        prefix,
        _blocks(t, p, w),
        extent,
        time_tick,
        position_tick,
        float(times[0]),
        np.array(positions[0]),
    )


def track_sums(track: Track) -> PrefixSums:
    """Return the prefix sums of a track in ticks of 1 ms and 1 mm, finer if it is fast or small.

    Examples
    --------
    >>> sums = track_sums(Track("far", [1e9, 1e9 + 1, 1e9 + 2], [[5e6], [5e6 + 3], [5e6 + 4]]))
    >>> sums.time_tick, sums.first_time
    (0.001, 1000000000.0)
    """
    return build_prefix_sums(track.times, track.positions, track.weights)


def _time_tick(seconds: NDArray[np.float64]) -> float:
    """1 ms, or finer if samples follow each other fast; coarser if the track is very long."""
    if len(seconds) < 2:
        return _COARSEST_TIME_TICK
    shortest = float(np.diff(seconds).min())
    fine = min(_COARSEST_TIME_TICK, _decimal(shortest, _TIME_DIGITS))
    return max(fine, _decimal(float(seconds[-1]) / _MAX_TICKS, -1.0))


def _position_tick(metres: NDArray[np.float64]) -> float:
    """1 mm, or finer if the track is small; coarser if it is very large."""
    extent = float(np.abs(metres).max())
    if extent == 0:
        return _COARSEST_POSITION_TICK
    fine = min(_COARSEST_POSITION_TICK, _decimal(extent, _POSITION_DIGITS))
    return max(fine, _decimal(extent / _MAX_TICKS, -1.0))


def _decimal(size: float, digits: float) -> float:
    """Largest power of ten that is ``digits`` orders below ``size``."""
    return float(10.0 ** np.floor(np.log10(max(size, 1e-300)) - digits))


def _ticks(values: NDArray[np.float64], tick: float) -> NDArray[np.float64]:
    """Whole ticks nearest to each value, nearly."""
    counted: NDArray[np.float64] = np.floor(values / tick + _TICK_OFFSET)
    return counted


def _prefix(t: NDArray[np.float64], p: NDArray[np.float64]) -> NDArray[np.int64]:
    """Prefix sums of t, t^2, |p|^2, p and t p, shape (n + 1, 2 d + 3); they wrap around."""
    n, d = p.shape
    ticks, positions = t.astype(np.int64), p.astype(np.int64)

    prefix = np.zeros((n + 1, 2 * d + 3), dtype=np.int64)
    prefix[1:, 0] = ticks
    prefix[1:, 1] = ticks * ticks
    prefix[1:, 2] = (positions * positions).sum(axis=1)
    prefix[1:, 3 : 3 + d] = positions
    prefix[1:, 3 + d :] = positions * ticks[:, None]
    np.cumsum(prefix, axis=0, out=prefix)
    return prefix


@jit
def _blocks(
    t: NDArray[np.float64], p: NDArray[np.float64], w: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Moments of each block of samples about its first sample, shape (ceil(n / 256), 2 d + 4)."""
    n, d = p.shape
    rows = np.zeros(((n + BLOCK_SIZE - 1) // BLOCK_SIZE, 2 * d + 4))
    for i in range(n):
        first = i // BLOCK_SIZE * BLOCK_SIZE
        add_sample(rows[i // BLOCK_SIZE], t[i] - t[first], w[i], p, i, first)
    return rows


@inner_uncounted
def add_sample(
    row: NDArray[np.float64], x: float, w: float, p: NDArray[np.float64], i: int, origin: int
) -> None:
    """Add sample i, x time ticks from the origin, to a row of moments about sample ``origin``."""
    d = p.shape[1]
    row[0] += w
    row[1] += w * x
    row[2] += w * x * x
    for c in range(d):
        r = p[i, c] - p[origin, c]
        row[3] += w * r * r
        row[4 + c] += w * r
        row[4 + d + c] += w * x * r


@inner_uncounted
def add_moments(
    row: NDArray[np.float64],
    later: NDArray[np.float64],
    x: float,
    p: NDArray[np.float64],
    first: int,
    origin: int,
) -> None:
    """Add the moments ``later``, taken about sample ``first``, to a row about sample ``origin``.

    With x the time and r the position of sample ``first`` since the origin, and primed moments
    those of ``later``, the shifted sums are

        X1' + x W',  X2' + 2 x X1' + x^2 W',  Q' + 2 r.M' + |r|^2 W',
        M' + r W',   N' + x M' + r (X1' + x W')
    """
    # Moments of time alone.
    d = p.shape[1]
    row[0] += later[0]
    row[1] += later[1] + x * later[0]
    row[2] += later[2] + 2.0 * x * later[1] + x * x * later[0]
    row[3] += later[3]

    # Moments with the position.
    for c in range(d):
        r = p[first, c] - p[origin, c]
        row[3] += 2.0 * r * later[4 + c] + r * r * later[0]
        row[4 + c] += later[4 + c] + r * later[0]
        row[4 + d + c] += later[4 + d + c] + x * later[4 + c] + r * (later[1] + x * later[0])


@inner_uncounted
def _from_prefix(sums: PrefixSums, a: int, b: int, out: NDArray[np.float64]) -> None:
    """Moments of samples a to b - 1 about sample a, from differences of the prefix sums.

    Everything is integer arithmetic modulo 2^64 until the result is written. With t0 and p0 the
    ticks of sample a, and T1, P1, TP sums of t, p and t p over the segment:

        X1 = T1 - t0 W,  X2 = sum t^2 - 2 t0 T1 + t0^2 W,  Q = sum |p|^2 + |p0|^2 W - 2 p0.P1,
        M = P1 - p0 W,   N = TP - t0 P1 - p0 X1
    """
    # Moments of time alone.
    prefix, p, d = sums.prefix, sums.p, sums.p.shape[1]
    w = np.int64(b - a)
    t0 = np.int64(sums.t[a])
    t1 = prefix[b, 0] - prefix[a, 0]
    x1 = t1 - t0 * w
    x2 = prefix[b, 1] - prefix[a, 1] - 2 * t0 * t1 + t0 * t0 * w

    # Moments with the position.
    q = prefix[b, 2] - prefix[a, 2]
    for c in range(d):
        p0 = np.int64(p[a, c])
        p1 = prefix[b, 3 + c] - prefix[a, 3 + c]
        tp = prefix[b, 3 + d + c] - prefix[a, 3 + d + c]
        q += p0 * p0 * w - 2 * p0 * p1
        out[4 + c] = p1 - p0 * w
        out[4 + d + c] = tp - t0 * p1 - p0 * x1

    # Write weight W, moments of time X1 and X2, and Q.
    out[0], out[1], out[2], out[3] = w, x1, x2, q


@inner_uncounted
def _from_blocks(sums: PrefixSums, a: int, b: int, out: NDArray[np.float64]) -> None:
    """Moments of samples a to b - 1 about sample a, from full blocks and single samples."""
    out[:] = 0.0
    i = a
    while i < b:
        if i % BLOCK_SIZE == 0 and i + BLOCK_SIZE <= b:
            add_moments(out, sums.blocks[i // BLOCK_SIZE], sums.t[i] - sums.t[a], sums.p, i, a)
            i += BLOCK_SIZE
        else:
            add_sample(out, sums.t[i] - sums.t[a], sums.w[i], sums.p, i, a)
            i += 1


@inner_uncounted
def tick_moments(sums: PrefixSums, a: int, b: int, out: NDArray[np.float64]) -> None:
    """Write the moments of samples a to b - 1 about sample a, with x in time ticks."""
    # All re-centred sums are at most (b - a) reach^2.
    reach = max(sums.t[b - 1] - sums.t[a], sums.extent)
    if len(sums.prefix) > 0 and (b - a) * reach * reach < _MAX_EXACT:
        _from_prefix(sums, a, b, out)
    else:
        _from_blocks(sums, a, b, out)


@jit_uncounted
def normalised_moments(sums: PrefixSums, a: int, b: int, out: NDArray[np.float64]) -> None:
    """Write the moments of samples a to b - 1 about sample a, in normalised time.

    x runs from 0 at sample a to 1 at sample b - 1.
    """
    tick_moments(sums, a, b, out)
    d = sums.p.shape[1]
    length = sums.t[b - 1] - sums.t[a]
    inverse = 1.0 / length if length > 0 else 0.0
    out[1] *= inverse
    out[2] *= inverse * inverse
    for c in range(4 + d, 4 + 2 * d):
        out[c] *= inverse


@jit
def segment_moments(sums: PrefixSums, boundaries: NDArray[np.int64]) -> NDArray[np.float64]:
    """Moments of every segment in its own normalised time, shape (k, 2 d + 4).

    Segment j consists of the samples ``boundaries[j]`` to ``boundaries[j + 1] - 1``.
    """
    rows = np.empty((len(boundaries) - 1, 2 * sums.p.shape[1] + 4))
    for j in range(len(rows)):
        normalised_moments(sums, boundaries[j], boundaries[j + 1], rows[j])
    return rows


@jit_uncounted
def best_line_cost(row: NDArray[np.float64]) -> float:
    """Cost of the samples against their own best line, by centred least squares.

    With m the mean time, Stt = X2 - m X1, Spp = Q - |M|^2 / W and Stp = N - m M, the least sum of
    squares is Spp - |Stp|^2 / Stt.
    """
    # A segment without weight costs nothing.
    if row[0] <= 0:
        return 0.0

    # Centre the moments on the weighted mean.
    d = (len(row) - 4) // 2
    mean = row[1] / row[0]
    stt = row[2] - mean * row[1]
    spp = row[3]
    stp = 0.0
    for c in range(d):
        spp -= row[4 + c] * row[4 + c] / row[0]
        s = row[4 + d + c] - mean * row[4 + c]
        stp += s * s

    # Samples at a single time have no slope; rounding may leave a variance just above zero.
    if stt > 1e-14 * row[2]:
        spp -= stp / stt
    cost: float = max(spp, 0.0)
    return cost
