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

#: Samples in a row that share an error, at one sample a second.
_CORRELATED_SAMPLES = 5.0

#: Multiple of the fastest road's speed that nobody exceeds.
_MAX_SPEED_FACTOR = 3.0


class Matcher(LiveMatcher):
    """Follows one agent over roads or over the map of an archive, sample by sample.

    Parameters
    ----------
    map : Network, Archive or path
        The roads: a network, or the clean map of an archive.
    scales : Scales, optional
        Error and speeds of the log, best from an earlier one:
        ``gpszip.match(earlier, map).scales``. By default those of vehicles with a receiver for a
        network in degrees; for an archive, what its error and speeds suggest.
    lag : int, default 100
        Samples are finalised as soon as no later one can change them, at the latest after so
        many samples at different positions.
    gap : float, default 120.0
        Gaps longer than this, in seconds, break the route.

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
            map, scales = _roads_and_scales(archive, scales)
        super().__init__(map, scales, lag=lag, gap=gap)


def _roads_and_scales(archive: Archive, scales: Scales | None) -> tuple[Network, Scales]:
    """An archive's clean map as a network, and the scales that the archive suggests."""
    from gpszip.pipeline.match import read_network

    # Read the clean map as roads; scales that the user gave need no estimate.
    network = read_network(archive, plane=archive.grid.plane).network
    if scales is not None:
        return network, scales

    # The grid's step is about the error that the archive keeps.
    error = step_size(archive.grid.space)
    speeds = network.speeds[np.isfinite(network.speeds)]
    if len(speeds):
        median_speed, max_speed = float(np.median(speeds)), float(speeds.max())
    else:
        median_speed, max_speed = 0.0, math.inf
    return network, Scales(
        error, _CORRELATED_SAMPLES * error, error, median_speed, _MAX_SPEED_FACTOR * max_speed
    )
