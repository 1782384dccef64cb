import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gpszip
from gpszip.errors import OptionError
from gpszip.geo.planes import choose_plane, reproject_track, to_plane
from gpszip.model import Track
from gpszip.pipeline.diff import Curve, Side, diff, side_of_archive, side_of_log
from random_tests import examples


def walk(id="walk", n=40, seed=0, shift=(0.0, 0.0)):
    rng = np.random.default_rng(seed)
    positions = np.cumsum(rng.normal(size=(n, 2)), axis=0) + shift
    return Track(id, np.arange(float(n)), positions)


def coarse(tracks, error):
    return gpszip.compress(tracks, max_error=error, effort=1)


def test_log_against_archive_is_what_compress_measures():
    tracks = [walk("a", seed=1), walk("b", seed=2)]
    archive = coarse(tracks, 2.0)
    found = gpszip.diff(archive, tracks)
    assert [track.compared_at for track in found.tracks] == ["samples", "samples"]
    assert found.total.rmse == pytest.approx(archive.report.rmse)
    assert found.total.maximum == pytest.approx(archive.report.max_error)
    assert found.total.compared == 80
    assert found.missing == ((), ())
    # The other way around, only the sides change.
    back = gpszip.diff(tracks, archive)
    assert back.total.rmse == pytest.approx(found.total.rmse)
    assert back.tracks[0].lengths == found.tracks[0].lengths[::-1]


def knots(seed, n, shift):
    """A walk as a side, with knots at any times from 0 to 39."""
    rng = np.random.default_rng(seed)
    times = np.array([0.0, *np.sort(rng.uniform(0, 39, n)), 39.0])
    positions = np.cumsum(rng.normal(size=(n + 2, 2)), axis=0) + shift
    curve = Curve("walk", times, positions, np.zeros(n + 1, np.bool_), timed=True)
    return Side({"walk": curve}, None, 2, sampled=False)


@examples(30)
@given(st.integers(0, 10_000), st.integers(0, 40), st.integers(0, 40))
def test_archives_are_compared_over_all_time(seed, n, m):
    first, second = knots(seed, n, 0.0), knots(seed + 1, m, 0.5)
    assert_over_all_time(
        first, second, first.curves["walk"].at(TIMES) - second.curves["walk"].at(TIMES)
    )


def test_walks_of_archives_are_compared_over_all_time():
    first, second = coarse(walk(), 3.0), coarse(walk(shift=(0.5, 0)), 0.5)
    difference = first.position("walk", TIMES) - second.position("walk", TIMES)
    assert_over_all_time(side_of_archive(first), side_of_archive(second), difference)


#: The plain twin: many times, each counting alike.
TIMES = np.linspace(0.001, 38.999, 50_001)


def assert_over_all_time(first, second, difference):
    found = diff(first, second).tracks[0]
    far = np.linalg.norm(difference, axis=1)
    assert found.compared_at == "knots"
    assert found.distances.mean == pytest.approx(far.mean(), rel=5e-3)
    assert found.distances.rmse == pytest.approx(np.sqrt((far**2).mean()), rel=5e-3)
    assert found.distances.percentile_95 == pytest.approx(np.quantile(far, 0.95), rel=5e-3)
    assert far.max() - 1e-9 <= found.distances.maximum
    assert found.distances.maximum <= far.max() * 1.02


def test_a_constant_distance_has_one_value():
    first, second = coarse(walk(), 0.01), coarse(walk(shift=(3.0, 4.0)), 0.01)
    total = gpszip.diff(first, second).total
    values = (total.mean, total.rmse, total.percentile_95, total.maximum)
    assert values == pytest.approx([5.0] * 4, abs=0.03)


def test_logs_are_compared_at_the_times_of_both_where_both_travel():
    first = Track("a", [0, 2, 4, 100, 102], [[0.0, 0], [2, 0], [4, 0], [100, 0], [102, 0]])
    second = Track("a", [1, 3, 50, 101], [[1.0, 1], [3, 2], [50, 0], [101, 0]])
    found = diff(side_of_log([first], 20.0), side_of_log([second], 50.5)).tracks[0]
    # 1 to 4, and nothing in the gap of the first from 4 to 100; the second travels from 3 to 50.
    assert found.compared_at == "times"
    assert found.distances.compared == 4 + 1
    assert found.distances.maximum == pytest.approx(2.0)
    assert found.at == 3.0
    assert found.durations == (6.0, 49.0)
    assert found.alone[0] == ((0.0, 1.0), (100.0, 102.0))
    assert found.alone[1] == ((4.0, 50.0),)
    assert found.unmatched == (2 + 1, 1)


def test_tracks_of_one_alone_and_worst_places():
    first = [walk("a"), Track("b", range(5), np.zeros((5, 2)))]
    away = [0.0, 1.0, 0.0, 3.0, 2.0]
    second = [Track("b", range(5), [[0.0, y] for y in away]), walk("c")]
    found = gpszip.diff(first, second, worst=3)
    assert found.missing == (("c",), ("a",))
    assert [track.id for track in found.tracks] == ["b"]
    assert [(place.time, place.distance) for place in found.worst] == [(3.0, 3.0), (1.0, 1.0)]
    assert (found.worst[0].first, found.worst[0].second) == ((0.0, 0.0), (0.0, 3.0))


def test_shapes_are_compared_as_lines():
    shape = Track("s", [0, 5], [[0.0, 0], [5, 0]], timed=False)
    moved = Track("s", [0, 5], [[0.0, 2], [5, 2]], timed=False)
    found = gpszip.diff(shape, moved)
    track = found.tracks[0]
    assert (track.compared_at, track.at, track.distances.compared) == (None, None, 0)
    assert track.frechet == pytest.approx(2.0, abs=1e-3)
    assert found.worst == ()


def test_degrees_on_other_planes_are_compared_on_the_first():
    near, far = choose_plane([52.5], [13.4]), choose_plane([52.6], [13.9])
    track = Track("a", [0, 1], to_plane([52.5, 52.51], [13.4, 13.41], near), plane=near)
    total = gpszip.diff(track, reproject_track(track, far)).total
    assert total.maximum < 1e-3


def test_metres_and_degrees_are_refused():
    plane = choose_plane([52.5], [13.4])
    with pytest.raises(OptionError, match="first is in"):
        gpszip.diff(walk(), Track("walk", [0.0], [[0.0, 0.0]], plane=plane))


def test_no_tracks_are_refused():
    with pytest.raises(OptionError, match="no tracks"):
        gpszip.diff([], walk())
