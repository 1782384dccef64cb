"""A plain reader of the tail of walks payloads, written from docs/format.md, "The tail"."""

from __future__ import annotations

import math

from oracle.adaptive import Bit
from oracle.walk_decoder import BadWalks

TICKS = [
    (0, 1),
    *((n, 1) for n in (60, 30, 15, 10, 5, 2, 1)),
    *((1, n) for n in (2, 5, 10, 20, 50, 100, 200, 1000)),
]
FIRST_CUT, FAR, MOST = (36, 4), 2.0, 255


def read_tail(coder, places, tracks, step):
    """Numbers of the shapes, and the tick with (start, end) of each piece in ticks since the epoch; None without a tick.

    ``tracks`` are lists of (node, cell, whether a gap leads there), and ``step`` is the quantum of time in seconds.
    """
    shapes = (
        {number for number in range(len(tracks)) if uniform(coder, 2)} if rare(coder) else set()
    )
    tick = uniform(coder, 16)
    if tick == 0:
        return shapes, None
    seconds, parts = TICKS[tick]
    cut, found = Bit(*FIRST_CUT), []
    for number, track in enumerate(tracks):
        cuts = [0, *(at for at, knot in enumerate(track) if knot[2]), len(track)]
        for first, after in zip(cuts, cuts[1:], strict=False):
            low = math.floor(track[first][1] * step * parts / seconds)
            high = math.ceil(track[after - 1][1] * step * parts / seconds)
            if number in shapes:
                found.append((low, high))
                continue
            offsets = []
            for end in (0, 1):
                always = first == 0 if end == 0 else after == len(track)
                near = (first, first + 1) if end == 0 else (after - 2, after - 1)
                may_be_cut = after - first > 1 and pace(places, track, near) > FAR
                there = always or (may_be_cut and cut.read(coder))
                offsets.append(offset(coder, int(step * parts / seconds) + 2) if there else 0)
            if low + offsets[0] > high - offsets[1]:
                raise BadWalks("ends before it starts")
            found.append((low + offsets[0], high - offsets[1]))
    return shapes, (tick, found)


def pace(places, track, knots):
    (u, begin, _), (v, end, _) = (track[knot] for knot in knots)
    return math.dist(places[u], places[v]) / (end - begin)


def uniform(coder, total):
    value = coder.target(total)
    coder.interval(value, 1, total)
    return value


def rare(coder):
    happens = coder.target(64) == 63
    coder.interval(63 if happens else 0, 1 if happens else 63, 64)
    return happens


def offset(coder, levels):
    wraps = 0
    while rare(coder):
        wraps += 1
        if wraps > MOST:
            raise BadWalks("too far")
    return wraps * levels + uniform(coder, levels)
