"""The numbers of a report, as plain values: metres, seconds, bytes, numbers of edges and places."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive
from gpszip.geo.planes import to_geographic
from gpszip.history.calendar import Calendar
from gpszip.history.traversals import History, Traversals
from gpszip.history.usage import traversal_speeds
from gpszip.model import Network, ReadResult
from gpszip.pipeline.findings import Findings
from gpszip.simplification.traversals import grouped_quantiles
from gpszip.view.history import hours_of_week

__all__ = ["collect_numbers"]

#: Rows of each table at most.
_MAX_PLACES, _MAX_EDGES, _MAX_CHANGES, _MAX_UNUSUAL, _MAX_ROUNDS = 15, 12, 20, 15, 12

#: Rounds whose durations are drawn at most: the latest.
_MAX_DRAWN = 200

#: Seconds of an hour, a day and a week.
_HOUR, _DAY, _WEEK = 3600.0, 86_400.0, 604_800.0

#: Days from which periods are weeks, and months; below two, they are hours.
_WEEKS_FROM, _MONTHS_FROM, _DAYS_FROM = 21.0, 800.0, 2.0

#: Days from a Monday to the first of January 1970.
_MONDAY = 3

#: Hours of a week and of a day.
_WEEK_HOURS, _DAY_HOURS = 168, 24

#: Share of an edge that a traversal takes to count as one.
_MIN_SHARE = 0.5

#: Share of the usual round from which a round is complete.
_COMPLETE = 0.999

Floats = NDArray[np.float64]
Numbers = dict[str, Any]


def collect_numbers(
    found: Findings, archive: Archive, name: str, read_result: ReadResult | None = None
) -> Numbers:
    """Collect the numbers of a report.

    Parameters
    ----------
    found : Findings
        All parts of the history.
    archive : Archive
        The archive.
    name : str
        Its name.
    read_result : ReadResult, optional
        The log, if it is at hand.

    Returns
    -------
    dict
        Plain values for JSON. A part that can't be told is None, and ``cannot_tell`` says why.
    """
    # Traversals with times, if there are any.
    rows = found.history.traversals if found.history is not None else None
    timed = None if rows is None else rows.take(np.isfinite(rows.enter))
    if timed is not None and not len(timed):
        timed = None

    # All parts.
    return {
        "name": name,
        "archive": _count_archive(archive, read_result),
        "period": _tell_period(found, archive, timed),
        "travel": None if found.history is None else _sum_travel(found, found.history),
        "trips": _count_trips(found),
        "activity": _count_activity(found, timed),
        "places": _list_places(found),
        "hours": None if timed is None else _metres_by_hour(found.calendar, timed),
        "speeds": None if timed is None else _speeds_by_hour(found.calendar, timed),
        "edges": None if found.history is None else _list_edges(found.history),
        "changes": _list_changes(found),
        "unusual": _list_unusual(found),
        "rounds": _list_rounds(found),
        "prediction": _tell_prediction(found),
        "cannot_tell": dict(found.notes),
    }


def _known(value: float, digits: int = 3) -> float | None:
    """A number for JSON; None for one that is not finite."""
    return round(float(value), digits) if math.isfinite(value) else None


def _count_archive(archive: Archive, read_result: ReadResult | None) -> Numbers:
    return {
        "bytes": archive.size,
        "tracks": len(archive.ids),
        "points": None if read_result is None else read_result.kept,
        "error_bound": None if archive.error_bound is None else str(archive.error_bound),
        "error_bound_m": None if archive.error_bound is None else archive.error_bound.metres,
        "gaps": sum(int(walk.gaps.sum()) for walk in archive.walks),
    }


def _tell_period(found: Findings, archive: Archive, timed: Traversals | None) -> Numbers | None:
    """From when to when, and on how many days something moved."""
    span = archive.time_range
    if span is None:
        return None

    # Local dates, and those of traversals.
    calendar = found.calendar
    first, last = np.floor(calendar.local(list(span)) / _DAY)
    moved = 0
    if timed is not None:
        moved = len(np.unique(np.floor(calendar.local(timed.enter) / _DAY)))
    return {
        "start": _known(span[0]),
        "end": _known(span[1]),
        "days": int(last - first) + 1,
        "days_with_travel": moved,
        "timezone": calendar.name or None,
        "timezone_from": calendar.source,
        "since": None if found.since is None else _known(found.since),
    }


def _sum_travel(found: Findings, history: History) -> Numbers:
    """All travel together; jumps of the receiver have neither speed nor time."""
    network, rows = history.network, history.traversals
    jumps = rows.jumps
    moving = np.where(jumps, np.nan, np.maximum(rows.leave - rows.enter - rows.standing, 0.0))
    seconds = float(np.nansum(moving))
    metres = float(rows.travelled.sum())
    return {
        "tracks": len(np.unique(rows.track)),
        "metres": _known(metres, 1),
        "moving_s": _known(seconds, 1),
        "speed": _known(float(rows.metres[np.isfinite(moving)].sum()) / seconds)
        if seconds
        else None,
        "jumps": int(jumps.sum()),
        "max_speed": _known(rows.max_speed),
        "edges": len(network),
        "network_metres": _known(float(network.lengths.sum()), 1),
        "repeated": None if found.usage is None else _known(found.usage.repeated, 4),
    }


def _count_trips(found: Findings) -> Numbers | None:
    trips = found.trips
    if trips is None:
        return None

    # Medians, as single long trips say little of the others.
    lengths = [trip.length for trip in trips.trips]
    durations = [trip.end - trip.start for trip in trips.trips]
    return {
        "trips": len(trips.trips),
        "stays": len(trips.stays),
        "places": len(trips.places),
        "median_length": _known(float(np.median(lengths)), 1) if lengths else None,
        "median_duration": _known(float(np.median(durations)), 1) if durations else None,
        "unseen": trips.unseen,
        "doubtful": trips.doubtful,
        "pairs": [
            {"from": origin, "to": goal, "trips": count}
            for (origin, goal), count in list(trips.matrix.items())[:_MAX_PLACES]
        ],
    }


def _count_activity(found: Findings, timed: Traversals | None) -> Numbers | None:
    """Trips and metres in each hour, day, week or month."""
    if timed is None:
        return None
    calendar = found.calendar
    local = calendar.local(timed.enter)
    unit, number = _choose_periods(local, dated=bool(calendar.name))
    first, count = int(number(local).min()), int(np.ptp(number(local))) + 1
    metres = np.bincount((number(local) - first).astype(int), timed.travelled, minlength=count)

    # Trips begin in a period of the traversals, or there are none.
    trips = None
    if found.trips is not None and found.trips.trips:
        starts = calendar.local([trip.start for trip in found.trips.trips])
        place = np.clip(number(starts) - first, 0, count - 1).astype(int)
        trips = np.bincount(place, minlength=count).tolist()
    return {
        "unit": unit,
        "first": first,
        "starts": [_name_period(unit, first + i, calendar) for i in range(count)],
        "trips": trips,
        "metres": [round(each, 1) for each in metres.tolist()],
    }


def _choose_periods(local: Floats, *, dated: bool) -> tuple[str, Callable[[Floats], Floats]]:
    """Unit of periods, and the function that numbers those of local times."""
    # The unit that gives a dozen bars or a few dozen.
    days = float(np.ptp(local)) / _DAY
    if days < _DAYS_FROM:
        return "hour", lambda times: np.floor(times / _HOUR)
    if days < _WEEKS_FROM:
        return "day", lambda times: np.floor(times / _DAY)
    if days < _MONTHS_FROM or not dated:
        shift = _MONDAY * _DAY if dated else 0.0
        return "week", lambda times: np.floor((times + shift) / _WEEK)
    return (
        "month",
        lambda times: (
            np.floor(times / _DAY)
            .astype("datetime64[D]")
            .astype("datetime64[M]")
            .astype(np.int64)
            .astype(np.float64)
        ),
    )


def _name_period(unit: str, number: int, calendar: Calendar) -> str:
    """When a period begins, as text.

    Examples
    --------
    >>> from datetime import UTC
    >>> utc = Calendar(UTC, "UTC", "default")
    >>> _name_period("week", 2900, utc), _name_period("hour", 30, Calendar(UTC, "", "log"))
    ('2025-07-28', 'hour 31')
    """
    if not calendar.name:
        return f"{unit} {number + 1}"
    if unit == "hour":
        return str(np.datetime64(number, "h")).replace("T", " ") + ":00"
    if unit == "month":
        return str(np.datetime64(number, "M"))
    days = number * 7 - _MONDAY if unit == "week" else number
    return str(np.datetime64(days, "D"))


def _list_places(found: Findings) -> list[Numbers] | None:
    if found.trips is None:
        return None

    # Six digits of degrees, and one of metres, are a decimetre.
    names = ("x", "y") if not found.trips.geographic else ("lat", "lon")
    digits = 1 if not found.trips.geographic else 6
    return [
        {
            "place": place.number,
            **{
                axis: round(float(value), digits)
                for axis, value in zip(names, [*place.position, 0.0][:2], strict=True)
            },
            "visits": place.visits,
            "dwell_s": _known(place.dwell, 1),
            "usual": place.usual,
            "role": place.role,
            "evidence": place.evidence,
            "arrivals": place.arrivals,
            "departures": place.departures,
        }
        for place in found.trips.places[:_MAX_PLACES]
    ]


def _metres_by_hour(calendar: Calendar, timed: Traversals) -> list[float]:
    """Metres travelled in each hour of the week, from Monday 0 o'clock."""
    slot = hours_of_week(calendar, timed.enter)
    metres = np.bincount(slot, timed.travelled, minlength=_WEEK_HOURS)
    return [round(each, 1) for each in metres.tolist()]


