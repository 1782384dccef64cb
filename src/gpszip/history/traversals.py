"""Traversals of the edges of an archive's map by all tracks, as its walks tell them.

The edges are those of the clean map as a network, in the numbers that the routes of
``gpszip.match(track, archive)`` have. The walks' knots are matched to that network by the same
hidden Markov model that matches logs. It needs no samples: between knots a track is linear.

On logs of school buses and of a robot, the traversals have 99.7 % and 99.4 % of the edges, in
their order, of the log's own routes, and the edge of 94 % and 96 % of its samples (the others are
near nodes). Of three taxis with a sample a minute it is 84 % of the samples, and 63 % of a
person's, whose map has many paths within the error of each other.

The other way would be to look up the path of each road map edge on the skeleton, which
simplification finds for its counts. It leaves out 12 % of the traversals of these taxis and 21 % of
those of the person, whose edges have a node off the skeleton or no path in their corridor; matching
leaves out less than 1 % of the knots.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive
from gpszip.errors import InputError
from gpszip.history.turning import Legs, remove_wandering
from gpszip.io.networks.from_archive import clean_map_network
from gpszip.matching.match import match
from gpszip.model import Network, Track
from gpszip.model.grid import step_size
from gpszip.model.match import Match
from gpszip.model.text import count_text

__all__ = ["History", "Traversals", "match_traversals", "read_history"]

#: A track slower than this share of the log's median speed stands still, but for what its way takes
#: at the median speed.
_STANDING = 0.1

#: Metres within which a place is passed with a knot: rounding of sums over long logs.
_SAME_PLACE = 1e-3

#: Metres below which a traversal has no speed: errors are as long.
_NO_TRAVEL = 1e-3

#: Turning back within this many errors of the match is noise of a receiver.
_WANDERING = 2.0

#: Metres between the routes of two pieces on one line, so that no two have a place in common.
_APART = 1.0


@dataclass(frozen=True, eq=False, repr=False)
class Traversals:
    """Traversals of edges, track by track in the order of travel.

    Parameters
    ----------
    ids : tuple of str
        Names of the tracks.
    track : int32 array, shape (n,)
        Track of each traversal, as an index of ``ids``. Never decreases.
    edge : int64 array, shape (n,)
        Edge of the network.
    forward : bool array, shape (n,)
        Whether it was travelled from its start to its end.
    enter, leave : float64 array, shape (n,)
        Seconds at which the traversal begins and ends, in the log's own zero; NaN where a track has
        no times.
    begin, end : float64 array, shape (n,)
        Metres from the edge's start, along it, at which the traversal begins and ends. Inside of a
        track these are the ends of the edge, unless the agent turned round on it.
    standing : float64 array, shape (n,)
        Seconds between ``enter`` and ``leave`` in which the agent stood still; NaN without times.
    starts : bool array, shape (n,)
        Whether the traversal does not go on from the one before: at the start of a track, after a
        gap, and after travel off the map. Otherwise it begins at the node at which the one before
        ended, or turns back on the same edge.
    max_speed : float, default infinity
        Speed in m/s above which a traversal is a jump of the receiver, as for matching: four times
        the speed that one step of the log in twenty exceeds.
    """

    ids: tuple[str, ...]
    track: NDArray[np.int32]
    edge: NDArray[np.int64]
    forward: NDArray[np.bool_]
    enter: NDArray[np.float64]
    leave: NDArray[np.float64]
    begin: NDArray[np.float64]
    end: NDArray[np.float64]
    standing: NDArray[np.float64]
    starts: NDArray[np.bool_]
    max_speed: float = np.inf

    def __repr__(self) -> str:
        tracks = count_text(len(self.ids), "track")
        return f"Traversals({count_text(len(self), 'traversal')}, {tracks})"

    def __len__(self) -> int:
        return len(self.edge)

    @property
    def metres(self) -> NDArray[np.float64]:
        """Metres travelled on the edge, shape (n,)."""
        metres: NDArray[np.float64] = np.abs(self.end - self.begin)
        return metres

    @cached_property
    def speeds(self) -> NDArray[np.float64]:
        """Speed in m/s without standing, shape (n,), also of jumps; NaN without times or travel."""
        seconds = self.leave - self.enter - self.standing
        moved = (self.metres > _NO_TRAVEL) & (seconds > 0)
        unknown = np.full(len(self), np.nan)
        speeds: NDArray[np.float64] = np.divide(self.metres, seconds, out=unknown, where=moved)
        return speeds

    @property
    def jumps(self) -> NDArray[np.bool_]:
        """Which ones are jumps of the receiver, by their speed, shape (n,)."""
        jumps: NDArray[np.bool_] = self.speeds > self.max_speed
        return jumps

    @property
    def travelled(self) -> NDArray[np.float64]:
        """Metres that were travelled, shape (n,): those of jumps were not."""
        travelled: NDArray[np.float64] = np.where(self.jumps, 0.0, self.metres)
        return travelled

    @property
    def directed(self) -> NDArray[np.int64]:
        """One number for edge and direction, shape (n,): ``2 * edge``, plus 1 where backward."""
        return 2 * self.edge + ~self.forward

    @property
    def follows(self) -> NDArray[np.int64]:
        """Indices of the traversals that go on from the one before."""
        return np.flatnonzero(~self.starts)

    def take(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> Traversals:
        """Some of the traversals; one whose predecessor is left out starts anew.

        Parameters
        ----------
        chosen : bool array, shape (n,), or int array, shape (m,)
            Which ones, or their indices in increasing order.
        """
        chosen = np.flatnonzero(chosen) if chosen.dtype == np.bool_ else chosen
        starts = self.starts[chosen] | (np.diff(chosen, prepend=-2) != 1)
        return Traversals(
            ids=self.ids,
            track=self.track[chosen],
            edge=self.edge[chosen],
            forward=self.forward[chosen],
            enter=self.enter[chosen],
            leave=self.leave[chosen],
            begin=self.begin[chosen],
            end=self.end[chosen],
            standing=self.standing[chosen],
            starts=starts,
            max_speed=self.max_speed,
        )


@dataclass(frozen=True, eq=False)
class History:
    """The traversals of an archive, and the network whose edges they name.

    Parameters
    ----------
    network : Network
        All edges of the clean map, both ways open.
    traversals : Traversals
        Traversals by all tracks.
    archive : Archive, optional
        The archive, whose positions tell stays.
    """

    network: Network
    traversals: Traversals
    archive: Archive | None = None


def read_history(archive: Archive) -> History:
    """List the traversals of edges by all tracks of an archive.

    1. The knots of each piece between gaps are matched to the clean map.
    2. The moments at which a route passes a node are interpolated between its knots.
    3. Turning back within the error of the match is taken out, so that a vehicle which is parked on
       an edge or at a crossing is there once, however its receiver wanders.

    On a fleet with a million samples (117,000 knots) this takes 1.5 s of CPU after decoding and
    cleaning.

    Parameters
    ----------
    archive : Archive
        With or without times.

    Returns
    -------
    History
        Deterministic.

    Raises
    ------
    InputError
        If nothing moves in the archive, or none of its tracks matches its clean map.

    Examples
    --------
    >>> import gpszip
    >>> track = gpszip.Track("cab", range(40), [[10.0 * abs(t % 20 - 10), 0] for t in range(40)])
    >>> traversals = read_history(gpszip.compress(track, max_error=0.5)).traversals
    >>> traversals.edge.tolist(), traversals.forward.tolist()
    ([0, 0, 0, 0], [False, True, False, True])
    >>> traversals.leave.round().tolist()
    [10.0, 20.0, 30.0, 39.0]
    """
    # The archive knows its gaps, so that none is sought.
    grid = archive.grid
    network = clean_map_network(
        archive.clean_map(), "the archive", step_size(grid.space), plane=grid.plane
    )
    pieces = archive.decompress()
    number, names = {track: i for i, track in enumerate(archive.ids)}, archive.pieces
    owners = [number[names[piece.id]] for piece in pieces]
    traversals = match_traversals(pieces, network, archive.ids, owners, gap=np.inf, are_knots=True)
    if not len(traversals):
        raise InputError(
            "none of its tracks matches its clean map",
            path="the archive",
            remedy="select or compress longer tracks, or with a smaller error",
        )
    return History(network, traversals, archive)


def match_traversals(
    tracks: Sequence[Track],
    network: Network,
    ids: tuple[str, ...],
    owners: Sequence[int],
    *,
    gap: float | None = None,
    are_knots: bool = False,
) -> Traversals:
    """Match tracks to a network, and list the traversals of its edges.

    Parameters
    ----------
    tracks : sequence of Track
        Tracks, or pieces of them in their order, on the plane of the network.
    network : Network
        The edges.
    ids : tuple of str
        Names of the agents.
    owners : sequence of int
        Which of them each track belongs to; never decreases.
    gap : float, optional
        Seconds of a gap, as for :func:`gpszip.match`.
    are_knots : bool, default False
        Whether the samples are the knots of an archive, as for ``match``.
    """
    # Match, and find the times at which routes pass nodes, all pieces on one line.
    matching = match(tracks, network, gap=gap, are_knots=are_knots, with_confidence=False)
    timed = np.array([track.timed for track in tracks], np.bool_)
    clocks = [np.asarray(track.times, np.float64) for track in tracks]
    knots = _list_knots(matching.matches, clocks)
    legs = _list_legs(matching.matches, knots, np.asarray(owners, np.int32), timed)

    # Take out noise, and tell where travel goes on.
    legs = remove_wandering(legs, _WANDERING * matching.scales.error)
    return Traversals(
        ids=ids,
        track=legs.track,
        edge=legs.edge,
        forward=legs.forward,
        enter=legs.enter,
        leave=legs.leave,
        begin=legs.begin,
        end=legs.end,
        standing=legs.standing,
        starts=np.append(True, legs.piece[1:] != legs.piece[:-1])[: len(legs.piece)],
        max_speed=matching.scales.max_speed,
    )


class _Knots(NamedTuple):
    """Knots on routes, all pieces end to end.

    Parameters
    ----------
    along : float64 array, shape (k,)
        Metres along all routes; never decreases.
    times : float64 array, shape (k,)
        Seconds.
    piece : int64 array, shape (k,)
        Piece of a route, counted through all matches.
    leg : int64 array, shape (k,)
        Leg, counted through all pieces.
    """

    along: NDArray[np.float64]
    times: NDArray[np.float64]
    piece: NDArray[np.int64]
    leg: NDArray[np.int64]


def _list_knots(matches: tuple[Match, ...], clocks: list[NDArray[np.float64]]) -> _Knots:
    """Knots on the routes of all matches, end to end."""
    # Number the pieces and the legs of all matches.
    on_route = [matched.piece >= 0 for matched in matches]
    pieces = [len(matched.pieces) for matched in matches]
    first_piece = np.repeat(np.cumsum(pieces) - pieces, [rows.sum() for rows in on_route])
    routes = [piece.route for matched in matches for piece in matched.pieces]
    counts = np.array([len(route) for route in routes], np.int64)
    piece = _concatenate([m.piece[rows] for m, rows in zip(matches, on_route, strict=True)])
    piece = (piece + first_piece).astype(np.int64)
    leg = _concatenate([m.leg[rows] for m, rows in zip(matches, on_route, strict=True)])
    leg = leg.astype(np.int64) + (np.cumsum(counts) - counts)[piece]

    # Put the routes on one line, so that places on them have one order.
    along = _concatenate([m.along[rows] for m, rows in zip(matches, on_route, strict=True)])
    times = _concatenate([clock[rows] for clock, rows in zip(clocks, on_route, strict=True)])
    return _Knots(along + _route_starts(matches)[piece], times, piece, leg)


def _list_legs(
    matches: tuple[Match, ...],
    knots: _Knots,
    owner: NDArray[np.int32],
    timed: NDArray[np.bool_],
) -> Legs:
    """Legs of the routes of all matches, with the times at which they are passed."""
    # Legs of all routes.
    routes = [piece.route for matched in matches for piece in matched.pieces]
    counts = np.array([len(route) for route in routes], np.int64)
    piece = np.repeat(np.arange(len(routes)), counts)
    of_match = np.repeat(np.arange(len(matches)), [len(m.pieces) for m in matches])[piece]
    begin = _concatenate([route.begin for route in routes])
    end = _concatenate([route.end for route in routes])

    # Metres at which each ends, and the time there; the last one ends with the last knot.
    lengths = np.abs(end - begin)
    before = np.cumsum(lengths) - lengths
    first_leg = np.cumsum(counts) - counts
    passed = before - before[first_leg][piece] + lengths + _route_starts(matches)[piece]
    first_knot = np.searchsorted(knots.piece, np.arange(len(routes)))
    last_knot = np.searchsorted(knots.piece, np.arange(len(routes)), side="right") - 1
    values = np.stack([knots.times, _stood_before(knots)], axis=1)
    at_end = _interpolate(knots, values, passed, piece)
    at_end[first_leg + counts - 1] = values[last_knot]
    at_begin = np.roll(at_end, 1, axis=0)
    at_begin[first_leg] = values[first_knot]
    (enter, leave), standing = np.stack([at_begin, at_end])[..., 0], (at_end - at_begin)[:, 1]

    # A track without times has neither moments nor durations.
    untimed = ~timed[of_match]
    return Legs(
        piece,
        owner[of_match],
        _concatenate([route.edges for route in routes]).astype(np.int64),
        _concatenate([route.forward for route in routes]).astype(np.bool_),
        np.where(untimed, np.nan, enter),
        np.where(untimed, np.nan, leave),
        begin,
        end,
        np.where(untimed, np.nan, np.clip(standing, 0.0, leave - enter)),
    )


def _interpolate(
    knots: _Knots,
    values: NDArray[np.float64],
    places: NDArray[np.float64],
    piece: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Values of knots, shape (k, v), at the last time at which each place is passed."""
    # The last knot up to the place, and the one after it in the same piece.
    first = np.searchsorted(knots.piece, piece)
    last = np.searchsorted(knots.piece, piece, side="right") - 1
    low = np.searchsorted(knots.along, places + _SAME_PLACE, side="right") - 1
    low = np.clip(low, first, last)
    high = np.minimum(low + 1, last)

    # Between them, travel is even.
    metres = knots.along[high] - knots.along[low]
    share = np.divide(
        places - knots.along[low], metres, out=np.zeros(len(places)), where=metres > 0
    )
    between: NDArray[np.float64] = values[low] + np.clip(share, 0, 1)[:, None] * (
        values[high] - values[low]
    )
    return between


