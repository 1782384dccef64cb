"""The rounds of a patrol: the usual one, and how far each keeps to it.

A round leads from one passage of a base, an edge in one direction, to the next. Any edge could be
the base. The one is chosen that needs the fewest metres to tell the whole log: those of the usual
round once, and for each round the metres by which it differs. An edge that is passed once in each
round needs few. One that is passed twice cuts rounds into halves that are not alike, and one that
is passed rarely has rounds so long that the usual one is a large part of the log.
"""

from __future__ import annotations

import math
from collections import Counter
from itertools import chain, pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError, OptionError
from gpszip.history.groups import sum_by
from gpszip.history.traversals import History, Traversals
from gpszip.model.rounds import EdgeVisits, Round, Rounds

__all__ = ["find_rounds"]

#: Rounds that a patrol has at least: with two, nothing tells which of them is unusual.
_MIN_ROUNDS = 3

#: Share of travel that the usual round explains in a patrol at least. The errands of a taxi or a
#: person reach 0.1.
_MIN_REGULARITY = 0.3

#: Share of an edge that is travelled at least where an agent passes a base.
_PASSED = 0.5

#: Traversals of an edge by which a round may fall short: an agent turns back a little earlier.
_TOLERANCE = 0.1

#: Cost, as a share of the least, up to which the base is chosen by where agents wait.
_EQUAL_COST = 1.02

#: Traversals that are counted for all candidates together, at most: some seconds.
_MAX_WORK = 20_000_000

Floats = NDArray[np.float64]
Longs = NDArray[np.int64]


class _Travel(NamedTuple):
    """Traversals, with what is asked of them.

    Parameters
    ----------
    traversals : Traversals
        At least one.
    lengths : float64 array, shape (E,)
        Metres of all edges.
    share : float64 array, shape (n,)
        Share of the edge that each traversal travels, from 0 to 1.
    first_node, last_node : int32 array, shape (n,)
        Nodes at which each traversal begins and ends; the last one is -1 if it ends before.
    """

    traversals: Traversals
    lengths: Floats
    share: Floats
    first_node: NDArray[np.int32]
    last_node: NDArray[np.int32]


class _Cut(NamedTuple):
    """The traversals cut into rounds at the passages of a base.

    Parameters
    ----------
    begins, ends : int64 array, shape (r,)
        First traversal of each round, and the one after its last.
    round, edge : int64 array, shape (c,)
        Pairs of a round and an edge that it travels, in the order of rounds.
    counts : float64 array, shape (c,)
        How often it does; half an edge and back count as one.
    usual : float64 array, shape (E,)
        Median of the counts of each edge.
    cost : float
        Metres that tell the log.
    """

    begins: Longs
    ends: Longs
    round: Longs
    edge: Longs
    counts: Floats
    usual: Floats
    cost: float


def find_rounds(history: History, since: float | None = None) -> Rounds:
    """Find the usual round of a patrol, and compare all rounds with it.

    1. The base is chosen among all edges and directions, as the text above says. Of bases of about
       the same cost, the one before which agents stand longest begins the rounds.
    2. The usual round is the one that differs least from the median counts of edges.
    3. Each round is compared with it, edge by edge, in either direction.
    4. Visits of each edge are counted, with the rounds that miss it.

    Parameters
    ----------
    history : History
        Traversals of one agent or of several with the same round.
    since : float, optional
        Seconds, as the log counts them: only rounds and visits from this time on are told; the
        usual round is that of all.

    Returns
    -------
    Rounds

    Raises
    ------
    InputError
        If travel doesn't repeat in rounds.
    OptionError
        If ``since`` is given, and no track has times.

    Examples
    --------
    >>> import gpszip
    >>> from gpszip.history.traversals import read_history
    >>> corners = [[0, 0], [90, 0], [90, 60], [0, 60]]
    >>> track = gpszip.Track("guard", [30.0 * i for i in range(41)], [*corners * 10, [0, 0]])
    >>> find_rounds(read_history(gpszip.compress(track, max_error=0.5)))
    Rounds(10 rounds of usually 300 m, 90% regular)
    """
    # 1. The base.
    travel = _list_travel(history)
    traversals, lengths = travel.traversals, travel.lengths
    if since is not None and not np.isfinite(traversals.enter).any():
        raise OptionError("no track has times, so that nothing is since a given one")
    cut = _choose_base(travel)
    total = float(traversals.metres.sum())
    regularity = 0.0 if cut is None else 1.0 - cut.cost / total
    if cut is None or regularity < _MIN_REGULARITY:
        raise InputError(
            "travel doesn't repeat in rounds",
            remedy="select the tracks of a patrol, with at least three rounds",
        )

    # 2. The usual round.
    medoid = int(np.argmin(_count_differences(cut, lengths).metres))
    rows = slice(int(cut.begins[medoid]), int(cut.ends[medoid]))
    usual_edges, usual_forward = traversals.edge[rows], traversals.forward[rows]
    cut = cut._replace(usual=sum_by(usual_edges, travel.share[rows], len(lengths)))

    # 3. Compare all rounds with it.
    rounds = _list_rounds(traversals, cut, lengths)
    durations = [each.end - each.start for each in rounds]
    told = tuple(each for each in rounds if since is None or each.start >= since)

    # 4. Count visits.
    return Rounds(
        usual=tuple(zip(usual_edges.tolist(), usual_forward.tolist(), strict=True)),
        length=float(lengths @ cut.usual),
        duration=float(np.median(durations)),
        regularity=regularity,
        rounds=told,
        edges=_list_visits(traversals, cut.usual, told, since),
    )


