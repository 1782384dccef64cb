"""The (k,m)-segment mean by expectation and maximisation (thesis, algorithm 1)."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import replace
from functools import partial
from typing import Literal, TypedDict, Unpack, get_args

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OptionError
from gpszip.kernels.sums import PrefixSums, track_sums
from gpszip.model import SegmentMean, Track
from gpszip.run.executor import Executor, local_executor
from gpszip.segmentation import estep
from gpszip.segmentation.bottom_up import bottom_up, relax_boundaries
from gpszip.segmentation.clustering import Merges, cut_merges, find_merges, k_means
from gpszip.segmentation.douglas_peucker import douglas_peucker
from gpszip.segmentation.evaluate import distances
from gpszip.segmentation.evaluate import rmse as rmse_of
from gpszip.segmentation.memo import memo_key
from gpszip.segmentation.mstep import fit_segments, maximize
from gpszip.segmentation.state import EMState, to_segment_mean, total_cost

__all__ = [
    "Clustering",
    "ExpectationStep",
    "InitialPartition",
    "Problem",
    "SegmentMeanOptions",
    "as_problem",
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
    tolerance: float
    min_samples: int
    rng: np.random.Generator | None


#: Options that are left out.
_DEFAULTS: SegmentMeanOptions = {
    "initial": "bottom-up",
    "clustering": "ward",
    "expectation": "odd-even",
    "iterations": 100,
    "tolerance": _ROUNDING,
    "min_samples": 1,
    "rng": None,
}


def segment_mean(
    track: Track,
    k: int,
    m: int,
    begins: NDArray[np.int64] | None = None,
    *,
    initial: InitialPartition = "bottom-up",
    clustering: Clustering = "ward",
    expectation: ExpectationStep = "odd-even",
    iterations: int = 100,
    tolerance: float = _ROUNDING,
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
    begins : int64 array, shape (r,), optional
        First sample of each run, which no interval leaves: tracks that were joined by
        :func:`gpszip.segmentation.runs.join_tracks`, or pieces between gaps; r <= k. Default: one
        run.
    initial : {'bottom-up', 'douglas-peucker'}, default 'bottom-up'
        Method of the initial partition.
    clustering : {'ward', 'k-means++'}, default 'ward'
        Method of the initial labels.
    expectation : {'odd-even', 'linear', 'naive', 'exact'}, default 'odd-even'
        Form of the expectation step: of sections 6.3.3, 6.3.2 or 6.3.1, or the best partition of
        the entire track for the present segments. That is slower, and each of its steps costs no
        more than the odd-even one, but the cost at the end may be higher as well as lower: both
        end at some local minimum.
    iterations : int, default 100
        Most iterations.
    tolerance : float, default 1e-12
        Share of tau by which an iteration has to lower it, so that another one follows.
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
    problem = Problem(
        track,
        begins,
        initial=initial,
        clustering=clustering,
        expectation=expectation,
        iterations=iterations,
        tolerance=tolerance,
        min_samples=min_samples,
        rng=rng,
    )
    return problem.solve(k, m, executor=executor)


class Problem:
    """A track and options, with what the segment means for several k and m have in common.

    The parameters are those of :func:`segment_mean`. A caller that solves many pairs (k, m) saves
    prefix sums, initial partitions and merges of intervals; results are the same.

    Raises
    ------
    OptionError
        If an option is unknown, or doesn't fit the others.
    """

    def __init__(
        self,
        track: Track,
        begins: NDArray[np.int64] | None = None,
        **options: Unpack[SegmentMeanOptions],
    ) -> None:
        # Options that are left out, for whoever passes only some.
        self.track = track
        self.begins = np.zeros(1, np.int64) if begins is None else np.asarray(begins, np.int64)
        self.options: SegmentMeanOptions = {**_DEFAULTS, **options}
        self.least_gain = 0.0
        _check_choices(self.options, len(self.begins))

        # Prefix sums in ticks, from which the cost of any interval follows, and partitions and
        # merges by k.
        self.sums = track_sums(track)
        self._partitions: dict[int, NDArray[np.int64]] = {}
        self._merges: dict[int, Merges] = {}

    def stopping_early(self, tolerance: float, share: float) -> Problem:
        """Return the problem with iterations that stop early; both share what they have in common.

        Parameters
        ----------
        tolerance : float
            The option of this name, unless that of the problem is larger.
        share : float
            Iterations stop, too, where they lower tau by less than this share of the cost of one
            segment, which each run follows.
        """
        other = copy(self)
        tolerance = max(tolerance, self.options["tolerance"])
        other.options = {**self.options, "tolerance": tolerance}
        heads = np.arange(len(self.begins))
        boundaries = np.append(self.begins, len(self.track))
        labels = np.zeros(len(heads), np.int32)
        segment = fit_segments(self.sums, boundaries, labels, 1)
        other.least_gain = share * total_cost(
            self.sums, EMState(boundaries, labels, *segment, heads)
        )
        return other

    @property
    def most(self) -> int:
        """Most intervals: as many as samples allow."""
        return len(self.track) // self.options["min_samples"]

    def rmse(self, mean: SegmentMean) -> float:
        """Root mean square error of a solution in metres."""
        return rmse_of(mean, self.track)

    def max_error(self, mean: SegmentMean) -> float:
        """Largest error of any sample of a solution in metres."""
        return float(distances(mean, self.track).max())

    def key(self) -> str:
        """Hash by which a memo knows the track and the options."""
        options = {**self.options, "begins": self.begins.tolist(), "least_gain": self.least_gain}
        return memo_key(self.track, options)

    def solve(self, k: int, m: int, *, executor: Executor | None = None) -> SegmentMean:
        """Return the segment mean with k intervals and m segments.

        Raises
        ------
        OptionError
            If k or m doesn't fit the track.
        """
        min_samples = self.options["min_samples"]
        _check_sizes(self.track, len(self.begins), k, m, min_samples)

        # Expectation and maximisation until tau stops falling.
        if m == k:
            step: _Iteration = partial(_free_line_iteration, self.sums, min_samples)
        else:
            form = self.options["expectation"]
            step = _build_iteration(self.sums, form, min_samples, executor)
        return self._iterate(self._initial_state(k, m), step)

    def _initial_state(self, k: int, m: int) -> EMState:
        """Initial partition, labels and segments."""
        boundaries = self._partition(k)
        labels = self._labels(k, m)
        heads = np.searchsorted(boundaries, self.begins)
        segments = fit_segments(self.sums, boundaries, labels, m)
        return EMState(boundaries, labels, *segments, heads)

    def _iterate(self, state: EMState, step: _Iteration) -> SegmentMean:
        """Repeat an iteration until tau stops falling."""
        costs = [total_cost(self.sums, state)]
        for _ in range(self.options["iterations"]):
            candidate = step(state)
            cost = total_cost(self.sums, candidate)
            # Written so that NaN ends the loop, too.
            if not cost < costs[-1] * (1 - _ROUNDING):
                break
            state = candidate
            costs.append(cost)
            gain = costs[-2] - cost
            if gain < max(self.options["tolerance"] * costs[-2], self.least_gain):
                break
        return to_segment_mean(self.sums, state, costs)

    def _partition(self, k: int) -> NDArray[np.int64]:
        """Initial partition into k intervals."""
        if k not in self._partitions:
            if self.options["initial"] == "bottom-up":
                found = bottom_up(
                    self.sums, k, begins=self.begins, min_samples=self.options["min_samples"]
                )
            else:
                found = douglas_peucker(self.sums, k)
            self._partitions[k] = found
        return self._partitions[k]

    def _labels(self, k: int, m: int) -> NDArray[np.int32]:
        """Initial labels: by k-means if there are random numbers, else by Ward's method."""
        # There is one way to label only: each interval by itself, or all alike.
        if m == k:
            return np.arange(k, dtype=np.int32)
        if m == 1:
            return np.zeros(k, dtype=np.int32)
        if self.options["clustering"] == "k-means++":
            rng = self.options["rng"]
            assert rng is not None
            return k_means(self.sums, self._partition(k), m, rng)
        if k not in self._merges:
            self._merges[k] = find_merges(self.sums, self._partition(k))
        return cut_merges(self._merges[k], m)


