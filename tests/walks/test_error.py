import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import OptionError
from gpszip.model import Track, Walk
from gpszip.walks.error import measure_errors, positions_at, synchronised_errors
from oracle.decoded import position


def random_walk(seed, knots=20, dimension=2):
    rng = np.random.default_rng(seed)
    nodes = rng.normal(0, 100, (8, dimension))
    walk = Walk(
        "a",
        rng.integers(0, 8, knots).astype(np.int32),
        5 + np.cumsum(0.01 + rng.exponential(3, knots)),
        rng.random(knots - 1) < 0.3,
    )
    return nodes, walk, rng


@given(st.integers(0, 10_000), st.integers(1, 30), st.integers(1, 4))
def test_positions_match_the_plain_twin(seed, knots, dimension):
    nodes, walk, rng = random_walk(seed, knots, dimension)
    times = np.concatenate(
        [
            rng.uniform(0, walk.times[-1] + 5, 50),
            walk.times,
            walk.times + 9e-4,
            walk.times - 9e-4,
            walk.times + 1.1e-3,
        ]
    )
    positions = positions_at(walk, nodes, times)
    for t, p in zip(times, positions, strict=True):
        expected = position(walk.times, nodes[walk.nodes], walk.gaps, t)
        assert np.isnan(p).all() if expected is None else np.allclose(p, expected, atol=1e-9)


def test_query_order_does_not_matter():
    nodes, walk, rng = random_walk(1)
    times = rng.uniform(0, walk.times[-1], 10_000)
    order = np.argsort(times)
    np.testing.assert_array_equal(
        positions_at(walk, nodes, times)[order], positions_at(walk, nodes, times[order])
    )


@pytest.mark.parametrize("in_order", [True, False])
def test_many_times_about_unevenly_spaced_knots_have_the_positions_of_single_times(in_order):
    # Knots in bursts, a gap, and times on knots, between them and outside.
    rng = np.random.default_rng(4)
    knots = np.unique(np.concatenate([rng.normal(c, 1e-3, 40) for c in (0.0, 5.0, 5.1, 900.0)]))
    walk = Walk("a", np.arange(len(knots), dtype=np.int32), knots, rng.random(len(knots) - 1) < 0.1)
    nodes = rng.normal(0, 9, (len(knots), 2))
    times = np.concatenate([knots, rng.uniform(-10, 910, 2000), rng.normal(5, 0.1, 2000)])
    times = np.sort(times) if in_order else rng.permutation(times)
    together = positions_at(walk, nodes, times)
    alone = np.concatenate([positions_at(walk, nodes, times[[i]]) for i in range(len(times))])
    np.testing.assert_array_equal(together, alone)


def test_non_finite_times_have_no_position():
    nodes, walk, _ = random_walk(2)
    assert np.isnan(positions_at(walk, nodes, np.array([np.nan, np.inf, -np.inf]))).all()


def test_knots_are_hit_exactly():
    nodes, walk, _ = random_walk(3)
    np.testing.assert_array_equal(positions_at(walk, nodes, walk.times), nodes[walk.nodes])


def test_a_walk_without_times_has_no_positions():
    nodes, walk, _ = random_walk(4)
    with pytest.raises(OptionError, match="without"):
        positions_at(Walk("a", walk.nodes, None, walk.gaps), nodes, np.zeros(1))


@given(st.integers(0, 10_000))
def test_errors_and_their_summary_match_the_plain_twin(seed):
    nodes, walk, rng = random_walk(seed)
    track = Track("a", np.sort(rng.uniform(0, walk.times[-1] + 5, 40)), rng.normal(0, 100, (40, 2)))
    expected = [position(walk.times, nodes[walk.nodes], walk.gaps, t) for t in track.times]
    distances = np.array(
        [
            np.nan if e is None else np.hypot(*(p - e))
            for e, p in zip(expected, track.positions, strict=True)
        ]
    )
    np.testing.assert_allclose(synchronised_errors(track, walk, nodes), distances, atol=1e-9)
    summary = measure_errors([track, track], [walk, walk], nodes)
    assert (summary.points, summary.uncovered) == (80, 2 * int(np.isnan(distances).sum()))
    if not np.isnan(distances).all():
        assert summary.rmse == pytest.approx(np.sqrt(np.nanmean(distances**2)))
        assert summary.max_error == pytest.approx(np.nanmax(distances))


@pytest.mark.parametrize("seed", range(20))
def test_errors_of_many_tracks_are_those_of_each_alone(seed):
    rng = np.random.default_rng(seed)
    nodes = rng.normal(0, 50, (9, 2))
    tracks, walks = [], []
    for number in range(int(rng.integers(2, 7))):
        knots = int(rng.integers(1, 9))
        times, gaps = np.cumsum(rng.integers(1, 9, knots)) * 1.0, rng.random(knots - 1) < 0.3
        first, last = times[np.append(True, gaps)], times[np.append(gaps, True)]
        ranges = np.stack([first, last], axis=1) + rng.choice([0.0, 0.4], (len(first), 1)) * [1, -1]
        visited = rng.integers(0, len(nodes), knots).astype(np.int32)
        ranges = ranges if rng.random() < 0.7 else None
        walks.append(Walk(f"{number}", visited, times, gaps, ranges))
        sampled = np.unique(rng.uniform(times[0] - 1, times[-1] + 1, 20).round(1))
        tracks.append(Track(f"{number}", sampled, rng.normal(0, 50, (len(sampled), 2))))
    together = measure_errors(tracks, walks, nodes)
    alone = np.concatenate(
        [synchronised_errors(track, walk, nodes) for track, walk in zip(tracks, walks, strict=True)]
    )
    known = alone[~np.isnan(alone)]
    assert together.uncovered == np.isnan(alone).sum()
    assert together.points == len(alone)
    assert together.max_error == known.max(initial=0.0)
    assert together.rmse == pytest.approx(np.sqrt((known**2).sum() / max(len(known), 1)))
