"""The thesis's segment mean of tracks, with a search for the numbers that are left out."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OptionError
from gpszip.geo.gaps import estimate_gap, find_gaps_of_all
from gpszip.model import Likelihood, Listener, MarkovModel, Progress, SegmentMean, Track
from gpszip.pipeline.validate import check_tracks
from gpszip.run.executor import Executor
from gpszip.segmentation.memo import Memo

if TYPE_CHECKING:
    from gpszip.segmentation.em import Problem
    from gpszip.sketches.coreset import Coreset
    from gpszip.sketches.stream import CoresetStream

__all__ = [
    "Numbers",
    "Signal",
    "as_signal",
    "find_likelihood_of",
    "fit_model",
    "follow_model",
    "join_runs",
    "learn_model",
    "part_rows",
    "segment_mean",
    "signal_of_coreset",
]

#: Fewest segments k up to which the search goes, however short the track is.
_FEWEST_SEGMENTS = 10

#: Most segments k that are searched at first: the elbow mostly lies lower, and a search of more
#: takes minutes. Where it lies in the upper third, twice as many are searched.
_MOST_SEGMENTS = 300

#: Most segments m that are searched at first; the same holds.
_MOST_DISTINCT = 100

#: Samples above which k and m are searched on a coreset: a search on more takes minutes. One on a
#: patrol of 72,273 samples takes 28 s.
_MAX_SEARCHED = 200_000

#: Blocks of that coreset. Of the patrol, it finds k = 35 and m = 7 in 9 s; a search on all finds
#: k = 45 and m = 8.
_SEARCH_BLOCKS = 2400

#: Decimals of seconds, as everywhere in files.
_TIME_DECIMALS = 6

#: A number, the least and the greatest of a range, or None where it is searched.
Numbers = int | tuple[int, int] | None


@dataclass(frozen=True, eq=False)
class Signal:
    """Tracks as one sequence of samples, or a coreset of some.

    Parameters
    ----------
    tracks : tuple of Track
        The tracks; none where only their coreset is at hand.
    joined : Track
        All their samples, or those that stand for the blocks of the coreset.
    begins : int64 array, shape (r,)
        First sample of each run: of a track, or after a gap.
    gap : float
        Longer intervals, in seconds, are gaps; may be infinite.
    coreset : Coreset, optional
        What segments are learned from, instead of the samples.
    """

    tracks: tuple[Track, ...]
    joined: Track
    begins: NDArray[np.int64]
    gap: float
    coreset: Coreset | None = None

    @cached_property
    def problem(self) -> Problem:
        """The problem of segment means of this signal."""
        from gpszip.pipeline.coreset_problem import CoresetProblem
        from gpszip.segmentation.em import Problem

        if self.coreset is None:
            return Problem(self.joined, self.begins)
        return CoresetProblem(self.coreset, self.joined if self.tracks else None)

    @property
    def samples(self) -> int:
        """Number of samples of the log."""
        if self.coreset is not None:
            return self.coreset.samples
        return len(self.joined)


def join_runs(
    tracks: Sequence[Track] | Track, gap: float | None, *, coreset: int | None = None
) -> Signal:
    """Join tracks, and find their gaps.

    Parameters
    ----------
    tracks : Track or sequence of Track
        On one plane.
    gap : float or None
        Longer intervals, in seconds, are gaps; None to estimate that.
    coreset : int, optional
        Learn from a coreset of this many blocks; each run has at least one.
    """
    from gpszip.segmentation.runs import join_tracks

    if gap is not None and not gap > 0:
        raise OptionError(f"gap is {gap:g}; it must be a positive number of seconds, or infinite")
    checked = check_tracks(tracks)
    timed = [track for track in checked if track.timed]
    seconds = estimate_gap(timed) if gap is None else gap
    joined, begins = join_tracks(checked, find_gaps_of_all(checked, seconds))
    blocks = None if coreset is None else _coreset_of_runs(joined, begins, coreset)
    return Signal(checked, joined, begins, seconds, blocks)


def _coreset_of_runs(joined: Track, begins: NDArray[np.int64], size: int) -> Coreset:
    """Build a coreset with blocks within runs."""
    from gpszip.sketches.partition import build_coreset

    runs = []
    for number, (first, after) in enumerate(pairwise([*begins.tolist(), len(joined)])):
        weights = None if joined.weights is None else joined.weights[first:after]
        rows = slice(first, after)
        runs.append(Track(f"{number}", joined.times[rows], joined.positions[rows], weights))
    coreset = build_coreset(runs, size=max(size, len(runs)))
    return replace(coreset, plane=joined.plane)


def signal_of_coreset(coreset: Coreset) -> Signal:
    """Return the signal of a coreset whose samples are not at hand."""
    from gpszip.pipeline.coreset_problem import CoresetProblem

    problem = CoresetProblem(coreset)
    return Signal((), problem.track, problem.begins, math.inf, coreset)


def segment_mean(
    tracks: Sequence[Track] | Track | Coreset | CoresetStream,
    k: Numbers = None,
    m: Numbers = None,
    *,
    rmse: float | None = None,
    max_error: float | None = None,
    gap: float | None = math.inf,
    coreset: int | None = None,
    memo: Memo | None = None,
    executor: Executor | None = None,
    progress: Listener | None = None,
) -> SegmentMean:
    """Approximate tracks by k segments, of which m are distinct (thesis, algorithm 1).

    Without ``k``, it is searched up to a tenth of the samples, and up to 300 unless the elbow lies
    in the upper third; without ``m``, up to k and 100 alike (algorithms 3 and 4). With a bound,
    those left out are the least that hold it.
    """
    return learn_model(
        as_signal(tracks, gap, coreset),
        k,
        m,
        rmse=rmse,
        max_error=max_error,
        memo=memo,
        executor=executor,
        progress=progress,
    )


def as_signal(
    tracks: Sequence[Track] | Track | Coreset | CoresetStream,
    gap: float | None,
    coreset: int | None = None,
) -> Signal:
    """Return the signal of tracks or of a coreset.

    Raises
    ------
    OptionError
        If a coreset is to be learned from a coreset of another size.
    """
    from gpszip.sketches.coreset import Coreset
    from gpszip.sketches.stream import CoresetStream

    if not isinstance(tracks, (Coreset, CoresetStream)):
        return join_runs(tracks, gap, coreset=coreset)
    if coreset is not None:
        raise OptionError(
            "coreset was given with a coreset", remedy="leave it out, or call coreset.reduced(size)"
        )
    return signal_of_coreset(tracks if isinstance(tracks, Coreset) else tracks.coreset())


def learn_model(
    signal: Signal,
    k: Numbers,
    m: Numbers,
    *,
    rmse: float | None = None,
    max_error: float | None = None,
    memo: Memo | None = None,
    executor: Executor | None = None,
    progress: Listener | None = None,
) -> SegmentMean:
    """Learn the segment mean of a signal; see :func:`segment_mean`."""
    from gpszip.run import resolve_executor

    # Tell the listener a share of this one stage.
    def report(done: float) -> None:
        if progress is not None:
            progress(Progress("segment mean", done, signal.samples))

    report(0.0)
    workers = None if executor is None else resolve_executor(executor)
    bounded = rmse is not None or max_error is not None
    if bounded:
        return _learn_within(signal, k, m, rmse, max_error, workers, report)
    if isinstance(k, int) and isinstance(m, int):
        return signal.problem.solve(k, m, executor=workers)
    # Pairs (k, m) are solved by threads unless the caller says otherwise.
    return _search(signal, k, m, memo, resolve_executor(executor), report)


def _learn_within(
    signal: Signal,
    k: Numbers,
    m: Numbers,
    rmse: float | None,
    max_error: float | None,
    executor: Executor | None,
    report: Callable[[float], None],
) -> SegmentMean:
    """Learn a segment mean within a bound."""
    from gpszip.segmentation.bound import segment_mean_within, shortest_mean_within

    if isinstance(k, tuple) or isinstance(m, tuple):
        raise OptionError("a range of k or m doesn't go with a bound", remedy="give a number")
    if k is None and m is None:
        return shortest_mean_within(
            signal.problem,
            rmse=rmse,
            max_error=max_error,
            executor=executor,
            report=report,
        )
    return segment_mean_within(
        signal.problem,
        rmse=rmse,
        max_error=max_error,
        k=k,
        m=m,
        executor=executor,
    )


def _search(
    signal: Signal,
    k: Numbers,
    m: Numbers,
    memo: Memo | None,
    executor: Executor | None,
    report: Callable[[float], None],
) -> SegmentMean:
    """Search what was left out at the elbow of the cost."""
    from gpszip.segmentation.search import find_parameters

    # Search many samples on a coreset.
    searched = _searched_signal(signal, k, m)
    memo = memo or Memo()

    # Widen a range that nobody gave while the elbow lies in its upper third.
    most_parts, most_segments = _MOST_SEGMENTS, _MOST_DISTINCT
    while True:
        ks = _parts_range(searched, k, m, most_parts)
        ms = _segments_range(ks, k, m, most_segments)
        found = find_parameters(
            searched.problem,
            ks,
            ms,
            memo=memo,
            executor=executor,
            report=report,
        )
        wider_k = k is None and ks[1] == most_parts and _in_upper_third(found.k, ks)
        wider_m = (
            m is None and k is None and ms[1] == most_segments and _in_upper_third(found.m, ms)
        )
        if not (wider_k or wider_m):
            break
        most_parts *= 2 if wider_k else 1
        most_segments *= 2 if wider_m else 1

    # Of a coreset, only k and m count.
    if searched is signal:
        return found.mean
    return signal.problem.solve(found.k, found.m)


def _in_upper_third(number: int, limits: tuple[int, int]) -> bool:
    """Whether a number lies in the upper third of a range, whose end may have kept it from more.

    Half a range would be doubled for nothing: of 8,000 samples of a patrol, the elbow lies at 155
    of 300 parts, and a search of 600 takes 2.5 times as long.
    """
    least, greatest = limits
    return 3 * (greatest - number) < greatest - least


def _searched_signal(signal: Signal, k: Numbers, m: Numbers) -> Signal:
    """Return the signal on which k and m are searched: of many samples, a coreset."""
    numbers = [each for each in (k, m) if each is not None]
    asked = max((each if isinstance(each, int) else each[1] for each in numbers), default=1)
    too_many_parts = max(asked, len(signal.begins)) > _SEARCH_BLOCKS // 2
    if signal.coreset is not None or len(signal.joined) <= _MAX_SEARCHED or too_many_parts:
        return signal
    blocks = _coreset_of_runs(signal.joined, signal.begins, _SEARCH_BLOCKS)
    return replace(signal, coreset=blocks)


def _parts_range(signal: Signal, k: Numbers, m: Numbers, most: int) -> tuple[int, int]:
    """Least and greatest k: as given, or from as many as needed to a tenth of the samples."""
    if k is not None:
        return (k, k) if isinstance(k, int) else k
    n, runs = signal.problem.most, len(signal.begins)
    least = max(runs, 1 if m is None else m if isinstance(m, int) else m[0])
    needed = max(runs, 1 if m is None else m if isinstance(m, int) else m[1])
    # A track of a phone has many runs, each of which has a part.
    greatest = max(_FEWEST_SEGMENTS, min(n // 10, most), 2 * runs if runs > 1 else 1, needed)
    return least, min(n, greatest)


def _segments_range(ks: tuple[int, int], k: Numbers, m: Numbers, most: int) -> tuple[int, int]:
    """Least and greatest m: as given, or up to k; up to ``most`` where k is searched, too."""
    if m is not None:
        return (m, m) if isinstance(m, int) else m
    return 1, ks[1] if k is not None else min(ks[1], most)


def fit_model(
    signal: Signal, mean: SegmentMean, model: MarkovModel | None = None
) -> tuple[MarkovModel, Likelihood]:
    """Return the Markov model of a segment mean, and the log-likelihood of its tracks.

    With a model that was given, the log-likelihood is that under this one.
    """
    from gpszip.segmentation.markov import build_markov_model, find_likelihood

    found = build_markov_model(mean, signal.joined) if model is None else model
    return found, find_likelihood(found, mean, signal.joined, signal.samples)


def find_likelihood_of(
    model: MarkovModel, tracks: Sequence[Track] | Track, gap: float | None
) -> Likelihood:
    """Return the log-likelihood of tracks that follow the segments of a model."""
    signal = join_runs(tracks, gap)
    return fit_model(signal, follow_model(model, signal), model)[1]


def follow_model(model: MarkovModel, signal: Signal) -> SegmentMean:
    """Cut a signal into parts that follow the segments of a model.

    Raises
    ------
    OptionError
        If the signal doesn't lie on the plane of the model.
    """
    from gpszip.model.text import axes_text
    from gpszip.segmentation.markov import label_track

    joined = signal.joined
    if joined.dimension != model.dimension or joined.plane != model.plane:
        raise OptionError(
            f"the segments have {axes_text(model.dimension, model.plane)}, the log "
            f"{axes_text(joined.dimension, joined.plane)}, or lie on another plane",
            remedy="give a log of the same place, on the plane of the segments",
        )
    return label_track(model, joined, signal.begins)


def part_rows(signal: Signal, mean: SegmentMean) -> list[dict[str, Any]]:
    """Return each part with its track, samples, times and cost, by name.

    Samples are counted within the track. Of a coreset, times within blocks are those of even
    samples, and the costs of parts are not known (None).
    """
    from gpszip.segmentation.evaluate import distances

    # Names and sizes of tracks, times and costs of parts.
    coreset, joined = signal.coreset, signal.joined
    if signal.tracks or coreset is None:
        names = [(track.id, track.timed) for track in signal.tracks]
        sizes = [len(track) for track in signal.tracks]
        samples = np.concatenate([track.times for track in signal.tracks])
        starts, ends = samples[mean.boundaries[:-1]], samples[mean.boundaries[1:] - 1]
        weights = 1.0 if joined.weights is None else joined.weights
        squares = weights * np.square(distances(mean, joined))
        costs: list[Any] = np.add.reduceat(squares, mean.boundaries[:-1]).tolist()
    else:
        from gpszip.pipeline.coreset_problem import CoresetProblem

        assert isinstance(signal.problem, CoresetProblem)
        names = [(name, True) for name in coreset.tracks]
        sizes = np.bincount(coreset.owners, weights=coreset.counts).astype(int).tolist()
        starts, ends = signal.problem.times(mean)
        costs = [None] * mean.k

    # Rows.
    firsts = np.cumsum([0, *sizes])
    owners = np.searchsorted(firsts, mean.boundaries[:-1], side="right") - 1
    rows = []
    for number, (begin, after) in enumerate(pairwise(mean.boundaries.tolist())):
        name, timed = names[owners[number]]
        offset = int(firsts[owners[number]])
        rows.append(
            {
                "part": number,
                "track_id": name,
                "segment": int(mean.labels[number]),
                "first": begin - offset,
                "last": after - 1 - offset,
                "t_start": round(float(starts[number]), _TIME_DECIMALS) if timed else None,
                "t_end": round(float(ends[number]), _TIME_DECIMALS) if timed else None,
                "cost": costs[number],
            }
        )
    return rows
