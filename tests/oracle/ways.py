"""Cheapest paths over a small network, by trying all of them."""

import math


def cheapest(network, costs, start, end, turn_cost, u_turn_cost):
    """Cost of the cheapest path between two positions, each (directed road, offset).

    Tries all paths that use no directed road twice.
    """
    directed = range(2 * len(network))
    nodes = [
        [int(network.starts[a >> 1]), int(network.ends[a >> 1])][:: -1 if a % 2 else 1]
        for a in directed
    ]
    is_open = [bool((network.backward if a % 2 else network.forward)[a >> 1]) for a in directed]
    degree = [
        sum((pair[0] == node) + (pair[1] == node) for pair in nodes[::2])
        for node in range(len(network.nodes))
    ]

    def direction(a):
        line = network.road(a >> 1)[:: -1 if a % 2 else 1]
        step = line[1] - line[0]
        return step / math.hypot(*step)

    def cost_of_turn(a, b):
        if b == a ^ 1:
            return u_turn_cost
        if degree[nodes[a][1]] <= 2:
            return 0.0
        return turn_cost * (1 + float(direction(a ^ 1) @ direction(b)))

    def share(a, offset, *, leaving):
        """Share of a road behind a position (leaving), or before it."""
        length = float(network.lengths[a >> 1])
        metres_left = offset if a % 2 else length - offset
        return (metres_left if leaving else length - metres_left) / length

    least = math.inf

    def extend(a, total, used):
        """Try to end on road a, reached at ``total`` to its end, and all roads behind it."""
        nonlocal least
        for target, turn in ((end[0], 0.0), (end[0] ^ 1, u_turn_cost)):
            if a == target and len(used) > 1 and is_open[target]:
                unused = costs[a] * (1 - share(a, end[1], leaving=False))
                least = min(least, total - unused + turn)
        for b in directed:
            if b not in used and is_open[b] and nodes[b][0] == nodes[a][1]:
                extend(b, total + cost_of_turn(a, b) + costs[b], used | {b})

    for a, turn in ((start[0], 0.0), (start[0] ^ 1, u_turn_cost)):
        if is_open[a] or turn == 0.0:
            extend(a, costs[a] * share(a, start[1], leaving=True) + turn, {a})
    return least
