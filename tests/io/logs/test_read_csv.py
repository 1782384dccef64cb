import gzip
import io

import numpy as np
import pytest

from gpszip.errors import InputError, OptionError, UnknownFormatError
from gpszip.io.logs.read import read_logs


def read(text, **options):
    data = text if isinstance(text, bytes) else text.encode()
    return read_logs(io.BytesIO(data), **options)


def only(text, **options):
    (track,) = read(text, **options).tracks
    return track


@pytest.mark.parametrize(
    "text",
    [
        "t,x,y\n0,1,2\n1.5,3,4\n",
        "T,X,Y\r\n0,1,2\r\n1.5,3,4\r\n",
        "\ufefft;x;y\n0;1;2\n1.5;3;4\n",
        "y\tTime (s)\tx\n2\t0\t1\n4\t1.5\t3\n",
        "timestamp, east, north\n0, 1, 2\n1.5, 3, 4",
        "t;x;y\n0;1,0;2,0\n1,5;3,0;4,0\n",
        "# made by hand\n# t x y\n0 1 2\n1.5 3 4\n",
        "\n\nt,x,y\n0,1,2\n\n1.5,3,4\n\n",
        "position.x,position.y,header.stamp\n1,2,0\n3,4,1.5\n",
        "time_ms,x_m,y_m\n0,1,2\n1500,3,4\n",
        't,x,y,note\n0,1,2,"a, b"\n1.5,3,4,"line\nbreak"\n',
        "t,x,y\r0,1,2\r1.5,3,4\r",
        '"t","x","y"\n"0","1","2"\n"1.5","3","4"\n',
        "t,x,y\n0,1,2\n1.5,3,4\n".encode("utf-16"),
    ],
)
def test_one_log_in_many_dialects(text):
    track = only(text)
    assert track.id == "0"
    assert track.times.tolist() == [0.0, 1.5]
    assert track.positions.tolist() == [[1, 2], [3, 4]]
    assert track.plane is None


def test_ids_come_back_verbatim_in_the_order_of_their_first_row():
    ids = [
        "000",
        "1399383849620000002",
        " spaced  out ",
        "Zürich/東京",
        'quo"ted',
        "a,b",
        "1e5",
        "NaN",
        "",
        "-0",
    ]
    cells = ['"' + name.replace('"', '""') + '"' for name in ids]
    text = "track_id,t,x,y\n" + "".join(f"{cell},{t},{t},0\n" for t in range(2) for cell in cells)
    reading = read(text)
    assert [track.id for track in reading.tracks] == ids
    assert all(track.times.tolist() == [0, 1] for track in reading.tracks)
    assert reading.points == reading.kept == 20


def test_x_y_z_is_three_dimensional_but_alt_is_an_attribute():
    assert only("t,x,y,z\n0,1,2,3\n").positions.tolist() == [[1, 2, 3]]
    text = "t,lat,lon,alt,speed\n0,1,2,300,7\n1,1,2,301,8\n"
    reading = read(text)
    assert reading.dropped_columns == ("alt", "speed")
    assert reading.geographic
    assert reading.tracks[0].positions.shape == (2, 2)
    kept = read(text, keep=["alt"])
    assert kept.dropped_columns == ("speed",)
    assert kept.tracks[0].attributes["alt"].tolist() == [300, 301]


def test_alt_may_be_called_elevation_in_the_file():
    assert only("t,lat,lon,Elevation\n0,1,2,300\n", keep=("alt",)).attributes["alt"].tolist() == [
        300
    ]


def test_text_is_kept_as_text():
    assert only("t,x,y,gear\n0,1,2,first\n1,2,3,second\n", keep=["gear"]).attributes[
        "gear"
    ].tolist() == ["first", "second"]


