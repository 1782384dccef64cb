"""What is known of the map of an archive, for all agents."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive
from gpszip.errors import InputError
from gpszip.geo.planes import PLANE_RADIUS, to_plane
from gpszip.history.prediction.predictor import Predictor
from gpszip.history.rounds import find_rounds
from gpszip.history.traversals import read_history
from gpszip.history.unusual.unusual import Usual
from gpszip.live.fix import Fix
from gpszip.matching.index import create_workspace, index_network
from gpszip.matching.live import LiveMatcher
from gpszip.model.match import Scales
from gpszip.model.prediction import NextRoad
from gpszip.model.projection import map_coordinates
from gpszip.model.rounds import Rounds
from gpszip.pipeline.live import roads_and_scales

__all__ = ["KnownMap"]

#: Time steps that a matcher keeps: most positions converge after few.
_LAG = 20

#: Beta as a multiple of the error. Errors of two fixes are their own, unlike those of an archive
#: that is within its bound. Of 452 edges of two shuttle buses, 172 are found with 1, 441 with 3.
_BETA = 3.0

#: Metres of stated accuracy beyond which a fix tells no edge.
_MAX_ACCURACY = 100.0

#: Metres by which fixes of a receiver that stands spread, and as a multiple of the error of fixes.
#: An agent that stays and spreads more moves within its place, as a robot on its rounds.
_STANDING, _STANDING_ERRORS = 25.0, 4.0

#: Metres from a plane's centre beyond which there is no map.
_MAX_DISTANCE = 2 * PLANE_RADIUS

#: Metres from the end of a trip that belong to its place, as for stays.
_NEAR = 100.0

Floats = NDArray[np.float64]


class _AgentMatcher(LiveMatcher):
    """A matcher that shares its workspace, and leaves predictions to others."""

    def __init__(self, known_map: KnownMap) -> None:
        super().__init__(known_map.index, known_map.scales, lag=_LAG)
        self._work = known_map.workspace

    def _roads_after(self, road: int, time: float) -> tuple[NextRoad, ...]:  # noqa: ARG002
        return ()


class KnownMap:
    """The roads of an archive, and how agents have travelled them.

    Parameters
    ----------
    archive : Archive
        With travel that repeats.
    scales : Scales, optional
        Error and speeds of the live positions; by default what the archive suggests.

    Raises
    ------
    InputError
        If nothing moves in the archive.
    """

    def __init__(self, archive: Archive, scales: Scales | None = None) -> None:
        # Roads.
        network, self.scales = roads_and_scales(archive, scales)
        if scales is None:
            self.scales = replace(self.scales, beta=_BETA * self.scales.error)
        self.index = index_network(network)
        self.network = network
        self.plane = archive.grid.plane
        # A workspace is as large as the map, so that all matchers share one.
        self.workspace = create_workspace(self.index)

        # What is usual on them.
        history = read_history(archive)
        self.rows = history.traversals
        self.usual = Usual(history)
        self.predictor: Predictor = self.usual.predictor
        self.exits = self.predictor.exits
        self._trip_ends = self._find_trip_ends()
        self.lengths = self.network.lengths

        #: Tells this map from others, whose edges have other numbers.
        self.fingerprint = f"{len(self.network)} {float(self.lengths.sum()):.3f}"
        self.rounds: Rounds | None = None
        try:
            self.rounds = find_rounds(history)
        except InputError:
            # Travel that does not repeat in rounds is no patrol.
            self.rounds = None

    def ends_near(self, position: Floats) -> int:
        """Number of trips of the archive that ended near a position on the plane of the map."""
        axes = self._trip_ends.shape[1]
        away = np.linalg.norm(self._trip_ends - position[:axes], axis=1)
        return int((away <= _NEAR).sum())

    @property
    def standing(self) -> float:
        """Metres by which the fixes of an agent that stands spread, at most."""
        least = 0.0 if self.plane is None else _STANDING
        return max(least, _STANDING_ERRORS * self.scales.error)

    def matcher(self) -> LiveMatcher:
        """Return a matcher for one agent."""
        return _AgentMatcher(self)

    def project(self, fix: Fix) -> Floats | None:
        """Metres on the plane of the map; None far away, and for a rough or unlike fix."""
        if fix.geographic != (self.plane is not None) or (fix.accuracy or 0.0) > _MAX_ACCURACY:
            return None
        if self.plane is None:
            return np.array(fix.position)
        latitude, longitude = fix.position[:2]
        (position,) = to_plane([latitude], [longitude], self.plane)
        if len(self.plane.centers) == 1 and np.abs(position).max() > _MAX_DISTANCE:
            return None
        return np.asarray(position)

    def node_position(self, node: int) -> tuple[float, ...]:
        """Coordinates of a node, as fixes have them."""
        position = np.asarray(self.index.graph.node_positions[node], np.float64)
        return tuple(map_coordinates(position[None], self.plane)[0].tolist())

    def place_on(self, directed: int, along: float) -> tuple[float, ...]:
        """Coordinates of a place on a directed edge, some metres along it."""
        edge = directed >> 1
        offset = self.offset(directed, along)
        place = self._position_on(edge, offset)
        return tuple(map_coordinates(place[None], self.plane)[0].tolist())

    def offset(self, directed: int, along: float) -> float:
        """Metres from an edge's start, from those along a directed edge, or back."""
        return float(self.lengths[directed >> 1]) - along if directed & 1 else along

    def _position_on(self, edge: int, offset: float) -> Floats:
        """Metres on the plane, so many metres from an edge's start."""
        line = self.network.road(edge)
        first, after = self.network.offsets[edge : edge + 2]
        metres = self.network.along[first:after]
        return np.array([np.interp(offset, metres, axis) for axis in line.T])

    def _find_trip_ends(self) -> Floats:
        """Positions at which the trips of the archive end, shape (t, 2)."""
        last = self.predictor._trips.after - 1
        places = zip(self.rows.edge[last].tolist(), self.rows.end[last].tolist(), strict=True)
        positions = [self._position_on(edge, end)[:2] for edge, end in places]
        return np.array(positions, np.float64).reshape(-1, 2)
