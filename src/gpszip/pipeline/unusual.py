"""How unusual the trips of a log are, given an archive."""

from __future__ import annotations

from collections.abc import Sequence

from gpszip.archive import Archive
from gpszip.errors import InputError
from gpszip.history.traversals import match_traversals, read_history
from gpszip.history.unusual.unusual import Usual, find_unusual
from gpszip.model import Track
from gpszip.model.unusual import Unusual
from gpszip.pipeline.match import network_for

__all__ = ["unusual"]


def unusual(tracks: Sequence[Track], archive: Archive, *, timezone: str | None = None) -> Unusual:
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
    return find_unusual(Usual(read_history(archive), timezone), tracks, rows, network)
