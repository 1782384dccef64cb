"""A plain reader of the tail of walks payloads, written from docs/format.md, "The tail"."""

from __future__ import annotations

import math

from oracle.adaptive import Bit
from oracle.walk_decoder import InvalidWalks

TICKS = [
    (0, 1),
    *((n, 1) for n in (60, 30, 15, 10, 5, 2, 1)),
    *((1, n) for n in (2, 5, 10, 20, 50, 100, 200, 1000)),
]
INITIAL_OFFSET = (36, 4)  # counts of whether a piece beside a gap has an offset
MAX_OVERRUN = 2.0  # space steps by time step
MAX_QUOTIENT = 255


def read_tail(coder, positions, tracks, step):
    """Return the numbers of the tracks without times, and the tick with the ends of all pieces.

    The ends are (start, end) in ticks since the epoch; both are None without a tick. ``tracks`` are
    lists of (node, time step, whether a gap leads there), ``step`` is the time step in seconds.
    """
    shapes = set()
    if rare(coder):
        shapes = {number for number in range(len(tracks)) if uniform(coder, 2)}
    tick = uniform(coder, 16)
    if tick == 0:
        return shapes, None
    numerator, denominator = TICKS[tick]
    levels = int(step * denominator / numerator) + 2
    has_offset, ends = Bit(*INITIAL_OFFSET), []
    for number, track in enumerate(tracks):
        bounds = [0, *(i for i, knot in enumerate(track) if knot[2]), len(track)]
        for first, after in zip(bounds, bounds[1:], strict=False):
            low = math.floor(track[first][1] * step * denominator / numerator)
            high = math.ceil(track[after - 1][1] * step * denominator / numerator)
            if number in shapes:
                ends.append((low, high))
                continue
            start = end = 0
            fast = after - first > 1 and speed(positions, track, first, first + 1) > MAX_OVERRUN
            if first == 0 or (fast and has_offset.read(coder)):
                start = offset(coder, levels)
            fast = after - first > 1 and speed(positions, track, after - 2, after - 1) > MAX_OVERRUN
            if after == len(track) or (fast and has_offset.read(coder)):
                end = offset(coder, levels)
            if low + start > high - end:
                raise InvalidWalks("ends before it starts")
            ends.append((low + start, high - end))
    return shapes, (tick, ends)


def speed(positions, track, knot, next_knot):
    """Space steps by time step between two knots."""
    (u, begin, _), (v, end, _) = track[knot], track[next_knot]
    return math.dist(positions[u], positions[v]) / (end - begin)


def uniform(coder, total):
    value = coder.decode_cumulative(total)
    coder.interval(value, 1, total)
    return value


def rare(coder):
    """A choice with a probability of 1/64."""
    happens = coder.decode_cumulative(64) == 63
    coder.interval(63 if happens else 0, 1 if happens else 63, 64)
    return happens


def offset(coder, levels):
    quotient = 0
    while rare(coder):
        quotient += 1
        if quotient > MAX_QUOTIENT:
            raise InvalidWalks("too far")
    return quotient * levels + uniform(coder, levels)
