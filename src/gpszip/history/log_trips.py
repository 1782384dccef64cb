"""Trips of a log: its samples between gaps and stops, with their travel on and off the map."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.history.traversals import Traversals
from gpszip.history.trips import MIN_STOP
from gpszip.model import Track

__all__ = ["LogTrip", "OffMap", "list_trips"]

#: Seconds without a sample after which a new trip begins.
_MIN_GAP = 300.0

#: Metres off the map that count; less are errors of the receiver beside its roads.
_MIN_METRES = 100.0

#: Seconds by which times of traversals may be off those of samples, which they are computed from.
_ROUNDING = 1e-3


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


def list_trips(tracks: Sequence[Track], traversals: Traversals) -> Iterator[LogTrip]:
    """Cut each track at gaps and stops of five minutes or more, and find its travel off the map.

    Parameters
    ----------
    tracks : sequence of Track
        A log with times.
    traversals : Traversals
        Its traversals; ``traversals.track`` are indices of ``tracks``.
    """
    bounds = np.searchsorted(traversals.track, np.arange(len(tracks) + 1))
    for number, track in enumerate(tracks):
        rows = np.arange(bounds[number], bounds[number + 1])
        times = np.asarray(track.times, np.float64)

        # Trips begin with the track, after a gap, and after a stop.
        stood = np.nan_to_num(traversals.standing[rows]) >= MIN_STOP
        begins = np.concatenate(
            (times[1:][np.diff(times) >= _MIN_GAP], traversals.leave[rows[stood]])
        )
        begins = np.unique(np.append(times[0], begins[begins < times[-1]]))
        of_row = np.searchsorted(begins, traversals.enter[rows] + _ROUNDING, side="right") - 1
        of_sample = np.searchsorted(begins, times, side="right") - 1
        for trip in range(len(begins)):
            samples = np.flatnonzero(of_sample == trip)
            own = rows[np.maximum(of_row, 0) == trip]
            if len(samples) < 2 and not len(own):
                continue
            span = times[samples] if len(samples) else traversals.enter[own]
            yield LogTrip(
                number,
                float(span[0]),
                float(span[-1]),
                own,
                tuple(_off_map(track, samples, traversals, own)),
            )


def _off_map(
    track: Track, samples: NDArray[np.int64], traversals: Traversals, rows: NDArray[np.int64]
) -> Iterator[OffMap]:
    """Travel of a trip while it is on no edge."""
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
        if metres >= _MIN_METRES:
            yield OffMap(start, end, metres, line[len(line) // 2])
