"""A first look at many trips: how rare the turns of each are, by the last few edges alone.

Scoring a trip takes 0.2 ms for each of its edges. So of very many trips, those are scored whose
turns are the rarest at a first look, which takes a hundredth of that.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.history.prediction.contexts import context_keys, label_keys
from gpszip.history.traversals import Traversals

__all__ = ["quick_bits", "rarest_parts"]

#: Numbers of last edges by which a turn is looked up.
_ORDERS = (1, 2, 4, 8)

#: How much the estimate of fewer edges counts, in passes, and the estimate of none.
_PRIOR_PASSES, _NO_EDGE = 1.0, 0.2

#: Turns of a part, as of the scored ones.
_TURNS = 13

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


def quick_bits(rows: Traversals, known: Mask) -> Floats:
    """Bits of each traversal by the ones before it, shape (n,); 0 for the first of a route.

    With n passes of the last k edges, m of which went on as this one,
    ``p[k] = (m + p[k-1]) / (n + 1)``, and ``p[0] = 0.2``.

    Parameters
    ----------
    rows : Traversals
        All of them.
    known : bool array, shape (n,)
        Those that count.
    """
    # Moments: what followed, and whether it teaches.
    follows = rows.follows
    following = label_keys(rows.directed, 1)[follows]
    teaches = known[follows] & known[follows - 1]
    chance = np.full(len(follows), _NO_EDGE)
    for order, keys, is_whole in context_keys(rows.directed, rows.starts):
        if order not in _ORDERS:
            continue
        before = keys[follows - 1]
        passes = _count(before, teaches)
        same = _count(before * np.uint64(3) + following, teaches)
        mixed = (same + _PRIOR_PASSES * chance) / (passes + _PRIOR_PASSES)
        chance = np.where(is_whole[follows - 1], mixed, chance)
    bits = np.zeros(len(rows))
    bits[follows] = -np.log2(chance)
    return bits


def _count(keys: NDArray[np.uint64], counts: Mask) -> NDArray[np.int64]:
    """How many moments that count share the key of each, shape (n,)."""
    _, group = np.unique(keys, return_inverse=True)
    totals = np.bincount(group[counts], minlength=int(group.max(initial=-1)) + 1)
    return totals[group]


def rarest_parts(bits: Floats, first: NDArray[np.int64]) -> Floats:
    """Most bits of 13 successive traversals of each trip, shape (t,).

    Parameters
    ----------
    bits : float64 array, shape (n,)
        Of each traversal, trip after trip.
    first : int64 array, shape (t,)
        First traversal of each trip.

    Examples
    --------
    >>> bits = np.array([1.0] * 20 + [0, 5, 0])
    >>> rarest_parts(bits, np.array([0, 20])).tolist()
    [13.0, 5.0]
    """
    # Sums up to each traversal, less those before the last 13 or before its trip.
    total = np.append(0.0, np.cumsum(bits))
    sizes = np.diff(np.append(first, len(bits)))
    begin = np.maximum(np.arange(len(bits)) + 1 - _TURNS, np.repeat(first, sizes))
    rarest: Floats = np.maximum.reduceat(total[1:] - total[begin], first)
    return rarest
