from __future__ import annotations

import math

import numpy as np
import pytest

from gpszip.model import MarkovModel, SegmentMean, Track
from gpszip.segmentation.em import segment_mean
from gpszip.segmentation.evaluate import positions_at
from gpszip.segmentation.markov import (
    build_markov_model,
    count_transitions,
    find_likelihood,
    label_track,
)

LABELS = np.array([2, 0, 1, 0, 1, 1, 0, 2, 0], np.int32)
HEADS = np.array([0, 4, 7])


def labelled(labels=LABELS, heads=HEADS, m=3):
    points = np.zeros((m, 1))
    boundaries = np.arange(len(labels) + 1)
    return SegmentMean(boundaries, labels, points, points, 0.0, (), heads)


def pairs_of(labels, heads):
    """Each pair of labels that follow each other in a run."""
    return [
        (int(labels[j - 1]), int(labels[j])) for j in range(1, len(labels)) if j not in set(heads)
    ]


def square(laps, seed, length=12):
    corners = np.array([[0, 0], [60, 0], [60, 40], [0, 40]], dtype=float)
    u = np.linspace(0, 1, length)[:, None]
    line = [corners[j] * (1 - u) + corners[(j + 1) % 4] * u for j in range(4)]
    positions = np.concatenate(line * laps)
    noise = np.random.default_rng(seed).normal(0, 0.3, positions.shape)
    return Track("laps", np.arange(len(positions)), positions + noise)


def test_transitions_are_those_within_runs():
    pairs, counts = count_transitions(labelled())
    expected = pairs_of(LABELS, HEADS)
    assert [tuple(pair) for pair in pairs.tolist()] == sorted(set(expected))
    assert counts.tolist() == [expected.count(tuple(pair)) for pair in pairs.tolist()]


def test_probabilities_and_their_logarithms_equal_loops():
    mean = labelled()
    model = build_markov_model(mean, Track("t", np.arange(9.0), np.zeros((9, 1))))
    seen = pairs_of(LABELS, HEADS)
    totals = {a: sum(before == a for before, _ in seen) for a in range(3)}
    for (a, b), probability in zip(model.transitions.tolist(), model.probabilities, strict=True):
        assert probability == pytest.approx(seen.count((a, b)) / totals[a])

    # one passage more from each segment, spread over all
    labels, heads = np.array([1, 2, 2, 0], np.int32), np.array([0, 3])
    expected = sum(
        math.log((seen.count(pair) + 1 / 3) / (totals[pair[0]] + 1))
        for pair in pairs_of(labels, heads)
    )
    firsts = [2, 1, 2]
    expected += sum(math.log((firsts.count(int(labels[j])) + 1 / 3) / 4) for j in heads)
    assert model.firsts.tolist() == [0, 1, 2]
    assert model.log_probability(labels, heads) == pytest.approx(expected)


def test_a_model_without_transitions_has_one_outcome():
    mean = labelled(np.zeros(1, np.int32), np.zeros(1, np.int64), 1)
    model = build_markov_model(mean, Track("t", [0.0], [[0.0]]))
    assert model.log_probability(mean.labels, mean.heads) == 0.0
    assert model.sigma == 1e-3


@pytest.mark.parametrize("weighted", [False, True])
def test_the_density_of_samples_equals_a_loop(weighted):
    track = square(2, 0)
    weights = np.linspace(0.5, 2, len(track)) if weighted else np.ones(len(track))
    track = Track("t", track.times, track.positions, weights)
    mean = segment_mean(track, 8, 4)
    model = build_markov_model(mean, track)
    found = find_likelihood(model, mean, track)
    expected = 0.0
    for w, p, q in zip(weights, track.positions, positions_at(mean, track), strict=True):
        for axis in range(2):
            z = (p[axis] - q[axis]) / model.sigma
            expected -= w * (0.5 * math.log(2 * math.pi) + math.log(model.sigma) + z * z / 2)
    assert found.samples == pytest.approx(expected, rel=1e-6)
    assert found.total == found.samples + found.transitions
    assert found.per_sample == pytest.approx(found.total / len(track))
    assert model.sigma == pytest.approx(math.sqrt(mean.cost / (2 * weights.sum())))


def test_a_log_of_the_same_route_is_more_likely_than_one_of_another():
    learned = square(6, 0)
    model = build_markov_model(segment_mean(learned, 24, 4), learned)
    same, other = square(3, 1), square(3, 2, length=9)
    turned = Track("turned", other.times, other.positions[::-1])
    found = {}
    for name, track in (("same", same), ("turned", turned)):
        mean = label_track(model, track, np.zeros(1, np.int64))
        assert mean.boundaries[-1] == len(track)
        found[name] = find_likelihood(model, mean, track).per_sample
    assert found["same"] > found["turned"]
    mean = label_track(model, same, np.zeros(1, np.int64))
    assert mean.labels.tolist() == [0, 1, 2, 3] * 3
    assert mean.starts is model.starts


def test_runs_are_labelled_apart():
    track = square(2, 0)
    model = build_markov_model(segment_mean(track, 8, 4), track)
    mean = label_track(model, track, np.array([0, 48]))
    assert mean.boundaries[mean.heads].tolist() == [0, 48]
    assert mean.labels.tolist() == [0, 1, 2, 3] * 2


def test_the_repr_tells_what_counts():
    points = np.zeros((2, 1))
    model = MarkovModel(points, points, np.ones(2), np.array([[0, 1]]), np.array([3]), 0.5)
    assert repr(model) == "MarkovModel(m=2, 1 transition, sigma 0.5 m)"
