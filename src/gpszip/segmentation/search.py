"""The search for k and m: the elbow of the cost, by nested trinary search.

Source: the thesis, algorithms 3 and 4, with corrections to the printed form. The search stops
when at most one number is left between the bounds, and tries it; the printed loop never ends. It
returns the best point evaluated, not the upper bound. k is at least m. Algorithm 4 uses its own m
where it refers to an undefined m_n.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from functools import partial
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OptionError
from gpszip.model import SegmentMean, Track
from gpszip.run.executor import Executor, LocalValue, Serial, SharedValue, share_value
from gpszip.segmentation.bound import Report
from gpszip.segmentation.em import Problem, SegmentMeanOptions, as_problem
from gpszip.segmentation.memo import Memo

__all__ = ["FoundParameters", "find_elbow", "find_parameters"]

#: Share of tau by which an iteration has to lower it while k and m are searched. That of the result
#: falls as far as it can. This saves a third to a half of the iterations; with 3e-3, other m were
#: found on three of four logs.
_TOLERANCE = 1e-3

#: Share of the cost of one segment by which an iteration has to lower tau, too: of many segments,
#: tau is so small that its last digits don't move the elbow.
_LEAST_GAIN = 2e-5


@dataclass(frozen=True, eq=False)
class FoundParameters:
    """The result of the search for k and m.

    Parameters
    ----------
    mean : SegmentMean
        The segment mean at the elbow.
    evaluated : tuple of (int, int, float)
        Every (k, m) that was tried with its fitting cost in square metres, sorted.
    """

    mean: SegmentMean
    evaluated: tuple[tuple[int, int, float], ...]

    @property
    def k(self) -> int:
        """Number of intervals."""
        return self.mean.k

    @property
    def m(self) -> int:
        """Number of segments."""
        return self.mean.m


def find_parameters(
    track: Track | Problem,
    k_range: tuple[int, int],
    m_range: tuple[int, int],
    *,
    begins: NDArray[np.int64] | None = None,
    memo: Memo | None = None,
    executor: Executor | None = None,
    report: Report | None = None,
    **options: Unpack[SegmentMeanOptions],
) -> FoundParameters:
    """Search the numbers of intervals and segments (algorithms 3 and 4).

    For each m tried, the inner search finds the k at the elbow of the costs (k, cost) for this m
    fixed; the outer search takes the cost at the elbow over k. An elbow is the
    point farthest below the line through the extremes. About log^2 runs of
    :func:`gpszip.segmentation.em.segment_mean`, which stop early; only that of the result goes on
    until its cost stops falling.

    Parameters
    ----------
    track : Track or Problem
        n samples; a problem has its begins and options.
    k_range, m_range : (int, int)
        Least and greatest k and m, both included. Only pairs with m <= k are tried.
    begins : int64 array, shape (r,), optional
        First sample of each run, as for :func:`gpszip.segmentation.em.segment_mean`.
    memo : Memo, optional
        Keeps solutions between calls, and between processes if it has a folder.
    executor : Executor, optional
        Solves independent (k, m) in parallel; the result is the same for any number of workers.
    report : callable, optional
        Told the share of the search that is done, about.
    **options
        Passed to :func:`gpszip.segmentation.em.segment_mean`; ``tolerance`` is that of the result.

    Raises
    ------
    OptionError
        If a range is empty or doesn't fit the track.
    """
    problem = as_problem(track, begins, options)
    _check_ranges(problem, k_range, m_range)
    least_k, greatest_k = k_range
    search = _Search(problem, memo or Memo(), report, _expected(k_range, m_range))

    # Inner searches: the elbow over k for each of several m, all at once.
    best_ks: dict[int, int] = {}

    # Cost at that k, which stands for m in the outer search.
    def best_costs(ms: list[int]) -> list[float]:
        # A range of one number asks for it twice.
        once = list(dict.fromkeys(ms))
        steps = [_elbow_steps(max(least_k, m), greatest_k) for m in once]
        best_ks.update(zip(once, _run_together(steps, once, search.costs), strict=True))
        return [search.tried[best_ks[m], m].cost for m in ms]

    # Workers get the track and the options once, for all pairs.
    with share_value(executor, search.problem) as search.shared:
        m = find_elbow(*m_range, best_costs)

    # Report every pair tried with its cost, by k and then m.
    mean = search.solve_fully((best_ks[m], m), executor)
    evaluated = tuple(sorted((k, m, mean.cost) for (k, m), mean in search.tried.items()))
    return FoundParameters(mean, evaluated)


def _check_ranges(problem: Problem, k_range: tuple[int, int], m_range: tuple[int, int]) -> None:
    """Raise OptionError if a range is empty, or they don't fit each other or the track."""
    for name, (least, greatest) in (("k_range", k_range), ("m_range", m_range)):
        if not 1 <= least <= greatest:
            raise OptionError(
                f"{name} = ({least}, {greatest}) holds no number; "
                "give the least, at least 1, then the greatest"
            )
    if m_range[1] > k_range[1]:
        raise OptionError(
            f"m may reach {m_range[1]}, but k only {k_range[1]}; k is never below m: "
            "widen k_range or narrow m_range"
        )
    if k_range[1] > problem.most:
        raise OptionError(
            f"track {problem.track.id!r} allows {problem.most} intervals; k can't reach "
            f"{k_range[1]}"
        )


