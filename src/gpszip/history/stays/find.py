"""Stays, trips and places of a log in memory, or of an archive without its log."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive
from gpszip.errors import OptionError
from gpszip.geo.planes import to_plane
from gpszip.history.stays.collect import TrackSamples, collect_trips
from gpszip.history.stays.values import Settings
from gpszip.io.tables.roles import names_accuracy
from gpszip.model import Track
from gpszip.model.trips import Trips

__all__ = ["places_of_archive", "trips_of_archive", "trips_of_log"]

#: Seconds, and samples, in which a segment between knots is travel that was seen: a longer one may
#: bridge a gap that was too short to be one.
_SEEN_TRAVEL = 300.0
_SEEN_SAMPLES = 20.0

#: Attribute under which logs are read with the errors that they state.
_ACCURACY = "accuracy"


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
    timed = [track for track in tracks if track.timed]
    if not timed:
        raise OptionError("no track has times, so there are no stays and trips")
    return collect_trips(_LogTracks(timed), timed[0].plane, settings, timezone)


def trips_of_archive(archive: Archive, settings: Settings, timezone: str | None = None) -> Trips:
    """Find the stays and trips of an archive, track by track.

    Where it keeps a column of errors, the samples count, with these errors; else the knots.

    Parameters
    ----------
    archive : Archive
        With times.
    settings : Settings
        What counts as a stay and as a trip.
    timezone : str, optional
        Time zone of local hours.

    Raises
    ------
    OptionError
        If no track has times, or there is no such time zone.
    """
    if not archive.timed:
        raise OptionError("no track has times, so there are no stays and trips")
    kept = archive.kept_columns or ()
    accuracy = next((name for name in kept if names_accuracy(name)), None)
    error = 0.0 if archive.error_bound is None else archive.error_bound.metres
    tracks = _ArchiveTracks(archive, accuracy, error)
    return collect_trips(tracks, archive.grid.plane, settings, timezone)


def places_of_archive(archive: Archive) -> NDArray[np.float64]:
    """Centres of the places where a track of an archive stayed, in metres, shape (k, d)."""
    found = trips_of_archive(archive, Settings(), "UTC")
    positions = [place.position for place in found.places if place.visits]
    coordinates = np.array(positions, np.float64).reshape(-1, archive.grid.dimension)
    if archive.grid.plane is None:
        return coordinates
    return to_plane(coordinates[:, 0], coordinates[:, 1], archive.grid.plane)


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
    accuracy: str | None
    error: float

    def __iter__(self) -> Iterator[TrackSamples]:
        for id in self.archive.ids:
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
