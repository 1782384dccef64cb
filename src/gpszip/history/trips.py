"""What a trip is: travel from one stay to the next.

Stays and trips are those that ``gpszip trips`` finds in positions (:mod:`gpszip.history.stays`),
and a trip on edges has the traversals that share some of its time. So it goes on around pauses, off
the map, and in a gap that travel explains, and it ends with a stay, or a gap that hides one.

A stay is a place of 100 m. What never leaves such places, as a robot in a building, has no trips
between them. If less than half of the travel of an archive lies in trips between places, trips end
where an agent stands on an edge for five minutes, and with a gap as long.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.history.stays.find import spans_of_archive, spans_of_log
from gpszip.history.stays.values import TripSpans
from gpszip.history.traversals import History, Traversals
from gpszip.model import Network, Track
from gpszip.model.trips import Trips

__all__ = [
    "MIN_STOP",
    "TripRows",
    "choose_trips",
    "cut_trips",
    "lead_to_places",
    "nearest_ends",
    "spans_of_tracks",
    "trips_of_history",
]

#: Seconds for which an agent stands where a trip ends, and of a gap that ends one.
MIN_STOP = 300.0

#: Share of the metres of an archive in trips from place to place, from which places count.
_MIN_SHARE = 0.5

#: Traversals of an archive, and tracks, that tell this share, about: 0.3 s of CPU.
_SAMPLED, _SAMPLED_TRACKS = 20_000, 16

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class TripRows:
    """Trips as slices of traversals.

    Parameters
    ----------
    first, after : int64 array, shape (t,)
        Trip i has the traversals ``first[i]`` to ``after[i] - 1``.
    of : int64 array, shape (n,)
        Trip of each traversal; -1 for travel in a stay, such as the drift of a receiver.
    times : float64 array, shape (t, 2)
        Seconds at which each begins and ends; NaN without times.
    by_places : bool
        Whether they lead from place to place.
    """

    first: Ints
    after: Ints
    of: Ints
    times: Floats
    by_places: bool

    def __len__(self) -> int:
        return len(self.first)


def trips_of_history(history: History) -> TripRows:
    """Cut the traversals of an archive into trips."""
    archive, rows = history.archive, history.traversals
    if archive is None or not archive.timed:
        return cut_trips(rows)
    return _cut_by_places(rows, spans_of_archive(archive, archive.ids))


def choose_trips(rows: Traversals, found: Trips | None) -> TripRows:
    """Cut traversals into trips from place to place, if these hold half of all travel."""
    if found is None:
        return cut_trips(rows)
    tracks = {stay.track for stay in found.stays} | {trip.track for trip in found.trips}
    trips = tuple((trip.track, trip.start, trip.end) for trip in found.trips)
    return _cut_by_places(rows, TripSpans(frozenset(tracks), trips))


def _cut_by_places(rows: Traversals, found: TripSpans) -> TripRows:
    is_half = _covers(rows.take(np.isin(rows.track, _sample_tracks(rows))), found)
    return cut_trips(rows, found if is_half else None)


def lead_to_places(history: History) -> bool:
    """Whether trips of an archive lead from place to place, as a sample of its tracks tells."""
    archive, rows = history.archive, history.traversals
    if archive is None or not archive.timed:
        return False
    tracks = _sample_tracks(rows)
    found = spans_of_archive(archive, [rows.ids[track] for track in tracks.tolist()])
    return _covers(rows.take(np.isin(rows.track, tracks)), found)


def spans_of_tracks(tracks: Sequence[Track], by_places: bool) -> TripSpans | None:
    """Trips of a log from place to place; None where those of an archive are others."""
    if not by_places or not any(track.timed for track in tracks):
        return None
    return spans_of_log(tracks)


def _sample_tracks(rows: Traversals) -> Ints:
    """Indices of some tracks from all over a log, or of all of a small one."""
    moving = np.unique(rows.track).astype(np.int64)
    share = min(_SAMPLED / max(len(rows), 1), 1.0)
    count = min(max(math.ceil(share * len(moving)), _SAMPLED_TRACKS), len(moving))
    return moving[np.linspace(0, len(moving) - 1, count).astype(np.int64)]


def _covers(rows: Traversals, found: TripSpans) -> bool:
    """Whether half of all travel lies in trips from place to place."""
    covered = float(rows.metres[_number_spans(rows, found.trips) >= 0].sum())
    return covered > 0 and covered >= _MIN_SHARE * float(rows.metres.sum())


def cut_trips(rows: Traversals, found: TripSpans | None = None) -> TripRows:
    """Cut traversals into trips.

    Parameters
    ----------
    rows : Traversals
        In the order of travel.
    found : TripSpans, optional
        Trips by positions. Without, and in tracks without stays and trips, they end where an
        agent stands for MIN_STOP seconds, on the last edge of its trip, and with a gap as long.

    Examples
    --------
    >>> track, edge, forward = np.zeros(4, np.int32), np.arange(4), np.ones(4, bool)
    >>> enter, leave = np.array([0.0, 60, 500, 560]), np.array([60.0, 500, 560, 620])
    >>> begin, end, standing = np.zeros(4), np.full(4, 600.0), np.array([0.0, 380, 0, 0])
    >>> starts = np.array([True, False, False, False])
    >>> rows = Traversals(
    ...     ("bus",), track, edge, forward, enter, leave, begin, end, standing, starts
    ... )
    >>> cut_trips(rows).of.tolist()
    [0, 0, 1, 1]
    """
    # A number for each trip; trips of positions come first.
    spans, known = ((), frozenset[str]()) if found is None else (found.trips, found.tracks)
    number = _number_spans(rows, spans)
    is_known = np.array([name in known for name in rows.ids], np.bool_)[rows.track]
    by_stops = np.cumsum(_begins(rows)) - 1 + len(spans)
    number = np.where(is_known, number, by_stops)

    # Trips in the order of their traversals, each without what lies beside it.
    inside = np.flatnonzero(number >= 0)
    is_first = np.diff(number[inside], prepend=-1) != 0
    first = inside[is_first]
    last = inside[np.append(np.flatnonzero(is_first)[1:], len(inside)) - 1] if len(first) else first
    of = np.full(len(rows), -1, np.int64)
    of[inside] = np.cumsum(is_first) - 1

    # From when to when.
    times = np.stack([rows.enter[first], rows.leave[last]], axis=1)
    by_position = np.flatnonzero(is_known[first])
    for trip in by_position.tolist():
        times[trip] = spans[int(number[first[trip]])][1:]
    return TripRows(first, last + 1, of, times, found is not None)


def _begins(rows: Traversals) -> NDArray[np.bool_]:
    """Whether a trip begins with each traversal: at a track's start, after a stop or a gap."""
    n = len(rows)
    stood = np.append(True, np.nan_to_num(rows.standing) >= MIN_STOP)[:n]
    is_other = np.append(True, np.diff(rows.track) != 0)[:n]
    gap = np.append(0.0, np.nan_to_num(rows.enter[1:] - rows.leave[:-1]))[:n]
    begins: NDArray[np.bool_] = stood | is_other | (gap >= MIN_STOP)
    return begins


