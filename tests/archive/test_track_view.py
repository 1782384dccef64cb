import numpy as np
import pytest

from gpszip.errors import OptionError
from oracle.random_archives import random_archive


@pytest.fixture(scope="module")
def archive():
    return random_archive(gaps=0.2)


def test_a_view_answers_as_the_archive_does(archive):
    view, walk = archive["walk 1"], archive.walks[1]
    assert (view.start, view.end) == (walk.times[0], walk.times[-1])
    assert view.timed
    np.testing.assert_array_equal(view.walk.nodes, walk.nodes)
    np.testing.assert_array_equal(view.position(walk.times), archive.position("walk 1", walk.times))
    assert [piece.id for piece in view.pieces] == [
        name for name, track in archive.pieces.items() if track == "walk 1"
    ]
    sampled, expected = view.sample(10.0), archive.sample(10.0, track="walk 1")
    assert [piece.times.tolist() for piece in sampled] == [
        piece.times.tolist() for piece in expected
    ]
    np.testing.assert_array_equal(view.waypoints.nodes, archive.waypoints("walk 1").nodes)
    assert repr(view) == (
        f"TrackView('walk 1', {len(view.pieces)} pieces, 2014-05-13 16:53:28 to 17:03:23 UTC)"
    )


def test_a_slice_of_time_is_what_lies_in_it(archive):
    view = archive["walk 0"]
    begin, end = view.start + 50.3, view.end - 50.7
    cut = view[begin:end]
    assert all(begin <= piece.times[0] and piece.times[-1] <= end for piece in cut)
    times = np.linspace(view.start, view.end, 3000)
    inside = [
        (times >= piece.times[0]) & (times <= piece.times[-1]) for piece in cut if len(piece) > 1
    ]
    claimed = ~np.isnan(view.position(times)[:, 0])
    np.testing.assert_array_equal(
        np.any(inside, axis=0), claimed & (times >= begin) & (times <= end)
    )
    for piece in cut:
        np.testing.assert_allclose(view.position(piece.times), piece.positions, atol=1e-6)
    assert view[:] and len(view[:]) == len(view.pieces)
    assert view[view.end + 10 :] == []


def test_a_view_of_a_shape_has_no_times():
    view = random_archive(timed=False)["walk 0"]
    assert (view.timed, view.start, view.end) == (False, None, None)
    assert "no times" in repr(view)
    with pytest.raises(OptionError, match="no times"):
        view[0:10]
