"""Stays, trips and places of a log in memory, or of an archive without its log."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive
from gpszip.errors import OptionError
from gpszip.geo.planes import to_plane
from gpszip.history.stays.collect import TrackSamples, collect_spans, collect_trips
from gpszip.history.stays.values import Settings, TripSpans
from gpszip.io.tables.roles import names_accuracy
from gpszip.model import Plane, Track
from gpszip.model.trips import Trips

__all__ = [
    "places_of_archive",
    "spans_of_archive",
    "spans_of_log",
    "trips_of_archive",
    "trips_of_log",
]

#: Seconds, and samples, in which a segment between knots is travel that was seen: a longer one may
#: bridge a gap that was too short to be one.
_SEEN_TRAVEL = 300.0
_SEEN_SAMPLES = 20.0

#: Attribute under which logs are read with the errors that they state.
_ACCURACY = "accuracy"

_NO_TIMES = "no track has times, so there are no stays and trips"


def trips_of_log(tracks: Sequence[Track], settings: Settings, timezone: str | None = None) -> Trips:
    """Find the stays and trips of tracks.

    Parameters
    ----------
    tracks : sequence of Track
        On one plane. The attribute ``accuracy``, where a track has one, is its errors in metres.
    settings : Settings
        What counts as a stay and as a trip.
    timezone : str, optional
        Time zone of local hours.

    Raises
    ------
    OptionError
        If no track has times, or there is no such time zone.
    """
    samples, plane = _log_samples(tracks)
    return collect_trips(samples, plane, settings, timezone)


def trips_of_archive(archive: Archive, settings: Settings, timezone: str | None = None) -> Trips:
    """Find the stays and trips of an archive, track by track.

    Where it keeps a column of errors, the samples count, with these errors; else the knots.

    Parameters
    ----------
    archive : Archive
        With times.
    settings, timezone
        As for :func:`trips_of_log`.

    Raises
    ------
    OptionError
        If no track has times, or there is no such time zone.
    """
    return collect_trips(
        _archive_samples(archive, archive.ids), archive.grid.plane, settings, timezone
    )


def spans_of_log(tracks: Sequence[Track]) -> TripSpans:
    """When the trips of tracks are, as :func:`trips_of_log` finds them."""
    samples, plane = _log_samples(tracks)
    return collect_spans(samples, plane, Settings())


def spans_of_archive(archive: Archive, ids: Sequence[str]) -> TripSpans:
    """When the trips of some tracks of an archive are, as :func:`trips_of_archive` finds them."""
    return collect_spans(_archive_samples(archive, ids), archive.grid.plane, Settings())


def places_of_archive(archive: Archive) -> NDArray[np.float64]:
    """Centres of the places where a track of an archive stayed, in metres, shape (k, d)."""
    found = trips_of_archive(archive, Settings(), "UTC")
    positions = [place.position for place in found.places if place.visits]
    coordinates = np.array(positions, np.float64).reshape(-1, archive.grid.dimension)
    if archive.grid.plane is None:
        return coordinates
    return to_plane(coordinates[:, 0], coordinates[:, 1], archive.grid.plane)


def _log_samples(tracks: Sequence[Track]) -> tuple[_LogTracks, Plane | None]:
    """Samples of the tracks with times, and their plane."""
    timed = [track for track in tracks if track.timed]
    if not timed:
        raise OptionError(_NO_TIMES)
    return _LogTracks(timed), timed[0].plane


def _archive_samples(archive: Archive, ids: Sequence[str]) -> _ArchiveTracks:
    """Samples or knots of some tracks of an archive."""
    if not archive.timed:
        raise OptionError(_NO_TIMES)
    kept = archive.kept_columns or ()
    accuracy = next((name for name in kept if names_accuracy(name)), None)
    error = 0.0 if archive.error_bound is None else archive.error_bound.metres
    return _ArchiveTracks(archive, tuple(ids), accuracy, error)


@dataclass(frozen=True, eq=False)
class _LogTracks:
    """Tracks of a log, which can be iterated twice."""

    tracks: Sequence[Track]

    def __iter__(self) -> Iterator[TrackSamples]:
        for track in self.tracks:
            accuracy = track.attributes.get(_ACCURACY)
            # A column of text holds no errors.
            is_number = accuracy is not None and accuracy.dtype.kind in "iuf"
            errors = np.asarray(accuracy, np.float64) if is_number else None
            yield TrackSamples(track.id, track.times, track.positions, errors)


@dataclass(frozen=True, eq=False)
class _ArchiveTracks:
    """Tracks of an archive, decoded one by one; they can be iterated twice."""

    archive: Archive
    ids: tuple[str, ...]
    accuracy: str | None
    error: float

    def __iter__(self) -> Iterator[TrackSamples]:
        for id in self.ids:
            pieces = self.archive.decompress(id)
            if not pieces[0].timed:
                continue
            if self.accuracy is not None:
                (samples,) = self.archive.samples(id)
                stated = np.asarray(samples.attributes[self.accuracy], np.float64)
                errors = np.where(stated > 0, np.hypot(stated, self.error), np.nan)
                yield TrackSamples(id, samples.times, samples.positions, errors, self.error)
                continue
            times = np.concatenate([piece.times for piece in pieces])
            positions = np.concatenate([piece.positions for piece in pieces])
            travel = max(_SEEN_TRAVEL, _SEEN_SAMPLES * (self.archive.sampling or 0.0))
            yield TrackSamples(id, times, positions, None, self.error, travel)
