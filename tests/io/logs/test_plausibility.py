import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError
from gpszip.io.large.store import store_logs
from gpszip.io.logs.read import read_logs
from random_tests import examples

EIGHT = 1714809600.0  # 2024-05-04T08:00:00Z
EXCEL, MATLAB = 25569, 719529  # 1970-01-01


def csv(times, places, header="time,lat,lon", digits=8):
    rows = [
        f"{time},{one:.{digits}f},{other:.{digits}f}"
        for time, (one, other) in zip(times, places, strict=True)
    ]
    return "\n".join([header, *rows, ""])


def drive(count=60, step=5.0, speed=14.0):
    """Seconds and degrees of a vehicle that goes north-east through Munich."""
    seconds = np.arange(count) * step
    metres = np.cumsum(np.full((count, 2), speed * step / np.sqrt(2)), axis=0)
    return seconds, np.array([48.137, 11.575]) + metres / [111195, 74200]


def room(count=500, rng=None, size=6.0, speed=0.3, step=0.1):
    """Metres of a robot that turns about in a room."""
    rng = rng or np.random.default_rng(1)
    heading = np.cumsum(rng.normal(0, 0.3, count))
    walk = np.cumsum(speed * step * np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0)
    return np.arange(count) * step, np.abs((walk + size) % (2 * size) - size)


def read(text, **options):
    return read_logs(io.BytesIO(text.encode()), **options)


def told(reading):
    return [repair.what for repair in reading.repairs]


def test_days_of_a_spreadsheet_are_read_as_such_and_reported(tmp_path):
    seconds, places = drive()
    days = [f"{day:.8f}" for day in (EIGHT + seconds) / 86400 + EXCEL]
    reading = read(text := csv(days, places))
    np.testing.assert_allclose(reading.tracks[0].times, EIGHT + seconds, atol=1e-3)
    assert [(one.what, one.count, one.drops) for one in reading.repairs] == [
        ("times read as days from 1899-12-30, as spreadsheets count them", 60, False)
    ]
    (tmp_path / "log.csv").write_text(text)
    with store_logs(tmp_path / "log.csv", rows=1000) as log:
        assert log.read(log.tracks[0]).times.tolist() == reading.tracks[0].times.tolist()
        assert told(log.read_result) == told(reading)
    parked = read(csv(days, np.tile(places[:1], (60, 1))))
    assert parked.tracks[0].times.tolist() == reading.tracks[0].times.tolist()


def test_seconds_in_the_range_of_spreadsheets_stay_seconds():
    seconds, places = drive(step=0.5)
    assert read(csv(45416.25 + seconds, places)).tracks[0].times[1] == 45416.75
    days = (EIGHT + seconds) / 86400 + EXCEL
    assert read(csv(days, places), time_unit="s").tracks[0].times[0] == days[0]
    assert read(csv(days, places, "time [s],x,y")).tracks[0].times[0] == days[0]


def test_a_spreadsheet_with_other_numbers_far_down_is_refused(tmp_path):
    seconds, places = drive(200_000, 1.0, 0.2)
    days = (EIGHT + seconds) / 86400 + EXCEL
    days[-1] = 1.7e9
    (tmp_path / "log.csv").write_text(csv([f"{day:.8f}" for day in days], places))
    with pytest.raises(
        InputError, match=r"log.csv: row 200001: its time is no day of a spreadsheet"
    ):
        store_logs(tmp_path / "log.csv", rows=1000)


@pytest.mark.parametrize(
    ("times", "header", "remedy"),
    [
        (
            lambda seconds: (EIGHT + seconds) / 86400 + MATLAB,
            "time,lat,lon",
            "if they are MATLAB's days, say so: --time-unit matlab",
        ),
        (
            lambda seconds: seconds / 86400,
            "t,lat,lon",
            "if they are days, say so: --time-unit days",
        ),
        (lambda seconds: seconds, "time_ms,lat,lon", "if they are s, say so: --time-unit s"),
        (
            lambda seconds: EIGHT + seconds,
            "time_ms,lat,lon",
            "if they are s, say so: --time-unit s",
        ),
        (
            lambda seconds: 1000 * (EIGHT + seconds),
            "time_us,lat,lon",
            "if they are ms, say so: --time-unit ms",
        ),
    ],
)
def test_a_unit_that_makes_everybody_faster_than_an_aircraft_is_refused(times, header, remedy):
    seconds, places = drive()
    text = csv([f"{time:.9f}" for time in times(seconds)], places, header)
    with pytest.raises(InputError) as caught:
        read(text)
    assert remedy in str(caught.value)
    assert "its points move at" in str(caught.value)
    unit = str(caught.value).split("--time-unit ")[1].split(";")[0]
    assert np.ptp(read(text, time_unit=unit).tracks[0].times) == pytest.approx(295, abs=1e-3)