@pytest.mark.parametrize(
    ("cells", "expected"),
    [
        (["1700000000.077", "1700000000.154"], [1700000000.077, 1700000000.154]),
        (["1700000000077", "1700000000154"], [1700000000.077, 1700000000.154]),
        (["1700000000077123", "1700000000154000"], [1700000000.077123, 1700000000.154]),
        (["1700000000077123456", "1700000000154000000"], [1700000000.077123456, 1700000000.154]),
        (["99999999999", "100000000000"], [99999999999.0, 1e11]),
        (
            ["2023-11-14T22:13:20.077Z", "2023-11-14T22:13:20.154Z"],
            [1700000000.077, 1700000000.154],
        ),
        (["2023-11-14 22:13:20.077", "2023-11-14 22:13:20.154"], [1700000000.077, 1700000000.154]),
        (
            ["2023-11-14T23:13:20.077+01:00", "2023-11-14T23:13:20.154+0100"],
            [1700000000.077, 1700000000.154],
        ),
        (
            ["2023-11-14T22:13:20.077", "2023-11-14T20:13:20.154-02"],
            [1700000000.077, 1700000000.154],
        ),
        (
            ["2023/11/14 22:13:20.077 UTC", "2023/11/14 22:13:20.154 UTC"],
            [1700000000.077, 1700000000.154],
        ),
        (["2023-11-14", "2023-11-15 00:01"], [1699920000.0, 1700006460.0]),
        (["1969-12-31T23:59:59.5Z", "1970-01-01T00:00:00Z"], [-0.5, 0.0]),
    ],
)
def test_times_in_many_notations(cells, expected):
    track = only("time,x,y\n" + "".join(f"{cell},0,0\n" for cell in cells))
    assert track.times.tolist() == expected


def test_a_date_and_a_time_of_day_make_a_time():
    track = only("Date,Time,x,y\n2023-11-14,22:13:20.5,0,0\n2023-11-15,00:00:00,0,0\n")
    assert track.times.tolist() == [1700000000.5, 1700006400.0]


def test_the_unit_of_time_can_be_given():
    assert only("t,x,y\n0,0,0\n1500,1,1\n", time_unit="ms").times.tolist() == [0, 1.5]
    with pytest.raises(OptionError, match="fortnight"):
        read("t,x,y\n0,0,0\n", time_unit="fortnight")


def test_columns_by_name_and_by_position():
    text = "when,a,b,c\n0,1,2,3\n"
    assert only(text, columns="t=when,x=b,y=a").positions.tolist() == [[2, 1]]
    assert only(text, columns={"t": "when", "lat": "a", "lon": "b"}).plane is not None
    assert only(text, columns="t,x,y,z").positions.tolist() == [[1, 2, 3]]
    assert only("7,0,1,2\n7,1,1,2\n", columns="id,t,x,y").id == "7"
    assert read("7,0,9,1,2\n", columns=["id", "t", "-", "x", "y"]).tracks[0].positions.tolist() == [
        [1, 2]
    ]


def test_a_number_for_each_row_is_no_track_id():
    reading = read("id,t,x,y\n1,0,0,0\n2,1,0,0\n3,2,0,0\n")
    assert [len(track) for track in reading.tracks] == [3]
    assert reading.dropped_columns == ("id",)


def test_the_trip_wins_over_other_ids():
    assert [t.id for t in read("id,trip_id,t,x,y\n1,A,0,0,0\n2,B,1,0,0\n").tracks] == ["A", "B"]


def test_rows_that_can_not_be_used_are_dropped_and_counted():
    reading = read(
        "t,x,y\n0,0,0\n1,,0\n2,NaN,1\n3,oops,1\nlater,1,1\n,2,2\n6,1,1\n7,inf,0\n8,1\n9,1,1,1\n"
    )
    assert reading.tracks[0].times.tolist() == [0, 6]
    assert reading.points == 10
    assert reading.kept + reading.lost == reading.points
    counts = {repair.what: repair.count for repair in reading.repairs}
    assert counts == {
        "rows with too many or too few cells dropped": 2,
        "rows without a time dropped": 2,
        "rows without a position dropped": 4,
    }


def test_an_impossible_date_is_one_bad_row():
    reading = read(
        "t,x,y\n2023-02-28T00:00:00Z,0,0\n2023-02-30T00:00:00Z,1,1\n2023-03-01T00:00:00Z,2,2\n"
    )
    assert reading.tracks[0].times.tolist() == [1677542400.0, 1677628800.0]
    assert reading.lost == 1


def test_a_type_that_changes_far_down_the_file():
    rows = 400_000
    text = (
        "t,x,y\n"
        + "".join(f"{i},{i},0\n" for i in range(rows))
        + f"{rows}.5,-,0\n{rows + 1}.5,1.5,0\n"
    )
    reading = read(text)
    assert len(reading.tracks[0]) == rows + 1
    assert reading.tracks[0].times[-1] == rows + 1.5
    assert reading.lost == 1


