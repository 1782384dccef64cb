"""Closed edges, by what agents don't do although they have occasion to.

An agent at the junction before a directed edge that would have taken it with probability p, and
turns elsewhere, is evidence of ``-ln(1 - p)`` nats that the edge is closed. Evidence adds up over
agents, and a passage of the edge sets it back to 0. So nothing is claimed in the night, in which
nobody comes. An alarm is raised as soon as evidence reaches a threshold.

The threshold comes from the log itself: one part of the time before is watched with what was learnt
from another, and alarms there are false, as far as nothing was closed then. The evidence of the
largest of them falls about exponentially, with a mean that these alarms have.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.history.changes.choices import list_choices
from gpszip.history.traversals import Traversals
from gpszip.model import Network

__all__ = ["Closures", "choose_threshold", "find_closures"]

#: Largest probability that an agent takes an edge: any may have a reason not to.
_MAX_PROBABILITY = 0.9

#: Smallest probability that counts. Of less likely choices, those of one agent or one hour are
#: alike: a line that is not served for some hours is no closed edge.
_MIN_PROBABILITY = 0.3

#: Share of an edge after which it has been passed.
_PASSED = 0.9

#: Passages that an edge needs before; of others, nothing can be missed.
_MIN_PASSES = 5

#: Smallest threshold in nats: three agents that were sure to come reach 6.91, and may be chance.
_MIN_THRESHOLD = 7.0

#: Smallest threshold without a time to try it on.
_DEFAULT_THRESHOLD = 9.2

#: Share of the time before from which is learnt what the rest is tried with.
_LEARNT_SHARE = 0.6

#: Largest runs of evidence from which the tail is measured.
_TAIL = 12

#: Seconds of a day.
_DAY = 86_400.0

Longs = NDArray[np.int64]
Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Closures(NamedTuple):
    """Alarms about directed edges, in the order of time.

    Parameters
    ----------
    directed : int64 array, shape (a,)
        Directed edge of each.
    since : float64 array, shape (a,)
        When the first agent turned elsewhere after the last passage.
    detected : float64 array, shape (a,)
        When evidence reached the threshold.
    missed : int64 array, shape (a,)
        Agents that had turned elsewhere until then, of those that take it at times.
    evidence : float64 array, shape (a,)
        Nats, up to the next passage or to the end of the log.
    reopened : float64 array, shape (a,)
        When it was passed again; NaN if it was not.
    """

    directed: Longs
    since: Floats
    detected: Floats
    missed: Longs
    evidence: Floats
    reopened: Floats


class _Runs(NamedTuple):
    """Evidence about directed edges between passages.

    Parameters
    ----------
    directed : int64 array, shape (m,)
        Edge of each missed passage, sorted by edge and time.
    time : float64 array, shape (m,)
        When.
    evidence : float64 array, shape (m,)
        Sum since the last passage.
    run : int64 array, shape (m,)
        Number of the time between two passages.
    ends : float64 array, shape (runs,)
        Time of the passage that ends each run; NaN for none.
    """

    directed: Longs
    time: Floats
    evidence: Floats
    run: Longs
    ends: Floats


def find_closures(network: Network, rows: Traversals, after: Mask, threshold: float) -> Closures:
    """Find directed edges that are closed at some time after.

    Parameters
    ----------
    network : Network
        The edges.
    rows : Traversals
        All traversals, with times.
    after : bool array, shape (n,)
        Which are watched; the others are what was usual before.
    threshold : float
        Nats of evidence.
    """
    # Evidence of every missed passage, and the alarms: the first of each run beyond the threshold.
    runs = _collect_runs(network, rows, ~after, after)
    beyond = np.flatnonzero(runs.evidence >= threshold)
    _, first = np.unique(runs.run[beyond], return_index=True)
    alarms = beyond[first]

    # Where each run begins and ends.
    begin = np.searchsorted(runs.run, runs.run[alarms])
    last = np.searchsorted(runs.run, runs.run[alarms], side="right") - 1
    found = Closures(
        runs.directed[alarms],
        runs.time[begin],
        runs.time[alarms],
        alarms - begin + 1,
        runs.evidence[last],
        runs.ends[runs.run[alarms]],
    )
    order = np.argsort(found.detected, kind="stable")
    return Closures(
        found.directed[order],
        found.since[order],
        found.detected[order],
        found.missed[order],
        found.evidence[order],
        found.reopened[order],
    )


def choose_threshold(
    network: Network, rows: Traversals, before: Mask, false_alarms: float
) -> float:
    """Choose the threshold at which a log has so many false alarms a day.

    Parameters
    ----------
    network : Network
        The edges.
    rows : Traversals
        All traversals, with times.
    before : bool array, shape (n,)
        Traversals of a time in which nothing was closed.
    false_alarms : float
        Alarms a day.

    Returns
    -------
    float
        Nats; 7 at least.
    """
    # Learn from the first part of the time, and watch the rest.
    times = rows.enter[before]
    if len(times) < 2:
        return _DEFAULT_THRESHOLD
    cut = float(np.quantile(times, _LEARNT_SHARE))
    days = (float(times.max()) - cut) / _DAY
    runs = _collect_runs(network, rows, before & (rows.enter < cut), before & (rows.enter >= cut))
    if not len(runs.run) or days <= 0:
        return _DEFAULT_THRESHOLD

    # Largest evidence of each run; the largest of all fall about exponentially.
    last = np.flatnonzero(np.append(np.diff(runs.run) != 0, True))
    largest = np.sort(runs.evidence[last])[::-1]
    count = min(_TAIL, len(largest) - 1)
    if count < 1:
        return _DEFAULT_THRESHOLD
    mean = float((largest[:count] - largest[count]).mean())
    allowed = false_alarms * days
    threshold = float(largest[count]) + mean * math.log(count / allowed)
    return max(threshold, _MIN_THRESHOLD)


def _collect_runs(network: Network, rows: Traversals, known: Mask, asked: Mask) -> _Runs:
    """Sum up the evidence of missed passages between passages."""
    # Missed ones: options that were not taken, of edges with enough passages before.
    choices = list_choices(network, rows, known, asked)
    whole = rows.metres >= _PASSED * network.lengths[rows.edge]
    passes = np.bincount(rows.directed[known & whole], minlength=2 * len(network))
    missed = np.flatnonzero(
        ~choices.taken
        & (passes[choices.option] >= _MIN_PASSES)
        & (choices.probability >= _MIN_PROBABILITY)
    )
    option, time = choices.option[missed], rows.enter[choices.traversal[missed]]
    gain = -np.log1p(-np.minimum(choices.probability[missed], _MAX_PROBABILITY))

    # Put passages between them, by edge and time.
    passed = np.flatnonzero(asked & whole & (passes[rows.directed] >= _MIN_PASSES))
    directed = np.concatenate([option, rows.directed[passed]])
    times = np.concatenate([time, rows.enter[passed]])
    is_pass = np.append(np.zeros(len(option), np.bool_), np.ones(len(passed), np.bool_))
    gains = np.append(gain, np.zeros(len(passed)))
    order = np.lexsort((is_pass, times, directed))
    directed, times, is_pass, gains = directed[order], times[order], is_pass[order], gains[order]

    # A run begins with an edge and after each passage.
    begins = np.append(True, (np.diff(directed) != 0) | is_pass[:-1])[: len(directed)]
    number = np.cumsum(begins) - 1
    total = np.cumsum(gains)
    first = np.flatnonzero(begins)
    evidence = total - (total - gains)[first][number] if len(first) else total
    ends = np.full(len(first), np.nan)
    ends[number[is_pass]] = times[is_pass]

    # Runs with evidence, numbered anew.
    kept = ~is_pass
    used, run = np.unique(number[kept], return_inverse=True)
    return _Runs(
        directed[kept], times[kept], evidence[kept], run.reshape(-1).astype(np.int64), ends[used]
    )
