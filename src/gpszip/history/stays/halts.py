"""Which halts of a track are real: without errors, and with the goals of round trips."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gpszip.history.stays.fixes import Fixes
from gpszip.history.stays.stays import find_halts
from gpszip.history.stays.travel import (
    ERROR_FACTOR,
    MAX_GAP,
    TRAVEL_SHARE,
    directness,
    distance,
    distances,
    is_jump,
    travel_time,
)
from gpszip.history.stays.values import Halt, Settings

__all__ = ["TURN_TIME", "choose_halts", "find_known", "is_alone", "is_same", "turns_back"]

#: Fixes on the way that a trip has at least: a single one may be an error.
_MIN_ROUTE_FIXES = 2

#: Seconds of a stop at the far end of a round trip that is its goal. Red lights are as long, but
#: nobody turns back at one.
TURN_TIME = 60.0

#: A stop lies at the far end of a round trip if its distance from where the trip began is this
#: share of the largest one, or more.
_FAR_SHARE = 0.9

#: The straight line from begin to end, as a share of the way over the far end, below which the way
#: turned back there.
_TURNED_BACK = 0.3

#: Least way to the far end, as a multiple of the radius of places.
_MIN_TURN_WAY = 3.0

Floats = NDArray[np.float64]


def choose_halts(fixes: Fixes, settings: Settings, *, goes_on: bool = False) -> list[Halt]:
    """Return halts, with short ones at the far end of round trips, and both ends of long gaps.

    A track that goes on after its last fix has not turned back yet by where it is now.
    """
    halts = find_halts(fixes, settings.min_stay, settings.radius) if len(fixes) > 1 else []
    halts = _add_gaps(fixes, halts, settings)
    halts = _merge_halts(fixes, halts, settings)
    halts = _drop_jumps(fixes, halts, settings)
    return _add_turns(fixes, halts, settings, goes_on=goes_on)


def _add_gaps(fixes: Fixes, halts: list[Halt], settings: Settings) -> list[Halt]:
    """Add both ends of gaps on the way that are too long for what was travelled meanwhile."""
    # Steps outside of halts.
    gaps = np.diff(fixes.times)
    rows = np.flatnonzero(gaps >= settings.max_pause)
    firsts = np.array([halt.first for halt in halts], np.int64)
    lasts = np.array([halt.last for halt in halts], np.int64)
    owner = np.searchsorted(firsts, rows, side="right") - 1
    inside = (owner >= 0) & (rows < lasts[owner]) if len(halts) else np.zeros(len(rows), bool)

    ends = set()
    for row in rows[~inside].tolist():
        if gaps[row] > MAX_GAP or travel_time(fixes, row) < TRAVEL_SHARE * gaps[row]:
            ends |= {row, row + 1}
    ends -= {row for halt in halts for row in (halt.first, halt.last)}
    singles = [_single(fixes, row, settings) for row in sorted(ends)]
    return sorted([*halts, *singles], key=lambda halt: halt.first)


def _single(fixes: Fixes, row: int, settings: Settings) -> Halt:
    noise = float(fixes.noise[row])
    return Halt(row, row, fixes.positions[row], noise, settings.radius / 2 + noise)


def _merge_halts(fixes: Fixes, halts: list[Halt], settings: Settings) -> list[Halt]:
    """Merge successive halts at one place, unless the track was seen away from it meanwhile."""
    merged: list[Halt] = []
    for halt in halts:
        if (
            merged
            and is_same(merged[-1], halt, settings)
            and fixes.times[halt.first] - fixes.times[merged[-1].last] <= MAX_GAP
            and not _leaves(fixes, merged[-1], halt, settings)
        ):
            merged[-1] = _merged(fixes, merged[-1], halt)
        else:
            merged.append(halt)
    return merged


def is_same(one: Halt, other: Halt, settings: Settings) -> bool:
    """Whether two halts are at one place, as far as their errors tell."""
    noise = max(one.noise, other.noise)
    return distance(one.centre, other.centre) <= settings.radius + noise


def _merged(fixes: Fixes, one: Halt, other: Halt) -> Halt:
    """Return the halt of two at one place, whose centres count by their time."""
    # Halts of single fixes have no duration.
    times = [float(fixes.times[each.last] - fixes.times[each.first]) + 1.0 for each in (one, other)]
    share = times[0] / sum(times)
    return Halt(
        one.first,
        other.last,
        share * one.centre + (1 - share) * other.centre,
        max(one.noise, other.noise),
        max(one.reach, other.reach),
        share * one.spread + (1 - share) * other.spread,
    )


def _leaves(fixes: Fixes, one: Halt, other: Halt, settings: Settings) -> bool:
    """Whether fixes between two halts lead away from the first, and not just to one spot.

    Single far fixes are errors; two in succession show someone on the way. Fixes of one spot may be
    an error that lasts, such as the place of another WiFi.
    """
    rows = slice(one.last + 1, other.first)
    positions, noise = fixes.positions[rows], fixes.noise[rows]
    far = distances(positions, one.centre) - ERROR_FACTOR * noise > settings.radius
    if not (far[1:] & far[:-1]).any():
        return False
    outside, noise = positions[far], noise[far]
    spot = np.median(outside, axis=0)
    away = distances(outside, spot) - ERROR_FACTOR * noise
    return bool((away > settings.radius / 2).any())


def _drop_jumps(fixes: Fixes, halts: list[Halt], settings: Settings) -> list[Halt]:
    """Drop halts to which the track jumps from a place, and back to it.

    Nothing was seen on the way there and back, and it was faster than it can be, or the halt is
    shorter than a pause: an error that lasts.
    """
    kept: list[Halt] = []
    for halt in halts:
        if len(kept) > 1 and _is_error(fixes, kept[-2], kept[-1], halt, settings):
            kept.pop()
            kept[-1] = _merged(fixes, kept[-1], halt)
        else:
            kept.append(halt)
    return kept


def _is_error(fixes: Fixes, one: Halt, halt: Halt, other: Halt, settings: Settings) -> bool:
    """Whether a halt between two at one place is an error."""
    if not is_same(one, other, settings) or fixes.times[other.first] - fixes.times[one.last] > (
        MAX_GAP
    ):
        return False
    # Nothing was seen on the way.
    if _is_seen(fixes, one, halt, settings) or _is_seen(fixes, halt, other, settings):
        return False
    jumps = is_jump(fixes, one, halt) and is_jump(fixes, halt, other)
    duration = fixes.times[halt.last] - fixes.times[halt.first]
    return jumps or (halt.first != halt.last and bool(duration < settings.max_pause))


def _is_seen(fixes: Fixes, one: Halt, other: Halt, settings: Settings) -> bool:
    """Whether a fix between two halts is at neither of both places."""
    rows = slice(one.last + 1, other.first)
    positions = fixes.positions[rows]
    reach = settings.radius + ERROR_FACTOR * fixes.noise[rows]
    away = [distances(positions, halt.centre) > reach for halt in (one, other)]
    return bool((away[0] & away[1]).any())


def _add_turns(fixes: Fixes, halts: list[Halt], settings: Settings, *, goes_on: bool) -> list[Halt]:
    """Add short halts at the far end of round trips, which are their goals."""
    if settings.min_stay <= TURN_TIME or len(fixes) < 2:
        return halts
    # Ways from halt to halt; a track may begin and end on the way.
    ends = list(halts)
    if not halts or halts[0].first > 0:
        ends.insert(0, _single(fixes, 0, settings))
    if not goes_on and (not halts or halts[-1].last < len(fixes) - 1):
        ends.append(_single(fixes, len(fixes) - 1, settings))

    # At most one halt on each.
    turns = [
        turn
        for one, other in pairwise(ends)
        if (turn := _find_turn(fixes, one, other, settings)) is not None
    ]
    return sorted([*halts, *turns], key=lambda halt: halt.first)


def _find_turn(fixes: Fixes, one: Halt, other: Halt, settings: Settings) -> Halt | None:
    """Return the longest short halt at the far end of a way there and back; None without."""
    # Does it lead far, and back?
    rows = slice(one.last + 1, other.first)
    if rows.stop - rows.start < _MIN_ROUTE_FIXES:
        return None
    away = distances(fixes.positions[rows], one.centre)
    row = one.last + 1 + int(away.argmax())
    noise = float(fixes.noise[row])
    if not turns_back(one.centre, fixes.positions[row], other.centre, noise, settings):
        return None

    # Short halts there, of which the longest counts.
    way = Fixes(fixes.times[rows], fixes.positions[rows], fixes.noise[rows])
    radius = settings.radius * TURN_TIME / settings.min_stay
    least = _FAR_SHARE * float(away.max())
    turns = [
        halt
        for halt in find_halts(way, TURN_TIME, radius, beyond=(one.centre, least))
        if distance(halt.centre, one.centre) >= least
        and turns_back(one.centre, halt.centre, other.centre, halt.noise, settings)
    ]
    if not turns:
        return None
    longest = max(turns, key=lambda halt: way.times[halt.last] - way.times[halt.first])
    return replace(longest, first=longest.first + rows.start, last=longest.last + rows.start)


def turns_back(one: Floats, turn: Floats, other: Floats, noise: float, settings: Settings) -> bool:
    """Whether a way from one position to another leads far, to where it turns, and back.

    ``noise`` is the error of the turn in metres.
    """
    is_far = distance(one, turn) >= _MIN_TURN_WAY * settings.radius + ERROR_FACTOR * noise
    return is_far and directness(one, turn, other) < _TURNED_BACK


def is_alone(fixes: Fixes, halt: Halt, settings: Settings) -> bool:
    """Whether a halt is a single fix with gaps, or the end of the track, on both sides."""
    if halt.first != halt.last:
        return False
    row, last = halt.first, len(fixes) - 1
    before = math.inf if row == 0 else fixes.times[row] - fixes.times[row - 1]
    after = math.inf if row == last else fixes.times[row + 1] - fixes.times[row]
    return bool(min(before, after) >= settings.min_stay)


def find_known(
    halt: Halt, places: Floats | None, settings: Settings, *, allowance: float = 0.0
) -> int | None:
    """Number of the known place at which a halt is, within an allowance in metres; None without."""
    if places is None or not len(places):
        return None
    away = distances(places, halt.centre)
    nearest = int(away.argmin())
    return nearest if away[nearest] <= settings.radius + halt.noise + allowance else None