def test_gzip_is_recognised_by_content_and_may_have_several_members(tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes(gzip.compress(b"t,x,y\n0,0,0\n") + gzip.compress(b"1,1,1\n"))
    reading = read_logs(path)
    assert len(reading.tracks[0]) == 2
    assert reading.bytes == path.stat().st_size


def test_gzip_that_is_cut_off_is_named(tmp_path):
    path = tmp_path / "log.csv.gz"
    noise = np.random.default_rng(0).normal(size=(50_000, 2))
    path.write_bytes(
        gzip.compress(
            ("t,x,y\n" + "".join(f"{i},{x},{y}\n" for i, (x, y) in enumerate(noise))).encode()
        )[:700_000]
    )
    with pytest.raises(InputError, match="damaged gzip"):
        read_logs(path)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "empty file"),
        ("  \n\n", "empty file"),
        ("t,x,y\n", "no rows"),
        ("x,y\n1,2\n", "no time; columns found: x, y; needed: t"),
        ("t,speed\n1,2\n", "no position; columns found: t, speed"),
        ("hello\nworld\n", "no time and no position"),
        ("0,1,2\n1,2,3\n", "--columns t,x,y"),
        ("t,x,y\na,1,2\n", "column 't': 'a' is no date and time"),
        ("t,x,y\n0,left,right\n", "column 'x' holds no number"),
        ("t,x,y\n0,,1\n1,5,\n", "no row has a position"),
        ("t,lat,lon\n0,116.3,40.0\n1,116.4,40.1\n", "look swapped; name them: --columns lat="),
        ("t,lat,lon\n0,400123.5,5300123.5\n", "if they are metres, name them so: --columns x="),
        (
            "t,x,y\n5,0,0\n14,0,0\n0,0,0\n",
            "row 4: time goes back 14 s; --sort orders the points, --split starts a new track",
        ),
        ("t,x,y\nnoon of 31.12.2023,0,0\n", "ISO 8601"),
        (b"t,x,y,n\n0,1,2,a\n" + b"1,1,2,\xff\xfe\x80\n" * 20000, None),
    ],
)
def test_mistakes_are_named_in_one_line(text, says):
    if says is None:
        assert len(read(text, sort=True).tracks) == 1
        return
    with pytest.raises(InputError) as caught:
        read(text)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("stream: ")


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"columns": {"t": "tim"}}, "no column 'tim'; columns found: t, x, y"),
        ({"columns": "t,x,y,z"}, "has 3 columns, but --columns names 4"),
        ({"keep": ["speed"]}, "no column 'speed'"),
    ],
)
def test_missing_columns_are_named(options, says):
    with pytest.raises(InputError) as caught:
        read("t,x,y\n0,0,0\n", **options)
    assert says in str(caught.value)


@pytest.mark.parametrize("columns", ["t=when,x", {"colour": "a"}])
def test_impossible_columns_are_refused(columns):
    with pytest.raises(OptionError, match="--columns"):
        read("t,x,y\n0,0,0\n", columns=columns)


@pytest.mark.parametrize(
    "data",
    [np.random.default_rng(1).bytes(5000), b"SQLite format 3\0", b"<svg></svg>", b"BZh91AY&SY"],
)
def test_what_is_no_log_is_refused(data):
    with pytest.raises(UnknownFormatError) as caught:
        read(data)
    assert "\n" not in str(caught.value)


def test_latin_1_ids_survive():
    assert only("track_id,t,x,y\nStraße,0,0,0\n".encode("latin-1")).id == "Straße"


@pytest.mark.parametrize(
    "name", ["heading", "Bearing", "course_deg", "COG", "Heading (deg)", "gps_course"]
)
def test_headings_are_read_where_they_are_asked_for(name):
    text = f"t,x,y,{name}\n0,1,2,270\n1,3,4,\n2,3,5,none\n"
    reading = read(text, heading=True)
    np.testing.assert_array_equal(reading.tracks[0].attributes["heading"], [270, np.nan, np.nan])
    assert reading.dropped_columns == ()
    assert read(text).dropped_columns == (name,)


def test_a_column_can_be_named_the_heading():
    track = only("t,x,y,dir,course\n0,1,2,30,99\n", columns="heading=dir", heading=True)
    assert track.attributes["heading"].tolist() == [30]
    assert not only("t,x,y\n0,1,2\n", heading=True).attributes
