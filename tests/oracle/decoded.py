"""Plain twins of what an archive answers: one sample, one knot at a time."""

import math
from itertools import pairwise


def position(knot_times, knot_places, gaps, t, slack=1e-3):
    """The place at t by walking along the knots; None where nothing is claimed."""
    for i in range(len(gaps)):
        a, b = knot_times[i], knot_times[i + 1]
        if not gaps[i] and a <= t <= b:
            share = (t - a) / (b - a)
            return [
                p + share * (q - p) for p, q in zip(knot_places[i], knot_places[i + 1], strict=True)
            ]
    away, nearest = min((abs(t - a), i) for i, a in enumerate(knot_times))
    return list(knot_places[nearest]) if away <= slack else None


def pieces(knot_times, knot_places, gaps):
    """The knots of every piece between gaps."""
    out = [([knot_times[0]], [knot_places[0]])]
    for i, gap in enumerate(gaps):
        if gap:
            out.append(([], []))
        out[-1][0].append(knot_times[i + 1])
        out[-1][1].append(knot_places[i + 1])
    return out


def measure(original, decoded, slack=1e-3):
    """(rmse, maximum, samples without a position) as a scorer takes them from decoded tracks named id or id/NUMBER."""
    squares, lost = [], 0
    ids = {track.id for track in original}
    for track in original:
        mine = [
            d
            for d in decoded
            if d.id == track.id or (d.id not in ids and d.id.rsplit("/", 1)[0] == track.id)
        ]
        mine.sort(key=lambda d: d.times[0])
        for before, after in pairwise(mine):
            assert before.times[-1] <= after.times[0] + slack, f"pieces of {track.id} overlap"
        for t, p in zip(track.times, track.positions, strict=True):
            found = []
            for d in mine:
                if d.times[0] - slack <= t <= d.times[-1] + slack:
                    place = position(
                        d.times,
                        d.positions,
                        [False] * (len(d.times) - 1),
                        min(max(t, d.times[0]), d.times[-1]),
                    )
                    found.append(math.dist(place, p))
            lost += not found
            if found:
                squares.append(min(found) ** 2)
    return (
        math.sqrt(sum(squares) / max(len(squares), 1)),
        math.sqrt(max(squares, default=0.0)),
        lost,
    )
