"""The (k,m)-segment mean by expectation and maximisation (thesis, algorithm 1)."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Literal, TypedDict, get_args

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OptionError
from gpszip.kernels.sums import PrefixSums, track_sums
from gpszip.model import SegmentMean, Track
from gpszip.run.executor import Executor, local_executor
from gpszip.segmentation import estep
from gpszip.segmentation.bottom_up import bottom_up, relax_boundaries
from gpszip.segmentation.clustering import k_means, ward
from gpszip.segmentation.douglas_peucker import douglas_peucker
from gpszip.segmentation.mstep import fit_segments, maximize
from gpszip.segmentation.state import EMState, to_segment_mean, total_cost

__all__ = [
    "Clustering",
    "ExpectationStep",
    "InitialPartition",
    "SegmentMeanOptions",
    "segment_mean",
]

InitialPartition = Literal["bottom-up", "douglas-peucker"]
Clustering = Literal["ward", "k-means++"]
ExpectationStep = Literal["odd-even", "linear", "naive", "exact"]

#: One expectation step and one maximisation step.
_Iteration = Callable[[EMState], EMState]

#: Share of tau below which the gain of an iteration is rounding.
_ROUNDING = 1e-12


class SegmentMeanOptions(TypedDict, total=False):
    """Options of :func:`segment_mean` that other functions pass through."""

    initial: InitialPartition
    clustering: Clustering
    expectation: ExpectationStep
    iterations: int
    min_samples: int
    rng: np.random.Generator | None


def segment_mean(
    track: Track,
    k: int,
    m: int,
    *,
    initial: InitialPartition = "bottom-up",
    clustering: Clustering = "ward",
    expectation: ExpectationStep = "odd-even",
    iterations: int = 100,
    min_samples: int = 1,
    rng: np.random.Generator | None = None,
    executor: Executor | None = None,
) -> SegmentMean:
    """Approximate a track by k intervals, each assigned to one of m directed segments.

    Algorithm 1 of the thesis. It starts from an initial partition and an initial clustering. It
    alternates between the expectation step (better intervals and labels for given segments) and
    the maximisation step (best segments for given intervals) until neither lowers the fitting
    cost tau, which therefore never rises. With m = k each interval has its own segment, and the
    boundaries are shifted between best lines instead.

    Parameters
    ----------
    track : Track
        n samples in d dimensions, weighted or not.
    k, m : int
        Numbers of intervals and of segments, 1 <= m <= k <= n.
    initial : {'bottom-up', 'douglas-peucker'}, default 'bottom-up'
        Method of the initial partition.
    clustering : {'ward', 'k-means++'}, default 'ward'
        Method of the initial labels.
    expectation : {'odd-even', 'linear', 'naive', 'exact'}, default 'odd-even'
        Form of the expectation step: of sections 6.3.3, 6.3.2 or 6.3.1, or the best partition of
        the entire track, which is slower and reaches a lower cost.
    iterations : int, default 100
        Most iterations.
    min_samples : int, default 1
        Fewest samples of an interval.
    rng : numpy.random.Generator, optional
        Random numbers; needed by 'k-means++'.
    executor : Executor, optional
        Runs batches of boundaries of the 'odd-even' and 'exact' steps. The result is the same for
        any number of workers.

    Returns
    -------
    SegmentMean
        Boundaries, labels, segments in metres, and the cost after each iteration in square
        metres. Times and positions are rounded to ticks of 1 ms and 1 mm, or finer if the track
        is fast or small.

    Raises
    ------
    OptionError
        If k, m or another option doesn't fit the track.

    Examples
    --------
    >>> import numpy as np
    >>> forward, backward = np.linspace(0, 10, 6), np.linspace(10, 0, 6)
    >>> x = np.concatenate([forward, backward, forward, backward])
    >>> mean = segment_mean(Track("lane", np.arange(24.0), x[:, None]), k=4, m=2)
    >>> mean.boundaries.tolist(), mean.labels.tolist(), round(mean.cost, 9)
    ([0, 6, 12, 18, 24], [0, 1, 0, 1], 0.0)
    """
    # Prefix sums in ticks, from which the cost of any interval follows.
    _check_sizes(track, k, m, min_samples)
    _check_choices(initial, clustering, expectation, rng)
    sums = track_sums(track)

    # Initial partition, labels and segments.
    if initial == "bottom-up":
        boundaries = bottom_up(sums, k, min_samples=min_samples)
    else:
        boundaries = douglas_peucker(sums, k)
    state = _initial_state(sums, boundaries, m, rng if clustering == "k-means++" else None)

    # Expectation and maximisation until tau stops falling.
    if m == k:
        step: _Iteration = partial(_free_line_iteration, sums, min_samples)
    else:
        step = _build_iteration(sums, expectation, min_samples, executor)
    return _iterate(sums, state, step, iterations)


def _check_sizes(track: Track, k: int, m: int, min_samples: int) -> None:
    """Raise OptionError if k or m doesn't fit the track."""
    if not 1 <= m <= k:
        raise OptionError(
            f"k = {k} intervals can't have m = {m} different segments; choose 1 <= m <= k"
        )
    if min_samples < 1 or k * min_samples > len(track):
        max_k = len(track) // max(min_samples, 1)
        raise OptionError(
            f"track {track.id!r} has {len(track)} samples, too few for k = {k} intervals of "
            f"{min_samples} or more; choose k <= {max_k}"
        )