def as_problem(
    track: Track | Problem,
    begins: NDArray[np.int64] | None,
    options: SegmentMeanOptions,
) -> Problem:
    """Return the problem of a track; one that is given stays as it is, with its options."""
    return track if isinstance(track, Problem) else Problem(track, begins, **options)


def _check_sizes(track: Track, runs: int, k: int, m: int, min_samples: int) -> None:
    """Raise OptionError if k or m doesn't fit the track."""
    if not 1 <= m <= k:
        raise OptionError(
            f"k = {k} intervals can't have m = {m} different segments; choose 1 <= m <= k"
        )
    if k < runs:
        raise OptionError(
            f"k = {k} is too few: there are {runs} tracks, or pieces between gaps, and each has "
            "an interval of its own",
            remedy=f"choose k >= {runs}, or a longer gap",
        )
    if min_samples < 1 or k * min_samples > len(track):
        max_k = len(track) // max(min_samples, 1)
        raise OptionError(
            f"track {track.id!r} has {len(track)} samples, too few for k = {k} intervals of "
            f"{min_samples} or more; choose k <= {max_k}"
        )


def _check_choices(options: SegmentMeanOptions, runs: int) -> None:
    """Raise OptionError if a choice is unknown, or doesn't fit the others."""
    chosen = {
        "initial": (options["initial"], InitialPartition),
        "clustering": (options["clustering"], Clustering),
        "expectation": (options["expectation"], ExpectationStep),
    }
    for name, (value, choices) in chosen.items():
        if value not in get_args(choices):
            raise OptionError(
                f"{name} = {value!r} is unknown; choose one of {', '.join(get_args(choices))}"
            )
    if options["clustering"] == "k-means++" and options["rng"] is None:
        raise OptionError(
            "clustering 'k-means++' draws at random; pass rng=numpy.random.default_rng(seed)"
        )

    # These cut all samples at once.
    for name, value in (("initial", "douglas-peucker"), ("expectation", "exact")):
        if runs > 1 and chosen[name][0] == value:
            raise OptionError(
                f"{name} = {value!r} takes one track without gaps; choose another one"
            )


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
    boundaries = relax_boundaries(
        sums, state.boundaries, heads=state.heads, min_samples=min_samples, sweeps=1
    )
    starts, ends = fit_segments(sums, boundaries, state.labels, len(state.starts))
    return replace(state, boundaries=boundaries, starts=starts, ends=ends)
