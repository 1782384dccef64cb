"""Following an agent on a map while it moves."""

from __future__ import annotations

import math
import os

import numpy as np

from gpszip.archive import Archive, open_archive
from gpszip.matching.live import LiveMatcher
from gpszip.model import Network
from gpszip.model.grid import step_size
from gpszip.model.match import Scales

__all__ = ["Matcher"]

#: An archive's nodes lie on a lattice about as fine as its error; errors of samples in a row are alike, as at one sample a second.
_ALIKE = 5.0

#: Nobody is so many times as fast as is usual on the fastest road of a map.
_FASTER = 3.0


class Matcher(LiveMatcher):
    """Follows one agent over roads or over the map of an archive, one sample at a time.

    Parameters
    ----------
    map : Network, Archive or path
        The roads: those of a network, or the clean map of an archive or of an archive's file.
    scales : Scales, optional
        What is known of the log, best from an earlier one: ``gpszip.match(earlier, map).scales``. By default those of vehicles
        with a receiver for a network in degrees, and for an archive what its own error and speeds tell.
    lag : int, default 100
        Samples are settled as soon as no later one can change them, at the latest after so many that lie apart.
    gap : float, default 120.0
        Silences longer than this, in seconds, break the way.

    Raises
    ------
    OptionError
        If a network is on a plane of its own and no scales are given.

    Examples
    --------
    >>> from gpszip import Track, compress
    >>> rounds = Track("robot", range(40), [[abs(t % 20 - 10.0), 0.0] for t in range(40)])
    >>> matcher = Matcher(compress(rounds, max_error=0.1))
    >>> here = [matcher.push(t, [0.5 * t, 0.02]) for t in range(9)][-1]
    >>> here.off_map, round(here.distance, 2)
    (False, 0.02)
    """

    def __init__(
        self,
        map: Network | Archive | str | os.PathLike[str],
        scales: Scales | None = None,
        *,
        lag: int = 100,
        gap: float = 120.0,
    ) -> None:
        if not isinstance(map, Network):
            archive = map if isinstance(map, Archive) else open_archive(map)
            map, scales = _roads(archive, scales)
        super().__init__(map, scales, lag=lag, gap=gap)


def _roads(archive: Archive, scales: Scales | None) -> tuple[Network, Scales]:
    """An archive's map as a network, and the scales that it suggests."""
    from gpszip.pipeline.match import read_network

    network = read_network(archive, plane=archive.grid.plane).network
    error = step_size(archive.grid.space)
    speeds = network.speeds[np.isfinite(network.speeds)]
    usual, fastest = (
        (float(np.median(speeds)), _FASTER * float(speeds.max()))
        if len(speeds)
        else (0.0, math.inf)
    )
    return network, scales or Scales(error, _ALIKE * error, error, usual, fastest)
