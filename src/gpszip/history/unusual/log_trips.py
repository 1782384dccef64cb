"""Trips of a log, with their travel on and off the map.

They are those of :mod:`gpszip.history.trips`. As positions tell stays, travel off the map belongs
to a trip, too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from gpszip.history.stays.values import TripSpans
from gpszip.history.traversals import Traversals
from gpszip.history.trips import MIN_STOP
from gpszip.model import Track

__all__ = ["LogTrip", "OffMap", "list_trips"]

#: Metres off the map that count; less are errors of the receiver beside its roads. On small maps,
#: they are so many times the distance at which the map ends.
_MIN_METRES, _MIN_REACHES = 100.0, 10.0

#: The fewest metres that count on any map. A single sample off the map makes two steps: 2 m of a
#: robot at 1 m/s with a sample a second. Maps of simulated logs end millimetres from their edges.
_LEAST_METRES = 3.0

#: Seconds by which times of traversals may be off those of samples, which they are computed from.
_ROUNDING = 1e-3


#: Begin and end in seconds, samples and traversals of a trip.
_Part: TypeAlias = tuple[float, float, NDArray[np.int64], NDArray[np.int64]]


@dataclass(frozen=True)
class OffMap:
    """Travel off the map.

    Parameters
    ----------
    start, end : float
        Seconds from when to when.
    metres : float
        Length of the line of the samples, from where it leaves the map to where it comes back.
    position : float64 array, shape (d,)
        Position in the middle, in metres.
    """

    start: float
    end: float
    metres: float
    position: NDArray[np.float64]


@dataclass(frozen=True)
class LogTrip:
    """A trip of a log.

    Parameters
    ----------
    track : int
        Track of the log.
    start, end : float
        Seconds of its first and last sample.
    rows : int64 array, shape (k,)
        Its traversals.
    off_map : tuple of OffMap
        Its travel off the map.
    """

    track: int
    start: float
    end: float
    rows: NDArray[np.int64]
    off_map: tuple[OffMap, ...]


def list_trips(
    tracks: Sequence[Track],
    traversals: Traversals,
    found: TripSpans | None = None,
    reach: float = math.inf,
) -> Iterator[LogTrip]:
    """List the trips of each track, and find their travel off the map.

    Parameters
    ----------
    tracks : sequence of Track
        A log with times.
    traversals : Traversals
        Its traversals; ``traversals.track`` are indices of ``tracks``.
    found : TripSpans, optional
        Trips by positions. Without, and in tracks without stays and trips, they end with stops on
        an edge, and gaps, of five minutes or more.
    reach : float, default infinite
        Metres from all edges at which the map ends.
    """
    least = min(_MIN_METRES, max(_LEAST_METRES, _MIN_REACHES * reach))
    spans: dict[str, list[tuple[float, float]]] = {}
    if found is not None:
        spans = {name: [] for name in found.tracks}
        for name, start, end in found.trips:
            spans[name].append((start, end))
    bounds = np.searchsorted(traversals.track, np.arange(len(tracks) + 1))
    for number, track in enumerate(tracks):
        rows = np.arange(bounds[number], bounds[number + 1])
        times = np.asarray(track.times, np.float64)
        cut = spans.get(track.id)
        parts = (
            _by_stops(times, traversals, rows)
            if cut is None
            else _by_spans(times, traversals, rows, sorted(cut))
        )
        for start, end, samples, own in parts:
            off_map = tuple(_off_map(track, samples, traversals, own, least))
            yield LogTrip(number, start, end, own, off_map)


def _by_spans(
    times: NDArray[np.float64],
    traversals: Traversals,
    rows: NDArray[np.int64],
    spans: Sequence[tuple[float, float]],
) -> Iterator[_Part]:
    """Parts of a track in some time ranges; a traversal belongs to the last one that it meets."""
    starts = np.array([start for start, _ in spans])
    of_row = np.searchsorted(starts, traversals.leave[rows]) - 1
    for number, (start, end) in enumerate(spans):
        first = np.searchsorted(times, start)
        after = np.searchsorted(times, end, side="right")
        own = rows[(of_row == number) & (traversals.enter[rows] < end)]
        yield start, end, np.arange(first, after), own


def _by_stops(
    times: NDArray[np.float64], traversals: Traversals, rows: NDArray[np.int64]
) -> Iterator[_Part]:
    """Parts of a track between its stops on edges, and gaps between its samples."""
    # Where they begin: with the track, after a gap, and after a stop.
    stood = np.nan_to_num(traversals.standing[rows]) >= MIN_STOP
    begins = np.concatenate((times[1:][np.diff(times) >= MIN_STOP], traversals.leave[rows[stood]]))
    begins = np.unique(np.append(times[0], begins[begins < times[-1]]))
    of_row = np.searchsorted(begins, traversals.enter[rows] + _ROUNDING, side="right") - 1
    of_sample = np.searchsorted(begins, times, side="right") - 1

    # What belongs to each.
    for number in range(len(begins)):
        samples = np.flatnonzero(of_sample == number)
        own = rows[np.maximum(of_row, 0) == number]
        if len(samples) < 2 and not len(own):
            continue
        span = times[samples] if len(samples) else traversals.enter[own]
        yield float(span[0]), float(span[-1]), samples, own


def _off_map(
    track: Track,
    samples: NDArray[np.int64],
    traversals: Traversals,
    rows: NDArray[np.int64],
    least: float,
) -> Iterator[OffMap]:
    """Travel of a trip of some metres or more while it is on no edge."""
    if len(samples) < 2:
        return

    # Intervals on the map: those of connected traversals.
    times = np.asarray(track.times, np.float64)[samples]
    positions = np.asarray(track.positions, np.float64)[samples]
    first = np.flatnonzero(traversals.starts[rows] | (np.arange(len(rows)) == 0))
    last = np.append(first[1:], len(rows)) - 1 if len(first) else first
    enter, leave = traversals.enter[rows[first]], traversals.leave[rows[last]]

    # What lies between them, with the samples at both ends.
    for start, end in zip(
        np.append(times[0], leave).tolist(), np.append(enter, times[-1]).tolist(), strict=True
    ):
        inside = np.flatnonzero((times >= start - _ROUNDING) & (times <= end + _ROUNDING))
        if end - start <= _ROUNDING or len(inside) < 2:
            continue
        line = positions[inside]
        metres = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
        if metres >= least:
            yield OffMap(start, end, metres, line[len(line) // 2])
