"""What a page shows of a history: places, trips, use of edges, changes, unusual trips, rounds.

A trip, a stay or a round is a track and two times: the page has the walks already. An edge is its
number on the clean map.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gpszip.geo.planes import to_plane
from gpszip.view.blocks import pack_numbers

if TYPE_CHECKING:
    from gpszip.archive import Archive
    from gpszip.history.calendar import Calendar
    from gpszip.history.traversals import Traversals
    from gpszip.model import Plane
    from gpszip.model.unusual import Unusual
    from gpszip.pipeline.findings import Findings

__all__ = ["hours_of_week", "show_history"]

#: Seconds and metres to which the page knows numbers.
_STEP = 0.1

#: Rows of the use of edges from which weekdays are not told apart: 5 bytes each.
_MAX_USAGE_ROWS = 100_000

#: Trips that are listed as unusual.
_MAX_UNUSUAL = 100

#: Share of an edge that a traversal takes to count as one.
_MIN_SHARE = 0.5

#: Hours of a day and of a week.
_DAY_HOURS, _WEEK_HOURS = 24, 168

Floats = NDArray[np.float64]

#: Moves positions to the plane of a page that shows another archive, too.
Move = Callable[[Floats], Floats]


def show_history(found: Findings, archive: Archive, move: Move | None = None) -> dict[str, Any]:
    """Pack what a history tells for a page.

    Parameters
    ----------
    found : Findings
        Of the archive.
    archive : Archive
        Its tracks and plane.
    move : callable, optional
        Moves positions of the archive's plane to that of the page.
    """
    # Parts that are not known stay empty.
    tracks = {id: number for number, id in enumerate(archive.ids)}
    place = _Placing(archive.grid.plane, move)
    shown: dict[str, Any] = {
        "zone": found.calendar.name or None,
        "notes": found.notes,
        "places": None,
        "usage": None,
        "changes": None,
        "unusual": None,
        "rounds": None,
    }

    # Places, trips and the use of edges.
    if found.trips is not None:
        shown["places"] = _show_trips(found, tracks, place)
    if found.usage is not None and found.history is not None:
        shown["usage"] = _show_usage(found.usage.traversals, found)

    # Changes, unusual trips and rounds.
    if found.changes is not None:
        shown["changes"] = [
            {
                "kind": each.kind,
                "edge": each.edge,
                "since": round(each.since, 1),
                "agents": each.agents,
                "factor": round(each.factor, 2) if np.isfinite(each.factor) else None,
            }
            for each in found.changes.changes
        ]
    if found.unusual is not None:
        shown["unusual"] = _show_unusual(found.unusual.unusual, tracks, place)
    if found.rounds is not None:
        shown["rounds"] = {
            "edges": sorted({edge for edge, _ in found.rounds.usual}),
            "missed": sorted({each.edge for each in found.rounds.edges if each.missed}),
            "rows": [
                {
                    "track": tracks[each.track],
                    "start": _time(each.start),
                    "end": _time(each.end),
                    "share": round(each.share, 4),
                    "missed": len(each.missed),
                }
                for each in found.rounds.rounds
            ],
        }
    return shown


class _Placing:
    """Puts positions of people on the plane of the page."""

    def __init__(self, plane: Plane | None, move: Move | None) -> None:
        self.plane, self.move = plane, move

    def __call__(self, positions: Sequence[Sequence[float]]) -> Floats:
        """Return positions in metres, shape (n, 2), of latitudes and longitudes, or x and y."""
        rows = np.array([[*each[:2], 0.0][:2] for each in positions], np.float64).reshape(-1, 2)
        if not len(rows):
            return rows
        if self.plane is not None:
            rows = to_plane(rows[:, 0], rows[:, 1], self.plane)
        return rows if self.move is None else self.move(rows)


def _time(seconds: float) -> float | None:
    return round(seconds, 1) if np.isfinite(seconds) else None


def _pack(rows: Sequence[Any], names: Sequence[str], step: float = 1.0) -> dict[str, Any]:
    """Pack attributes of values."""
    return {name: pack_numbers([float(getattr(row, name)) for row in rows], step) for name in names}


def _show_trips(found: Findings, tracks: dict[str, int], place: _Placing) -> dict[str, Any] | None:
    """Places, and stays and trips by their tracks and times."""
    trips = found.trips
    if trips is None:
        return None

    # Stays and trips are parts of tracks: their lines are those of the walks.
    positions = place([each.position for each in trips.places])
    return {
        "x": pack_numbers(positions[:, 0], _STEP),
        "y": pack_numbers(positions[:, 1], _STEP),
        **_pack(trips.places, ("spread", "dwell"), _STEP),
        **_pack(trips.places, ("visits", "departures", "arrivals")),
        "usual": [each.usual for each in trips.places],
        "roles": [each.role for each in trips.places],
        "evidence": [each.evidence for each in trips.places],
        "stays": {
            "track": pack_numbers([tracks[each.track] for each in trips.stays]),
            **_pack(trips.stays, ("start", "end"), _STEP),
            **_pack(trips.stays, ("place",)),
        },
        "trips": {
            "track": pack_numbers([tracks[each.track] for each in trips.trips]),
            **_pack(trips.trips, ("start", "end", "length"), _STEP),
            **_pack(trips.trips, ("origin", "goal")),
        },
    }


def _show_usage(rows: Traversals, found: Findings) -> dict[str, Any] | None:
    """Traversals, metres and seconds of travel on each edge in each hour of the week."""
    if found.history is None:
        return None
    rows = rows.take(np.isfinite(rows.enter))
    if not len(rows):
        return None

    # Hours of the week, or of the day where those would be too many rows.
    slot = hours_of_week(found.calendar, rows.enter)
    key = rows.edge * _WEEK_HOURS + slot
    has_weekdays = len(np.unique(key)) <= _MAX_USAGE_ROWS
    if not has_weekdays:
        key = rows.edge * _WEEK_HOURS + slot % _DAY_HOURS
    distinct, group = np.unique(key, return_inverse=True)

    # What was travelled in each; jumps of the receiver are kept out of speeds.
    counted = rows.metres >= _MIN_SHARE * found.history.network.lengths[rows.edge]
    moving = np.maximum(rows.leave - rows.enter - rows.standing, 0.0)
    moves = ~rows.jumps
    edge, hour = np.divmod(distinct, _WEEK_HOURS)
    return {
        "weekdays": has_weekdays,
        "edge": pack_numbers(edge),
        "slot": pack_numbers(hour),
        "traversals": pack_numbers(np.bincount(group, counted)),
        "metres": pack_numbers(np.bincount(group, rows.metres * moves)),
        "seconds": pack_numbers(np.bincount(group, moving * moves)),
    }


def hours_of_week(calendar: Calendar, times: Floats) -> NDArray[np.int64]:
    """Hour of the week of finite times: 0 to 167, from Monday 0 o'clock of local clocks."""
    return _DAY_HOURS * calendar.part("weekday", times) + calendar.part("hour", times)


def _show_unusual(found: Unusual, tracks: dict[str, int], place: _Placing) -> list[dict[str, Any]]:
    """The most unusual trips that have a reason, each with its most unusual part."""
    ranked = [trip for trip in found.ranked if trip.anomalies][:_MAX_UNUSUAL]
    positions = place([trip.anomalies[0].position for trip in ranked])
    return [
        {
            "track": tracks[trip.track],
            "start": _time(trip.anomalies[0].start),
            "end": _time(trip.anomalies[0].end),
            "score": round(trip.score, 1),
            "reason": trip.reason,
            "x": round(float(x), 1),
            "y": round(float(y), 1),
        }
        for trip, (x, y) in zip(ranked, positions.tolist(), strict=True)
    ]
