"""The Markov model of a segment mean, and what it says about other tracks.

Source: the thesis's problem 4.2.1 asks for the hidden Markov model that most likely generates the
observations.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.sums import track_sums
from gpszip.model import Likelihood, MarkovModel, SegmentMean, Track
from gpszip.segmentation import estep
from gpszip.segmentation.partition import penalised_partition
from gpszip.segmentation.state import EMState, to_ticks, total_cost

__all__ = ["build_markov_model", "count_transitions", "find_likelihood", "label_track"]

#: Metres below which no standard deviation is: ticks of positions are as long.
_MIN_SIGMA = 1e-3

#: Samples at which parts may begin at first; they are shifted to any afterwards.
_CUTS = 4000

#: Most rounds of shifting boundaries between given segments.
_ROUNDS = 20


def count_transitions(mean: SegmentMean) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Return each pair of segments that follow each other, sorted, and how often they do.

    Parts of different runs don't follow each other.

    Examples
    --------
    >>> points = np.zeros((2, 1))
    >>> mean = SegmentMean(np.arange(5), np.array([0, 1, 0, 1], np.int32), points, points, 0.0)
    >>> pairs, counts = count_transitions(mean)
    >>> pairs.tolist(), counts.tolist()
    ([[0, 1], [1, 0]], [2, 1])
    """
    follows = np.ones(mean.k, np.bool_)
    follows[mean.heads] = False
    labels = mean.labels.astype(np.int64)
    keys, counts = np.unique((labels[:-1] * mean.m + labels[1:])[follows[1:]], return_counts=True)
    return np.stack(divmod(keys, mean.m), axis=1).astype(np.int32), counts.astype(np.int64)


def build_markov_model(mean: SegmentMean, track: Track) -> MarkovModel:
    """Return the Markov model of a segment mean.

    Parameters
    ----------
    mean : SegmentMean
        Parts and segments.
    track : Track
        Its samples; those of several tracks as :func:`gpszip.segmentation.runs.join_tracks` joins
        them.
    """
    # The most likely variance of each coordinate is the mean squared error.
    weight = float(len(track) if track.weights is None else track.weights.sum())
    sigma = math.sqrt(mean.cost / (weight * track.dimension))
    firsts = np.bincount(mean.labels[mean.heads], minlength=mean.m).astype(np.int64)
    return MarkovModel(
        mean.starts,
        mean.ends,
        firsts,
        *count_transitions(mean),
        max(sigma, _MIN_SIGMA),
        track.plane,
    )


def label_track(model: MarkovModel, track: Track, begins: NDArray[np.int64]) -> SegmentMean:
    """Cut a track into parts that follow the segments of a model.

    Minimises the fitting cost plus a price for each part: ``2 sigma^2`` times what a transition
    costs on average, ``-log p``. Segments stay as they are.

    Parameters
    ----------
    model : MarkovModel
        The segments.
    track : Track
        n samples on the plane of the model.
    begins : int64 array, shape (r,)
        First sample of each run.
    """
    # Square metres that one more part has to save.
    price = 2 * model.sigma**2 * _mean_surprise(model)
    boundaries, labels = [np.zeros(1, np.int64)], [np.zeros(0, np.int32)]
    heads, cost = list[int](), 0.0

    # Cut each run by itself.
    for first, after in pairwise([*begins.tolist(), len(track)]):
        weights = None if track.weights is None else track.weights[first:after]
        rows = slice(first, after)
        run = Track(track.id, track.times[rows], track.positions[rows], weights)
        heads.append(sum(len(part) for part in labels))
        state, run_cost = _cut_run(model, run, price)
        boundaries.append(first + state.boundaries[1:])
        labels.append(state.labels)
        cost += run_cost

    return SegmentMean(
        np.concatenate(boundaries),
        np.concatenate(labels),
        model.starts,
        model.ends,
        cost,
        (cost,),
        np.array(heads, np.int64),
    )


def _cut_run(model: MarkovModel, run: Track, price: float) -> tuple[EMState, float]:
    """Cut one run, and return its parts and their cost in square metres."""
    # Cut at some samples.
    sums = track_sums(run)
    starts, ends = to_ticks(sums, model.starts), to_ticks(sums, model.ends)
    cut = penalised_partition(
        sums, starts, ends, price / sums.position_tick**2, stride=max(1, len(run) // _CUTS)
    )

    # Shift the boundaries until no cost falls.
    state = EMState(cut.boundaries, cut.labels, starts, ends)
    cost = total_cost(sums, state)
    for _ in range(_ROUNDS):
        shifted = estep.odd_even(sums, state)
        shifted_cost = total_cost(sums, shifted)
        if not shifted_cost < cost:
            break
        state, cost = shifted, shifted_cost
    return state, cost * sums.position_tick**2


def _mean_surprise(model: MarkovModel) -> float:
    """Return ``-log p`` of the model's own transitions on average; at least log 2."""
    if not len(model.counts):
        return math.log(2)
    return max(float(np.average(-np.log(model.probabilities), weights=model.counts)), math.log(2))


def find_likelihood(
    model: MarkovModel, mean: SegmentMean, track: Track, samples: int | None = None
) -> Likelihood:
    """Return the log-likelihood of a track whose parts follow the segments of a model.

    With the distance r of each sample from its position on the segment, and its weight w, samples
    add ``-w (d log(2 pi sigma^2) + r^2 / sigma^2) / 2``. The sum of w r^2 is the fitting cost.

    Parameters
    ----------
    model : MarkovModel
        The model.
    mean : SegmentMean
        Parts on its segments.
    track : Track
        The samples, or what stands for them with their weight.
    samples : int, optional
        Number of samples; by default that of the track.

    Examples
    --------
    >>> track = Track("lane", range(4), [[0.0], [1.0], [2.0], [3.0]])
    >>> points = (np.array([[0.0]]), np.array([[3.0]]))
    >>> mean = SegmentMean(np.array([0, 4]), np.zeros(1, np.int32), *points, 0.0)
    >>> model = build_markov_model(mean, track)
    >>> find_likelihood(model, mean, track).transitions
    0.0
    """
    weight = float(len(track) if track.weights is None else track.weights.sum())
    variance = model.sigma**2
    density = track.dimension * math.log(2 * math.pi * variance)
    of_samples = -0.5 * (weight * density + mean.cost / variance)
    of_transitions = model.log_probability(mean.labels, mean.heads)
    return Likelihood(of_transitions, of_samples, len(track) if samples is None else samples)
