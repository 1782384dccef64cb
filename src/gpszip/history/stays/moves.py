"""Which moves between stops are trips, and which trips are one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.history.stays.fixes import Fixes
from gpszip.history.stays.halts import is_same
from gpszip.history.stays.travel import (
    ERROR_FACTOR,
    directness,
    distance,
    distances,
    fills,
    is_jump,
)
from gpszip.history.stays.values import Halt, Move, Settings, Stop

__all__ = ["find_moves", "join_over_pauses"]

#: Fixes on the way that a trip has at least: a single one may be an error.
_MIN_ROUTE_FIXES = 2

#: The straight line from begin to end of two trips, as a share of the way over the stop between
#: them, above which the stop lies on the way.
_ON_THE_WAY = 0.7

Floats = NDArray[np.float64]


def find_moves(fixes: Fixes, stops: list[Stop], settings: Settings) -> tuple[list[Move], int]:
    """Return the moves between stops that are trips, and the number of those not seen."""
    moves, unseen = list[Move](), 0
    for i in range(len(stops) + 1):
        one, other = (stops[i - 1] if i else None), (stops[i] if i < len(stops) else None)
        move = _find_trip(fixes, one, other, settings)
        if move is not None:
            goal = i if other is not None else None
            moves.append(Move(*move, None if one is None else i - 1, goal))
        elif one is not None and other is not None:
            unseen += not is_same(one.halt, other.halt, settings)
    return moves, unseen


def _find_trip(
    fixes: Fixes, one: Stop | None, other: Stop | None, settings: Settings
) -> tuple[float, float, Floats, Floats] | None:
    """Return times and positions of begin and end of the trip between two stops, if there is one.

    Without a stop, the track begins or ends on the way.
    """
    # Where it begins and ends, and when.
    first = _edge_halt(fixes, 0, settings) if one is None else one.halt
    last = _edge_halt(fixes, len(fixes) - 1, settings) if other is None else other.halt
    if first.last >= last.first:
        return None
    start = float(fixes.times[first.last]) if one is None else one.end
    end = float(fixes.times[last.first]) if other is None else other.start

    # Fixes on the way lead away from both ends, and from where it began by more than their errors.
    rows = slice(first.last + 1, last.first)
    positions, noise = fixes.positions[rows], fixes.noise[rows]
    from_first, from_last = (distances(positions, halt.centre) for halt in (first, last))
    least = ERROR_FACTOR * noise
    on_the_way = from_first > np.maximum(first.reach, least)
    on_the_way &= from_last > np.maximum(last.reach, least)
    farthest = float((from_first - least).max(initial=0.0))
    way = distance(first.centre, last.centre) - ERROR_FACTOR * (first.noise + last.noise)
    if max(farthest, way) <= settings.radius:
        return None
    trip = (start, end, first.centre, last.centre)
    if int(on_the_way.sum()) >= _MIN_ROUTE_FIXES:
        return trip

    # Else the two ends must say it.
    known = one is not None and other is not None
    is_travel = known and not is_jump(fixes, first, last) and fills(fixes, first, last)
    return trip if is_travel and way > settings.radius else None


def _edge_halt(fixes: Fixes, row: int, settings: Settings) -> Halt:
    """Return the fixes at the first or the last position of a track that are in place there."""
    centre, noise = fixes.positions[row], float(fixes.noise[row])
    reach = settings.radius / 2 + noise
    away = np.flatnonzero(distances(fixes.positions, centre) > reach + fixes.noise)
    if not len(away):
        return Halt(0, len(fixes) - 1, centre, noise, reach)
    if row == 0:
        return Halt(0, int(away[0]) - 1, centre, noise, reach)
    return Halt(int(away[-1]) + 1, row, centre, noise, reach)


def join_over_pauses(
    stops: list[Stop], moves: list[Move], settings: Settings, *, goes_on: bool = False
) -> tuple[list[Stop], list[Move]]:
    """Join trips that go on in their direction after a short stop, which becomes a pause.

    Where the last trip leads is not known while the track goes on.
    """
    stops, joined = list(stops), list[Move]()
    for move in moves:
        before = joined[-1] if joined else None
        stop = None if move.origin is None else stops[move.origin]
        if (
            before is not None
            and stop is not None
            and move.origin is not None
            and before.goal == move.origin
            and stop.duration < settings.max_pause
            and not (goes_on and move.goal is None)
            and directness(before.begin, stop.halt.centre, move.finish) >= _ON_THE_WAY
        ):
            stops[move.origin] = replace(stop, pause=True)
            joined[-1] = replace(before, end=move.end, finish=move.finish, goal=move.goal)
        else:
            joined.append(move)
    return stops, joined
