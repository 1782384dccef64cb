"""The stays and trips of one track.

A track is cut into halts, where its fixes stay in place, and moves between them. A move is a trip
if it was seen to lead away from a place by more than the errors of its fixes. When it began and
ended is estimated from how long its first and last steps take, as a phone that lies still may be
silent until it is well on its way.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.history.stays.fixes import Fixes
from gpszip.history.stays.halts import choose_halts, find_known, is_alone
from gpszip.history.stays.moves import find_moves, join_over_pauses
from gpszip.history.stays.stops import estimate_stops
from gpszip.history.stays.values import Doubt, Settings, Timeline

__all__ = ["build_timeline"]

#: Rounds in which single fixes are left out; more change hardly anything.
_MAX_ROUNDS = 4

Floats = NDArray[np.float64]


def build_timeline(
    fixes: Fixes, settings: Settings, places: Floats | None = None, *, goes_on: bool = False
) -> Timeline:
    """Find the stays and trips of a track.

    Parameters
    ----------
    fixes : Fixes
        At least one.
    settings : Settings
        What counts as which.
    places : float64 array, shape (k, d), optional
        Centres of places that are known from other stays. A single fix between gaps at one of them
        is no error, and a track that was seen there last or first stayed there.
    goes_on : bool, default False
        Whether the track goes on after its last fix. Then a short stop is a turn, or a pause, only
        once a later stop says so.

    Returns
    -------
    Timeline

    Examples
    --------
    >>> times = np.arange(0.0, 3001, 10)
    >>> x = np.interp(times, [0, 1000, 2000, 3000], [0, 0, 5000, 5000])
    >>> line = build_timeline(Fixes(times, x[:, None], np.full(301, 10.0)), Settings())
    >>> [(round(stop.start), round(stop.end)) for stop in line.stops]
    [(0, 1000), (2000, 3000)]
    >>> [(round(move.start), round(move.end)) for move in line.moves]
    [(1000, 2000)]
    """
    # Halts, without single fixes that nothing confirms: without these, other ones may be single.
    doubtful: list[Doubt] = []
    halts = choose_halts(fixes, settings, goes_on=goes_on)
    for _ in range(_MAX_ROUNDS):
        alone = [
            halt.first
            for halt in halts
            if is_alone(fixes, halt, settings) and find_known(halt, places, settings) is None
        ]
        if not alone or len(alone) == len(fixes):
            break
        doubtful += [Doubt(float(fixes.times[row]), fixes.positions[row]) for row in alone]
        fixes = fixes.take(~np.isin(np.arange(len(fixes)), alone))
        halts = choose_halts(fixes, settings, goes_on=goes_on)

    # Times of stops, and moves between them.
    stops = estimate_stops(fixes, halts, settings, places, goes_on=goes_on)
    moves, unseen = find_moves(fixes, stops, settings)
    stops, moves = join_over_pauses(stops, moves, settings, goes_on=goes_on)
    is_open = bool(doubtful) or any(halt.first == halt.last for halt in halts)
    return Timeline(fixes, tuple(stops), tuple(moves), tuple(doubtful), unseen, is_open)
