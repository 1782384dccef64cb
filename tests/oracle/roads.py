"""Joining lines to roads, said plainly: places by rounding, cuts by counting, one road for each shape."""

from collections import Counter

import numpy as np


def joined(lines, step=1e-3):
    """Roads of lines given as (vertices, forward, backward): a dict from shape, in its lesser reading, to directions."""
    placed = [
        ([tuple(np.rint(np.array(v) / step).astype(int).tolist()) for v in line], f, b)
        for line, f, b in lines
    ]
    placed = [
        ([v for i, v in enumerate(line) if i == 0 or v != line[i - 1]], f, b)
        for line, f, b in placed
    ]
    shapes = united([one for one in placed if len(one[0]) > 1])
    visits = Counter(v for shape in shapes for v in shape)
    parts = []
    for shape, (forward, backward) in shapes.items():
        start = 0
        for i in range(1, len(shape)):
            if i == len(shape) - 1 or visits[shape[i]] > 1:
                parts.append((shape[start : i + 1], forward, backward))
                start = i
    return united(parts)


def united(lines):
    found = {}
    for line, *ways in lines:
        shape = min(tuple(line), tuple(line[::-1]))
        own = ways if shape == tuple(line) else ways[::-1]
        known = found.get(shape, (False, False))
        found[shape] = (known[0] or own[0], known[1] or own[1])
    return found
