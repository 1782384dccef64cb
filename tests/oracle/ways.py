"""All ways over a small network, one by one."""

import math


def cheapest(network, costs, start, end, turn, u_turn):
    """Price of the cheapest way from (directed road, offset) to another, by trying all that use no directed road twice."""
    best = [math.inf]
    lengths = network.lengths
    nodes = [
        [int(network.starts[road >> 1]), int(network.ends[road >> 1])][:: -1 if road % 2 else 1]
        for road in range(2 * len(network))
    ]
    open_ = [
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

    def price(a, b):
        if b == a ^ 1:
            return u_turn
        if degree[nodes[a][1]] <= 2:
            return 0.0
        cosine = float(-heading(a ^ 1) @ heading(b))
        return turn * (1 - cosine)

    def share(road, offset, leaving):
        length = float(lengths[road >> 1])
        ahead = offset if road % 2 else length - offset
        return (ahead if leaving else length - ahead) / length

    def go(road, total, used):
        for place, extra in ((end[0], 0.0), (end[0] ^ 1, u_turn)):
            if road == place and len(used) > 1 and open_[place]:
                best[0] = min(
                    best[0], total - costs[road] * (1 - share(road, end[1], False)) + extra
                )
        for other in range(2 * len(network)):
            if other not in used and open_[other] and nodes[other][0] == nodes[road][1]:
                go(other, total + price(road, other) + costs[other], used | {other})

    for road, extra in ((start[0], 0.0), (start[0] ^ 1, u_turn)):
        if open_[road] or extra == 0.0:
            go(road, costs[road] * share(road, start[1], True) + extra, {road})
    return best[0]
