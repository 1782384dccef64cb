"""Histories of generated logs from their true walks, and plain twins of what is learned of them."""

import math
from collections import Counter, defaultdict

import numpy as np

from gpszip.history.traversals import History, Traversals

#: Seconds between two nodes that make a gap in the true walk.
GAP = 3600.0


def true_history(log, until=math.inf):
    """Traversals of whole roads by the true walks, up to a time; a night is a gap."""
    number = {}
    for edge, (u, v) in enumerate(log.road_map.edges.tolist()):
        number[u, v], number[v, u] = (edge, True), (edge, False)
    rows = []
    for track, walk in enumerate(log.walks):
        starts, stood = True, 0.0
        for u, v, enter, leave in zip(
            walk.nodes[:-1].tolist(),
            walk.nodes[1:].tolist(),
            walk.times[:-1].tolist(),
            walk.times[1:].tolist(),
            strict=True,
        ):
            if enter >= until:
                break
            if u == v:
                starts, stood = starts or leave - enter > GAP, leave - enter
                if rows and not starts:
                    rows[-1][4] += stood
                    rows[-1][5] += stood
                continue
            edge, forward = number[u, v]
            rows.append([track, edge, forward, enter, leave, 0.0, starts])
            starts = False

    track, edge, forward, enter, leave, standing, starts = map(np.array, zip(*rows, strict=True))
    network = log.network
    length = network.lengths[edge]
    return History(
        network,
        Traversals(
            ids=tuple(walk.id for walk in log.walks),
            track=track.astype(np.int32),
            edge=edge.astype(np.int64),
            forward=forward,
            enter=enter,
            leave=leave,
            begin=np.where(forward, 0.0, length),
            end=np.where(forward, length, 0.0),
            standing=standing,
            starts=starts,
        ),
    )


def routes_of(traversals):
    """Each connected piece: name of its track, edges with directions, and times of entering."""
    bounds = [*np.flatnonzero(traversals.starts).tolist(), len(traversals)]
    for first, after in zip(bounds[:-1], bounds[1:], strict=True):
        rows = slice(first, after)
        edges = list(
            zip(traversals.edge[rows].tolist(), traversals.forward[rows].tolist(), strict=True)
        )
        yield traversals.ids[traversals.track[first]], edges, traversals.enter[rows].tolist()


def exits_of(network):
    """Edges and directions that leave the end of each, by a loop over all pairs."""
    ends = {}
    for edge in range(len(network)):
        ends[edge, True] = int(network.starts[edge]), int(network.ends[edge])
        ends[edge, False] = ends[edge, True][::-1]
    order = [(edge, forward) for edge in range(len(network)) for forward in (True, False)]
    return {each: [other for other in order if ends[other][0] == ends[each][1]] for each in order}


def count_followers(routes, orders):
    """What followed each context, a tuple of edges, in all routes."""
    counts = defaultdict(Counter)
    for route in routes:
        for i in range(len(route) - 1):
            for order in orders:
                if i + 1 >= order:
                    counts[tuple(route[i + 1 - order : i + 1])][route[i + 1]] += 1
    return counts


def back_off(counts, route, exits, order):
    """Probabilities of the exits by PPM with escape method C, up to an order."""
    options = exits[route[-1]]
    p = {option: 1 / len(options) for option in options}
    for k in range(1, order + 1):
        seen = counts.get(tuple(route[-k:])) if len(route) >= k else None
        if not seen:
            break
        total, distinct = sum(seen.values()), len(seen)
        p = {o: (seen[o] + distinct * p[o]) / (total + distinct) for o in options}
    return p
