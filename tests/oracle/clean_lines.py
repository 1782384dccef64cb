"""Plain twins of the kernels of the clean map."""

import heapq

import numpy as np


def blurred(values, near, passes):
    for _ in range(passes):
        padded = np.append(values, 0.0)
        weights = np.array([2, 1] * 4)
        values = (4 * values + (padded[near] * weights).sum(axis=1)) / 16
    return values


def route_cost(places, near, price, start, end, far, wide):
    """Cost of the cheapest route within the ellipse and beside the straight line; infinite where there is none."""

    def away(a, b):
        return float(np.linalg.norm(places[a] - places[b]))

    line = places[[start, end]]
    cost, heap = {start: 0.0}, [(0.0, start)]
    while heap:
        reached, place = heapq.heappop(heap)
        if place == end:
            return reached
        if reached > cost[place]:
            continue
        for other in near[place][near[place] >= 0].tolist():
            total = reached + away(place, other) * (price[place] + price[other]) / 2
            allowed = (
                away(other, start) + away(other, end) <= far
                and distance_to_line(places[other], line) <= wide
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
        share = np.clip(np.dot(point - start, along) / max(np.dot(along, along), 1e-300), 0, 1)
        best = min(best, float(np.linalg.norm(start + share * along - point)))
    return best
