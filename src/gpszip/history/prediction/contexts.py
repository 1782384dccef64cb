"""Contexts: the last edges of a route, each context as a key of 64 bits.

The key of the last k directed edges ``s[0]`` (the newest), ``s[1]``, ... is
``sum(m(s[j]) * r[j] for j < k) + o[k]`` modulo 2^64, with random numbers m, r and o. So the keys
of all orders come from one sum. Two of 10^6 contexts share a key with a probability of about
10^-7.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["MASK", "ORDERS", "context_keys", "label_keys", "route_keys"]

#: Numbers of edges that contexts hold. On shuttle buses, whose rounds have 20 to 30 edges, orders
#: above 8 still take 4 % off the bits of a decision.
ORDERS = (1, 2, 3, 4, 5, 6, 8, 12, 20)

#: Keys are sums modulo 2^64.
MASK = (1 << 64) - 1

Keys = NDArray[np.uint64]


def _mix(numbers: Keys) -> Keys:
    """Pseudo-random numbers, one for each number (Steele et al. 2014, splitmix64)."""
    mixed = numbers * np.uint64(0x9E3779B97F4A7C15) + np.uint64(0x632BE59BD9B4E019)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(mixed ^ (mixed >> np.uint64(31)), np.uint64)


#: Odd multiplier of each place in a context.
_PLACES: Keys = _mix(np.arange(1 << 32, (1 << 32) + max(ORDERS), dtype=np.uint64)) | np.uint64(1)

#: What tells contexts of different orders from each other.
_OF_ORDER: Keys = _mix(np.arange(1 << 33, (1 << 33) + len(ORDERS), dtype=np.uint64))

#: The same numbers for sums in Python.
_PLACE_NUMBERS: list[int] = _PLACES.tolist()
_ORDER_NUMBERS: dict[int, int] = dict(zip(ORDERS, _OF_ORDER.tolist(), strict=True))


def label_keys(labels: NDArray[np.int64], kind: int) -> Keys:
    """Key of each label of a kind, such as an edge, an agent or an hour.

    Parameters
    ----------
    labels : int64 array, shape (n,)
        Labels from -1 on.
    kind : int
        Labels of two kinds have different keys.
    """
    return _mix((labels + 1).astype(np.uint64) + (np.uint64(kind) << np.uint64(40)))


def context_keys(
    edges: NDArray[np.int64], starts: NDArray[np.bool_]
) -> Iterator[tuple[int, Keys, NDArray[np.bool_]]]:
    """Keys of the contexts of all orders at each edge of many routes, end to end.

    Parameters
    ----------
    edges : int64 array, shape (n,)
        Directed edges.
    starts : bool array, shape (n,)
        Whether a route begins with the edge.

    Yields
    ------
    order : int
        Number of edges in the context.
    keys : uint64 array, shape (n,)
        Keys of the contexts that end with each edge.
    is_whole : bool array, shape (n,)
        Whether the route is long enough for the context.

    Examples
    --------
    >>> edges, starts = np.array([4, 6, 4, 6]), np.array([True, False, False, False])
    >>> (_, ones, _), (_, twos, whole) = list(context_keys(edges, starts))[:2]
    >>> (ones[0] == ones[2]).item(), (twos[1] == twos[3]).item(), whole.tolist()
    (True, True, [False, True, True, True])
    """
    # Number of edges since the route began.
    index = np.arange(len(edges))
    depth = index - np.maximum.accumulate(np.where(starts, index, 0)) + 1

    # Add the edges of one place after the other.
    labels = label_keys(edges, 0)
    total = np.zeros(len(edges), np.uint64)
    for place in range(min(max(ORDERS), len(edges))):
        total[place:] += labels[: len(edges) - place] * _PLACES[place]
        order = place + 1
        if order in _ORDER_NUMBERS:
            yield order, total + _OF_ORDER[ORDERS.index(order)], depth >= order


def route_keys(labels: Sequence[int]) -> Iterator[tuple[int, int]]:
    """Orders and keys of the contexts at the end of one route.

    Parameters
    ----------
    labels : sequence of int
        Keys of the route's directed edges (:func:`label_keys`), the last edge last.

    Examples
    --------
    >>> edges = np.array([4, 6, 4, 6])
    >>> batch = [keys[-1].item() for _, keys, _ in context_keys(edges, edges < 0)]
    >>> batch == [key for _, key in route_keys(label_keys(edges, 0).tolist())]
    True
    """
    total = 0
    for place in range(min(len(_PLACE_NUMBERS), len(labels))):
        total += labels[-1 - place] * _PLACE_NUMBERS[place]
        number = _ORDER_NUMBERS.get(place + 1)
        if number is not None:
            yield place + 1, (total + number) & MASK
