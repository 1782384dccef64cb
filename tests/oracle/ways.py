"""All paths between two positions on a small network, one by one."""

import math


def cheapest(network, costs, start, end, turn, u_turn):
    """Cost of the cheapest path between two positions, by trying all.

    Positions are pairs of a directed road and an offset. Paths use no directed road twice.
    """
    best = [math.inf]
    lengths = network.lengths
    nodes = [
        [int(network.starts[road >> 1]), int(network.ends[road >> 1])][:: -1 if road % 2 else 1]
        for road in range(2 * len(network))
    ]
    is_open = [
        bool((network.backward if road % 2 else network.forward)[road >> 1])
        for road in range(2 * len(network))
    ]
    degree = [
        sum(node in pair for pair in nodes[::2])
        + sum(pair[0] == pair[1] == node for pair in nodes[::2])
        for node in range(len(network.nodes))
    ]

    def heading(road):
        line = network.road(road >> 1)[:: -1 if road % 2 else 1]
        step = line[1] - line[0]
        return step / math.hypot(*step)

    def turn_cost(a, b):
        if b == a ^ 1:
            return u_turn
        if degree[nodes[a][1]] <= 2:
            return 0.0
        cosine = float(-heading(a ^ 1) @ heading(b))
        return turn * (1 - cosine)

    def fraction(road, offset, leaving):
        length = float(lengths[road >> 1])
        ahead = offset if road % 2 else length - offset
        return (ahead if leaving else length - ahead) / length

    def follow(road, total, used):
        for last, extra in ((end[0], 0.0), (end[0] ^ 1, u_turn)):
            if road == last and len(used) > 1 and is_open[last]:
                remaining = costs[road] * (1 - fraction(road, end[1], False))
                best[0] = min(best[0], total - remaining + extra)
        for other in range(2 * len(network)):
            if other not in used and is_open[other] and nodes[other][0] == nodes[road][1]:
                follow(other, total + turn_cost(road, other) + costs[other], used | {other})

    for road, extra in ((start[0], 0.0), (start[0] ^ 1, u_turn)):
        if is_open[road] or extra == 0.0:
            follow(road, costs[road] * fraction(road, start[1], True) + extra, {road})
    return best[0]
