"""What has changed on a map: closed, reopened, new, moved, slower, faster and one-way edges.

Each kind needs occasion, not time alone:

- **closed**: agents that come to the junction before an edge turn elsewhere, see
  :mod:`gpszip.history.changes.closures`; **one-way** where the other direction is still travelled;
- **reopened**: the next passage of a closed edge;
- **new**: an edge that nobody took before. Of the agents at its beginning now, a share q takes it;
  the evidence is ``-n ln(1 - q)`` for the n agents that were there before, with one passage fewer
  for q. New edges that touch each other have the evidence of the best;
- **moved**: a closed edge whose ends a new one joins;
- **slower**, **faster**: seconds against those expected for edge, direction and hour. Ratios of one
  track and hour count once; the evidence is that of a two-sided test of their means.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.special import log_ndtr

from gpszip.errors import OptionError
from gpszip.history.calendar import choose_calendar
from gpszip.history.changes.closures import Closures, choose_threshold, find_closures
from gpszip.history.travel_time import learn_travel_times
from gpszip.history.traversals import History, Traversals
from gpszip.model import Network
from gpszip.model.text import count_text

__all__ = ["KINDS", "Change", "Changes", "find_changes"]

#: Kinds of changes.
KINDS = ("closed", "reopened", "new", "moved", "slower", "faster", "one-way")

#: Traversals that a new edge needs, and an edge whose other direction is still travelled.
_MIN_NEW = 3
_MIN_OPEN = 3

#: Share of an edge that is travelled at least where it counts, and where all of it counts.
_MIN_SHARE = 0.5
_WHOLE = 0.9

#: Observations before and after for a change of speed.
_MIN_OBSERVATIONS = 6

#: Smallest change of travel times: a sixth.
_MIN_FACTOR = 1.15

#: A moved edge is at most this many times as long as before, or as short.
_MAX_RATIO = 1.5

#: Seconds of a day and of an hour.
_DAY = 86_400.0
_HOUR = 3600.0

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Change:
    """One change.

    Parameters
    ----------
    kind : str
        One of :data:`KINDS`.
    edge : int
        Edge of the network.
    forward : bool
        Direction concerned, from its start to its end; for ``one-way`` the one that is closed.
    since : float
        Seconds at which it was first seen: the first agent that turned elsewhere after the last
        passage, the first passage, or the first slow one.
    detected : float
        Seconds at which the evidence sufficed.
    evidence : float
        Nats: ``exp(-evidence)`` is about the probability of such evidence without a change.
    agents : int
        Missed passages until then, passages of a new edge, or observations of its speed.
    factor : float
        Travel time now over that before for ``slower`` and ``faster``; else NaN.
    other : int
        The new edge of a moved one; else -1.
    """

    kind: str
    edge: int
    forward: bool
    since: float
    detected: float
    evidence: float
    agents: int
    factor: float = float("nan")
    other: int = -1

    @property
    def delay(self) -> float:
        """Seconds from the first sign to the detection."""
        return self.detected - self.since


@dataclass(frozen=True, eq=False, repr=False)
class Changes:
    """All changes, by kind and time.

    Parameters
    ----------
    network : Network
        The map of the time before and after.
    changes : tuple of Change
        What has changed.
    since : float
        Seconds at which the time after begins.
    threshold : float
        Nats of evidence for a closure.
    false_alarms : float
        False alarms a day for which it was chosen; NaN if it was given.
    days : float
        Days after.
    """

    network: Network
    changes: tuple[Change, ...]
    since: float
    threshold: float
    false_alarms: float
    days: float

    def __repr__(self) -> str:
        kinds = [change.kind for change in self.changes]
        counts = [f"{kinds.count(kind)} {kind}" for kind in KINDS if kind in kinds]
        what = f": {', '.join(counts)}" if counts else ""
        return f"Changes({count_text(len(self), 'change')}{what})"

    def __len__(self) -> int:
        return len(self.changes)

    def __getitem__(self, number: int) -> Change:
        return self.changes[number]

    def of_kind(self, kind: str) -> tuple[Change, ...]:
        """Changes of one kind."""
        return tuple(change for change in self.changes if change.kind == kind)


class _Both(NamedTuple):
    """Traversals with times, and which are of the time after."""

    network: Network
    rows: Traversals
    after: Mask


def find_changes(
    history: History,
    after: Mask,
    *,
    false_alarms: float = 0.1,
    threshold: float | None = None,
    kinds: Sequence[str] = KINDS,
) -> Changes:
    """Find what has changed from a time before to one after.

    Parameters
    ----------
    history : History
        Traversals of both, on one map.
    after : bool array, shape (n,)
        Which traversals are of the time after.
    false_alarms : float, default 0.1
        False alarms of closures a day that the threshold is chosen for.
    threshold : float, optional
        Nats of evidence instead, whatever ``false_alarms`` is; positive.
    kinds : sequence of str
        Kinds to look for.

    Raises
    ------
    OptionError
        If tracks have no times, nothing is before or after, or a number is not positive.
    """
    # Refuse what can't be compared.
    for name, value in (("false_alarms", false_alarms), ("threshold", threshold)):
        if value is not None and not (value > 0 and np.isfinite(value)):
            raise OptionError(f"{name} is {value:g}; it must be a positive number")
    network, rows = history.network, history.traversals
    timed = np.isfinite(rows.enter)
    if not timed.any():
        raise OptionError("no track has times, so that nothing is before or after")
    both = _Both(network, rows.take(timed), after[timed])
    for mask, which in ((~both.after, "before"), (both.after, "after")):
        if not mask.any():
            raise OptionError(
                f"nothing was travelled {which} that time", remedy="choose a time within the log"
            )

    # Closures and what follows from them, then speeds.
    if threshold is None:
        threshold = choose_threshold(network, both.rows, ~both.after, false_alarms)
    else:
        false_alarms = np.nan
    closures = find_closures(network, both.rows, both.after, threshold)
    found = _closed(both, closures)
    new = _new(both, threshold)
    found = _moved(network, found, new) + _reopened(closures)
    found += [change for change in new if change.other < 0]
    if "slower" in kinds or "faster" in kinds:
        found += _speeds(both, threshold)

    # By kind and time.
    found = [change for change in found if change.kind in kinds]
    found.sort(key=lambda change: (KINDS.index(change.kind), change.detected, change.edge))
    times = both.rows.enter[both.after]
    days = float(both.rows.leave[both.after].max() - times.min()) / _DAY
    return Changes(network, tuple(found), float(times.min()), threshold, false_alarms, days)


def _closed(both: _Both, closures: Closures) -> list[Change]:
    """Closed directions, as ``one-way`` where the other one was travelled since."""
    found = []
    for directed, since, detected, missed, evidence, again in zip(
        closures.directed.tolist(),
        closures.since.tolist(),
        closures.detected.tolist(),
        closures.missed.tolist(),
        closures.evidence.tolist(),
        closures.reopened.tolist(),
        strict=True,
    ):
        # Passages against it while it was closed.
        enter = both.rows.enter
        against = both.after & (both.rows.directed == directed ^ 1) & (enter >= since)
        against &= ~(enter >= again)
        whole = both.rows.metres >= _WHOLE * both.network.lengths[both.rows.edge]
        kind = "one-way" if int((against & whole).sum()) >= _MIN_OPEN else "closed"
        forward = directed % 2 == 0
        found.append(Change(kind, directed // 2, forward, since, detected, evidence, missed))
    return found


def _reopened(closures: Closures) -> list[Change]:
    """Closed directions that were passed again."""
    return [
        Change("reopened", directed // 2, directed % 2 == 0, again, again, evidence, missed)
        for directed, again, evidence, missed in zip(
            closures.directed.tolist(),
            closures.reopened.tolist(),
            closures.evidence.tolist(),
            closures.missed.tolist(),
            strict=True,
        )
        if np.isfinite(again)
    ]


def _new(both: _Both, threshold: float) -> list[Change]:
    """Directions of edges that were not travelled before, by the agents at their ends."""
    # Passages before and after; those before count if they are any travel at all.
    network, rows, after = both
    size = 2 * len(network)
    whole = rows.metres >= _MIN_SHARE * network.lengths[rows.edge]
    passes = np.bincount(rows.directed[after & whole], minlength=size)
    known = np.bincount(rows.edge[~after & whole], minlength=len(network)) > 0
    candidates = np.flatnonzero((passes >= _MIN_NEW) & ~np.repeat(known, 2))
    if not len(candidates):
        return []

    # Agents at the node where each begins, before and after.
    tails = np.stack([network.starts, network.ends], axis=1).reshape(-1)
    node = tails[rows.directed]
    there = [
        np.bincount(node[mask & whole], minlength=len(network.nodes)) for mask in (~after, after)
    ]
    begin = tails[candidates]
    share = (passes[candidates] - 1) / np.maximum(there[1][begin], 1)
    evidence = -there[0][begin] * np.log1p(-np.minimum(share, 0.9))

    # Edges that touch each other are one street.
    edges = candidates // 2
    nodes = len(network.nodes)
    ends = network.starts[edges], network.ends[edges]
    joined = coo_array((np.ones(len(edges)), ends), shape=(nodes, nodes))
    group = connected_components(joined, directed=False)[1][network.starts[edges]]
    best = np.zeros(nodes)
    np.maximum.at(best, group, evidence)
    found = []
    for directed, strength in zip(candidates.tolist(), best[group].tolist(), strict=True):
        if strength < threshold:
            continue
        times = np.sort(rows.enter[after & whole & (rows.directed == directed)])
        found.append(
            Change(
                "new",
                directed // 2,
                directed % 2 == 0,
                float(times[0]),
                float(times[_MIN_NEW - 1]),
                strength,
                len(times),
            )
        )
    return found


def _moved(network: Network, closed: list[Change], new: list[Change]) -> list[Change]:
    """Closed edges, as ``moved`` where a new one of about their length joins the same nodes."""
    moved = []
    for change in closed:
        # New edges between the same nodes, of about the same length.
        ends = {network.starts[change.edge], network.ends[change.edge]}
        others = [
            other.edge
            for other in new
            if {network.starts[other.edge], network.ends[other.edge]} == ends
            and 1 / _MAX_RATIO
            < network.lengths[other.edge] / network.lengths[change.edge]
            < _MAX_RATIO
        ]

        # A street that is closed in one direction only has not moved.
        if others and change.kind == "closed":
            moved.append(replace(change, kind="moved", other=others[0]))
        else:
            moved.append(change)
    return moved


def _speeds(both: _Both, threshold: float) -> list[Change]:
    """Directions that take longer or shorter than before."""
    # Observed over expected seconds, as the time before expects them. Jumps of the receiver have
    # no speed.
    network, rows, after = both
    calendar = choose_calendar(network, rows.enter, None)
    seconds = rows.leave - rows.enter - rows.standing
    whole = (rows.metres >= _MIN_SHARE * network.lengths[rows.edge]) & (seconds > 0)
    whole &= ~rows.jumps
    if not whole[~after].any():
        return []
    times = learn_travel_times(History(network, rows.take(~after)), calendar)
    hour = calendar.part("hour", rows.enter)
    told = np.flatnonzero(whole & (times.counts[rows.directed] > 0))
    expected = times.rates[rows.directed[told], hour[told]] * rows.metres[told]
    ratio = np.log(seconds[told] / expected)

    # Ratios of one track and hour on one edge are one observation.
    hours = np.floor(rows.enter[told] / _HOUR).astype(np.int64)
    columns = np.stack([rows.directed[told], after[told], rows.track[told], hours])
    keys, group = np.unique(columns, axis=1, return_inverse=True)
    group = group.reshape(-1)
    counts = np.bincount(group)
    means = np.bincount(group, weights=ratio) / counts
    first = np.full(len(counts), np.inf)
    np.minimum.at(first, group, rows.enter[told])

    # Test each edge and direction; with so many tests, evidence must be larger.
    directed = keys[0]
    tested = np.unique(directed[keys[1] == 1])
    limit = threshold + np.log(max(len(tested), 1))
    found = []
    for each in tested.tolist():
        mine = directed == each
        change = _compare(means[mine], keys[1][mine] == 1, first[mine])
        if change is not None and change.evidence >= limit:
            kind = "slower" if change.factor > 1 else "faster"
            found.append(
                Change(
                    kind,
                    each // 2,
                    each % 2 == 0,
                    change.since,
                    change.detected,
                    change.evidence,
                    change.observations,
                    factor=change.factor,
                )
            )
    return found


class _Shift(NamedTuple):
    """Change of the mean of logarithms of ratios."""

    factor: float
    evidence: float
    since: float
    detected: float
    observations: int


def _compare(values: Floats, after: Mask, times: Floats) -> _Shift | None:
    """Compare two groups of observations; None if they are few or alike."""
    # Medians and their spreads don't feel single long stops.
    old, new = values[~after], values[after]
    if min(len(old), len(new)) < _MIN_OBSERVATIONS:
        return None
    shift = float(np.median(new) - np.median(old))
    if abs(shift) < np.log(_MIN_FACTOR):
        return None
    spread = [max(_spread(group), 0.02) for group in (old, new)]

    # The median of n normal values has the variance pi / 2 s^2 / n.
    error = np.sqrt(np.pi / 2 * (spread[0] ** 2 / len(old) + spread[1] ** 2 / len(new)))
    evidence = -float(log_ndtr(-abs(shift) / error) + np.log(2.0))

    # It began where the observations from then on differ most from those before.
    order = np.argsort(times[after], kind="stable")
    ordered, when = new[order], times[after][order]
    signed = np.sign(shift) * (ordered - np.median(old)) - abs(shift) / 2
    begin = int(np.argmax(np.cumsum(signed[::-1])[::-1]))
    enough = min(begin + _MIN_OBSERVATIONS - 1, len(when) - 1)
    return _Shift(float(np.exp(shift)), evidence, float(when[begin]), float(when[enough]), len(new))


def _spread(values: Floats) -> float:
    """Standard deviation of normal values from their median absolute deviation."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))
