"""Lines of streams become rows."""

import json

import numpy as np
import pytest

from gpszip.errors import InputError, OptionError
from gpszip.io.logs.raw import Request
from gpszip.live.stream.rows import StreamReader


def lines(text):
    return text.encode().splitlines(keepends=True)


def read(*batches, request=None, **options):
    """Rows of each batch of text."""
    reader = StreamReader("robot", request or Request(), **options)
    return [reader.read(lines(batch)) for batch in batches]


def times(rows, track="0"):
    return rows.tracks[track][0].tolist() if track in rows.tracks else []


def test_the_header_holds_for_all_batches():
    first, second, third = read("# a robot\nx,t,y\n", "1,0,2\n", "3,1,4\n5,2,6\n")
    assert (len(first), times(second), times(third)) == (0, [0.0], [1.0, 2.0])
    assert third.tracks["0"][1].tolist() == [[3.0, 4.0], [5.0, 6.0]]


def test_columns_without_a_header_are_named():
    first, second = read("0,1,2\n", "1,3,4\n", request=Request(columns=("t", "x", "y")))
    assert times(first) + times(second) == [0.0, 1.0]


def test_the_unit_of_time_of_the_first_rows_holds_for_all():
    first, second = read("time,lat,lon\n1700000000000,48,11\n", "5,48,11\n")
    assert (times(first), times(second)) == ([1.7e9], [0.005])


def test_the_order_of_dates_of_the_first_rows_holds_for_all():
    first, second = read("time,lat,lon\n31/01/2024 10:00:00,48,11\n", "03/02/2024 10:00:00,48,11\n")
    assert times(second)[0] - times(first)[0] == 3 * 86_400


def test_rows_that_cannot_be_used_are_counted_with_their_lines():
    [_, rows] = read("t,x,y\n0,0,0\n", "1,1,1\nbroken\n2,,2\nt,x,y\n3,3,3\n4,4,4\n5,5,5\n")
    assert times(rows) == [1.0, 3.0, 4.0, 5.0]
    assert {repair.what: repair.count for repair in rows.repairs} == {
        "rows with too many or too few cells dropped": 1,
        "rows without a time dropped": 1,
        "rows without a position dropped": 1,
    }


def test_a_batch_of_nothing_but_trouble_is_counted():
    text = "".join(f"oops,{n},1\n" for n in range(5)) + "7,1,1\n"
    [_, rows] = read("t,x,y\n0,0,0\n", text)
    assert times(rows) == [7.0]
    assert sum(repair.count for repair in rows.repairs) == 5


def test_an_open_quote_costs_its_own_line_only():
    [_, rows] = read("t,x,y\n0,0,0\n", '1,1,1\n"2,2,2\n3,3,3\n4,4,4\n')
    assert times(rows) == [1.0, 3.0, 4.0]
    assert [repair.count for repair in rows.repairs] == [1]


def test_tracks_of_a_batch_keep_their_order():
    [rows] = read("id,t,x,y\nb,1,1,0\na,1,2,0\nb,2,3,0\n")
    assert {name: values[1][:, 0].tolist() for name, values in rows.tracks.items()} == {
        "b": [1.0, 3.0],
        "a": [2.0],
    }


def test_positions_off_the_globe_do_not_end_the_stream():
    [rows] = read("t,lat,lon\n0,48,11\n1,248,11\n2,48,11\n")
    assert times(rows) == [0.0, 2.0]
    assert [repair.what for repair in rows.repairs] == ["rows off the globe dropped"]


def test_objects_have_columns():
    objects = [
        {"id": "a", "time": 1.0, "x": 1.0, "y": 2.0},
        {"id": "a", "time": 2.0, "x": 1.0, "y": 2.0, "z": 3.0},
        {"id": "a", "time": 3.0},
        {"id": "a", "time": 4.0, "x": 3.0, "y": 4.0},
    ]
    [rows] = read("".join(json.dumps(each) + "\n" for each in objects) + "{broken\n")
    assert times(rows, "a") == [1.0, 4.0]
    assert sum(repair.count for repair in rows.repairs) == 3


def test_a_receiver_may_have_no_position_at_first():
    void = "$GPRMC,000000.5,V,,,,,,,230394,,,N*47\r\n"
    fixed = "$GPRMC,000001.5,A,4807.038,N,01131.000,E,022.4,084.4,230394,,*06\r\n"
    first, second = read(void, fixed)
    assert len(first) == 0
    assert np.round(second.tracks["0"][1], 4).tolist() == [[48.1173, 11.5167]]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (b"\x1f\x8b\x08\x00", "is compressed"),
        (b"<gpx></gpx>\n", "is gpx, which can't be read line by line"),
        ("t,x,y\n0,1,2\n".encode("utf-16"), "UTF-16"),
        (b"a,b,c\n1,2,3\n", "no time and no position"),
    ],
)
def test_streams_that_cannot_be_read_are_refused(text, reason):
    with pytest.raises(InputError, match=reason):
        StreamReader("robot", Request()).read(text.splitlines(keepends=True))


def test_options_of_other_formats_are_refused():
    with pytest.raises(OptionError, match="--rate is not for csv"):
        StreamReader("robot", Request(rate=10.0)).read(lines("t,x,y\n0,0,0\n"))
