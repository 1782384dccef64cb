"""Where the agents of a log go from their last positions, given an archive."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpszip.archive import Archive
from gpszip.errors import OptionError
from gpszip.geo.planes import to_geographic
from gpszip.history.prediction.predictor import Predictor
from gpszip.history.prediction.read_route import tell_route
from gpszip.history.traversals import Traversals, match_traversals, read_history
from gpszip.history.trips import TripRows, cut_trips, spans_of_tracks
from gpszip.model import Network, Track
from gpszip.model.prediction import Destination, LikelyNode, Outlook
from gpszip.pipeline.match import network_for

__all__ = ["predict"]

#: Routes that are told.
_ROUTES = 3


def predict(
    archive: Archive,
    tracks: Sequence[Track] | None = None,
    *,
    edges: int = 5,
    destinations: int = 3,
    timezone: str | None = None,
) -> tuple[tuple[Outlook, ...], Network]:
    """Predict where each track goes on; see ``gpszip predict``.

    Parameters
    ----------
    archive : Archive
        What is known.
    tracks : sequence of Track, optional
        A log; by default the archive's own tracks.
    edges : int, default 5
        Edges of the routes that are predicted.
    destinations : int, default 3
        Destinations of each.
    timezone : str, optional
        Time zone of the hours of the day; by default that of the place, else UTC.

    Returns
    -------
    tuple of Outlook
        One for each track.
    Network
        The edges.

    Raises
    ------
    InputError
        If nothing moves in the archive, or the log is elsewhere.
    """
    # What is known, and the traversals of the log on the same edges.
    history = read_history(archive)
    predictor = Predictor(history, timezone=timezone)
    rows, trips = history.traversals, predictor._trips
    if tracks is not None:
        network = network_for(tracks, archive)
        ids = tuple(track.id for track in tracks)
        rows = match_traversals(tracks, network, ids, list(range(len(tracks))))
        trips = cut_trips(rows, spans_of_tracks(tracks, trips.by_places))

    # Each track from its last traversal on.
    outlooks = []
    for number, name in enumerate(rows.ids):
        last = int(np.searchsorted(rows.track, number, side="right")) - 1
        if last < 0 or rows.track[last] != number or _has_left(rows, last, tracks, number):
            time = float(tracks[number].times[-1]) if tracks and tracks[number].timed else np.nan
            outlooks.append(Outlook(name, time, -1, False, (), (), ()))
            continue
        first = _trip_begin(trips, rows, last)
        outlooks.append(_outlook(predictor, rows, first, last, edges, destinations))
    return tuple(outlooks), predictor.network


def _trip_begin(trips: TripRows, rows: Traversals, last: int) -> int:
    """First traversal of a trip since it was on the map without a break."""
    trip = int(np.searchsorted(trips.first, last, side="right")) - 1
    route = int(np.flatnonzero(rows.starts[: last + 1])[-1])
    return max(route, int(trips.first[trip])) if trip >= 0 else route


def _has_left(rows: Traversals, last: int, tracks: Sequence[Track] | None, number: int) -> bool:
    """Whether a track goes on off the map after its last traversal."""
    if tracks is None or not tracks[number].timed:
        return False
    after = np.count_nonzero(tracks[number].times > rows.leave[last] + 1e-3)
    return bool(after)


def _outlook(
    predictor: Predictor, rows: Traversals, first: int, last: int, edges: int, destinations: int
) -> Outlook:
    """Where an agent goes after a traversal, the last one of a trip so far."""
    # The trip so far.
    name = rows.ids[rows.track[last]]
    trip = slice(first, last + 1)
    route = list(tell_route(rows.directed[trip].tolist()))
    time = float(rows.leave[last])
    now = time if np.isfinite(time) else None
    times = rows.enter[trip].tolist() if now is not None else None

    # What is left of its last edge.
    edge, forward = route[-1]
    length = float(predictor.network.lengths[edge])
    left = length - float(rows.end[last]) if forward else float(rows.end[last])

    # Destinations with arrivals.
    told = [
        _destination(predictor, route, node, now, name, times, left)
        for node in predictor.destination(route, now, name, count=destinations)
    ]
    return Outlook(
        name,
        time,
        edge,
        forward,
        tuple(predictor.next(route, now, name)),
        tuple(predictor.routes(route, edges, now, name, count=_ROUTES)),
        tuple(told),
    )


def _destination(
    predictor: Predictor,
    route: list[tuple[int, bool]],
    likely: LikelyNode,
    now: float | None,
    name: str,
    times: list[float] | None,
    left: float,
) -> Destination:
    """A destination with its position and the arrival there."""
    try:
        arrival = predictor.arrival(
            route, likely.node, now, name, times=times, metres_left=max(left, 0.0)
        )
    except OptionError:  # no way leads there, or the archive has no times
        arrival = None
    position = predictor.network.nodes[likely.node]
    if predictor.network.plane is not None:
        lat, lon = to_geographic(position[None, :2], predictor.network.plane)
        position = np.array([lat[0], lon[0]])
    return Destination(likely.node, likely.probability, tuple(position.tolist()), arrival)
