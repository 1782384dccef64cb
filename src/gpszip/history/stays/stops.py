"""When stops of a track begin and end, also where it was not seen to come and go."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.history.stays.fixes import Fixes
from gpszip.history.stays.halts import TURN_TIME, find_known, turns_back
from gpszip.history.stays.travel import (
    MAX_GAP,
    WAY_FACTOR,
    distance,
    passes_by,
    speed_after,
    speed_before,
    travel_time,
)
from gpszip.history.stays.values import Halt, Settings, Stop

__all__ = ["estimate_stops"]

#: Seconds of fixes at a place from which the track was seen to be still there.
_SEEN_STILL = 60.0

Floats = NDArray[np.float64]


def estimate_stops(
    fixes: Fixes,
    halts: list[Halt],
    settings: Settings,
    places: Floats | None,
    *,
    goes_on: bool = False,
) -> list[Stop]:
    """Return the stops with estimated times; those that turn out too short are left out.

    Whether the last one is a turn is not known while the track goes on.
    """
    # As they were seen.
    begins = [float(fixes.times[halt.first]) for halt in halts]
    ends = [float(fixes.times[halt.last]) for halt in halts]
    seen = [end - begin for begin, end in zip(begins, ends, strict=True)]
    known = [
        find_known(halt, places, settings, allowance=_next_step(fixes, halt, settings))
        for halt in halts
    ]

    # When each is left and reached.
    for i, halt in enumerate(halts):
        if i + 1 < len(halts) and halts[i + 1].first == halt.last + 1:
            # At a place that is known, too, a track stays, unless it is seen there again.
            elsewhere = known[i] != known[i + 1]
            passes = passes_by(fixes, halt.last)
            still = [
                seen[row] >= _SEEN_STILL
                or (elsewhere and known[row] is not None and not passes[row - i])
                for row in (i, i + 1)
            ]
            ends[i], begins[i + 1] = _share_gap(fixes, halt.last, *still)
            continue
        if halt.last + 1 < len(fixes):
            ends[i] = _departure(fixes, halt)
        if i + 1 < len(halts):
            begins[i + 1] = _arrival(fixes, halts[i + 1])
    if halts and halts[0].first > 0:
        begins[0] = _arrival(fixes, halts[0])

    # Those that are long enough, or where the way turns back.
    centres = [fixes.positions[0], *(halt.centre for halt in halts), fixes.positions[-1]]
    stops = []
    for i, (begin, end, halt) in enumerate(zip(begins, ends, halts, strict=True)):
        is_decided = not goes_on or i + 1 < len(halts)
        is_turn = (
            is_decided
            and end - begin >= TURN_TIME
            and turns_back(centres[i], halt.centre, centres[i + 2], halt.noise, settings)
        )
        if is_turn or end - begin >= settings.min_stay:
            first_seen, last_seen = fixes.times[[halt.first, halt.last]].tolist()
            stops.append(Stop(begin, end, first_seen, last_seen, halt))
    return stops


def _next_step(fixes: Fixes, halt: Halt, settings: Settings) -> float:
    """Metres by which a track on the way may have gone on beyond a halt of a single fix, unseen.

    It is the step before or after it, whichever is not the gap.
    """
    rows = [row for row in (halt.first - 1, halt.last) if 0 <= row < len(fixes) - 1]
    steps = [
        distance(fixes.positions[row], fixes.positions[row + 1])
        for row in rows
        if fixes.times[row + 1] - fixes.times[row] < _SEEN_STILL
    ]
    return min(max(steps, default=0.0), settings.radius) if halt.first == halt.last else 0.0


def _departure(fixes: Fixes, halt: Halt) -> float:
    """Time at which a halt is left: as long before the next fix as the way to there takes."""
    row = halt.last
    way = distance(fixes.positions[row + 1], halt.centre)
    duration = WAY_FACTOR * way / speed_after(fixes, row + 1)
    before, after = fixes.times[row], fixes.times[row + 1]
    return float(max(before, after - duration)) if after - before <= MAX_GAP else float(before)


def _arrival(fixes: Fixes, halt: Halt) -> float:
    """Time at which a halt is reached: as long after the fix before as the way from there takes."""
    row = halt.first
    way = distance(fixes.positions[row - 1], halt.centre)
    duration = WAY_FACTOR * way / speed_before(fixes, row - 1)
    before, after = fixes.times[row - 1], fixes.times[row]
    return float(min(after, before + duration)) if after - before <= MAX_GAP else float(after)


def _share_gap(
    fixes: Fixes, row: int, still_before: bool, still_after: bool
) -> tuple[float, float]:
    """When the place before a gap is left, and the one after it is reached.

    Parameters
    ----------
    fixes : Fixes
        A track.
    row : int
        Number of the last fix before the gap.
    still_before, still_after : bool
        Whether the track was seen to be still before the gap, and after it.
    """
    before, after = float(fixes.times[row]), float(fixes.times[row + 1])
    if after - before > MAX_GAP:
        return before, after
    travel = min(travel_time(fixes, row), after - before)
    spare = after - before - travel

    # Whoever is on the way goes on to where it is seen next.
    if still_before and still_after:
        return before + spare / 2, after - spare / 2
    if still_before:
        return after - travel, after
    return before, before + travel
