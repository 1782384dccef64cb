"""Oracle of joining lines: round positions, count visits to split, keep one road a shape."""

from collections import Counter

import numpy as np


def build_road_graph(lines, step=1e-3):
    """Return the roads of lines given as (vertices, forward, backward).

    The answer is a dict from the shape, in the smaller of its two directions, to whether it may be
    travelled forward and backward.
    """
    # Round, and drop repeated vertices.
    rounded = []
    for line, forward, backward in lines:
        vertices = [tuple(np.rint(np.array(v) / step).astype(int).tolist()) for v in line]
        vertices = [v for i, v in enumerate(vertices) if i == 0 or v != vertices[i - 1]]
        if len(vertices) > 1:
            rounded.append((vertices, forward, backward))

    # Split at vertices that occur more than once.
    shapes = merge_same_shapes(rounded)
    visits = Counter(v for shape in shapes for v in shape)
    fragments = []
    for shape, (forward, backward) in shapes.items():
        start = 0
        for i in range(1, len(shape)):
            if i == len(shape) - 1 or visits[shape[i]] > 1:
                fragments.append((shape[start : i + 1], forward, backward))
                start = i
    return merge_same_shapes(fragments)


def merge_same_shapes(lines):
    merged = {}
    for line, *directions in lines:
        shape = min(tuple(line), tuple(line[::-1]))
        forward, backward = directions if shape == tuple(line) else directions[::-1]
        known = merged.get(shape, (False, False))
        merged[shape] = (known[0] or forward, known[1] or backward)
    return merged