def _number_spans(rows: Traversals, spans: Sequence[tuple[str, float, float]]) -> Ints:
    """Last span with which each traversal has some time in common, shape (n,); -1 for none."""
    # Spans by their tracks.
    by_track: dict[str, list[tuple[float, float, int]]] = {}
    for i, (name, start, end) in enumerate(spans):
        by_track.setdefault(name, []).append((start, end, i))

    # The last one that begins before each traversal ends.
    number = np.full(len(rows), -1, np.int64)
    bounds = np.searchsorted(rows.track, np.arange(len(rows.ids) + 1)).tolist()
    for track, id in enumerate(rows.ids):
        if id not in by_track:
            continue
        own = sorted(by_track[id])
        starts, ends, numbers = (np.array(each) for each in zip(*own, strict=True))
        part = slice(bounds[track], bounds[track + 1])
        last = np.searchsorted(starts, rows.leave[part]) - 1
        is_inside = (last >= 0) & (rows.enter[part] < ends[last])
        number[part] = np.where(is_inside, numbers[last], -1)
    return number


def nearest_ends(network: Network, traversals: Traversals, rows: Ints) -> Ints:
    """Node nearest to the place at which each of some traversals ends."""
    edge = traversals.edge[rows]
    is_past_middle = traversals.end[rows] > 0.5 * network.lengths[edge]
    nodes: NDArray[np.int64] = np.where(is_past_middle, network.ends[edge], network.starts[edge])
    return nodes.astype(np.int64)