def _speeds_by_hour(calendar: Calendar, timed: Traversals) -> list[Numbers]:
    """Speeds of all edges in each hour in which somebody moves, without standing."""
    # Quartiles over the metres travelled.
    speeds = traversal_speeds(timed)
    known = np.isfinite(speeds)
    hour = calendar.part("hour", timed.enter[known])
    quartiles = grouped_quantiles(
        hour, speeds[known], timed.metres[known], _DAY_HOURS, (0.25, 0.5, 0.75)
    )
    counts = np.bincount(hour, minlength=_DAY_HOURS)

    # Hours in which nobody moves are left out.
    return [
        {
            "hour": number,
            "traversals": int(counts[number]),
            "speed_q1": _known(low),
            "speed": _known(middle),
            "speed_q3": _known(high),
        }
        for number, (low, middle, high) in enumerate(quartiles.tolist())
        if counts[number]
    ]


def _list_edges(history: History) -> list[Numbers]:
    """The edges that are travelled most."""
    # Traversals of half of the edge or more, by direction.
    network, rows = history.network, history.traversals
    counted = rows.metres >= _MIN_SHARE * network.lengths[rows.edge]
    forward = np.bincount(rows.edge[counted & rows.forward], minlength=len(network))
    backward = np.bincount(rows.edge[counted & ~rows.forward], minlength=len(network))
    speeds = traversal_speeds(rows)
    most = np.argsort(-(forward + backward), kind="stable")[:_MAX_EDGES].tolist()

    # Their numbers.
    listed = []
    for edge in most:
        own = speeds[rows.edge == edge]
        own = own[np.isfinite(own)]
        listed.append(
            {
                "edge": edge,
                **_middle(network, edge),
                "length": _known(float(network.lengths[edge]), 1),
                "forward": int(forward[edge]),
                "backward": int(backward[edge]),
                "speed": _known(float(np.median(own))) if len(own) else None,
            }
        )
    return listed


