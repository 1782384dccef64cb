import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gpszip.geo.linear_in_degrees import densify_for_degrees
from gpszip.geo.planes import to_geographic, to_plane
from gpszip.model import Plane
from gpszip.testing.city import city
from random_tests import examples


def plane_at(lat, lon=11.5):
    return Plane(((round(lat * 1e7), round(lon * 1e7)),))


def deviation(line, plane, columns, query_times):
    """Largest distance in metres between a line and its columns in degrees at some times."""
    times, positions = line
    column_times, lat, lon = columns
    unwrapped = np.degrees(np.unwrap(np.radians(lon)))
    interpolated = to_plane(
        np.interp(query_times, column_times, lat),
        np.interp(query_times, column_times, unwrapped),
        plane,
    )
    expected = np.stack([np.interp(query_times, times, axis) for axis in positions.T], axis=1)
    return np.hypot(*(interpolated - expected).T).max()


@examples(60)
@given(
    st.sampled_from([0.0, 48.0, -65.0, 80.0, -80.0, 89.5, 90.0]),
    st.lists(
        st.tuples(st.integers(-280_000, 280_000), st.integers(-280_000, 280_000)),
        min_size=2,
        max_size=5,
    ),
    st.sampled_from([0.01, 0.5, 20.0]),
    st.integers(0, 2**32 - 1),
)
def test_densified_lines_stay_within_the_tolerance(lat, points, max_deviation, seed):
    plane, rng = plane_at(lat), np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(60, 4000, len(points)))
    positions = np.array(points, dtype=np.float64)
    columns = densify_for_degrees(
        times, positions, plane, max_deviation, decimals=8, time_decimals=6
    )
    assert (np.diff(columns[0]) > 0).all()
    assert np.isin(np.round(times, 6), columns[0]).all()
    query_times = rng.uniform(times[0], times[-1], 5000)
    assert deviation((times, positions), plane, columns, query_times) <= max_deviation


def test_a_long_segment_without_extra_points_deviates_by_a_kilometre():
    plane = plane_at(48.0)
    line = (np.array([0.0, 1200.0]), np.array([[-112_000.0, 0.0], [112_000.0, 0.0]]))
    ends = (line[0], *to_geographic(line[1], plane))
    assert deviation(line, plane, ends, np.linspace(0, 1200, 100)) > 1000
    columns = densify_for_degrees(*line, plane, 0.02, decimals=8, time_decimals=6)
    assert deviation(line, plane, columns, np.linspace(0, 1200, 10_000)) <= 0.02
    assert len(columns[0]) < 300


def test_tracks_in_a_town_need_no_extra_points():
    for times, degrees in city(vehicles=3, duration=900.0).values():
        plane = plane_at(*degrees[0])
        positions = to_plane(*degrees.T, plane)
        columns = densify_for_degrees(times, positions, plane, 0.02, decimals=8, time_decimals=6)
        assert columns[0].tolist() == times.tolist()
        assert np.allclose(columns[1:], degrees.T, atol=1e-8, rtol=0)


def test_skipped_steps_and_changes_of_plane_get_no_points():
    plane = Plane(((480000000, 115000000), (480000000, 215000000)))
    positions = np.array(
        [[0.0, 0.0], [90_000.0, 0.0], [Plane.SPREAD, 0.0], [Plane.SPREAD + 10.0, 0.0]]
    )
    times = np.arange(4.0)
    dense, _, _ = densify_for_degrees(times, positions, plane, 1.0, decimals=8, time_decimals=6)
    assert ((dense > 0) & (dense < 1)).any()
    assert not ((dense > 1) & (dense < 2)).any()
    skipped = np.array([True, False, False])
    dense, _, _ = densify_for_degrees(
        times, positions, plane, 1.0, decimals=8, time_decimals=6, skipped=skipped
    )
    assert len(dense) == 4


def test_a_single_point_and_a_stationary_one_need_no_extra_points():
    plane = plane_at(48.0)
    for times in (np.array([5.0]), np.array([5.0, 9.0])):
        positions = np.zeros((len(times), 2))
        dense, _, _ = densify_for_degrees(
            times, positions, plane, 0.01, decimals=8, time_decimals=6
        )
        assert dense.tolist() == times.tolist()


def test_a_segment_too_short_in_time_is_not_split_forever():
    plane, positions = plane_at(48.0), np.array([[0.0, 0.0], [200_000.0, 0.0]])
    times, _, _ = densify_for_degrees(
        np.array([0.0, 5e-6]), positions, plane, 0.01, decimals=8, time_decimals=6
    )
    assert (np.diff(times) > 0).all()
    assert len(times) <= 6
