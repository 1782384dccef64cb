"""How unusual the trips of a log are, given an archive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gpszip.archive import Archive
from gpszip.errors import InputError
from gpszip.history.traversals import match_traversals, read_history
from gpszip.history.unusual.unusual import Usual, find_unusual
from gpszip.model import Track
from gpszip.model.unusual import Unusual
from gpszip.pipeline.match import network_for

__all__ = ["unusual"]


def unusual(
    tracks: Sequence[Track],
    archive: Archive,
    *,
    timezone: str | None = None,
    coded: bool = False,
) -> Unusual:
    """Score the trips of a log by what an archive knows; see :func:`gpszip.unusual`."""
    # Trips have times.
    untimed = next((track.id for track in tracks if not track.timed), None)
    if untimed is not None:
        raise InputError(
            f"track {untimed!r} has no times", remedy="give tracks with times; others have no trips"
        )

    # The log is matched to the edges of the archive, whose numbers don't depend on it.
    network = network_for(tracks, archive)
    ids = tuple(track.id for track in tracks)
    rows = match_traversals(tracks, network, ids, list(range(len(tracks))))
    found = find_unusual(Usual(read_history(archive), timezone), tracks, rows)
    return _with_coded_bits(found, tracks, archive) if coded else found


def _with_coded_bits(found: Unusual, tracks: Sequence[Track], archive: Archive) -> Unusual:
    """Add what the archive's coder takes for each trip and part."""
    from gpszip.pipeline.coded_bits import code_paths

    bits = code_paths(tracks, archive)
    trips = []
    for trip in found.trips:
        own = bits[trip.track]
        parts = [
            replace(part, coded_bits=own.between(part.start, part.end)) for part in trip.anomalies
        ]
        total = own.between(trip.start, trip.end)
        trips.append(replace(trip, anomalies=tuple(parts), coded_bits=total))
    return replace(found, trips=tuple(trips))
