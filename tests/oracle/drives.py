"""Plain twins of drives on roads: shortest paths by a heap, and one node after the other."""

import heapq
import math

import numpy as np


def shortest_path(nodes, edges, start, end):
    """Nodes of the shortest path from start to end."""
    neighbours = {number: [] for number in range(len(nodes))}
    for u, v in edges.tolist():
        length = math.dist(nodes[u], nodes[v])
        neighbours[u].append((v, length))
        neighbours[v].append((u, length))

    queue, done, before = [(0.0, start, -1)], set(), {}
    while queue:
        distance, node, last = heapq.heappop(queue)
        if node in done:
            continue
        done.add(node)
        before[node] = last
        if node == end:
            break
        for other, length in neighbours[node]:
            heapq.heappush(queue, (distance + length, other, node))

    path = [end]
    while path[-1] != start:
        path.append(before[path[-1]])
    return path[::-1]


def drive(nodes, edges, stops, departures, speeds, wait, until):
    """Nodes and times of a walk from stop to stop."""
    walked, times, clock = [], [], -math.inf
    for number, departure in enumerate(departures):
        clock = max(clock + wait, departure)
        path = shortest_path(nodes, edges, stops[number], stops[number + 1])
        for place, node in enumerate(path):
            if place:
                clock += math.dist(nodes[path[place - 1]], nodes[node]) / speeds[number]
            if not times or clock > times[-1] + 1e-6:
                walked.append(node)
                times.append(clock)
    if times[-1] < until:
        walked.append(walked[-1])
        times.append(until + 1.0)
    count = next(number for number, time in enumerate(times) if time >= until) + 1
    return walked[:count], times[:count]


def traversals(walk):
    """Traversals of each directed pair of nodes of a walk, until its travel ends."""
    counts = {}
    for u, v, begin in zip(walk.nodes[:-1], walk.nodes[1:], walk.times[:-1], strict=True):
        if u != v and begin < walk.time_ranges[0, 1]:
            counts[int(u), int(v)] = counts.get((int(u), int(v)), 0) + 1
    return counts


def position(walk, nodes, time):
    """Position of a walk at a time."""
    after = min(max(int(np.searchsorted(walk.times, time)), 1), len(walk.times) - 1)
    begin, end = walk.times[after - 1], walk.times[after]
    share = min(max((time - begin) / (end - begin), 0.0), 1.0)
    return nodes[walk.nodes[after - 1]] * (1 - share) + nodes[walk.nodes[after]] * share