def _stood_before(knots: _Knots) -> NDArray[np.float64]:
    """Seconds for which the agents stood still before each knot, shape (k,).

    Between two knots that are slow, the way takes its time at the median speed, and the agent
    stands for the rest: so no way is left that takes no time.
    """
    # Speeds from knot to knot.
    together = np.diff(knots.piece) == 0
    seconds, metres = (np.where(together, np.diff(of), 0.0) for of in (knots.times, knots.along))
    speed = np.divide(metres, seconds, out=np.zeros(len(seconds)), where=seconds > 0)
    stood = seconds
    if metres.any():
        # Half of all metres are travelled faster than the median speed.
        order = np.argsort(speed, kind="stable")
        travelled = np.cumsum(metres[order])
        median = speed[order][np.searchsorted(travelled, 0.5 * travelled[-1])]
        stood = np.where(speed < _STANDING * median, seconds - metres / median, 0.0)
    return np.append(0.0, np.cumsum(stood))[: len(knots.times)]


def _route_starts(matches: tuple[Match, ...]) -> NDArray[np.float64]:
    """Metres at which the route of each piece begins on one line with all others."""
    lengths = np.array([piece.length for matched in matches for piece in matched.pieces])
    lengths = lengths.reshape(-1) + _APART
    starts: NDArray[np.float64] = np.cumsum(lengths) - lengths
    return starts


def _concatenate(arrays: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Concatenate arrays, of which there may be none."""
    return np.concatenate(arrays) if arrays else np.zeros(0)
