"""Hidden Markov map matching: the roads that tracks took (Newson and Krumm 2009; thesis, chapters 5.2 and 7.1)."""

from __future__ import annotations

from collections.abc import Sequence

from gpszip.matching.result import Matching
from gpszip.model import Track
from gpszip.model.network import Network

__all__ = ["match"]


def match(
    tracks: Sequence[Track] | Track,
    network: Network,
    *,
    sigma: float | None = None,
    beta: float | None = None,
    gap: float | None = None,
) -> Matching:
    """Find the roads that tracks took.

    Parameters
    ----------
    tracks : sequence of Track, or one Track
        On the plane of the network.
    network : Network
        The roads.
    sigma, beta : float, optional
        Scales in metres, see :class:`~gpszip.matching.result.Match`; estimated from the log by default.
    gap : float, optional
        Silences longer than this, in seconds, are breaks; ``math.inf`` for none. Estimated by default.

    Returns
    -------
    Matching
    """
    raise NotImplementedError
