"""Plain twin of the mixture over orders: contexts as tuples, one exit after the other."""

import math


def kind_of(counts):
    total = sum(counts)
    if not total:
        return 0
    kind = 1 + sum(total > limit for limit in (1, 3, 10, 40))
    return kind + 5 if max(counts) == total else kind


def predict(weights, orders, own_orders, counts, cosines, route, options):
    """Probabilities by options, all of them directed edges.

    ``weights`` are the model's own, ``counts`` the followers of each context, a tuple, and
    ``cosines`` those of the turns to the options.
    """
    back = [1.0 if option == route[-1] ^ 1 else 0.0 for option in options]
    scores = [
        weights.straight * cosine + weights.turn_back * is_back
        for cosine, is_back in zip(cosines, back, strict=True)
    ]
    chain = [math.exp(1.5 * c - 4.0 * b) for c, b in zip(cosines, back, strict=True)]
    chain = [each / sum(chain) for each in chain]

    def add(seen, row):
        if sum(seen):
            for i, count in enumerate(seen):
                share = (count + 0.4) / (sum(seen) + 0.4 * len(seen))
                scores[i] += row[kind_of(seen)] * math.log(share)

    for row, order in zip(weights.orders.tolist(), orders, strict=True):
        followers = counts.get(tuple(route[-order:])) if len(route) >= order else None
        if followers:
            seen = [followers[option] for option in options]
            add(seen, row)
            escape = 0.7 * max(1, sum(count > 0 for count in seen))
            chain = [
                (n + escape * p) / (sum(seen) + escape) for n, p in zip(seen, chain, strict=True)
            ]
    for row, order in zip(weights.own.tolist(), own_orders, strict=True):
        if len(route) >= order:
            ends = [i for i in range(order, len(route)) if route[i - order : i] == route[-order:]]
            add([sum(route[i] == option for i in ends) for option in options], row)

    scores = [
        s + weights.chain * math.log(max(p, 1e-9)) for s, p in zip(scores, chain, strict=True)
    ]
    total = sum(math.exp(score) for score in scores)
    return [math.exp(score) / total for score in scores]