def _list_travel(history: History) -> _Travel:
    # An agent that stops on an edge, or turns back there, reaches no node.
    network, traversals = history.network, history.traversals
    lengths = network.lengths
    own_length = lengths[traversals.edge]
    missing = np.abs(traversals.end - np.where(traversals.forward, own_length, 0.0))
    reaches = missing <= _TOLERANCE * own_length

    starts, ends = network.starts[traversals.edge], network.ends[traversals.edge]
    return _Travel(
        traversals,
        lengths,
        np.minimum(traversals.metres / own_length, 1.0),
        np.where(traversals.forward, starts, ends),
        np.where(reaches, np.where(traversals.forward, ends, starts), -1),
    )


def _choose_base(travel: _Travel) -> _Cut | None:
    """Cut all travel at the base that needs the fewest metres; None if none is passed enough."""
    traversals, lengths, share, _, _ = travel

    # Edges and directions that are passed often enough, by how often; evenly chosen if many.
    passes = np.bincount(traversals.directed[share > _PASSED], minlength=2 * len(lengths))
    candidates = np.argsort(-passes, kind="stable")
    candidates = candidates[passes[candidates] >= _MIN_ROUNDS]
    most = max(_MAX_WORK // max(len(traversals), 1), 1)
    candidates = candidates[:: -(-len(candidates) // most) or 1]

    # The cost of each, and how long agents stand before they pass it.
    cuts: list[tuple[_Cut, float]] = []
    standing = np.append(0.0, np.nan_to_num(traversals.standing)[:-1])
    for base in candidates.tolist():
        cut = _cut_at(travel, base)
        if len(cut.begins) >= _MIN_ROUNDS:
            cuts.append((cut, float(standing[cut.begins].sum())))
    if not cuts:
        return None

    # Of about the same cost, where agents wait.
    least = min(cut.cost for cut, _ in cuts)
    return max(
        (pair for pair in cuts if pair[0].cost <= _EQUAL_COST * least), key=lambda pair: pair[1]
    )[0]


def _cut_at(travel: _Travel, base: int) -> _Cut:
    """Cut the travel of each track into rounds, each from one passage of a base to the next."""
    traversals, lengths, share, first_node, last_node = travel
    # A round begins at a passage and ends at the next one of the same track, or at the end of the
    # track if it is back there; a small start of one more round doesn't count.
    begins = np.flatnonzero((traversals.directed == base) & (share > _PASSED))
    ends = np.append(begins[1:], len(traversals))
    counted = np.flatnonzero(share > _TOLERANCE)
    last = np.searchsorted(traversals.track[counted], traversals.track[begins], side="right") - 1
    track_ends = counted[last] + 1
    is_last = ends >= track_ends
    ends = np.where(is_last, track_ends, ends)
    is_round = ~is_last | (last_node[ends - 1] == first_node[begins])
    begins, ends = begins[is_round], ends[is_round]

    # Count the traversals of each edge in each round.
    starts = np.zeros(len(traversals) + 1, np.int64)
    np.add.at(starts, begins, 1)
    number = np.cumsum(starts)[:-1] - 1
    inside = np.zeros(len(traversals) + 1, np.int64)
    np.add.at(inside, begins, 1)
    np.add.at(inside, ends, -1)
    is_inside = np.cumsum(inside)[:-1] > 0
    keys = number[is_inside] * len(lengths) + traversals.edge[is_inside]
    keys, pair = np.unique(keys, return_inverse=True)
    counts = sum_by(pair, share[is_inside], len(keys))
    round_, edge = np.divmod(keys, len(lengths))

    # Metres that tell the log: a usual round, the differences, and what is in no round.
    usual = _median_counts(edge, counts, len(begins), len(lengths))
    cut = _Cut(begins, ends, round_, edge, counts, usual, 0.0)
    outside = float(traversals.metres[~is_inside].sum())
    differences = _count_differences(cut, lengths)
    cost = float(lengths @ usual) + float(differences.metres.sum()) + outside
    return cut._replace(cost=cost)


def _median_counts(edge: Longs, counts: Floats, rounds: int, edges: int) -> Floats:
    """Return the lower median of the counts of each edge over all rounds, most of which are 0.

    Examples
    --------
    >>> _median_counts(np.array([0, 0, 0, 2]), np.array([1.0, 2.0, 1.5, 5.0]), 4, 3).tolist()
    [1.0, 0.0, 0.0]
    """
    # The rank of a count among those of its edge, from the largest; those not listed are 0.
    order = np.lexsort((-counts, edge))
    sorted_edge = edge[order]
    first = np.searchsorted(sorted_edge, np.arange(edges))
    is_median = np.arange(len(order)) - first[sorted_edge] == rounds // 2

    medians = np.zeros(edges)
    medians[sorted_edge[is_median]] = counts[order][is_median]
    return medians


class _Differences(NamedTuple):
    """How rounds differ from the usual one, in metres.

    Parameters
    ----------
    missed, extra : float64 array, shape (r,)
        Metres that a round travels less often, and more often.
    """

    missed: Floats
    extra: Floats

    @property
    def metres(self) -> Floats:
        """Metres of both kinds."""
        return self.missed + self.extra


def _count_differences(cut: _Cut, lengths: Floats) -> _Differences:
    # What a round covers of the usual one, and what it adds to it.
    both = np.minimum(cut.counts, cut.usual[cut.edge])
    covered = sum_by(cut.round, lengths[cut.edge] * both, len(cut.begins))
    extra = sum_by(cut.round, lengths[cut.edge] * (cut.counts - both), len(cut.begins))
    return _Differences(float(lengths @ cut.usual) - covered, extra)


def _list_rounds(traversals: Traversals, cut: _Cut, lengths: Floats) -> tuple[Round, ...]:
    """Compare all rounds with the usual one."""
    # Numbers of rounds within their tracks, and their times.
    track = traversals.track[cut.begins]
    first = np.searchsorted(track, track)
    start, end = traversals.enter[cut.begins], traversals.leave[cut.ends - 1]
    late = end - start - np.median(end - start)

    # Metres travelled, and those by which rounds differ.
    differences = _count_differences(cut, lengths)
    usual_length = float(lengths @ cut.usual)
    travelled = usual_length - differences.missed + differences.extra
    missed = _list_missed(cut)
    return tuple(
        Round(
            track=traversals.ids[track[i]],
            number=i - int(first[i]) + 1,
            start=float(start[i]),
            end=float(end[i]),
            length=float(travelled[i]),
            share=1.0 - float(differences.missed[i]) / usual_length,
            extra=float(differences.extra[i]),
            late=float(late[i]),
            missed=missed[i],
        )
        for i in range(len(cut.begins))
    )


def _list_missed(cut: _Cut) -> list[tuple[int, ...]]:
    """Return the edges that each round travels less often than the usual one."""
    edges = np.flatnonzero(cut.usual)
    bounds = np.searchsorted(cut.round, np.arange(len(cut.begins) + 1))
    missed = []
    for begin, end in pairwise(bounds.tolist()):
        counts = np.zeros(len(cut.usual))
        counts[cut.edge[begin:end]] = cut.counts[begin:end]
        missed.append(tuple(edges[counts[edges] < cut.usual[edges] - _TOLERANCE].tolist()))
    return missed


def _list_visits(
    traversals: Traversals, usual: Floats, rounds: tuple[Round, ...], since: float | None
) -> tuple[EdgeVisits, ...]:
    """Count the visits of each edge, and the rounds that miss it."""
    # Visits from the time asked for, edge by edge in the order of time.
    chosen = np.full(len(traversals), True) if since is None else traversals.enter >= since
    edge, enter = traversals.edge[chosen], traversals.enter[chosen]
    order = np.lexsort((enter, edge))
    edge, enter = edge[order], enter[order]
    bounds = np.searchsorted(edge, np.arange(len(usual) + 1))
    missed = Counter(chain.from_iterable(each.missed for each in rounds))
    end = float(traversals.leave.max())

    # Intervals between them.
    visits = []
    for number in np.flatnonzero((usual > 0) | (np.diff(bounds) > 0)).tolist():
        times = enter[bounds[number] : bounds[number + 1]]
        steps = np.diff(times)
        visits.append(
            EdgeVisits(
                edge=number,
                usual=float(usual[number]),
                visits=len(times),
                missed=missed[number],
                first=float(times[0]) if len(times) else math.nan,
                last=float(times[-1]) if len(times) else math.nan,
                interval=float(np.median(steps)) if len(steps) else math.nan,
                longest=float(max([*steps, end - times[-1]])) if len(times) else math.nan,
            )
        )
    return tuple(visits)
