"""Plain twins of canonical paths and of compression to waypoints; random maps and walks."""

from __future__ import annotations

import heapq

import numpy as np
from hypothesis import strategies as st

from gpszip.graph.road_graph import RoadGraph, build_road_graph
from gpszip.graph.route import GAP, STOP, Route


def out_arcs(graph: RoadGraph, node: int) -> list[tuple[int, int, int]]:
    """(weight, edge, target) of each arc that leaves a node."""
    arcs = range(int(graph.offsets[node]), int(graph.offsets[node + 1]))
    return [
        (int(graph.weights[arc]), int(graph.edges[arc]), int(graph.targets[arc])) for arc in arcs
    ]


def canonical_paths(
    graph: RoadGraph, source: int
) -> dict[int, tuple[int, tuple[int, ...], tuple[int, ...]]]:
    """For each node reached: length, nodes and edges of its canonical path.

    The queue holds complete paths.
    """
    best: dict[int, tuple[int, tuple[int, ...], tuple[int, ...]]] = {}
    rank = graph.ranks.tolist()
    queue = [(0, (rank[source],), (), (source,))]
    while queue:
        length, ranks, edges, nodes = heapq.heappop(queue)
        if nodes[-1] in best:
            continue
        best[nodes[-1]] = (length, nodes, edges)
        for weight, edge, target in out_arcs(graph, nodes[-1]):
            heapq.heappush(
                queue, (length + weight, (*ranks, rank[target]), (*edges, edge), (*nodes, target))
            )
    return best


def all_simple_paths(
    graph: RoadGraph, source: int
) -> list[tuple[int, tuple[int, ...], tuple[int, ...], tuple[int, ...]]]:
    """(length, ranks, edges, nodes) of every path that visits no node twice."""
    rank = graph.ranks.tolist()
    paths, stack = [], [(0, (rank[source],), (), (source,))]
    while stack:
        length, ranks, edges, nodes = stack.pop()
        paths.append((length, ranks, edges, nodes))
        stack += [
            (length + weight, (*ranks, rank[target]), (*edges, edge), (*nodes, target))
            for weight, edge, target in out_arcs(graph, nodes[-1])
            if target not in nodes
        ]
    return paths


def fewest_waypoints(graph: RoadGraph, route: Route) -> int:
    """Smallest number of waypoints, by trying all of them."""
    nodes, edges = route.nodes.tolist(), route.edges.tolist()
    best = [1] + [len(nodes) + 1] * (len(nodes) - 1)
    for first in range(len(nodes)):
        paths = canonical_paths(graph, nodes[first])
        for last in range(first + 1, len(nodes)):
            path = paths.get(nodes[last])
            canonical = (
                path is not None
                and path[1] == tuple(nodes[first : last + 1])
                and path[2] == tuple(edges[first:last])
            )
            if canonical or last == first + 1:
                best[last] = min(best[last], best[first] + 1)
    return best[-1]


def random_walk(graph: RoadGraph, choices: list[int]) -> Route:
    """A walk of stops, gaps and arcs that any numbers choose."""
    nodes, edges = [choices[0] % len(graph)], []
    for choice in choices[1:]:
        arcs = out_arcs(graph, nodes[-1])
        kind = choice % 16
        if kind == 0 or (not arcs and kind > 1):
            nodes.append(nodes[-1])
            edges.append(STOP)
        elif kind == 1:
            nodes.append(choice // 16 % len(graph))
            edges.append(GAP)
        else:
            _, edge, target = arcs[choice // 16 % len(arcs)]
            nodes.append(target)
            edges.append(edge)
    return Route(np.array(nodes, np.int32), np.array(edges, np.int32))


@st.composite
def random_maps(draw: st.DrawFn, max_nodes: int = 8) -> RoadGraph:
    """Maps with ties, parallel and one-way edges, self-loops, coinciding and isolated nodes."""
    size = draw(st.integers(1, max_nodes))
    nodes = draw(
        st.lists(st.tuples(st.integers(0, 3), st.integers(0, 2)), min_size=size, max_size=size)
    )
    ends = st.integers(0, size - 1)
    edges = draw(st.lists(st.tuples(ends, ends), max_size=2 * size))
    oneway = draw(st.lists(st.booleans(), min_size=len(edges), max_size=len(edges)))
    lengths = draw(
        st.none() | st.lists(st.integers(0, 4), min_size=len(edges), max_size=len(edges))
    )
    return build_road_graph(
        nodes, np.array(edges, np.int32).reshape(-1, 2), lengths=lengths, oneway=oneway
    )


@st.composite
def maps_with_walks(
    draw: st.DrawFn, max_nodes: int = 8, max_segments: int = 30
) -> tuple[RoadGraph, Route]:
    """A random map and a walk on it."""
    graph = draw(random_maps(max_nodes))
    choices = draw(st.lists(st.integers(0, 4000), min_size=1, max_size=max_segments))
    return graph, random_walk(graph, choices)
