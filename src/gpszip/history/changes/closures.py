"""Closed edges, by what agents don't do although they have occasion to.

An agent at the junction before a directed edge that would have taken it with probability p, and
turns elsewhere, is evidence of ``-ln(1 - p)`` nats that the edge is closed. Evidence adds up over
agents, and a passage of the edge sets it back to 0. So nothing is claimed in the night, in which
nobody comes. An alarm is raised as soon as evidence reaches a threshold.

Four things look like closures, and are none:

- A line that nobody serves for some hours. So p goes by the agents that came by the same route
  (:mod:`gpszip.history.changes.alike_routes`), where that foresees the agents watched better than
  their last edges do (:mod:`gpszip.history.changes.choices`).
- A new line, lap by lap. What nobody ever travelled like that is no evidence.
- Turning back on the way to the junction, or at a stop on the edge behind it.
- A detour, whose agents miss all edges until it ends. Only the edge at which an agent leaves its
  way is evidence, not the next six.

The threshold comes from the log itself. One part of the time before is watched with what was learnt
from another: alarms there are false, as far as nothing was closed then. Evidence of x nats by
chance alone comes up in a share exp(-x) of the runs between passages, so that the threshold is
``ln(runs a day / false alarms a day)`` at least. The largest runs may fall more slowly: their tail
is about exponential, with the mean that they have.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.history.changes.alike_routes import compare_routes
from gpszip.history.changes.choices import Choices, list_choices
from gpszip.history.traversals import Traversals
from gpszip.model import Network

__all__ = ["Closures", "choose_threshold", "find_closures"]

#: Largest probability that an agent takes an edge: any may have a reason not to.
_MAX_PROBABILITY = 0.95

#: Smallest probability that counts. Of less likely choices, those of one agent or one hour are
#: alike.
_MIN_PROBABILITY = 0.1

#: Probability from which an agent that takes another edge has left its way, and the traversals
#: after that in which it misses other edges for the same reason.
_SURE, _DETOUR = 0.75, 6

#: Share of what agents usually travel of an edge after which it has been passed.
_PASSED = 0.9

#: Quantile of the metres travelled on an edge that is usual: some edges lead on to where nobody
#: goes, beyond a stop at which all turn back.
_USUAL = 0.5

#: Share of an edge within whose end an agent is at the junction: matches turn a little before it.
_AT_JUNCTION = 0.2

#: Passages that an edge needs before; of others, nothing can be missed.
_MIN_PASSES = 5

#: Smallest threshold in nats: two agents that were sure to come reach 6, and may be chance.
_MIN_THRESHOLD = 7.0

#: Least probability whose logarithm is taken.
_LEAST = 1e-9

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
    # Evidence of every missed passage, and the alarms.
    missed = _list_missed(network, rows, ~after, after)
    runs = _collect_runs(missed)
    alarms = _alarms(runs, threshold)

    # What agents miss on their detour around an edge that is known to be closed is no evidence.
    if len(alarms):
        known = np.full(2 * len(network), np.inf)
        np.minimum.at(known, runs.directed[alarms], runs.time[alarms])
        is_around = ~missed.is_pass & (missed.time > known[missed.directed])
        around = np.unique(missed.traversal[is_around])
        counts = missed.is_pass | ~_follows(rows, around, missed.traversal)
        runs = _collect_runs(missed.take(counts))
        alarms = _alarms(runs, threshold)

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
    is_learnt = rows.enter < cut
    runs = _collect_runs(_list_missed(network, rows, before & is_learnt, before & ~is_learnt))
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
    by_chance = math.log(len(largest) / allowed)
    return max(threshold, by_chance, _MIN_THRESHOLD)


class _Missed(NamedTuple):
    """Missed passages of edges and the passages themselves, by edge and time.

    Parameters
    ----------
    directed : int64 array, shape (m,)
        The edge.
    traversal : int64 array, shape (m,)
        What the agent traversed instead; or the passage.
    time : float64 array, shape (m,)
        When.
    is_pass : bool array, shape (m,)
        Whether it was passed.
    gain : float64 array, shape (m,)
        Nats of evidence; 0 for a passage.
    """

    directed: Longs
    traversal: Longs
    time: Floats
    is_pass: Mask
    gain: Floats

    def take(self, chosen: Mask | Longs) -> _Missed:
        """Some of them."""
        return _Missed(
            self.directed[chosen],
            self.traversal[chosen],
            self.time[chosen],
            self.is_pass[chosen],
            self.gain[chosen],
        )


def _list_missed(network: Network, rows: Traversals, known: Mask, asked: Mask) -> _Missed:
    """List missed passages, with their evidence, and passages."""
    # Missed ones: options that were not taken, of edges with enough passages before.
    at_junction = _begins_at_junction(network, rows)
    choices = _foresee(network, rows, known & at_junction, asked & at_junction)
    whole = rows.metres >= _PASSED * _usual_metres(network, rows, known)[rows.directed]
    passes = np.bincount(rows.directed[known & whole], minlength=2 * len(network))
    missed = np.flatnonzero(
        ~choices.taken
        & (passes[choices.option] >= _MIN_PASSES)
        & (choices.probability >= _MIN_PROBABILITY)
    )

    # Agents that have left their way before tell nothing.
    sure = choices.probability[missed] >= _SURE
    leaving = np.unique(choices.traversal[missed[sure]])
    missed = missed[~_follows(rows, leaving, choices.traversal[missed])]
    gain = -np.log1p(-np.minimum(choices.probability[missed], _MAX_PROBABILITY))

    # Put passages between them, by edge and time.
    passed = np.flatnonzero(asked & whole & (passes[rows.directed] >= _MIN_PASSES))
    directed = np.concatenate([choices.option[missed], rows.directed[passed]])
    traversal = np.concatenate([choices.traversal[missed], passed])
    is_pass = np.append(np.zeros(len(missed), np.bool_), np.ones(len(passed), np.bool_))
    gains = np.append(gain, np.zeros(len(passed)))
    order = np.lexsort((is_pass, rows.enter[traversal], directed))
    return _Missed(directed, traversal, rows.enter[traversal], is_pass, gains).take(order)


def _collect_runs(missed: _Missed) -> _Runs:
    """Sum up the evidence of missed passages between passages."""
    # A run begins with an edge and after each passage.
    directed, _, times, is_pass, gains = missed
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


def _alarms(runs: _Runs, threshold: float) -> Longs:
    """The first missed passage of each run whose evidence reaches the threshold."""
    beyond = np.flatnonzero(runs.evidence >= threshold)
    _, first = np.unique(runs.run[beyond], return_index=True)
    alarms: Longs = beyond[first]
    return alarms


def _begins_at_junction(network: Network, rows: Traversals) -> Mask:
    """Whether each traversal begins at the tail of its edge: who turned back before was not there.

    Parameters
    ----------
    network : Network
        The edges.
    rows : Traversals
        All traversals.
    """
    length = network.lengths[rows.edge]
    off: Floats = np.where(rows.forward, rows.begin, length - rows.begin)
    at_junction: Mask = off <= _AT_JUNCTION * length
    return at_junction


def _usual_metres(network: Network, rows: Traversals, known: Mask) -> Floats:
    """Metres that agents usually travel on each directed edge, shape (2 E,); else its length."""
    # The quantile of each edge's traversals, sorted by edge and metres.
    chosen = np.flatnonzero(known)
    order = chosen[np.lexsort((rows.metres[chosen], rows.directed[chosen]))]
    edges, first, counts = np.unique(rows.directed[order], return_index=True, return_counts=True)
    usual = np.repeat(network.lengths, 2)
    usual[edges] = rows.metres[order[first + (_USUAL * (counts - 1)).astype(np.int64)]]
    return usual


def _foresee(network: Network, rows: Traversals, known: Mask, asked: Mask) -> Choices:
    """Choices by their routes or by their last edges, whichever foresees them better."""
    by_last = list_choices(network, rows, known, asked)
    alike = compare_routes(rows, known, by_last)
    taken = by_last.taken
    if _surprise(alike.probability[taken]) >= _surprise(by_last.probability[taken]):
        return by_last

    # Of those who travel like nobody before, nothing is known.
    return by_last._replace(probability=np.where(alike.is_usual, alike.probability, 0.0))


def _surprise(probability: Floats) -> float:
    """Nats of what was taken."""
    return -float(np.log(np.maximum(probability, _LEAST)).sum())


def _follows(rows: Traversals, leaving: Longs, at: Longs) -> Mask:
    """Whether each traversal comes shortly after one by which the same agent left its way."""
    if not len(leaving):
        return np.zeros(len(at), np.bool_)
    last = leaving[np.maximum(np.searchsorted(leaving, at) - 1, 0)]
    follows: Mask = (last < at) & (at - last <= _DETOUR) & (rows.track[last] == rows.track[at])
    return follows
