"""Pairs of the times and positions of a track, which KML writes as two lists."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["COORD", "WHEN", "Rows", "pair_positions"]

#: Marks of the two lists in the order of the file.
WHEN = 0
COORD = 1

#: Indices of rows.
Rows = NDArray[np.intp]


def pair_positions(order: bytes) -> tuple[Rows, Rows]:
    """Pair times and positions.

    If there are as many of the one as of the other, the i-th time belongs to the i-th position, as
    KML 2.3 states. If their numbers differ, some are missing. Where they alternate, they are paired
    within each group that begins where the first kind comes again, so that one that is missing
    doesn't shift those after it. Where all times come first, there is one group, and those at the
    end of the longer list have no partner.

    Parameters
    ----------
    order : bytes
        :data:`WHEN` or :data:`COORD` for each element in the order of the file.

    Returns
    -------
    int array, shape (n,)
        Index of the time of each pair.
    int array, shape (n,)
        Index of its position.

    Examples
    --------
    >>> whens, coords = pair_positions(bytes([WHEN, COORD, WHEN, WHEN, COORD]))
    >>> whens.tolist(), coords.tolist()
    ([0, 1], [0, 1])
    >>> whens, coords = pair_positions(bytes([WHEN, COORD, COORD, WHEN, COORD]))
    >>> whens.tolist(), coords.tolist()
    ([0, 1], [0, 2])
    """
    # As many times as positions.
    kinds = np.frombuffer(order, np.uint8)
    is_when = kinds == WHEN
    count = int(is_when.sum())
    if 2 * count == len(kinds):
        rows = np.arange(count)
        return rows, rows

    # A group begins where an element of the first kind follows one of the other.
    begins = np.zeros(len(kinds), np.intp)
    begins[1:] = (kinds[1:] == kinds[:1]) & (kinds[:-1] != kinds[:1])
    groups = np.cumsum(begins)

    # Number the elements of each kind within their groups; equal numbers are a pair.
    whens, coords = (_number_in_groups(groups[kinds == kind]) for kind in (WHEN, COORD))
    span = len(kinds) + 1
    when_keys = groups[is_when] * span + whens
    coord_keys = groups[~is_when] * span + coords
    _, when_rows, coord_rows = np.intersect1d(
        when_keys, coord_keys, assume_unique=True, return_indices=True
    )
    return when_rows, coord_rows


def _number_in_groups(groups: Rows) -> Rows:
    """Number elements from 0 within each group; groups don't decrease."""
    starts = np.searchsorted(groups, groups)
    numbers: Rows = np.arange(len(groups)) - starts
    return numbers
