"""Map matching said plainly: every candidate of every layer, every pair of them, shortest ways over the whole network."""

import heapq
import math

import numpy as np


class Plain:
    """A network as directed roads: 2e is road e from its start to its end, 2e + 1 back."""

    def __init__(self, network):
        self.lines = [
            network.road(e)[:: -1 if way else 1] for e in range(len(network)) for way in (0, 1)
        ]
        self.length = [
            float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()) for line in self.lines
        ]
        self.open = [
            bool(one)
            for pair in zip(network.forward, network.backward, strict=True)
            for one in pair
        ]
        self.tail = [
            int(v) for pair in zip(network.starts, network.ends, strict=True) for v in pair
        ]
        self.head = [
            int(v) for pair in zip(network.ends, network.starts, strict=True) for v in pair
        ]
        self.outs = {
            v: [a for a in range(len(self.open)) if self.open[a] and self.tail[a] == v]
            for v in range(len(network.nodes))
        }

    def heading(self, a):
        step = self.lines[a][1] - self.lines[a][0]
        return step / np.linalg.norm(step)

    def cosine(self, a, metres, heading):
        """Cosine between a heading and the bit of a directed road just behind so many metres."""
        if heading is None:
            return 0.0
        steps = np.diff(self.lines[a], axis=0)
        ends = np.cumsum(np.linalg.norm(steps, axis=1))
        step = steps[min(int((ends <= metres + 1e-6).sum()), len(steps) - 1)]
        return float(heading @ step) / float(np.linalg.norm(step))

    def turn_cost(self, a, b, model):
        if b == a ^ 1:
            return model.u_turn_cost
        if len(self.outs[self.head[a]]) <= 2:
            return 0.0
        return 0.5 * model.turn_cost * (1 + float(self.heading(a ^ 1) @ self.heading(b)))

    def reached(self, a, rest, model):
        """(metres, turns) to the beginning of every directed road from ``rest`` metres before the end of one, cheapest first."""
        found, heap = (
            {},
            [
                (
                    rest + model.beta * self.turn_cost(a, b, model),
                    b,
                    rest,
                    self.turn_cost(a, b, model),
                )
                for b in self.outs[self.head[a]]
            ],
        )
        heapq.heapify(heap)
        while heap:
            _, b, metres, turns = heapq.heappop(heap)
            if b in found:
                continue
            found[b] = (metres, turns)
            for c in self.outs[self.head[b]]:
                m, t = metres + self.length[b], turns + self.turn_cost(b, c, model)
                heapq.heappush(heap, (m + model.beta * t, c, m, t))
        return found


def candidates(plain, place, model, heading=None):
    """(directed road, metres on it, price) of a layer; the last one is off the roads. ``heading`` is a vector, None for not known."""
    hits = []
    for e in range(0, len(plain.lines), 2):
        along = 0.0
        for p, q in zip(plain.lines[e][:-1], plain.lines[e][1:], strict=True):
            step = q - p
            share = (
                min(max(float(step @ (place - p)) / float(step @ step), 0.0), 1.0)
                if step.any()
                else 0.0
            )
            far = float(np.linalg.norm(place - p - share * step))
            if far <= model.search_radius:
                hits.append((far, e, along + share * float(np.linalg.norm(step))))
            along += float(np.linalg.norm(step))
    kept = []
    for far, e, offset in sorted(hits):
        if len(kept) < model.max_candidates and not any(
            e == other and abs(offset - at) <= model.search_radius for _, other, at in kept
        ):
            kept.append((far, e, offset))

    def turned(cosine):
        return 0.0 if heading is None else math.log(1 + model.heading_weight * (1 - cosine))

    out = [
        (a, offset, 0.5 * (far / model.sigma) ** 2 + turned(plain.cosine(e, offset, heading)))
        if a == e
        else (
            a,
            plain.length[e] - offset,
            0.5 * (far / model.sigma) ** 2 + turned(-plain.cosine(e, offset, heading)),
        )
        for far, e, offset in kept
        for a in (e, e ^ 1)
        if plain.open[a]
    ]
    return [*out, (-1, 0.0, model.off_road_cost + turned(0.0))]


def move(plain, ways, here, there, straight, longest, model):
    """Price of going from one candidate to another; ``ways`` are those from the first."""
    (a, u, _), (b, v, _) = here, there
    if a < 0 or b < 0:
        return 0.5 * model.jump_cost * ((a >= 0) + (b >= 0))
    prices = [model.jump_cost]
    if a == b and -model.backward_tolerance <= v - u <= longest:
        prices.append(abs(v - u - straight) / model.beta)
    if a == b ^ 1 and abs(plain.length[a] - v - u) <= longest:
        prices.append(abs(abs(plain.length[a] - v - u) - straight) / model.beta + model.u_turn_cost)
    if b in ways and ways[b][0] + v <= longest:
        metres, turns = ways[b][0] + v, ways[b][1]
        prices.append(abs(metres - straight) / model.beta + turns)
    return min(prices)


def first_least(scores):
    """The first of those that are least but for rounding."""
    return next(i for i, score in enumerate(scores) if score <= min(scores) + 1e-9)


def cheapest(network, places, times, model, headings=None):
    """Price of the cheapest chain through all places, the candidates on it, and a function that prices any other chain."""
    plain = Plain(network)
    layers = [
        candidates(plain, place, model, facing)
        for place, facing in zip(places, headings or [None] * len(places), strict=True)
    ]
    moves = []
    for k in range(1, len(places)):
        straight, seconds = (
            float(np.linalg.norm(places[k] - places[k - 1])),
            times[k] - times[k - 1],
        )
        longest = (
            min(
                model.max_speed * seconds,
                max(model.max_detour * straight, model.median_speed * seconds),
            )
            + model.length_tolerance
        )
        if (
            straight > model.max_speed * seconds + model.length_tolerance
        ):  # as good as the begin of another track
            moves.append([[0.0] * len(layers[k]) for _ in layers[k - 1]])
            continue
        ways = [
            {} if one[0] < 0 else plain.reached(one[0], plain.length[one[0]] - one[1], model)
            for one in layers[k - 1]
        ]
        moves.append(
            [
                [move(plain, way, a, b, straight, longest, model) for b in layers[k]]
                for way, a in zip(ways, layers[k - 1], strict=True)
            ]
        )
    score, backs = [one[2] for one in layers[0]], []
    for k in range(1, len(places)):
        best = [
            first_least([score[i] + moves[k - 1][i][j] for i in range(len(score))])
            for j in range(len(layers[k]))
        ]
        score = [score[i] + moves[k - 1][i][j] + layers[k][j][2] for j, i in enumerate(best)]
        backs.append(best)
    chosen = [first_least(score)]
    for best in backs[::-1]:
        chosen.append(best[chosen[-1]])
    chain = [layer[j] for layer, j in zip(layers, chosen[::-1], strict=True)]

    def price(roads):
        """Least price of a chain over these directed roads."""
        last = {j: one[2] for j, one in enumerate(layers[0]) if one[0] == roads[0]}
        for k in range(1, len(roads)):
            last = {
                j: min(at + moves[k - 1][i][j] for i, at in last.items()) + one[2]
                for j, one in enumerate(layers[k])
                if one[0] == roads[k]
            }
        return min(last.values(), default=math.inf)

    return min(score), chain, price
