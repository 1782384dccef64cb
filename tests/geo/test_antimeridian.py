import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gpszip.geo.antimeridian import align_antimeridian_signs, find_crossings, insert_crossings
from gpszip.geo.degree_lines import cut_at_antimeridian, lines_in_degrees
from gpszip.model import Plane

DATE_LINE = Plane(((-170000000, 1800000000),))


@given(st.lists(st.tuples(st.integers(-3, 3), st.integers(-89, 89)), min_size=1, max_size=12))
def test_lines_are_cut_at_180_degrees_and_nowhere_else(steps):
    east, lat = (np.array(column, dtype=np.float64) for column in zip(*steps, strict=True))
    lon = (east + 180.0 + 180.0) % 360.0 - 180.0  # about the antimeridian
    times = np.arange(len(steps), dtype=np.float64)
    new_times, new_lat, new_lon = insert_crossings(times, lat, lon, 1e-6)

    # the given points remain, and the line between them is the same
    assert (np.diff(new_times) > 0).all()
    assert np.isin(times, new_times).all()
    assert np.allclose(np.interp(times, new_times, new_lat), lat)
    middle = np.interp(times[:-1] + 0.37, new_times, np.degrees(np.unwrap(np.radians(new_lon))))
    straight = np.interp(
        times[:-1] + 0.37, times, np.degrees(np.unwrap(np.radians(lon), period=2 * np.pi))
    )
    assert np.allclose((middle - straight + 180) % 360 - 180, 0, atol=1e-4)

    # it ends at 180 degrees on one side and continues at 180 degrees on the other
    for step in np.flatnonzero(find_crossings(new_lon)):
        assert abs(new_lon[step]) == 180.0
        assert new_lon[step + 1] == -new_lon[step]
        assert new_lat[step + 1] == new_lat[step]


def test_points_on_the_antimeridian_get_the_sign_of_their_neighbours():
    assert align_antimeridian_signs(np.array([-180.0, -180.0, 179.0, -180.0])).tolist() == [
        180.0,
        180.0,
        179.0,
        180.0,
    ]
    assert align_antimeridian_signs(np.array([180.0, -180.0])).tolist() == [180.0, 180.0]
    lon = np.array([180.0, -180.0, 179.0])
    times, _, _ = insert_crossings(np.arange(3.0), np.zeros(3), lon, 1e-6)
    assert len(times) == 3


def test_only_lines_that_cross_are_cut():
    positions = np.array(
        [
            [-300.0, 0.0],
            [-200.0, 0.0],
            [-300.0, 50.0],
            [300.0, 50.0],
            [-300.0, 50.0],
            [300.0, 90.0],
            [400.0, 90.0],
        ]
    )
    lines = lines_in_degrees(positions, np.array([0, 2, 5, 7]), DATE_LINE, 0.1, decimals=8)
    assert lines.offsets.tolist() == [0, 2, 9, 11]
    assert lines.cuts.tolist() == [4, 7]
    assert np.abs(lines.points[[3, 4, 6, 7], 0]).tolist() == [180.0] * 4
    assert (np.sign(lines.points[:, 0]) == [1, 1, 1, 1, -1, -1, -1, 1, 1, -1, -1]).all()


def test_lines_far_from_the_antimeridian_are_unchanged():
    points = np.array([[179.0, 0.0], [178.0, 0.0], [-179.0, 0.0], [-178.0, 0.0]])
    lines = cut_at_antimeridian(points, np.array([0, 2, 4]), decimals=8)
    assert lines.points.tolist() == points.tolist()
    assert lines.offsets.tolist() == [0, 2, 4]
    assert not len(lines.cuts)


def test_a_step_that_starts_on_the_antimeridian_gets_one_more_point():
    times, lat, lon = insert_crossings(
        np.arange(3.0), np.array([1.0, 2.0, 3.0]), np.array([179.0, 180.0, -179.0]), 0.0
    )
    assert lon.tolist() == [179, 180, -180, -179]
    assert lat.tolist() == [1, 2, 2, 3]
    assert times.tolist() == [0, 1, 1, 2]
