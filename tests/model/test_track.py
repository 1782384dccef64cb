from datetime import datetime

import numpy as np
import pytest

from gpszip.errors import OptionError, TrackError
from gpszip.geo.planes import choose_plane, to_plane
from gpszip.model import Track

START = 1_400_000_000.0


def gps_track(n=50):
    lat, lon = 52.5 + 1e-4 * np.arange(n), 13.4 - 1e-4 * np.arange(n)
    plane = choose_plane(lat, lon)
    times = START + 10.0 * np.arange(n)
    attributes = {"speed": np.arange(n)}
    positions = to_plane(lat, lon, plane)
    weights = 1.0 + np.arange(n)
    track = Track("walk", times, positions, weights, attributes, plane)
    return track, np.stack([lat, lon], axis=1)


def test_coordinates_are_those_of_the_log():
    track, degrees = gps_track()
    np.testing.assert_allclose(track.coordinates, degrees, atol=1e-9)
    flat = Track("robot", [0, 1], [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    np.testing.assert_array_equal(flat.coordinates, flat.positions)


def test_a_slice_of_time_holds_the_samples_from_its_begin_and_before_its_end():
    track, _ = gps_track()
    part = track[START + 10 : START + 40]
    assert (part.times - START).tolist() == [10.0, 20.0, 30.0]
    np.testing.assert_array_equal(part.positions, track.positions[1:4])
    assert part.attributes["speed"].tolist() == [1, 2, 3]
    assert part.weights.tolist() == [2.0, 3.0, 4.0]
    assert (part.id, part.plane) == (track.id, track.plane)
    joined = [*track[: START + 40].times, *track[START + 40 :].times]
    assert joined == track.times.tolist()


@pytest.mark.parametrize(
    ("begin", "end"),
    [
        ("2014-05-13T16:53:30Z", "2014-05-13T16:54:00Z"),
        (datetime(2014, 5, 13, 16, 53, 30), datetime(2014, 5, 13, 16, 54)),
        (np.datetime64("2014-05-13T16:53:30"), START + 40),
    ],
)
def test_slices_take_times_in_any_form(begin, end):
    assert len(gps_track()[0][begin:end]) == 3


@pytest.mark.parametrize(
    ("span", "says"),
    [
        (slice(0, 10), "seconds from the start of the log"),
        (slice("2013-01-01", "2013-01-02"), "2014-05-13 16:53:20 to 17:01:30 UTC"),
        (slice(START + 20, START + 10), "no sample"),
        (slice(None, None, 2), "no step"),
        (slice("soon", None), "no time"),
        (slice([1.0, 2.0], None), "not one time"),
    ],
)
def test_slices_without_samples_say_why(span, says):
    with pytest.raises(OptionError, match=says):
        gps_track()[0][span]


def test_tracks_are_not_indexed_by_number():
    with pytest.raises(TypeError, match="by time"):
        gps_track()[0][3]
    with pytest.raises(TypeError, match="by time"):
        next(iter(gps_track()[0]))


def test_a_shape_has_no_slices_of_time():
    with pytest.raises(OptionError, match="no times"):
        Track("plan", [0.0, 5.0], [[0.0], [5.0]], timed=False)[0:3]


def test_errors_say_which_sample():
    with pytest.raises(TrackError) as caught:
        Track("bus", [0, 2, 1], np.zeros((3, 2)))
    assert caught.value.location == "track 'bus': sample 2"
    assert caught.value.remedy == "sort or split the track"
    assert str(caught.value) == (
        "track 'bus': sample 2: time 1 is not later than 2; sort or split the track"
    )


@pytest.mark.parametrize("weight", [0.0, -1.0, np.nan, np.inf])
def test_weights_are_positive_and_finite(weight):
    with pytest.raises(TrackError, match="2 positive finite numbers"):
        Track("walk", [0, 1], [[0.0], [1.0]], weights=[1.0, weight])


def test_an_error_names_times_in_full():
    with pytest.raises(TrackError, match=r"time 1700000000\.5 is not later than 1700000001"):
        Track("walk", [1_700_000_001.0, 1_700_000_000.5], [[0.0], [1.0]])
