"""Plain twins of the kernels of map simplification."""

import heapq
import itertools

import numpy as np


def cells_near(starts, ends, size, margin):
    """Columns and rows of the cells near points on lines; their centers are multiples of size."""
    cells = set()
    around = range(-margin, margin + 1)
    for start, end in zip(starts, ends, strict=True):
        count = int(np.ceil(2 * np.linalg.norm(end - start) / size)) + 1
        for number in range(count):
            point = start + (number + 0.5) / count * (end - start)
            column, row = np.floor(point / size + 0.5).astype(int).tolist()
            cells |= {(column + i, row + j) for i, j in itertools.product(around, around)}
    return cells


def blurred(values, neighbours, passes):
    for _ in range(passes):
        padded = np.append(values, 0.0)
        weights = np.array([2, 1] * 4)
        values = (4 * values + (padded[neighbours] * weights).sum(axis=1)) / 16
    return values


def path_cost(positions, neighbours, price, start, end, max_detour, max_offset, may_turn_back=True):
    """Cost of the cheapest path within the corridor; infinite if there is none.

    One that may not turn back never decreases along the longer axis from the start to the end.
    """
    longer = np.argmax(np.abs(positions[end] - positions[start]))
    ahead = np.sign(positions[end] - positions[start])[longer]

    def distance(a, b):
        return float(np.linalg.norm(positions[a] - positions[b]))

    line = positions[[start, end]]
    cost, heap = {start: 0.0}, [(0.0, start)]
    while heap:
        reached, vertex = heapq.heappop(heap)
        if vertex == end:
            return reached
        if reached > cost[vertex]:
            continue
        for other in neighbours[vertex][neighbours[vertex] >= 0].tolist():
            total = reached + distance(vertex, other) * (price[vertex] + price[other]) / 2
            allowed = (
                distance(other, start) + distance(other, end) <= max_detour
                and distance_to_line(positions[other], line) <= max_offset
                and (
                    may_turn_back or ahead * (positions[other] - positions[vertex])[longer] >= -1e-9
                )
            )
            if allowed and total < cost.get(other, np.inf):
                cost[other] = total
                heapq.heappush(heap, (total, other))
    return np.inf


def distance_to_line(point, line):
    """Distance of a point from a polyline."""
    best = np.inf
    for start, end in zip(line[:-1], line[1:], strict=True):
        along = end - start
        square = max(np.dot(along, along), 1e-300)
        fraction = np.clip(np.dot(point - start, along) / square, 0, 1)
        best = min(best, float(np.linalg.norm(start + fraction * along - point)))
    return best
