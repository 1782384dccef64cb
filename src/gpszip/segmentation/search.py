"""The search for k and m: the elbow of the cost, by nested trinary search (thesis, algorithms 3 and 4).

Mended against the printed form: the search stops when at most one number is left between the bounds and tries it, where
the thesis's loop never ends; the best point evaluated is returned, not the upper bound; k is at least m; and
Algorithm 4 uses its own m where it names an m_n that it isn't given.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from gpszip.errors import OptionError
from gpszip.model import SegmentMean, Track
from gpszip.run.executor import Executor, SharedValue, share_value
from gpszip.segmentation.em import segment_mean
from gpszip.segmentation.memo import Memo, memo_key

__all__ = ["FoundParameters", "find_elbow", "find_parameters"]

#: The track, and the options of all segment means.
_TrackAndOptions = tuple[Track, dict[str, Any]]


@dataclass(frozen=True, eq=False)
class FoundParameters:
    """What the search found.

    Parameters
    ----------
    mean : SegmentMean
        The segment mean at the elbow.
    evaluated : tuple of (int, int, float)
        Every (k, m) that was tried and its fitting cost in square metres, sorted.
    """

    mean: SegmentMean
    evaluated: tuple[tuple[int, int, float], ...]

    @property
    def k(self) -> int:
        """Number of parts."""
        return self.mean.k

    @property
    def m(self) -> int:
        """Number of segments."""
        return self.mean.m


def find_parameters(
    track: Track,
    k_range: tuple[int, int],
    m_range: tuple[int, int],
    *,
    memo: Memo | None = None,
    executor: Executor | None = None,
    **options: Any,
) -> FoundParameters:
    """Find the k and m at the elbow of the fitting cost.

    For every m tried, k is where the cost over k lies farthest below the line through its extremes; m is where the
    costs at those k lie farthest below theirs. About log^2 runs of :func:`segment_mean`.

    Parameters
    ----------
    track : Track
        n samples.
    k_range, m_range : (int, int)
        Least and greatest k and m, both included. Only pairs with m <= k are tried.
    memo : Memo, optional
        Remembers solutions between calls, and between runs if it has a folder.
    executor : Executor, optional
        Runs independent (k, m) side by side; the result is the same for any number of workers.
    **options
        Passed on to :func:`gpszip.segmentation.em.segment_mean`.

    Raises
    ------
    OptionError
        If a range is empty or doesn't fit the track.
    """
    _check_ranges(track, k_range, m_range)
    (least_k, greatest_k), memo = k_range, memo or Memo()
    key = memo_key(track, options)
    tried: dict[tuple[int, int], SegmentMean] = {}

    def costs_of(pairs: list[tuple[int, int]]) -> list[float]:
        _solve_pairs(shared, pairs, tried, key, memo)
        return [tried[pair].cost for pair in pairs]

    def best_k(m: int) -> tuple[float, int]:
        k = find_elbow(max(least_k, m), greatest_k, lambda ks: costs_of([(k, m) for k in ks]))
        return tried[k, m].cost, k

    found = {}

    def best_costs(ms: list[int]) -> list[float]:
        found.update({m: best_k(m) for m in ms})
        return [found[m][0] for m in ms]

    with share_value(executor, (track, options)) as shared:
        m = find_elbow(*m_range, best_costs)
    evaluated = tuple(sorted((k, m, mean.cost) for (k, m), mean in tried.items()))
    return FoundParameters(tried[found[m][1], m], evaluated)


def _check_ranges(track: Track, k_range: tuple[int, int], m_range: tuple[int, int]) -> None:
    for name, (least, greatest) in (("k_range", k_range), ("m_range", m_range)):
        if not 1 <= least <= greatest:
            raise OptionError(
                f"{name} = ({least}, {greatest}) holds no number; give the least, at least 1, then the greatest"
            )
    if m_range[1] > k_range[1]:
        raise OptionError(
            f"m may reach {m_range[1]}, but k only {k_range[1]}; k is never below m: widen k_range or narrow m_range"
        )
    if k_range[1] > len(track):
        raise OptionError(
            f"track {track.id!r} has {len(track)} samples; k can't reach {k_range[1]}"
        )


def _solve_pairs(
    shared: SharedValue[_TrackAndOptions],
    pairs: Iterable[tuple[int, int]],
    tried: dict[tuple[int, int], SegmentMean],
    key: str,
    memo: Memo,
) -> None:
    """Solve the pairs that neither this search nor the memo knows, side by side."""
    for pair in pairs:
        known = tried.get(pair) or memo.get(key, *pair)
        if known is not None:
            tried[pair] = known
    missing = [pair for pair in dict.fromkeys(pairs) if pair not in tried]
    for pair, mean in zip(missing, shared.map(_mean_of_pair, missing), strict=True):
        tried[pair] = mean
        memo.put(key, mean)


def _mean_of_pair(given: _TrackAndOptions, pair: tuple[int, int]) -> SegmentMean:
    track, options = given
    return segment_mean(track, *pair, **options)


def find_elbow(low: int, high: int, costs_of: Callable[[list[int]], list[float]]) -> int:
    """Number between low and high whose cost lies farthest below the line through the extremes, by trinary search.

    Parameters
    ----------
    low, high : int
        The extremes, both included.
    costs_of : callable
        Returns the costs of a list of numbers; called with those that can be evaluated side by side.

    Returns
    -------
    int
        The best number evaluated: the true elbow if the distance from the line has a single peak.

    Examples
    --------
    >>> find_elbow(1, 20, lambda numbers: [1000 / x + x for x in numbers])
    5
    """
    extremes = dict(zip((low, high), costs_of([low, high]), strict=True))
    below = partial(_depth_below_chord, low, extremes[low], high, extremes[high])
    seen = {x: below(x, cost) for x, cost in extremes.items()}
    lower, upper = low, high
    while upper - lower > 2:
        third = (upper - lower) // 3
        a, b = lower + third, upper - third
        seen.update({x: below(x, cost) for x, cost in zip((a, b), costs_of([a, b]), strict=True)})
        if seen[a] > seen[b]:
            upper = b
        else:
            lower = a
    rest = [x for x in range(lower, upper + 1) if x not in seen]
    seen.update({x: below(x, cost) for x, cost in zip(rest, costs_of(rest), strict=True)})
    return max(sorted(seen), key=seen.__getitem__)


def _depth_below_chord(
    low: int, cost_low: float, high: int, cost_high: float, x: int, cost: float
) -> float:
    """How far (x, cost) lies below the line through the extremes once both axes run from 0 to 1."""
    if high == low or cost_low == cost_high:
        return 0.0
    right, up = (x - low) / (high - low), (cost - cost_high) / (cost_low - cost_high)
    return float((1 - right - up) / np.sqrt(2))
