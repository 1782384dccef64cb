"""How the edges of an archive's map are used, and how likely other logs are there."""

from __future__ import annotations

from collections.abc import Sequence

from gpszip.archive import Archive
from gpszip.history.transitions import RouteLikelihood
from gpszip.history.traversals import match_traversals, read_history
from gpszip.history.usage import Usage, measure_usage
from gpszip.model import Track
from gpszip.pipeline.match import network_for

__all__ = ["log_likelihood", "usage"]


def usage(archive: Archive, *, by: Sequence[str], timezone: str | None) -> Usage:
    """Count how the edges of an archive's map are used; see :func:`gpszip.usage`."""
    return measure_usage(read_history(archive), by, timezone)


def log_likelihood(found: Usage, archive: Archive, tracks: Sequence[Track]) -> RouteLikelihood:
    """How likely the transitions of a log are under the Markov model of an archive.

    Raises
    ------
    InputError
        If the log is elsewhere.
    """
    # The log is matched to the same edges, whose numbers don't depend on it.
    network = network_for(tracks, archive)
    owners = list(range(len(tracks)))
    ids = tuple(track.id for track in tracks)
    return found.markov.likelihood(match_traversals(tracks, network, ids, owners))