class _Search:
    """The pairs (k, m) that were tried, and how others are solved.

    Parameters
    ----------
    problem : Problem
        The samples.
    memo, report
        Those of :func:`find_parameters`.
    expected : int
        About how many pairs will be tried.
    """

    def __init__(self, problem: Problem, memo: Memo, report: Report | None, expected: int) -> None:
        # Solutions are known to the memo by a key of the track and the options.
        self.full = problem
        self.problem = self.full.stopping_early(_TOLERANCE, _LEAST_GAIN)
        self.key, self.full_key = self.problem.key(), self.full.key()
        self.tried: dict[tuple[int, int], SegmentMean] = {}
        self.memo = memo
        self.report = report or (lambda _share: None)
        self.expected = expected
        # Replaced by one whose workers may be elsewhere.
        self.shared: SharedValue[Problem] = LocalValue(Serial(), self.problem)

    def costs(self, pairs: list[tuple[int, int]]) -> list[float]:
        """Return the costs of pairs; solve those in parallel that neither were tried nor noted."""
        # Known solutions.
        for pair in pairs:
            known = self.tried.get(pair) or self.memo.get(self.key, *pair)
            if known is not None:
                self.tried[pair] = known

        # Missing ones.
        missing = [pair for pair in dict.fromkeys(pairs) if pair not in self.tried]
        for pair, mean in zip(missing, self.shared.map(_mean_of_pair, missing), strict=True):
            self.tried[pair] = mean
            self.memo.put(self.key, mean)
        self.report(min(len(self.tried) / self.expected, 1.0))
        return [self.tried[pair].cost for pair in pairs]

    def solve_fully(self, pair: tuple[int, int], executor: Executor | None) -> SegmentMean:
        """Return the solution of a pair with the tolerance that the caller gave."""
        mean = self.memo.get(self.full_key, *pair)
        if mean is None:
            mean = self.full.solve(*pair, executor=executor)
            self.memo.put(self.full_key, mean)
        return mean


def _mean_of_pair(problem: Problem, pair: tuple[int, int]) -> SegmentMean:
    """Return the segment mean with k intervals and m segments."""
    return problem.solve(*pair)


def _expected(k_range: tuple[int, int], m_range: tuple[int, int]) -> int:
    """About how many pairs a search tries: those of a curve without an elbow."""
    tried: set[int] = set()

    def flat(numbers: list[int]) -> list[float]:
        tried.update(numbers)
        return [0.0] * len(numbers)

    # The numbers of m, times those of k.
    find_elbow(*m_range, flat)
    of_m = len(tried)
    tried.clear()
    find_elbow(*k_range, flat)
    return of_m * len(tried)


def find_elbow(low: int, high: int, costs_of: Callable[[list[int]], list[float]]) -> int:
    """Find the number whose cost is farthest below the line through the extremes.

    Trinary search: two numbers divide the range into thirds, and the outer third beside the
    lesser one is dropped.

    Parameters
    ----------
    low, high : int
        The extremes, both included.
    costs_of : callable
        Returns the costs of a list of numbers, which can be evaluated in parallel.

    Returns
    -------
    int
        The best number evaluated. It is the true elbow if the distance from the line has a single
        peak.

    Examples
    --------
    >>> find_elbow(1, 20, lambda numbers: [1000 / x + x for x in numbers])
    5
    """
    steps = _elbow_steps(low, high)
    numbers = next(steps)
    while True:
        try:
            numbers = steps.send(costs_of(numbers))
        except StopIteration as end:
            return int(end.value)


def _run_together(
    searches: list[Generator[list[int], list[float], int]],
    ms: list[int],
    costs_of: Callable[[list[tuple[int, int]]], list[float]],
) -> list[int]:
    """Run searches for k, one for each of different m: what they ask for is solved at once.

    Returns the k that each of them finds.
    """
    wanted = {m: next(search) for m, search in zip(ms, searches, strict=True)}
    found: dict[int, int] = {}
    while wanted:
        # The costs of all pairs, in one go.
        pairs = [(k, m) for m, ks in wanted.items() for k in ks]
        costs = dict(zip(pairs, costs_of(pairs), strict=True))

        # Each search goes on with its own.
        for m, search in zip(ms, searches, strict=True):
            if m in found:
                continue
            try:
                wanted[m] = search.send([costs[k, m] for k in wanted[m]])
            except StopIteration as end:
                found[m] = int(end.value)
                del wanted[m]
    return [found[m] for m in ms]


def _elbow_steps(low: int, high: int) -> Generator[list[int], list[float], int]:
    """Yield the numbers whose costs :func:`find_elbow` needs next; return the number it finds."""
    # The line through the extremes, and the depths below it by number.
    ends = dict(zip((low, high), (yield [low, high]), strict=True))
    depth = partial(_depth_below_chord, low, ends[low], high, ends[high])
    depths = {x: depth(x, cost) for x, cost in ends.items()}

    # Drop a third of the range at a time.
    lower, upper = low, high
    while upper - lower > 2:
        third = (upper - lower) // 3
        a, b = lower + third, upper - third
        depths.update({x: depth(x, cost) for x, cost in zip((a, b), (yield [a, b]), strict=True)})
        if depths[a] > depths[b]:
            upper = b
        else:
            lower = a

    # Evaluate what is left; of equal numbers take the least.
    rest = [x for x in range(lower, upper + 1) if x not in depths]
    depths.update({x: depth(x, cost) for x, cost in zip(rest, (yield rest), strict=True)})
    return max(sorted(depths), key=depths.__getitem__)


def _depth_below_chord(
    low: int, cost_low: float, high: int, cost_high: float, x: int, cost: float
) -> float:
    """Return the distance of (x, cost) below the chord, with both axes scaled to [0, 1]."""
    # A chord without width or height has no point below it.
    if high == low or cost_low == cost_high:
        return 0.0
    right, up = (x - low) / (high - low), (cost - cost_high) / (cost_low - cost_high)
    return float((1 - right - up) / np.sqrt(2))
