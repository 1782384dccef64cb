"""Counts of what followed each context: in all of a history, and before each moment of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "CLASS_COUNTS",
    "KINDS",
    "Groups",
    "count_all",
    "count_before",
    "group_contexts",
    "kinds_of_counts",
]

#: Largest counts of the classes 1 to 4 of a context; class 5 has more, and class 0 none.
CLASS_COUNTS = (1, 3, 10, 40)

#: Classes of counts: none, 1 to 5 with several followers, 6 to 10 with only one.
KINDS = 11

Counts = NDArray[np.float64]


class Groups(NamedTuple):
    """Moments grouped by their context.

    Parameters
    ----------
    moments : int64 array, shape (m,)
        Moments that have a context, increasing.
    group : int64 array, shape (m,)
        Group of each.
    keys : uint64 array, shape (g,)
        Key of each group's context, increasing.
    first : int64 array, shape (g,)
        A moment of each group.
    """

    moments: NDArray[np.int64]
    group: NDArray[np.int64]
    keys: NDArray[np.uint64]
    first: NDArray[np.int64]


def group_contexts(keys: NDArray[np.uint64], has_context: NDArray[np.bool_]) -> Groups:
    """Group moments by the keys of their contexts, both of shape (n,)."""
    moments = np.flatnonzero(has_context)
    unique, first, group = np.unique(keys[moments], return_index=True, return_inverse=True)
    return Groups(moments, group, unique, moments[first])


def count_all(groups: Groups, chosen: NDArray[np.int64], exits: int) -> Counts:
    """Count how often each exit followed each context.

    Parameters
    ----------
    groups : Groups
        Moments by context.
    chosen : int64 array, shape (n,)
        Exit taken at each moment, -1 for none.
    exits : int
        Largest number of exits D.

    Returns
    -------
    float64 array, shape (g, D)

    Examples
    --------
    >>> groups = group_contexts(np.array([7, 9, 7, 7], np.uint64), np.ones(4, bool))
    >>> count_all(groups, np.array([0, 1, 0, 1]), 2).tolist()
    [[2.0, 1.0], [0.0, 1.0]]
    """
    exit_taken = chosen[groups.moments]
    known = exit_taken >= 0
    cell = groups.group[known] * exits + exit_taken[known]
    counts = np.bincount(cell, minlength=len(groups.keys) * exits).astype(np.float64)
    return counts.reshape(-1, exits)


def count_before(
    groups: Groups, chosen: NDArray[np.int64], exits: int, asked: NDArray[np.int64]
) -> Counts:
    """Count how often each exit followed a context before some moments.

    Parameters
    ----------
    groups, chosen, exits
        As for :func:`count_all`, with moments in the order of time.
    asked : int64 array, shape (a,)
        Moments.

    Returns
    -------
    float64 array, shape (a, D)
        Counts up to the moment, which is not counted itself; 0 without a context.

    Examples
    --------
    >>> groups = group_contexts(np.array([7, 9, 7, 7], np.uint64), np.ones(4, bool))
    >>> count_before(groups, np.array([0, 1, 0, 1]), 2, np.array([2, 3])).tolist()
    [[1.0, 0.0], [2.0, 0.0]]
    """
    # The moments of each group side by side, in the order of time.
    order = np.argsort(groups.group, kind="stable")
    exit_taken = chosen[groups.moments[order]]
    taken = np.zeros((len(order), exits))
    known = np.flatnonzero(exit_taken >= 0)
    taken[known, exit_taken[known]] = 1.0

    # Sums before each, less those before its group.
    total = np.cumsum(taken, axis=0) - taken
    group = groups.group[order]
    begin = np.searchsorted(group, np.arange(len(groups.keys)))
    row = np.full(len(chosen), -1)
    row[groups.moments[order]] = np.arange(len(order))
    rows = row[asked]
    counts = np.zeros((len(asked), exits))
    found = rows >= 0
    counts[found] = total[rows[found]] - total[begin[group[rows[found]]]]
    return counts


def kinds_of_counts(counts: Counts) -> NDArray[np.int64]:
    """Class of the counts in each row: how many there are, and whether one exit has them all.

    Examples
    --------
    >>> kinds_of_counts(np.array([[0, 0], [1, 0], [1, 1], [0, 50]])).tolist()
    [0, 6, 2, 10]
    """
    total = counts.sum(axis=1)
    kind = np.searchsorted(CLASS_COUNTS, total) + 1
    only_one = counts.max(axis=1, initial=0.0) == total
    return np.where(total == 0, 0, kind + np.where(only_one, len(CLASS_COUNTS) + 1, 0))
