"""Logs with the positions between their samples filled in along roads, as chapter 5.2 has them."""

from __future__ import annotations

from gpszip.matching.patch import patch
from gpszip.model import Network, Track

__all__ = ["patched"]


def patched(track: Track, network: Network, interval: float) -> Track:
    """Return a track with samples along roads wherever two are farther apart than an interval.

    Where no plausible path explains the time between two samples, none are added.

    Parameters
    ----------
    track : Track
        n samples with times.
    network : Network
        Roads on the same plane.
    interval : float
        Seconds.

    Examples
    --------
    >>> from gpszip.testing import ring
    >>> log = ring(12, laps=3, samples=20, noise=1.0)
    >>> samples = [*range(100), *range(180, len(log))]
    >>> track = Track("0", log.tracks[0].times[samples], log.tracks[0].positions[samples])
    >>> len(patched(track, log.network, 10.0)) - len(track)
    80
    """
    (filled,) = patch(track, network, gap=interval).to_tracks()
    return Track(filled.id, filled.times, filled.positions, plane=filled.plane)
