"""Trips of an archive, scored by what its other trips did, and what it would have predicted.

A trip that is known is never unusual. So a part of the trips teaches what is usual, and the others
are scored: those since a time by the trips before it, or every second trip by those between them,
and the other way round.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OptionError
from gpszip.history.traversals import History, Traversals
from gpszip.history.trips import TripRows, trips_of_history
from gpszip.history.unusual.first_look import quick_bits, rarest_parts
from gpszip.history.unusual.log_trips import LogTrip
from gpszip.history.unusual.unusual import Usual
from gpszip.model.unusual import Unusual, UnusualTrip

__all__ = ["Foresight", "OwnTrips", "score_own_trips"]

#: Trips that teach, and trips that are scored, at least: with fewer, all are unusual.
_MIN_TRIPS = 4

#: Traversals that are scored at most, those of the trips that a first look finds the rarest: 1 s of
#: CPU on a log of buses.
_MAX_SCORED = 6_000

#: Decisions that are predicted at most: 0.2 s of CPU.
_MAX_DECISIONS = 2_000

#: Edges before a decision that count.
_LOOK_BACK = 256

Mask = NDArray[np.bool_]
Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Foresight:
    """How well the next edge is predicted where there are two ways on or more.

    Parameters
    ----------
    decisions : int
        Decisions that were predicted.
    right : float
        Share of them whose likeliest edge was taken.
    bits : float
        Mean of -log2 of the probability of the edge that was taken.
    """

    decisions: int
    right: float
    bits: float


@dataclass(frozen=True, eq=False)
class OwnTrips:
    """Trips of an archive with their scores, and how well the others foresaw them.

    Parameters
    ----------
    unusual : Unusual
        The trips that were scored, in the order of the log.
    foresight : Foresight or None
        None where no trip comes to a crossing.
    left_out : int
        Trips before ``since``.
    usual : int
        Trips, of very many, that a first look found to be usual, and that were not scored.
    """

    unusual: Unusual
    foresight: Foresight | None
    left_out: int
    usual: int


def score_own_trips(
    history: History,
    since: float | None = None,
    trips: TripRows | None = None,
    timezone: str | None = None,
) -> OwnTrips:
    """Score trips of an archive by what others of its trips did.

    Parameters
    ----------
    history : History
        Traversals of the archive.
    since : float, optional
        Trips that begin from this time on, in seconds, are scored by those before. By default,
        every second trip is scored by the others, and the other way round.
    trips : TripRows, optional
        The trips of the archive, where they are known.
    timezone : str, optional
        Time zone of hours; by default that of the place, else UTC.

    Returns
    -------
    OwnTrips
        Scores and reasons are those of :func:`gpszip.unusual`.

    Raises
    ------
    OptionError
        If there are no times, or too few trips.

    Examples
    --------
    >>> import gpszip
    >>> from gpszip.history.traversals import read_history
    >>> times = np.arange(0.0, 16000.0, 20.0)
    >>> x = np.interp(times % 1600, [0, 600, 800, 1400, 1600], [0, 0, 900, 900, 0])
    >>> track = gpszip.Track("bus", times, np.stack([x, 0 * x], axis=1))
    >>> own = score_own_trips(read_history(gpszip.compress(track, rmse=5.0, effort=1)))
    >>> own.unusual, own.left_out
    (Unusual(20 trips, 0 absences), 0)
    """
    # Trips with times.
    network, rows = history.network, history.traversals
    if not np.isfinite(rows.enter).any():
        raise OptionError("no track has times, so there are no trips to compare")
    trips = trips_of_history(history) if trips is None else trips
    rows, of_row, times = _take_timed(rows, trips)
    first = np.flatnonzero(np.diff(of_row, prepend=-1))
    end = np.append(first[1:], len(rows)) if len(first) else first

    # Which of them teach which others: by their places in the order of time.
    place = np.empty(len(first), np.int64)
    place[np.argsort(times[:, 0], kind="stable")] = np.arange(len(first))
    after = place % 2 == 0 if since is None else times[:, 0] >= since
    if min(after.sum(), (~after).sum()) < _MIN_TRIPS:
        raise OptionError("there are too few trips to tell what is usual")

    # The rarest ones at a first look, if there are many.
    folds = [(after, ~after)] if since is not None else [(after, ~after), (~after, after)]
    rarest = np.full(len(first), -1.0)
    for asked, known in folds:
        rarest[asked] = rarest_parts(quick_bits(rows, known[of_row]), first)[asked]
    is_scored = _choose(end - first, rarest, _MAX_SCORED)

    # Learn from one part, and score the other one.
    scored: dict[int, UnusualTrip] = {}
    told: list[tuple[float, bool]] = []
    for asked, known in folds:
        usual = Usual(History(network, rows.take(known[of_row])), timezone)
        for trip in np.flatnonzero(asked & is_scored).tolist():
            own = np.arange(first[trip], end[trip])
            track = int(rows.track[own[0]])
            begin, over = times[trip].tolist()
            asked_trip = LogTrip(track, begin, over, own, ())
            scored[trip] = usual.score(asked_trip, rows.ids[track], rows)
        told += _predict(usual, rows, asked[of_row], _MAX_DECISIONS // len(folds))

    # All of them.
    found = Unusual(tuple(scored[trip] for trip in sorted(scored)), (), network.plane is not None)
    left_out = int((rarest < 0).sum())
    return OwnTrips(found, _sum_up(told), left_out, len(first) - left_out - len(scored))


def _choose(sizes: Ints, rarest: Floats, most: int) -> Mask:
    """Which trips are scored: the rarest that fit in together, one at least; none below zero."""
    is_chosen = np.zeros(len(sizes), np.bool_)
    left = most
    for trip in np.argsort(-rarest, kind="stable").tolist():
        if rarest[trip] >= 0 and (sizes[trip] <= left or left == most):
            is_chosen[trip] = True
            left -= int(sizes[trip])
    return is_chosen


def _take_timed(rows: Traversals, trips: TripRows) -> tuple[Traversals, Ints, Floats]:
    """Traversals of trips with times, the trip of each, and the times of all these trips."""
    kept = (trips.of >= 0) & np.isfinite(rows.enter)
    number, of = np.unique(trips.of[kept], return_inverse=True)
    return rows.take(kept), of.reshape(-1), trips.times[number]


def _predict(usual: Usual, rows: Traversals, asked: Mask, most: int) -> list[tuple[float, bool]]:
    """Probability of the edge taken, and whether it was the likeliest, at some decisions."""
    # Decisions: edges that are followed by another one, and have two ways on besides the way back.
    options, directed = usual.model.options, rows.directed
    ways = np.array([len(row) for row in options])
    follows = np.append(~rows.starts[1:], False)
    decisions = np.flatnonzero(asked & follows & (ways[directed] > 2))
    decisions = decisions[np.linspace(0, len(decisions) - 1, min(most, len(decisions))).astype(int)]

    # What the route before each tells.
    begins = np.flatnonzero(rows.starts)
    first = begins[np.searchsorted(begins, decisions, side="right") - 1]
    hours = usual.hours(rows)
    told = []
    for start, row in zip(np.maximum(first, decisions - _LOOK_BACK), decisions, strict=True):
        route = directed[start : row + 1].tolist()
        if int(directed[row + 1]) not in options[route[-1]]:
            continue
        hour, agent = int(hours[row]), usual.predictor.agent_number(rows.ids[rows.track[row]])
        chances = usual.model.predict(route, None if hour < 0 else hour, agent)
        taken = options[route[-1]].index(int(directed[row + 1]))
        told.append((chances[taken], chances[taken] == max(chances)))
    return told


def _sum_up(told: list[tuple[float, bool]]) -> Foresight | None:
    if not told:
        return None
    chances, right = np.array(told).T
    bits = float(-np.log2(np.maximum(chances, 1e-9)).mean())
    return Foresight(len(told), float(right.mean()), bits)
