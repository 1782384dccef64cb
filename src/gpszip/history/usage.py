"""How the edges of a map are used: how often, how fast, for how long, and when."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OptionError
from gpszip.history.agents import AgentSpeed, cluster_agents
from gpszip.history.calendar import PARTS, Calendar, choose_calendar
from gpszip.history.groups import sum_by
from gpszip.history.transitions import EdgeTransitions, learn_transitions
from gpszip.history.traversals import History, Traversals
from gpszip.model import Network
from gpszip.model.text import count_text
from gpszip.simplification.traversals import grouped_quantiles

__all__ = ["Usage", "measure_usage", "traversal_speeds"]

#: Share of an edge that a traversal takes to count as one.
_MIN_SHARE = 0.5

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Usage:
    """How the edges of a map are used.

    ``usage["speed"]`` is a column.

    Parameters
    ----------
    network : Network
        The edges.
    traversals : Traversals
        All traversals, from which the columns are counted.
    by : tuple of str
        Parts of local time by which rows are split.
    calendar : Calendar
        Time zone of these parts.
    columns : mapping of str to array, shape (r,)
        ``edge`` and ``forward``; the parts of ``by``; ``traversals`` of half of the edge or more;
        ``tracks`` that made them; ``metres`` travelled; ``speed``, ``speed_q1`` and ``speed_q3``,
        median and quartiles in m/s, weighted by metres and without standing; ``duration``, median
        seconds of a traversal with standing; ``dwell``, seconds of standing in all; ``first`` and
        ``last``, times of the first entry and of the last exit. NaN where not known.
    agents : tuple of AgentSpeed
        Relative speeds of the tracks, and their clusters.
    repeated : float
        Share of all metres on edges that some track had travelled before, in either direction.
    repeated_by_track : float
        The same, of edges that the same track had travelled before.
    markov : EdgeTransitions
        Probabilities of the transitions between edges.
    """

    network: Network
    traversals: Traversals
    by: tuple[str, ...]
    calendar: Calendar
    columns: Mapping[str, NDArray[np.generic]]
    agents: tuple[AgentSpeed, ...]
    repeated: float
    repeated_by_track: float
    markov: EdgeTransitions

    def __repr__(self) -> str:
        split = f", by {' and '.join(self.by)}" if self.by else ""
        return (
            f"Usage({count_text(len(self), 'row')}{split}, "
            f"{count_text(len(self.traversals), 'traversal')})"
        )

    def __len__(self) -> int:
        return len(self.columns["edge"])

    def __getitem__(self, column: str) -> NDArray[Any]:
        return self.columns[column]

    @property
    def timezone(self) -> str:
        """Name of the time zone; empty where times are no dates."""
        return self.calendar.name


def measure_usage(
    history: History, by: Sequence[str] = ("hour", "weekday"), timezone: str | None = None
) -> Usage:
    """Count how the edges of a map are used.

    A traversal belongs to the local time at which it begins.

    Parameters
    ----------
    history : History
        The traversals of an archive.
    by : sequence of str
        Parts of local time by which rows are split, among ``hour``, ``weekday`` (0 is Monday),
        ``month``, ``period`` (night, morning from 6, midday from 10, evening from 16, night from 20
        o'clock) and ``date``; none for one row for each edge and direction.
    timezone : str, optional
        Name of the time zone, see :func:`choose_calendar`.

    Raises
    ------
    OptionError
        If there is no such part or zone, or tracks have no times, which parts need.
    """
    # Refuse what can't be counted.
    network, rows = history.network, history.traversals
    for part in by:
        if part not in PARTS:
            raise OptionError(
                f"{part!r} is no part of time", remedy=f"parts are {', '.join(PARTS)}, and none"
            )
    calendar = choose_calendar(network, rows.enter, timezone)
    timed = np.isfinite(rows.enter)
    if by and not timed.any():
        raise OptionError(
            "no track has times, so that there are no hours", remedy="count by none, without times"
        )

    # One group for each edge and direction and part of time; tracks without times have none.
    if by:
        rows = rows.take(timed)
    keys = [rows.edge, (~rows.forward).astype(np.int64)]
    keys += [calendar.part(part, rows.enter) for part in by]
    distinct, group = np.unique(np.stack(keys), axis=1, return_inverse=True)
    columns: dict[str, NDArray[np.generic]] = {
        "edge": distinct[0],
        "forward": distinct[1] == 0,
    }
    for part, values in zip(by, distinct[2:], strict=True):
        columns[part] = calendar.labels(part, values)
    columns |= _measure_groups(network, rows, group.reshape(-1), distinct.shape[1])

    # What concerns all of them.
    rows = history.traversals
    speeds, directed = traversal_speeds(rows), rows.directed
    medians = grouped_quantiles(
        *_known(directed, speeds, rows.metres), 2 * len(network), (0.5,)
    ).reshape(-1)
    return Usage(
        network=network,
        traversals=rows,
        by=tuple(by),
        calendar=calendar,
        columns=columns,
        agents=cluster_agents(rows, speeds, medians[directed]),
        repeated=_repeated_share(rows, by_track=False),
        repeated_by_track=_repeated_share(rows, by_track=True),
        markov=learn_transitions(network, rows),
    )


def traversal_speeds(rows: Traversals) -> Floats:
    """Speed of each traversal in m/s without standing; NaN without times or travel, and of jumps.

    A jump is faster than the ``max_speed`` of the traversals: an error of the receiver.
    """
    return np.where(rows.jumps, np.nan, rows.speeds)


def _measure_groups(
    network: Network, rows: Traversals, group: NDArray[np.int64], count: int
) -> dict[str, NDArray[np.generic]]:
    """Columns of numbers of each group."""
    # Counts.
    metres = rows.metres
    counted = metres >= _MIN_SHARE * network.lengths[rows.edge]
    tracks = np.unique(np.stack([group, rows.track.astype(np.int64)]), axis=1)[0]

    # Speeds and durations.
    speeds = traversal_speeds(rows)
    seconds = np.where(rows.jumps, np.nan, rows.leave - rows.enter)
    quartiles = grouped_quantiles(*_known(group, speeds, metres), count, (0.25, 0.5, 0.75))
    durations = np.where(counted, seconds, np.nan)
    median = grouped_quantiles(*_known(group, durations, np.ones(len(rows))), count, (0.5,))

    # First and last time.
    first, last = np.full(count, np.inf), np.full(count, -np.inf)
    np.fmin.at(first, group, rows.enter)
    np.fmax.at(last, group, rows.leave)
    return {
        "traversals": np.bincount(group[counted], minlength=count),
        "tracks": np.bincount(tracks, minlength=count),
        "metres": sum_by(group, rows.travelled, count),
        "speed": quartiles[:, 1],
        "speed_q1": quartiles[:, 0],
        "speed_q3": quartiles[:, 2],
        "duration": median[:, 0],
        "dwell": sum_by(group, rows.standing, count),
        "first": np.where(np.isfinite(first), first, np.nan),
        "last": np.where(np.isfinite(last), last, np.nan),
    }


def _known(
    group: NDArray[np.int64], values: Floats, weights: Floats
) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Groups, values and weights of the values that are known."""
    known = np.isfinite(values)
    return group[known], values[known], weights[known]


def _repeated_share(rows: Traversals, *, by_track: bool) -> float:
    """Share of the metres on edges that were travelled before, by any track or by the same one."""
    # In the order of time; tracks without times come last, in their own order.
    order = np.argsort(rows.enter, kind="stable")
    key = rows.edge[order]
    if by_track:
        key = key * len(rows.ids) + rows.track[order]
    first = np.unique(key, return_index=True)[1]
    metres = rows.travelled[order]
    total = float(metres.sum())
    # Sums in another order may differ in their last digits.
    return max(1.0 - float(metres[first].sum()) / total, 0.0) if total else 0.0
