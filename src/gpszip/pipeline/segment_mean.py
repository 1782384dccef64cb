"""The thesis's segment mean of tracks, with a search for the numbers that are left out."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OptionError
from gpszip.geo.gaps import estimate_gap, find_gaps_of_all
from gpszip.model import Likelihood, Listener, MarkovModel, Progress, SegmentMean, Track
from gpszip.pipeline.validate import check_tracks
from gpszip.run.executor import Executor
from gpszip.segmentation.memo import Memo

__all__ = [
    "Numbers",
    "Signal",
    "find_likelihood_of",
    "fit_model",
    "follow_model",
    "join_runs",
    "learn_model",
    "segment_mean",
]

#: Fewest segments k up to which the search goes, however short the track is.
_FEWEST_SEGMENTS = 10

#: Most segments k that are searched at first: the elbow mostly lies lower, and a search of more
#: takes minutes. Where it lies in the upper half, twice as many are searched.
_MOST_SEGMENTS = 300

#: Most segments m that are searched at first; the same holds.
_MOST_DISTINCT = 100

#: A number, the least and the greatest of a range, or None where it is searched.
Numbers = int | tuple[int, int] | None


@dataclass(frozen=True, eq=False)
class Signal:
    """Tracks as one sequence of samples.

    Parameters
    ----------
    tracks : tuple of Track
        The tracks.
    joined : Track
        All their samples.
    begins : int64 array, shape (r,)
        First sample of each run: of a track, or after a gap.
    gap : float
        Longer intervals, in seconds, are gaps; may be infinite.
    """

    tracks: tuple[Track, ...]
    joined: Track
    begins: NDArray[np.int64]
    gap: float


def join_runs(tracks: Sequence[Track] | Track, gap: float | None) -> Signal:
    """Join tracks, and find their gaps.

    Parameters
    ----------
    tracks : Track or sequence of Track
        On one plane.
    gap : float or None
        Longer intervals, in seconds, are gaps; None to estimate that.
    """
    from gpszip.segmentation.runs import join_tracks

    if gap is not None and not gap > 0:
        raise OptionError(f"gap is {gap:g}; it must be a positive number of seconds, or infinite")
    checked = check_tracks(tracks)
    timed = [track for track in checked if track.timed]
    seconds = estimate_gap(timed) if gap is None else gap
    return Signal(checked, *join_tracks(checked, find_gaps_of_all(checked, seconds)), seconds)


def segment_mean(
    tracks: Sequence[Track] | Track,
    k: Numbers = None,
    m: Numbers = None,
    *,
    rmse: float | None = None,
    max_error: float | None = None,
    gap: float | None = math.inf,
    memo: Memo | None = None,
    executor: Executor | None = None,
    progress: Listener | None = None,
) -> SegmentMean:
    """Approximate tracks by k segments, of which m are distinct (thesis, algorithm 1).

    Without ``k``, it is searched up to a tenth of the samples, and up to 300 unless the elbow lies
    in the upper half; without ``m``, up to k and 100 alike (algorithms 3 and 4). With a bound,
    those left out are the least that hold it.
    """
    return learn_model(
        join_runs(tracks, gap),
        k,
        m,
        rmse=rmse,
        max_error=max_error,
        memo=memo,
        executor=executor,
        progress=progress,
    )


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
    from gpszip.segmentation.em import segment_mean as with_both

    # Tell the listener a share of this one stage.
    def report(done: float) -> None:
        if progress is not None:
            progress(Progress("segment mean", done, len(signal.joined)))

    report(0.0)
    workers = None if executor is None else resolve_executor(executor)
    bounded = rmse is not None or max_error is not None
    if bounded:
        return _learn_within(signal, k, m, rmse, max_error, workers, report)
    if isinstance(k, int) and isinstance(m, int):
        return with_both(signal.joined, k, m, signal.begins, executor=workers)
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
            signal.joined,
            rmse=rmse,
            max_error=max_error,
            begins=signal.begins,
            executor=executor,
            report=report,
        )
    return segment_mean_within(
        signal.joined,
        rmse=rmse,
        max_error=max_error,
        k=k,
        m=m,
        begins=signal.begins,
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

    # Widen a range that nobody gave while the elbow lies in its upper half.
    memo = memo or Memo()
    most_parts, most_segments = _MOST_SEGMENTS, _MOST_DISTINCT
    while True:
        ks = _parts_range(signal, k, m, most_parts)
        ms = _segments_range(ks, k, m, most_segments)
        found = find_parameters(
            signal.joined,
            ks,
            ms,
            begins=signal.begins,
            memo=memo,
            executor=executor,
            report=report,
        )
        wider_k = k is None and ks[1] == most_parts and found.k > most_parts // 2
        wider_m = m is None and k is None and ms[1] == most_segments and found.m > ms[1] // 2
        if not (wider_k or wider_m):
            return found.mean
        most_parts *= 2 if wider_k else 1
        most_segments *= 2 if wider_m else 1


def _parts_range(signal: Signal, k: Numbers, m: Numbers, most: int) -> tuple[int, int]:
    """Least and greatest k: as given, or from as many as needed to a tenth of the samples."""
    if k is not None:
        return (k, k) if isinstance(k, int) else k
    n, runs = len(signal.joined), len(signal.begins)
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
    return found, find_likelihood(found, mean, signal.joined)


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
