"""Travel times of routes from all traversals: by edge, direction and hour, with a band.

Seconds per metre of a directed edge d in hour h are ``r(d) f(h) g(d, h)``, each a ratio of observed
to expected seconds that is drawn to what is known without it, as long as observations are few:

- ``r(d) = (sum of t + p r0) / (sum of m + p)`` with seconds t and metres m of its traversals, p
  metres that grow with its length, and r0 of the other direction, drawn to that of all edges;
- ``f(h) = (sum of t + K) / (sum of r m + K)`` over all traversals about hour h;
- ``g(d, h) = (sum of t + p' r f) / (sum of r f m + p' r f)`` over those of edge d.

Seconds include standing, as at lights and stops, but not parking: they are cut off at a multiple of
the edge's median. The band is that of drives in the log: quantiles of observed over expected
seconds, by the length of the drive, each drive expected without the half of the tracks it belongs
to.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.errors import OptionError
from gpszip.history.calendar import Calendar
from gpszip.history.groups import sum_by
from gpszip.history.traversals import History, Traversals
from gpszip.model import Network
from gpszip.simplification.traversals import grouped_quantiles

__all__ = ["TravelTime", "TravelTimes", "learn_travel_times"]

#: Hours of the day.
_HOURS = 24

#: Weights of the hour before, the hour itself and the hour after.
_HOUR_WEIGHTS = (0.5, 1.0, 0.5)

#: Share of an edge below which a traversal tells no travel time.
_MIN_SHARE = 0.5

#: Seconds above the median after which a vehicle is parked, and the multiple of the median.
_PARKED_SECONDS = 120.0
_PARKED_FACTOR = 3.0

#: Traversals that the speed elsewhere may count for on an edge. The one is chosen that foresees the
#: drives of half of the tracks best from the others: logs have few traversals or many.
_STRENGTHS = (32.0, 8.0, 2.0, 0.5)

#: Metres added to the length of an edge in its prior: on a short one, the seconds of a few
#: traversals are mostly errors of their ends.
_PRIOR_METRES = 200.0

#: Expected seconds of the drives by which the strength is chosen.
_CHOICE_SECONDS = 180.0

#: Traversals that the median of an edge needs; otherwise that of all edges counts.
_MIN_TRAVERSALS = 5

#: Seconds that no effect of the hour counts for, among all edges together.
_HOUR_PRIOR = 3600.0

#: Multiple of the strength that the usual effect of the hour counts for on an edge.
_EDGE_HOUR_FACTOR = 8.0

#: Seconds that the usual pace counts for against that of this drive so far.
_PACE_PRIOR = 600.0

#: Expected seconds of drives from which the band is read.
_BAND_SECONDS = (60.0, 180.0, 420.0, 900.0, 1800.0, 3600.0)

#: Quantiles of the band of 80 %.
_BAND = (0.1, 0.9)

#: Observed over expected seconds where a log has too few drives to tell.
_WIDE_BAND = (0.6, 1.7)

#: Drives that a length needs for quantiles of its own.
_MIN_DRIVES = 20

#: Multiples of it are spread evenly between whole numbers.
_GOLDEN = 0.618033988749895

#: Seconds of a day and of an hour.
_DAY = 86_400.0
_HOUR = 3600.0

Floats = NDArray[np.float64]
Longs = NDArray[np.int64]


class TravelTime(NamedTuple):
    """Seconds that a route takes: expected, and an interval that holds 80 % of all drives.

    Parameters
    ----------
    seconds, low, high : float
        Seconds from departure.
    """

    seconds: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class TravelTimes:
    """Expected seconds on each directed edge (``2 * edge``, plus 1 backward) in each hour.

    Parameters
    ----------
    network : Network
        The edges.
    calendar : Calendar
        Whose hours they are.
    rates : float64 array, shape (2 E, 24)
        Seconds per metre.
    counts : int64 array, shape (2 E,)
        Traversals from which they come.
    band_seconds : float64 array, shape (b,)
        Expected seconds of drives, increasing.
    band : float64 array, shape (b, 2)
        Quantiles at 10 and 90 % of observed over expected seconds of drives as long.
    """

    network: Network
    calendar: Calendar
    rates: Floats
    counts: Longs
    band_seconds: Floats
    band: Floats

    def seconds(
        self,
        edges: ArrayLike,
        forward: ArrayLike,
        depart: float | None = None,
        *,
        metres: ArrayLike | None = None,
        pace: float = 1.0,
    ) -> Floats:
        """Expected seconds on each edge of a route.

        Parameters
        ----------
        edges, forward : array_like, shape (n,)
            The route: edges of the network and directions, as in routes of ``gpszip.match``.
        depart : float, optional
            Time of departure in seconds, in the log's zero; by default the mean over the day.
        metres : array_like, shape (n,), optional
            Metres travelled on each edge; by default all of it.
        pace : float, default 1
            Multiplies all, see :meth:`pace_so_far`.

        Examples
        --------
        >>> import gpszip
        >>> from gpszip.history.traversals import read_history
        >>> from gpszip.testing import ring
        >>> history = read_history(gpszip.compress(ring(4, laps=9).tracks, max_error=5))
        >>> times = learn_travel_times(history)
        >>> seconds = times.seconds(history.traversals.edge[:3], history.traversals.forward[:3])
        >>> bool((seconds > 0).all())
        True
        """
        # Metres and directed edges.
        edges = np.asarray(edges, np.int64)
        directed = 2 * edges + ~np.asarray(forward, np.bool_)
        lengths = self.network.lengths[edges] if metres is None else np.asarray(metres, np.float64)
        if depart is None:
            average: Floats = self.rates[directed].mean(axis=1) * lengths * pace
            return average

        # The hour at which each edge is entered follows from those before; two rounds settle it.
        local = float(self.calendar.local([depart])[0])
        hour = np.full(len(edges), int(local % _DAY // _HOUR))
        seconds = np.zeros(len(edges))
        for _ in range(3):
            seconds = self.rates[directed, hour] * lengths * pace
            entered = local + np.cumsum(seconds) - seconds
            hour = (entered % _DAY // _HOUR).astype(np.int64)
        return seconds

    def arrival(
        self,
        edges: ArrayLike,
        forward: ArrayLike,
        depart: float | None = None,
        *,
        metres: ArrayLike | None = None,
        pace: float = 1.0,
    ) -> TravelTime:
        """Seconds that a route takes, with a band; parameters as of :meth:`seconds`."""
        total = float(self.seconds(edges, forward, depart, metres=metres, pace=pace).sum())
        return self.with_band(total)

    def with_band(self, seconds: float) -> TravelTime:
        """The band about expected seconds of a drive."""
        place = np.log(max(seconds, 1.0))
        low, high = (
            float(np.interp(place, np.log(self.band_seconds), self.band[:, side]))
            for side in range(2)
        )
        return TravelTime(seconds, seconds * low, seconds * high)

    def pace_so_far(self, observed: float, expected: float) -> float:
        """Pace of a drive from its observed and expected seconds, drawn to 1 while it is short.

        Examples
        --------
        >>> TravelTimes.pace_so_far(None, 1200.0, 600.0)
        1.5
        """
        return (observed + _PACE_PRIOR) / (expected + _PACE_PRIOR)


def learn_travel_times(history: History, calendar: Calendar | None = None) -> TravelTimes:
    """Learn travel times from all traversals.

    Parameters
    ----------
    history : History
        The traversals of an archive.
    calendar : Calendar, optional
        Time zone of the hours; by default that of :func:`choose_calendar`.

    Raises
    ------
    OptionError
        If no track has times, or none travels half of an edge.
    """
    from gpszip.history.calendar import choose_calendar

    # Traversals of at least half of an edge tell its speed.
    network, rows = history.network, history.traversals
    calendar = calendar or choose_calendar(network, rows.enter, None)
    told = _told(network, rows, calendar)
    if not np.isfinite(rows.enter).any():
        raise OptionError(
            "no track has times, so that there are no travel times", remedy="log times, too"
        )
    if not len(told.seconds):
        raise OptionError(
            "no track travels half of an edge, so that there are no travel times",
            remedy="give longer tracks",
        )

    # The strength that foresees drives best, and the band with it.
    foreseen = [_foresee(network, told, strength) for strength in _STRENGTHS]
    errors = [_mean_error(_drives(told, expected, _CHOICE_SECONDS)) for expected in foreseen]
    best = int(np.argmin(errors))
    return TravelTimes(
        network=network,
        calendar=calendar,
        rates=_rates(network, told, _STRENGTHS[best]),
        counts=np.bincount(told.directed, minlength=2 * len(network)),
        band_seconds=np.array(_BAND_SECONDS),
        band=_measure_band(told, foreseen[best]),
    )


class _Told(NamedTuple):
    """Traversals that tell a travel time.

    Parameters
    ----------
    directed, hour, track : int64 array, shape (n,)
        Directed edge, local hour and track.
    metres, seconds : float64 array, shape (n,)
        Travel, with standing, but not parking.
    continues : bool array, shape (n,)
        Whether the traversal goes on from the one before among these.
    """

    directed: Longs
    hour: Longs
    track: Longs
    metres: Floats
    seconds: Floats
    continues: NDArray[np.bool_]


def _told(network: Network, rows: Traversals, calendar: Calendar) -> _Told:
    """Traversals with times of half of their edge or more, without parking."""
    # Which ones.
    seconds, metres = rows.leave - rows.enter, rows.metres
    kept = np.isfinite(seconds) & ~rows.jumps & (metres >= _MIN_SHARE * network.lengths[rows.edge])
    kept &= seconds > 0
    chosen = rows.take(kept)
    seconds, metres = seconds[kept], metres[kept]

    # Parking is longer than usual travel on the edge in that direction, or on others.
    directed, size = chosen.directed, 2 * len(network)
    paces, alike = seconds / metres, np.ones(len(metres))
    median = grouped_quantiles(directed, paces, alike, size, (0.5,))[:, 0]
    rare = np.bincount(directed, minlength=size) < _MIN_TRAVERSALS
    if len(paces):
        median[rare] = np.median(paces)
    usual = median[directed] * metres
    parked = seconds > _PARKED_FACTOR * usual + _PARKED_SECONDS
    seconds = np.where(parked, usual, seconds)
    return _Told(
        directed,
        calendar.part("hour", chosen.enter),
        chosen.track.astype(np.int64),
        metres,
        seconds,
        ~chosen.starts & ~parked,
    )


def _rates(network: Network, told: _Told, strength: float) -> Floats:
    """Seconds per metre of each directed edge in each hour, shape (2 E, 24)."""
    # Edges, drawn to the other direction, and that to all.
    size = 2 * len(network)
    lengths = np.repeat(network.lengths, 2)
    seconds = sum_by(told.directed, told.seconds, size)
    metres = sum_by(told.directed, told.metres, size)
    overall = float(told.seconds.sum() / told.metres.sum())
    other = np.arange(size) ^ 1
    prior = strength * (lengths + _PRIOR_METRES)
    drawn = (seconds[other] + prior * overall) / (metres[other] + prior)
    rate = (seconds + prior * drawn) / (metres + prior)

    # Hours of all edges.
    expected = rate[told.directed] * told.metres
    observed_hour = _about(sum_by(told.hour, told.seconds, _HOURS)[None])[0]
    expected_hour = _about(sum_by(told.hour, expected, _HOURS)[None])[0]
    hour = (observed_hour + _HOUR_PRIOR) / (expected_hour + _HOUR_PRIOR)

    # Hours of each edge.
    usual = rate[:, None] * hour
    key = told.directed * _HOURS + told.hour
    observed = _about(sum_by(key, told.seconds, size * _HOURS).reshape(-1, _HOURS))
    expected = _about(
        sum_by(key, usual[told.directed, told.hour] * told.metres, size * _HOURS).reshape(
            -1, _HOURS
        )
    )
    prior = _EDGE_HOUR_FACTOR * prior[:, None] * usual
    rates: Floats = usual * (observed + prior) / (expected + prior)
    return rates


def _about(sums: Floats) -> Floats:
    """Sums of each hour and its neighbours, shape (n, 24), the day being a circle."""
    before, here, after = _HOUR_WEIGHTS
    return before * np.roll(sums, 1, axis=1) + here * sums + after * np.roll(sums, -1, axis=1)


def _foresee(network: Network, told: _Told, strength: float) -> Floats:
    """Expected seconds of each traversal by the other half of the tracks, shape (n,)."""
    # Halves that follow no pattern in the order of the tracks; of a single track, its traversals.
    half = (told.track * _GOLDEN % 1.0 < 0.5).astype(np.int64)
    if half.all() or not half.any():
        half = np.arange(len(told.seconds)) * 2 // len(told.seconds)

    # Where one half is empty, all that there is.
    expected = np.zeros(len(told.seconds))
    for side in range(2):
        mine = half == side
        others = told if mine.all() else _Told(*(values[~mine] for values in told))
        rates = _rates(network, others, strength)
        expected[mine] = rates[told.directed[mine], told.hour[mine]] * told.metres[mine]
    return expected


def _drives(told: _Told, expected: Floats, length: float) -> Floats:
    """Observed over expected seconds of all drives of an expected length in seconds."""
    # From every traversal on, up to the one in which the length is reached, within one run.
    run = np.cumsum(~told.continues)
    last_of_run = np.searchsorted(run, run, side="right") - 1
    ends, observed = np.cumsum(expected), np.cumsum(told.seconds)
    begins = ends - expected
    last = np.searchsorted(ends, begins + length)
    first = np.flatnonzero(last <= last_of_run)
    last = last[first]
    took = observed[last] - observed[first] + told.seconds[first]
    ratio: Floats = took / (ends[last] - begins[first])
    return ratio


def _mean_error(ratio: Floats) -> float:
    """Mean error of expected seconds, relative to observed ones; infinite without drives."""
    return float(np.abs(1 / ratio - 1).mean()) if len(ratio) else np.inf


def _measure_band(told: _Told, expected: Floats) -> Floats:
    """Quantiles of observed over expected seconds of drives by their length, shape (b, 2)."""
    # Lengths with few drives have the band of the length before.
    band = [_WIDE_BAND]
    for length in _BAND_SECONDS:
        ratio = _drives(told, expected, length)
        low, high = band[-1] if len(ratio) < _MIN_DRIVES else np.quantile(ratio, _BAND).tolist()
        band.append((low, high))
    return np.array(band[1:])