def _check_choices(
    initial: str, clustering: str, expectation: str, rng: np.random.Generator | None
) -> None:
    """Raise OptionError if a choice is unknown or its random numbers are missing."""
    chosen = {
        "initial": (initial, InitialPartition),
        "clustering": (clustering, Clustering),
        "expectation": (expectation, ExpectationStep),
    }
    for name, (value, choices) in chosen.items():
        if value not in get_args(choices):
            raise OptionError(
                f"{name} = {value!r} is unknown; choose one of {', '.join(get_args(choices))}"
            )
    if clustering == "k-means++" and rng is None:
        raise OptionError(
            "clustering 'k-means++' draws at random; pass rng=numpy.random.default_rng(seed)"
        )


def _initial_state(
    sums: PrefixSums, boundaries: NDArray[np.int64], m: int, rng: np.random.Generator | None
) -> EMState:
    """Label the intervals and fit the segments."""
    labels = _initial_labels(sums, boundaries, m, rng)
    return EMState(boundaries, labels, *fit_segments(sums, boundaries, labels, m))


def _initial_labels(
    sums: PrefixSums, boundaries: NDArray[np.int64], m: int, rng: np.random.Generator | None
) -> NDArray[np.int32]:
    """Return the initial labels: by k-means if there are random numbers, else by Ward's method."""
    k = len(boundaries) - 1
    # There is one way to label only: each interval by itself, or all alike.
    if m == k:
        return np.arange(k, dtype=np.int32)
    if m == 1:
        return np.zeros(k, dtype=np.int32)
    return ward(sums, boundaries, m) if rng is None else k_means(sums, boundaries, m, rng)


def _build_iteration(
    sums: PrefixSums, expectation: str, min_samples: int, executor: Executor | None
) -> _Iteration:
    """Return an iteration with the chosen form of the expectation step."""
    executor = None if executor is None else local_executor(executor)
    steps: dict[str, _Iteration] = {
        "odd-even": partial(estep.odd_even, sums, min_samples=min_samples, executor=executor),
        "linear": partial(estep.linear, sums, min_samples=min_samples),
        "naive": partial(estep.naive, sums, min_samples=min_samples),
        "exact": partial(estep.exact, sums, min_samples=min_samples, executor=executor),
    }
    expect = steps[expectation]
    return lambda state: maximize(sums, expect(state))


def _free_line_iteration(sums: PrefixSums, min_samples: int, state: EMState) -> EMState:
    """Shift boundaries between best lines and refit them: an iteration for m = k."""
    boundaries = relax_boundaries(sums, state.boundaries, min_samples=min_samples, sweeps=1)
    return EMState(
        boundaries, state.labels, *fit_segments(sums, boundaries, state.labels, len(state.starts))
    )


def _iterate(sums: PrefixSums, state: EMState, step: _Iteration, iterations: int) -> SegmentMean:
    """Repeat an iteration until tau stops falling."""
    costs = [total_cost(sums, state)]
    for _ in range(iterations):
        candidate = step(state)
        cost = total_cost(sums, candidate)
        # Written so that NaN ends the loop, too.
        if not cost < costs[-1] * (1 - _ROUNDING):
            break
        state = candidate
        costs.append(cost)
    return to_segment_mean(sums, state, costs)