def _middle(network: Network, edge: int) -> Numbers:
    """Position in the middle of an edge."""
    point = network.middle(edge)[:2]
    if network.plane is None:
        return {"x": round(float(point[0]), 1), "y": round(float(point[1]), 1)}
    lat, lon = to_geographic(point[None], network.plane)
    return {"lat": round(float(lat[0]), 6), "lon": round(float(lon[0]), 6)}


def _list_changes(found: Findings) -> Numbers | None:
    changes = found.changes
    if changes is None:
        return None

    # Those that are surest.
    rows = sorted(changes.changes, key=lambda each: -each.evidence)[:_MAX_CHANGES]
    return {
        "since": _known(changes.since),
        "days": _known(changes.days),
        "threshold": _known(changes.threshold),
        "expected_false": _known(changes.false_alarms * changes.days),
        "changes": len(changes),
        "rows": [
            {
                "kind": each.kind,
                "edge": each.edge,
                "forward": each.forward,
                "since": _known(each.since),
                "evidence": _known(each.evidence),
                "agents": each.agents,
                "factor": _known(each.factor),
                **_middle(changes.network, each.edge),
            }
            for each in rows
        ],
    }


def _list_unusual(found: Findings) -> Numbers | None:
    own = found.unusual
    if own is None:
        return None

    # Those that have a reason.
    ranked = [trip for trip in own.unusual.ranked if trip.anomalies][:_MAX_UNUSUAL]
    names = ("lat", "lon") if own.unusual.geographic else ("x", "y")
    return {
        "trips": len(own.unusual),
        "left_out": own.left_out,
        "usual": own.usual,
        "rows": [
            {
                "track": trip.track,
                "start": _known(trip.start),
                "end": _known(trip.end),
                "score": _known(trip.score, 1),
                "reason": trip.reason,
                **{
                    axis: round(float(value), 6)
                    for axis, value in zip(names, trip.anomalies[0].position[:2], strict=True)
                },
            }
            for trip in ranked
        ],
    }


def _list_rounds(found: Findings) -> Numbers | None:
    rounds = found.rounds
    if rounds is None:
        return None

    # Those that cover least, then those that are late.
    ordered = sorted(rounds.rounds, key=lambda each: (each.share, -np.nan_to_num(each.late)))
    return {
        "edges": len(rounds.usual),
        "length": _known(rounds.length, 1),
        "duration": _known(rounds.duration, 1),
        "regularity": _known(rounds.regularity, 4),
        "rounds": len(rounds.rounds),
        "complete": sum(each.share >= _COMPLETE for each in rounds.rounds),
        "durations": [
            {"seconds": _known(each.end - each.start, 1), "complete": each.share >= _COMPLETE}
            for each in rounds.rounds[-_MAX_DRAWN:]
        ],
        "rows": [
            {
                "track": each.track,
                "round": each.number,
                "start": _known(each.start),
                "share": _known(each.share, 4),
                "late_s": _known(each.late, 1),
                "missed": list(each.missed),
            }
            for each in ordered[:_MAX_ROUNDS]
        ],
    }


def _tell_prediction(found: Findings) -> Numbers | None:
    foresight = None if found.unusual is None else found.unusual.foresight
    if foresight is None:
        return None
    return {
        "decisions": foresight.decisions,
        "right": _known(foresight.right, 4),
        "bits": _known(foresight.bits, 4),
    }
