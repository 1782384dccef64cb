"""What is usual in an archive: turns, paths, paces and stops, for comparison with new trips."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.history.groups import sum_by
from gpszip.history.traversals import Traversals
from gpszip.model import Network

__all__ = ["Paces", "Stops", "learn_paces", "learn_stops", "pace_groups"]

#: Share of an edge, and metres, below which a traversal tells no pace.
_MIN_SHARE, _MIN_METRES = 0.5, 20.0

#: Traversals that the pace of all edges counts for on one edge, and about one hour.
_EDGE_PRIOR, _HOUR_PRIOR = 3.0, 50.0

#: Expected seconds of the parts whose paces are compared: over less, errors of positions show.
_PART_SECONDS = 60.0

#: Quantiles from which the tail of paces is extrapolated; shares beyond them.
_TAIL = (0.9, 0.99)

#: Least scale of a tail, in logarithms of the pace.
_MIN_SCALE = 0.02

#: Most bits of a pace or a stop.
_MAX_BITS = 40.0

#: Hours of the day, and one for unknown.
_HOURS = 25

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Paces(NamedTuple):
    """Expected seconds per metre of travel, without standing, and how far drives are off.

    Parameters
    ----------
    edge : float64 array, shape (2 E,)
        Logarithm of the seconds per metre on each directed edge.
    hour : float64 array, shape (25,)
        What is added in each hour of the day; the last one is for unknown hours.
    slow, fast : tuple of (float, float)
        Quantiles at 90 and 99 % of how much slower and faster parts of drives are, in logarithms.
    """

    edge: Floats
    hour: Floats
    slow: tuple[float, float]
    fast: tuple[float, float]

    def expected(self, directed: Ints, hour: Ints) -> Floats:
        """Expected seconds per metre, shape (n,)."""
        expected: Floats = np.exp(self.edge[directed] + self.hour[hour])
        return expected

    def bits(self, ratio: float) -> float:
        """Bits of a part of a drive by its observed over expected seconds.

        Beyond the quantile q of 90 %, ``p(x) = 0.1 * 10**(-(x - q) / s)`` with s from there to the
        quantile of 99 %.
        """
        off = math.log(ratio)
        low, high = self.slow if off > 0 else self.fast
        beyond = max(0.0, (abs(off) - low) / max(high - low, _MIN_SCALE))
        return min(_MAX_BITS, (1.0 + beyond) * math.log2(10.0)) if beyond else 0.0


def learn_paces(network: Network, rows: Traversals, hours: Ints) -> Paces | None:
    """Learn the pace of each edge and hour; None if no track has times.

    Parameters
    ----------
    network : Network
        The edges.
    rows : Traversals
        Of an archive.
    hours : int64 array, shape (n,)
        Hour of the day of each, -1 where unknown.
    """
    # Logarithms of the seconds per metre of traversals of most of an edge.
    told = np.flatnonzero(_tells_pace(network, rows))
    if not len(told):
        return None
    directed, hour = rows.directed[told], hours[told]
    pace = np.log(_moving(rows)[told] / rows.metres[told])

    # Means by edge, drawn to that of all, and by hour of what is left.
    overall = float(np.median(pace))
    size = 2 * len(network)
    count = np.bincount(directed, minlength=size)
    edge = (sum_by(directed, pace, size) + _EDGE_PRIOR * overall) / (count + _EDGE_PRIOR)
    left = pace - edge[directed]
    hour_count = np.bincount(hour % _HOURS, minlength=_HOURS)
    effect = sum_by(hour % _HOURS, left, _HOURS) / (hour_count + _HOUR_PRIOR)

    # How far parts of drives are off.
    paces = Paces(edge, effect, (0.0, 1.0), (0.0, 1.0))
    _, _, observed, expected = pace_groups(network, rows, hours, paces)
    off = np.log(observed / expected)
    slow = np.quantile(np.maximum(off, 0.0), _TAIL).tolist() if len(off) else [0.5, 1.0]
    fast = np.quantile(np.maximum(-off, 0.0), _TAIL).tolist() if len(off) else [0.5, 1.0]
    return paces._replace(slow=(slow[0], slow[1]), fast=(fast[0], fast[1]))


def pace_groups(
    network: Network, rows: Traversals, hours: Ints, paces: Paces
) -> tuple[Ints, Ints, Floats, Floats]:
    """Parts of drives of a minute or more.

    Returns
    -------
    first, last : int64 array, shape (g,)
        First and last traversal of each part.
    observed, expected : float64 array, shape (g,)
        Seconds of travel, without standing.
    """
    # Expected seconds from the start of each piece; a part is over when a minute is.
    told = np.flatnonzero(_tells_pace(network, rows))
    rates = paces.expected(rows.directed[told], hours[told])
    expected = rates * rows.metres[told]
    piece = np.cumsum(rows.starts)[told]
    begun = np.cumsum(expected) - expected
    _, first_of_piece, of = np.unique(piece, return_index=True, return_inverse=True)
    minute = ((begun - begun[first_of_piece][of]) // _PART_SECONDS).astype(np.int64)

    # Sums of each part, without those that a piece ended early.
    is_new = np.append(True, (np.diff(piece) != 0) | (np.diff(minute) != 0))[: len(told)]
    part = np.cumsum(is_new) - 1
    parts = int(is_new.sum())
    sums = sum_by(part, expected, parts)
    took = sum_by(part, _moving(rows)[told], parts)
    first = told[is_new]
    last = told[np.append(np.flatnonzero(is_new)[1:], len(told)) - 1] if parts else first
    is_long = sums >= 0.5 * _PART_SECONDS
    return first[is_long], last[is_long], took[is_long], sums[is_long]


def _moving(rows: Traversals) -> Floats:
    """Seconds of each traversal without standing."""
    moving: Floats = rows.leave - rows.enter - rows.standing
    return moving


def _tells_pace(network: Network, rows: Traversals) -> NDArray[np.bool_]:
    """Whether each traversal is of most of an edge, with times, and no jump of the receiver."""
    moving = np.nan_to_num(_moving(rows))
    is_long = rows.metres >= np.maximum(_MIN_SHARE * network.lengths[rows.edge], _MIN_METRES)
    tells: NDArray[np.bool_] = is_long & (moving > 0) & ~rows.jumps
    return tells


class Stops(NamedTuple):
    """How long agents stood on each directed edge.

    Parameters
    ----------
    passes : int64 array, shape (2 E,)
        Traversals of each.
    seconds : dict of int to float64 array
        Seconds of standing on each edge on which anybody stood, increasing.
    everywhere : float64 array
        Seconds of standing of all traversals, increasing.
    """

    passes: Ints
    seconds: dict[int, Floats]
    everywhere: Floats

    def bits(self, edge: int, seconds: float) -> float:
        """Bits of standing so long or longer on a directed edge.

        With k of n agents who stood so long there, and a share g of them everywhere,
        ``p = (k + g) / (n + 1)``.
        """
        here = self.seconds.get(edge)
        so_long = 0 if here is None else len(here) - int(np.searchsorted(here, seconds))
        count = len(self.everywhere)
        anywhere = count - int(np.searchsorted(self.everywhere, seconds))
        share = (anywhere + 0.5) / (count + 1)
        return min(_MAX_BITS, -math.log2((so_long + share) / (float(self.passes[edge]) + 1)))


def learn_stops(network: Network, rows: Traversals) -> Stops:
    """Collect how long agents stood on each directed edge."""
    stood = np.nan_to_num(rows.standing)
    directed = rows.directed
    order = np.lexsort((stood, directed))
    order = order[stood[order] > 0]
    edges, begin = np.unique(directed[order], return_index=True)
    groups = np.split(stood[order], begin[1:]) if len(edges) else []
    return Stops(
        np.bincount(directed, minlength=2 * len(network)),
        dict(zip(edges.tolist(), groups, strict=True)),
        np.sort(stood),
    )
