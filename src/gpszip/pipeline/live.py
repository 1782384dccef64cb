"""Following an agent on a map while it moves."""

from __future__ import annotations

import math
import os

import numpy as np

from gpszip.archive import Archive, open_archive
from gpszip.errors import OptionError
from gpszip.history.prediction.paths import connect_roads
from gpszip.history.prediction.predictor import Predictor
from gpszip.history.prediction.read_route import tell_route
from gpszip.matching.live import LiveMatcher
from gpszip.model import Network
from gpszip.model.grid import step_size
from gpszip.model.match import Scales
from gpszip.model.prediction import NextRoad

__all__ = ["Matcher", "roads_and_scales"]

#: Samples in a row that share an error, at one sample a second.
_CORRELATED_SAMPLES = 5.0

#: Multiple of the fastest road's speed that nobody exceeds.
_MAX_SPEED_FACTOR = 3.0


class Matcher(LiveMatcher):
    """Follows one agent over roads or over the map of an archive, sample by sample.

    The roads that may come next have the probabilities of :class:`gpszip.Predictor` on the map of
    an archive, and those of the angles of their turns on a network.

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
    predictor : Predictor, optional
        Predicts the roads that come next, for an archive; by default one of that archive, which
        takes a few seconds for a large one. Matchers of many agents can share one.
    agent : str, optional
        Name of the agent: that of its track in the archive.

    Raises
    ------
    OptionError
        If a network is on a plane of its own and no scales are given, or the predictor knows other
        edges.

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
        predictor: Predictor | None = None,
        agent: str | None = None,
    ) -> None:
        # The roads of an archive, and what is known of the past on them.
        if not isinstance(map, Network):
            archive = map if isinstance(map, Archive) else open_archive(map)
            map, scales = roads_and_scales(archive, scales)
            if predictor is None:
                predictor = Predictor(archive)
        if predictor is not None and len(predictor.network) != len(map):
            raise OptionError(
                f"the predictor knows {len(predictor.network):,} edges, and the map has "
                f"{len(map):,}",
                remedy="give the archive of the predictor",
            )
        super().__init__(map, scales, lag=lag, gap=gap)
        self._predictor, self._agent = predictor, agent
        self._predicted: tuple[int, tuple[NextRoad, ...]] = (-1, ())

    def _roads_after(self, road: int, time: float) -> tuple[NextRoad, ...]:
        """Roads that may come next: by what followed this route before, else by angles."""
        if self._predictor is None:
            return super()._roads_after(road, time)

        # While the agent stays on its road, they are the same.
        if self._predicted[0] != road:
            roads = self._best_roads()
            if not roads or roads[-1] != road:
                roads = [road]
            route = connect_roads(roads, self._predictor.exits, self.index.network.lengths)
            following = self._predictor.next(tell_route(route), time, self._agent)
            self._predicted = road, tuple(following)
        return self._predicted[1]


def roads_and_scales(archive: Archive, scales: Scales | None) -> tuple[Network, Scales]:
    """An archive's clean map as a network, and the scales that the archive suggests.

    Parameters
    ----------
    archive : Archive
        With a map.
    scales : Scales or None
        Those of the user, which are returned then.
    """
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
        error,
        _CORRELATED_SAMPLES * error,
        error,
        median_speed,
        _MAX_SPEED_FACTOR * max_speed,
    )
