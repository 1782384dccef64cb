"""Places that are left out of tracks before they are shared."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gpszip.history.stays.hide import hide_places
from gpszip.model import Track
from random_tests import examples


def a_track(rng, name="a", n=30):
    times = np.cumsum(rng.uniform(1, 50, n))
    positions = np.cumsum(rng.normal(0, 120, (n, 2)), axis=0)
    # some stops
    positions[rng.random(n) < 0.3] = positions[0]
    return Track(name, times, positions, attributes={"speed": np.arange(n)})


def fine(track, count=40):
    """Positions along a track, and their times."""
    share = np.linspace(0, 1, count)
    steps = zip(track.times[:-1], track.times[1:], strict=True)
    times = np.unique(np.concatenate([track.times, *(a + share * (b - a) for a, b in steps)]))
    return times, np.stack([np.interp(times, track.times, axis) for axis in track.positions.T], 1)


@examples(40)
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_nothing_near_a_place_is_left_and_nothing_far_is_lost(seed, sampled):
    rng = np.random.default_rng(seed)
    track = a_track(rng)
    places = track.positions[rng.integers(0, len(track), 2)]
    left, owners = hide_places([track], {}, places, rng, radius=200.0, sampled=sampled)
    assert set(owners.values()) <= {"a"}

    # The circle reaches 60 m beyond the place on all sides, whatever its centre.
    seen = np.zeros(0)
    for piece in left:
        times, line = (piece.times, piece.positions) if sampled else fine(piece)
        for place in places:
            assert np.linalg.norm(line - place, axis=1).min() >= 59.9
        expected = [np.interp(times, track.times, axis) for axis in track.positions.T]
        np.testing.assert_allclose(line, np.stack(expected, 1), atol=1e-6)
        seen = np.append(seen, piece.times)
        if sampled:
            rows = np.searchsorted(track.times, piece.times)
            np.testing.assert_array_equal(piece.attributes["speed"], rows)
    assert (np.diff(seen) > 0).all()

    # No circle reaches farther than 340 m.
    far = np.array([np.linalg.norm(places - row, axis=1).min() > 340 for row in track.positions])
    assert np.isin(track.times[far], seen).all()


def test_circles_are_not_around_places():
    lane = Track("lane", [0, 100], [[-1000, 0], [1000, 0]])
    ends = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        left, owners = hide_places([lane], {}, np.zeros((1, 2)), rng, radius=200.0)
        assert list(owners) == ["lane/0", "lane/1"]
        ends.append((left[0].positions[-1, 0], left[1].positions[0, 0]))
    middle = np.mean(ends, axis=1)
    assert np.abs(middle).max() > 80 and middle.std() > 30


def test_ends_are_those_of_each_track():
    one = Track("one", [0, 100], [[0, 0], [2000, 0]])
    other = Track("other", [0, 100], [[-1000, 0], [1000, 0]])
    left, owners = hide_places(
        [one, other], {}, np.zeros((0, 2)), np.random.default_rng(1), ends=150
    )
    assert list(owners) == ["one", "other"]
    for piece, begin, end in zip(left, (0, -1000), (2000, 1000), strict=True):
        assert begin + 44 < piece.positions[0, 0] < begin + 256
        assert end - 256 < piece.positions[-1, 0] < end - 44


def test_pieces_and_shapes():
    pieces = [
        Track("a/0", [0, 1], [[0.0, 0.0], [10.0, 0.0]]),
        Track("a/1", [5.0], [[4000.0, 0.0]]),
        Track("b", [0, 5000.0], [[0.0, 0.0], [5000.0, 0.0]], timed=False),
    ]
    owners = {"a/0": "a", "a/1": "a", "b": "b"}
    rng = np.random.default_rng(2)
    left, names = hide_places(pieces, owners, np.zeros((1, 2)), rng, radius=100.0)
    assert names == {"a": "a", "b": "b"}
    assert left[0].times.tolist() == [5.0]
    assert not left[1].timed and left[1].times[0] == 0 and left[1].times[-1] > 4800


def test_a_track_of_which_nothing_is_left_has_no_piece():
    still = Track("a", [0, 100], [[0.0, 0.0], [1.0, 0.0]])
    left, owners = hide_places(
        [still], {}, np.zeros((1, 2)), np.random.default_rng(1), radius=100.0
    )
    assert (left, owners) == ([], {})
