"""Streamed and merged coresets, and weighted samples with the moments of blocks."""

import numpy as np
import pytest

from gpszip import Coreset, CoresetStream, OptionError, Track, TrackError, coreset
from gpszip.sketches.pieces import polyline
from gpszip.sketches.samples import weighted_samples
from gpszip.sketches.stream import merge_coresets
from gpszip.testing.patrol import patrol
from oracle.coreset import exact_cost, moments

N = 20_000


def random_log(kind):
    rng = np.random.default_rng(5)
    t = np.arange(float(N))
    if kind == "patrol":
        return patrol(N)
    if kind == "parked":
        drive = np.where((np.arange(N) // 3000) % 2 == 0, 1.0, 0.0)[:, None] * [[10, 1]]
        return Track("0", t, np.cumsum(drive, axis=0) + rng.normal(0, 3, (N, 2)))
    if kind == "circle":
        return Track(
            "0",
            t / 10,
            100 * np.stack([np.cos(t / 500), np.sin(t / 500)], axis=1) + rng.normal(0, 0.1, (N, 2)),
        )
    if kind == "uneven":
        return Track(
            "0",
            np.cumsum(rng.exponential(30, N) + 1),
            np.cumsum(np.cumsum(rng.normal(0, 0.05, (N, 3)), axis=0), axis=0),
        )
    if kind == "weights":
        return Track("0", t, np.cumsum(rng.normal(0, 1, (N, 1)), axis=0), rng.uniform(0.1, 5, N))
    return Track("0", t, rng.normal(0, 1, (N, 2)))


def stream_of(track, size, chunk=1 << 20):
    stream = CoresetStream(size, id=track.id)
    for a in range(0, len(track), chunk):
        rows = slice(a, a + chunk)
        stream.push(
            track.times[rows],
            track.positions[rows],
            None if track.weights is None else track.weights[rows],
        )
    return stream


@pytest.mark.parametrize("kind", ["patrol", "parked", "circle", "uneven", "weights", "noise"])
@pytest.mark.parametrize("size", [30, 300])
def test_a_streamed_coreset_costs_at_most_a_tenth_more(kind, size):
    track = random_log(kind)
    small = stream_of(track, size, 1777).coreset()
    assert len(small) <= size
    assert small.samples == len(track)
    assert small.error <= 1.1 * coreset(track, size=size).error


@pytest.mark.parametrize("chunk", [1, 2, 3, 64, 999, 5000])
def test_the_result_does_not_depend_on_the_chunks(chunk):
    track = patrol(3001, seed=2)
    at_once, in_chunks = stream_of(track, 11).coreset(), stream_of(track, 11, chunk).coreset()
    assert np.array_equal(at_once.rows, in_chunks.rows)


def test_memory_is_bounded_and_coresets_can_be_taken_in_between():
    track = patrol(8000)
    stream = CoresetStream(5)
    for a in range(0, 8000, 100):
        stream.push(track.times[a : a + 100], track.positions[a : a + 100])
        assert stream.blocks <= 16 * 5
        if a % 1000 == 0:
            assert len(stream.coreset()) <= 5
    assert np.array_equal(stream.coreset().rows, stream_of(track, 5).coreset().rows)


def test_the_bounds_hold_for_a_streamed_coreset():
    track = patrol(4000)
    small = stream_of(track, 50).coreset()
    knots = np.linspace(track.times[0], track.times[-1], 30)
    f = polyline(
        knots, np.stack([np.interp(knots, track.times, axis) for axis in track.positions.T], axis=1)
    )
    assert (
        small.cost(f).lower
        <= exact_cost(track.times, track.positions, np.ones(4000), f)
        <= small.cost(f).upper
    )


def test_invalid_samples_are_refused_and_not_added():
    stream = CoresetStream(4)
    stream.push([0, 1], [[0.0], [1.0]])
    for times, positions, weights in (
        ([2, 2], [[0.0], [1.0]], None),
        ([1], [[0.0]], None),
        ([5], [[np.nan]], None),
        ([5], [[1.0]], [0.0]),
        ([5], [[1.0, 2.0]], None),
    ):
        with pytest.raises(TrackError):
            stream.push(times, positions, weights)
    stream.push([], np.empty((0, 1)))
    assert stream.coreset().samples == stream.samples == 2
    with pytest.raises(OptionError):
        CoresetStream(0)


def test_errors_of_slices_name_times_in_full():
    times = 1700000000.25 + np.arange(50)
    stream = CoresetStream(4)
    stream.push(times, np.zeros((50, 1)))
    with pytest.raises(TrackError, match=r"time 1700000007\.25 is not later"):
        stream.push([times[7]], [[0.0]])
    one = stream.coreset()
    with pytest.raises(OptionError, match=r"overlap at time 1700000000\.25"):
        merge_coresets([one, one])


def test_coresets_of_two_slices_merge_to_one_track():
    track = patrol(6000)
    a = Track("0", track.times[:2500], track.positions[:2500])
    b = Track("0", track.times[2500:], track.positions[2500:])
    both = merge_coresets([stream_of(b, 40).coreset(), stream_of(a, 40).coreset()], size=40)
    assert both.samples == 6000
    assert len(both) <= 40
    assert (np.diff(both.edges.ravel()) > 0).all()
    assert both.error <= 1.5 * coreset(track, size=40).error
    f = polyline(track.times[[0, 3000, 5999]], track.positions[[0, 3000, 5999]])
    assert (
        both.cost(f).lower
        <= exact_cost(track.times, track.positions, np.ones(6000), f)
        <= both.cost(f).upper
    )


def test_different_tracks_may_overlap_in_time_but_slices_of_one_may_not():
    a, b = (
        coreset(Track(name, range(50), [[abs(t - 25)] for t in range(50)]), size=8) for name in "ab"
    )
    assert merge_coresets([a, b], size=4).tracks == ("a", "b")
    assert merge_coresets([a, b]).track("b").error == b.error
    with pytest.raises(OptionError, match="overlap at time"):
        merge_coresets([a, a])
    with pytest.raises(OptionError, match="as many blocks"):
        merge_coresets([a, b], size=1)


def test_merging_is_associative():
    coresets = [
        coreset(
            Track(name, range(50), np.random.default_rng(ord(name)).normal(0, 1, (50, 1))), size=8
        )
        for name in "abc"
    ]
    left = merge_coresets([merge_coresets(coresets[:2]), coresets[2]])
    right = merge_coresets([coresets[0], merge_coresets(coresets[1:])])
    assert np.array_equal(left.rows, right.rows)


@pytest.mark.parametrize("dimension", [1, 2, 3])
@pytest.mark.parametrize("weighted", [False, True])
def test_weighted_samples_keep_the_moments(dimension, weighted):
    rng = np.random.default_rng(dimension)
    n = 4000
    times = 1.7e9 + np.cumsum(rng.exponential(1, n))
    track = Track(
        "0",
        times,
        5e6 + np.cumsum(rng.normal(0, 1, (n, dimension)), axis=0),
        rng.uniform(0.5, 2, n) if weighted else None,
    )
    small = coreset(track, size=9)
    (few,) = weighted_samples(small, track)
    cuts = np.concatenate([[0], np.cumsum(small.counts)])
    where = np.searchsorted(track.times, few.times)
    assert np.array_equal(track.times[where], few.times)
    assert np.array_equal(track.positions[where], few.positions)
    weights = np.ones(n) if track.weights is None else track.weights
    new = np.zeros(n)
    new[where] = few.weights
    for a, b in zip(cuts[:-1], cuts[1:], strict=True):
        assert (new[a:b] > 0).sum() <= 2 * dimension + 4
        columns = moments(track.times[a:b], track.positions[a:b], weights[a:b])
        scale = weights[a:b] @ np.abs(columns)
        assert (np.abs((new[a:b] - weights[a:b]) @ columns) <= 1e-12 * scale).all()


def test_weighted_samples_of_a_stationary_track():
    track = Track("0", range(500), np.full((500, 2), 7.0))
    (few,) = weighted_samples(coreset(track, size=1), track)
    assert len(few) <= 8
    assert few.weights.sum() == pytest.approx(500)
    with pytest.raises(OptionError, match="not of this track"):
        weighted_samples(coreset(track, size=1), Track("0", range(499), np.full((499, 2), 7.0)))


def test_the_coreset_is_frozen():
    small = coreset(patrol(500), size=3)
    assert isinstance(small, Coreset)
    with pytest.raises(ValueError, match="read-only"):
        small.rows[0, 0] = 1
