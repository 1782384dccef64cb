"""Plain twins of queries to an archive: one sample and one knot at a time."""

import math
from itertools import pairwise


def position(knot_times, knot_positions, gaps, t, slack=1e-3):
    """Position at time t by walking along the knots; None where the walk claims no travel."""
    for i in range(len(gaps)):
        a, b = knot_times[i], knot_times[i + 1]
        if not gaps[i] and a <= t <= b:
            fraction = (t - a) / (b - a)
            start, end = knot_positions[i], knot_positions[i + 1]
            return [p + fraction * (q - p) for p, q in zip(start, end, strict=True)]
    distance, nearest = min((abs(t - a), i) for i, a in enumerate(knot_times))
    return list(knot_positions[nearest]) if distance <= slack else None


def pieces(knot_times, knot_positions, gaps):
    """The knots of every piece between gaps."""
    out = [([knot_times[0]], [knot_positions[0]])]
    for i, gap in enumerate(gaps):
        if gap:
            out.append(([], []))
        out[-1][0].append(knot_times[i + 1])
        out[-1][1].append(knot_positions[i + 1])
    return out


def measure(original, decoded, slack=1e-3):
    """(rmse, maximum, uncovered samples) from decoded tracks, which are named id or id/NUMBER."""
    squares, uncovered = [], 0
    ids = {track.id for track in original}
    for track in original:
        track_pieces = [
            d
            for d in decoded
            if d.id == track.id or (d.id not in ids and d.id.rsplit("/", 1)[0] == track.id)
        ]
        track_pieces.sort(key=lambda d: d.times[0])
        for before, after in pairwise(track_pieces):
            assert before.times[-1] <= after.times[0] + slack, f"pieces of {track.id} overlap"
        for t, p in zip(track.times, track.positions, strict=True):
            distances = []
            for d in track_pieces:
                if d.times[0] - slack <= t <= d.times[-1] + slack:
                    nearest_time = min(max(t, d.times[0]), d.times[-1])
                    no_gaps = [False] * (len(d.times) - 1)
                    decoded_position = position(d.times, d.positions, no_gaps, nearest_time)
                    distances.append(math.dist(decoded_position, p))
            uncovered += not distances
            if distances:
                squares.append(min(distances) ** 2)
    return (
        math.sqrt(sum(squares) / max(len(squares), 1)),
        math.sqrt(max(squares, default=0.0)),
        uncovered,
    )
