import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gpszip.geo.linear_in_degrees import densify_for_degrees
from gpszip.geo.planes import to_geographic, to_plane
from gpszip.model import Plane
from gpszip.testing.city import city


def plane_at(lat, lon=11.5):
    return Plane(((round(lat * 1e7), round(lon * 1e7)),))


def deviation(line, plane, found, instants):
    """Metres between a line and what is read from columns in degrees, at most."""
    times, positions = line
    when, lat, lon = found
    east = np.degrees(np.unwrap(np.radians(lon)))
    read = to_plane(np.interp(instants, when, lat), np.interp(instants, when, east), plane)
    true = np.stack([np.interp(instants, times, axis) for axis in positions.T], axis=1)
    return np.hypot(*(read - true).T).max()


@settings(max_examples=60, deadline=None)
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
def test_columns_in_degrees_stay_near_the_line(lat, places, within, seed):
    plane, rng = plane_at(lat), np.random.default_rng(seed)
    times, positions = (
        np.cumsum(rng.uniform(60, 4000, len(places))),
        np.array(places, dtype=np.float64),
    )
    found = densify_for_degrees(times, positions, plane, within, decimals=8, time_decimals=6)
    assert (np.diff(found[0]) > 0).all()
    assert np.isin(np.round(times, 6), found[0]).all()
    assert (
        deviation((times, positions), plane, found, rng.uniform(times[0], times[-1], 5000))
        <= within
    )


def test_without_more_points_a_long_leg_would_be_a_kilometre_off():
    plane, line = (
        plane_at(48.0),
        (np.array([0.0, 1200.0]), np.array([[-112_000.0, 0.0], [112_000.0, 0.0]])),
    )
    ends = (line[0], *to_geographic(line[1], plane))
    assert deviation(line, plane, ends, np.linspace(0, 1200, 100)) > 1000
    found = densify_for_degrees(*line, plane, 0.02, decimals=8, time_decimals=6)
    assert deviation(line, plane, found, np.linspace(0, 1200, 10_000)) <= 0.02
    assert len(found[0]) < 300


def test_a_town_needs_no_more_points():
    for times, degrees in city(vehicles=3, duration=900.0).values():
        plane = plane_at(*degrees[0])
        positions = to_plane(*degrees.T, plane)
        found = densify_for_degrees(times, positions, plane, 0.02, decimals=8, time_decimals=6)
        assert found[0].tolist() == times.tolist()
        assert np.allclose(found[1:], degrees.T, atol=1e-8, rtol=0)


def test_steps_that_are_no_part_of_a_line_are_left_alone():
    plane = Plane(((480000000, 115000000), (480000000, 215000000)))
    positions = np.array(
        [[0.0, 0.0], [90_000.0, 0.0], [Plane.SPREAD, 0.0], [Plane.SPREAD + 10.0, 0.0]]
    )
    times = np.arange(4.0)
    when, _, _ = densify_for_degrees(times, positions, plane, 1.0, decimals=8, time_decimals=6)
    assert ((when > 0) & (when < 1)).any()
    assert not ((when > 1) & (when < 2)).any()
    apart = np.array([True, False, False])
    assert (
        len(
            densify_for_degrees(
                times, positions, plane, 1.0, decimals=8, time_decimals=6, skipped=apart
            )[0]
        )
        == 4
    )


def test_a_single_point_and_one_that_stands_still():
    plane = plane_at(48.0)
    assert (
        len(
            densify_for_degrees(
                np.array([5.0]), np.zeros((1, 2)), plane, 0.01, decimals=8, time_decimals=6
            )[0]
        )
        == 1
    )
    assert (
        len(
            densify_for_degrees(
                np.array([5.0, 9.0]), np.zeros((2, 2)), plane, 0.01, decimals=8, time_decimals=6
            )[0]
        )
        == 2
    )


def test_a_leg_too_short_in_time_for_more_points_ends():
    plane, positions = plane_at(48.0), np.array([[0.0, 0.0], [200_000.0, 0.0]])
    when, _, _ = densify_for_degrees(
        np.array([0.0, 5e-6]), positions, plane, 0.01, decimals=8, time_decimals=6
    )
    assert (np.diff(when) > 0).all()
    assert len(when) <= 6