def test_a_log_of_a_thousandth_of_a_second_is_refused():
    _, places = drive(5)
    with pytest.raises(
        InputError,
        match=r"read as s, its times last 4e-07 s; .*--time-unit; if that is right: --time-unit s",
    ):
        read(csv(["0", "1e-7", "2e-7", "3e-7", "4e-7"], np.tile(places[:1], (5, 1))))


@pytest.mark.parametrize(
    "what", ["jitter at 1 kHz", "satellite", "aircraft", "several in one", "simulated", "dates"]
)
def test_fast_logs_are_accepted_if_no_other_unit_is_likely(what):
    rng = np.random.default_rng(4)
    seconds, places = drive(600)
    header = "t,lat,lon"
    if what == "jitter at 1 kHz":
        seconds, places = np.arange(600) / 1000, 48 + rng.normal(0, 1e-5, (600, 2))
    elif what == "satellite":
        seconds, places = (
            np.arange(600.0),
            np.stack([np.linspace(-40, 40, 600), np.linspace(0, 20, 600)], axis=1),
        )
    elif what == "aircraft":
        seconds, places = drive(600, 0.05, 300.0)
    elif what == "several in one":
        seconds, places = np.arange(600.0), 48 + rng.normal(0, 0.1, (600, 2))
    elif what == "simulated":
        seconds, places, header = np.arange(600) * 1e-6, rng.normal(0, 100, (600, 2)), "t,x,y"
    else:
        seconds = [f"2024-05-04T08:00:00.{number:06d}Z" for number in range(600)]
    assert told(read(csv(seconds, places, header))) == []


def test_x_and_y_in_degrees_are_refused_with_the_remedy(tmp_path):
    seconds, places = drive()
    text = csv(EIGHT + seconds, places[:, ::-1], "t,X,Y", 6)
    with pytest.raises(
        InputError,
        match=r"'X' and 'Y' are degrees: .* name them: --columns lon=X,lat=Y; .* --columns x=X,y=Y",
    ):
        read(text)
    (tmp_path / "log.csv").write_text(text)
    with pytest.raises(InputError, match="are degrees"):
        store_logs(tmp_path / "log.csv", rows=1000)
    assert read(text, columns="lon=X,lat=Y").geographic
    for columns in ("x=X,y=Y", "t,x,y"):
        reading = read(text, columns=columns)
        assert (reading.geographic, told(reading)) == (False, [])


def test_a_journey_far_across_the_country_is_refused_too():
    seconds, places = drive(3000, 10.0, 25.0)
    places[17] = 0
    with pytest.raises(InputError, match="are degrees"):
        read(csv(seconds, places[:, ::-1], "t,x,y", 6))


def test_three_points_in_degrees_are_refused_too():
    rows = [
        "2024-05-04T08:00:00Z,11.5750,48.1371",
        "2024-05-04T08:01:00Z,11.5850,48.1471",
        "2024-05-04T08:02:00Z,11.5950,48.1371",
    ]
    with pytest.raises(InputError, match="--columns lon=X,lat=Y"):
        read("\n".join(["t,X,Y", *rows, ""]))


def test_swapped_degrees_are_recognised():
    seconds, places = drive()
    with pytest.raises(InputError, match="--columns lon=y,lat=x"):
        read(csv(seconds, places + np.array([-80, 90]), "t,x,y", 6))


def test_what_may_be_degrees_is_reported():
    seconds, places = drive(speed=80.0)
    reading = read(csv(seconds, places[:, ::-1], "t,x,y"))
    assert told(reading) == [
        "positions read as metres, but they look like degrees; if they are, name them: "
        "--columns lon=x,lat=y"
    ]
    assert reading.lost == 0
    glacier = np.stack([3 + 1.23e-5 * np.arange(60) * 600, np.full(60, 40.0)], axis=1)
    assert len(told(read(csv(np.arange(60) * 600, glacier, "t,x,y")))) == 1


@examples(40)
@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.floats(1, 100),
    speed=st.floats(0.005, 2),
    step=st.sampled_from([0.01, 0.1, 1.0, 5.0]),
    origin=st.floats(-60, 60),
    digits=st.sampled_from([3, 4, 6, 9]),
    parked=st.booleans(),
    count=st.integers(3, 400),
)
def test_robots_in_rooms_and_yards_are_never_refused(
    seed, size, speed, step, origin, digits, parked, count
):
    rng = np.random.default_rng(seed)
    seconds, places = room(count, rng, size, speed, step)
    if parked:  # only the noise of its localisation moves it
        places = places[:1] + rng.normal(0, 0.002, places.shape)
    assert len(read(csv(seconds, origin + places, "t,x,y", digits)).tracks[0]) == count


@pytest.mark.parametrize("radius", [0.0005, 0.002, 0.01, 0.5, 50])
@pytest.mark.parametrize("turn", [0.1, 1.0])
def test_circles_of_any_size_are_metres(radius, turn):
    angle = turn * np.arange(400) * 0.1
    circle = np.array([3.0, 4.0]) + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    assert len(read(csv(np.arange(400) * 0.1, circle, "t,x,y")).tracks[0]) == 400
