"""Streams make what offline makes, whatever the chunks; coresets merge; weighted samples have the moments."""

import numpy as np
import pytest

from gpszip import Coreset, CoresetStream, OptionError, Track, TrackError, coreset
from gpszip.sketches.pieces import polyline
from gpszip.sketches.samples import weighted_samples
from gpszip.sketches.stream import merge_coresets
from gpszip.testing.patrol import patrol
from oracle.coreset import exact_cost, moments

N = 20_000


def log(kind):
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


def streamed(track, size, chunk=1 << 20):
    stream = CoresetStream(size, id=track.id)
    for a in range(0, len(track), chunk):
        part = slice(a, a + chunk)
        stream.push(
            track.times[part],
            track.positions[part],
            None if track.weights is None else track.weights[part],
        )
    return stream


@pytest.mark.parametrize("kind", ["patrol", "parked", "circle", "uneven", "weights", "noise"])
@pytest.mark.parametrize("size", [30, 300])
def test_a_stream_costs_at_most_a_tenth_more_than_offline(kind, size):
    track = log(kind)
    small = streamed(track, size, 1777).coreset()
    assert len(small) <= size
    assert small.samples == len(track)
    assert small.error <= 1.1 * coreset(track, size=size).error


@pytest.mark.parametrize("chunk", [1, 2, 3, 64, 999, 5000])
def test_chunks_make_no_difference(chunk):
    track = patrol(3001, seed=2)
    whole, cut = streamed(track, 11).coreset(), streamed(track, 11, chunk).coreset()
    assert np.array_equal(whole.rows, cut.rows)


def test_memory_is_bounded_and_the_stream_goes_on_after_a_look():
    track = patrol(8000)
    stream = CoresetStream(5)
    for a in range(0, 8000, 100):
        stream.push(track.times[a : a + 100], track.positions[a : a + 100])
        assert stream.blocks <= 16 * 5
        if a % 1000 == 0:
            assert len(stream.coreset()) <= 5
    assert np.array_equal(stream.coreset().rows, streamed(track, 5).coreset().rows)


def test_a_stream_prices_like_any_coreset():
    track = patrol(4000)
    small = streamed(track, 50).coreset()
    knots = np.linspace(track.times[0], track.times[-1], 30)
    f = polyline(
        knots, np.stack([np.interp(knots, track.times, axis) for axis in track.positions.T], axis=1)
    )
    assert (
        small.cost(f).lower
        <= exact_cost(track.times, track.positions, np.ones(4000), f)
        <= small.cost(f).upper
    )


def test_bad_samples_are_refused_and_leave_the_stream_as_it_was():
    stream = CoresetStream(4)
    stream.push([0, 1], [[0.0], [1.0]])
    for times, places, weights in (
        ([2, 2], [[0.0], [1.0]], None),
        ([1], [[0.0]], None),
        ([5], [[np.nan]], None),
        ([5], [[1.0]], [0.0]),
        ([5], [[1.0, 2.0]], None),
    ):
        with pytest.raises(TrackError):
            stream.push(times, places, weights)
    stream.push([], np.empty((0, 1)))
    assert stream.coreset().samples == stream.samples == 2
    with pytest.raises(OptionError):
        CoresetStream(0)


def test_halves_merge_to_the_whole():
    track = patrol(6000)
    a, b = (
        Track("0", track.times[:2500], track.positions[:2500]),
        Track("0", track.times[2500:], track.positions[2500:]),
    )
    both = merge_coresets([streamed(b, 40).coreset(), streamed(a, 40).coreset()], size=40)
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


def test_overlapping_tracks_merge_side_by_side_but_one_track_can_not_overlap_itself():
    one, two = (
        coreset(Track(name, range(50), [[abs(t - 25)] for t in range(50)]), size=8) for name in "ab"
    )
    assert merge_coresets([one, two], size=4).tracks == ("a", "b")
    assert merge_coresets([one, two]).track("b").error == two.error
    with pytest.raises(OptionError, match="overlap at time"):
        merge_coresets([one, one])
    with pytest.raises(OptionError, match="as many blocks"):
        merge_coresets([one, two], size=1)


def test_merging_in_any_order_gives_the_same_blocks():
    parts = [
        coreset(
            Track(name, range(50), np.random.default_rng(ord(name)).normal(0, 1, (50, 1))), size=8
        )
        for name in "abc"
    ]
    left = merge_coresets([merge_coresets(parts[:2]), parts[2]])
    right = merge_coresets([parts[0], merge_coresets(parts[1:])])
    assert np.array_equal(left.rows, right.rows)


@pytest.mark.parametrize("dimension", [1, 2, 3])
@pytest.mark.parametrize("weighted", [False, True])
def test_few_points_have_the_moments_of_all(dimension, weighted):
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


def test_points_of_a_place_where_nothing_moves():
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
