"""Plain twins of f(t), algorithm 5 and edge counts, and random segment means."""

from __future__ import annotations

import itertools
from collections import Counter

import numpy as np

from gpszip.model import SegmentMean, Track


def fitted_positions(mean: SegmentMean, track: Track) -> np.ndarray:
    """f(t_i) of a segment mean at each sample; a segment of one sample is at its start."""
    rows = []
    for i, label in enumerate(mean.labels):
        times = track.times[mean.boundaries[i] : mean.boundaries[i + 1]]
        for time in times:
            u = (time - times[0]) / (times[-1] - times[0]) if len(times) > 1 else 0.0
            rows.append((1 - u) * mean.starts[label] + u * mean.ends[label])
    return np.array(rows)


def segment_map(mean: SegmentMean) -> tuple[list[tuple[int, int]], dict[tuple[int, int], int]]:
    """Algorithm 5: directed edges in the order in which they are added, and their traversals."""
    labels = mean.labels.tolist()
    edges = [(label, mean.m + label) for label in range(mean.m)]
    traversals = Counter((label, mean.m + label) for label in labels)
    for label, following in itertools.pairwise(labels):
        edge = (mean.m + label, following)
        if edge not in edges:
            edges.append(edge)
        traversals[edge] += 1
    return edges, dict(traversals)


def directed_counts(walks: list) -> Counter:
    """How often each pair of different nodes is travelled, pair by pair."""
    counts: Counter = Counter()
    for walk in walks:
        for (start, end), gap in zip(
            itertools.pairwise(walk.nodes.tolist()), walk.gaps.tolist(), strict=True
        ):
            if start != end and not gap:
                counts[start, end] += 1
    return counts


def random_mean(rng: np.random.Generator, *, dimension: int = 2) -> tuple[SegmentMean, Track]:
    """A track with uneven times and a segment mean with single samples and empty clusters."""
    n = int(rng.integers(1, 60))
    k = int(rng.integers(1, n + 1))
    m = int(rng.integers(1, k + 2))
    inner = np.sort(rng.choice(np.arange(1, n), k - 1, replace=False))
    boundaries = np.concatenate(([0], inner, [n])).astype(np.int64)
    starts, ends = rng.normal(0, 50, (2, m, dimension))
    times = 1.7e9 + np.cumsum(rng.uniform(0.01, 30, n))
    track = Track("t", times, rng.normal(0, 50, (n, dimension)))
    return SegmentMean(
        boundaries, rng.integers(0, m, k).astype(np.int32), starts, ends, cost=0.0
    ), track
