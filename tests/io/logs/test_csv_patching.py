import io

import numpy as np
import pytest

from gpszip.errors import InputError
from gpszip.io.logs.csv_patching import read_for_patching, read_patchable_csv
from gpszip.io.storage.source import Source
from gpszip.model import Patch


def text_log(text, encoding="utf-8", **options):
    return read_patchable_csv(
        Source("log.csv", data=text if isinstance(text, bytes) else text.encode(encoding)),
        **options,
    )


def written(log, *patches):
    out = io.BytesIO()
    log.write(patches, out)
    return out.getvalue().decode(log.dialect.encoding)


def patch_of(log, track, after, times, positions=None, confidence=0.5):
    """Fill a gap with samples, by default at the position before it."""
    times = np.array(times, float)
    if positions is None:
        before = log.read_result.tracks[track].positions[[after]]
        positions = np.repeat(before, len(times), axis=0)
    positions = np.array(positions, float)
    return Patch(track, after, 60.0, times, positions, np.full(len(times), confidence), 10.0)


def test_rows_stay_as_they_were_and_rows_are_added():
    text = (
        'name,"the time",x,y,note\n"a",0,1.50,2,"he said ""hi"""\n a ,1,2,2,\n'
        '"a",60,007.0,2,"two\nlines"\n'
    )
    log = text_log(text.replace(" a ", "a"), columns="t=the time,x=x,y=y")
    patched = written(log, patch_of(log, 0, 1, [30, 45], [[3.14159, 2], [5, 2.5]]))
    assert patched == (
        'name,"the time",x,y,note,source,confidence\n'
        '"a",0,1.50,2,"he said ""hi""",log,1\na,1,2,2,,log,1\n'
        'a,30,3.14,2.00,,patched,0.500\na,45,5.00,2.50,,patched,0.500\n"a",60,007.0,2,"two\nlines",log,1\n'
    )


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("last", [True, False])
def test_line_ends(end, last):
    text = end.join(["t,x,y", "0,0,0", "1,1,0", "60,2,0"]) + (end if last else "")
    log = text_log(text)
    expected = [
        "t,x,y,source,confidence",
        "0,0,0,log,1",
        "1,1,0,log,1",
        "30,1.00,0.00,patched,0.500",
        "60,2,0,log,1",
        "",
    ]
    assert written(log, patch_of(log, 0, 1, [30])) == end.join(expected)


def test_tracks_that_take_turns_keep_the_order_of_time():
    rows = [("a", 0), ("b", 0), ("a", 1), ("b", 1), ("b", 20), ("b", 40), ("a", 60), ("b", 60)]
    log = text_log("id,t,x,y\n" + "".join(f"{name},{time},0,0\n" for name, time in rows))
    lines = [
        line.split(",")[:2]
        for line in written(log, patch_of(log, 0, 1, [10, 20, 30, 50])).splitlines()[1:]
    ]
    times = [float(time) for _, time in lines]
    assert times == sorted(times)
    assert [float(time) for name, time in lines if name == "a"] == [0, 1, 10, 20, 30, 50, 60]


def test_tracks_one_after_the_other_stay_apart():
    log = text_log("id,t,x,y\nb,0,0,0\nb,60,0,0\na,0,0,0\na,60,0,0\n")
    names = [
        line.split(",")[0]
        for line in written(log, patch_of(log, 0, 0, [30]), patch_of(log, 1, 0, [30])).splitlines()[
            1:
        ]
    ]
    assert names == ["b", "b", "b", "a", "a", "a"]


@pytest.mark.parametrize(
    ("one", "other", "step", "expected"),
    [
        ("1700000000", "1700000060", 30, "1700000030"),
        ("1700000000.250", "1700000060.250", 30, "1700000030.250"),
        ("1700000000000", "1700000060000", 30, "1700000030000"),
        ("1.7e9", "1.70000006e9", 30, "1700000030"),
        ("2024-05-06T07:08:09Z", "2024-05-06T07:09:09Z", 30, "2024-05-06T07:08:39Z"),
        ("2024-05-06 07:08:09.5", "2024-05-06 07:09:09.5", 30, "2024-05-06 07:08:39.5"),
        ("2024-05-06T07:08:09+02:00", "2024-05-06T07:09:09+02:00", 30, "2024-05-06T07:08:39+02:00"),
        ("2024-12-31T23:59:50Z", "2025-01-01T00:00:50Z", 30, "2025-01-01T00:00:20Z"),
        ("0", "60", 0.5, "0.5"),
        ("08:00:00", "08:01:00", 30, "08:00:30"),
        ("20240504080000", "20240504080100", 30, "2024-05-04T08:00:30Z"),
        ("2024-05-04T24:00:00Z", "2024-05-05T00:01:00Z", 30, "2024-05-05T00:00:30Z"),
        ("2016-12-31T23:59:60Z", "2017-01-01T00:01:00Z", 30.5, "2017-01-01T00:00:30.000Z"),
        ("31/12/2016 08:00", "31/12/2016 08:01", 30, "2016-12-31T08:00:30Z"),
    ],
)
def test_times_are_written_as_the_log_writes_them(one, other, step, expected):
    log = text_log(f"t,x,y\n{one},0,0\n{other},1,0\n")
    start = log.read_result.tracks[0].times[0]
    line = written(log, patch_of(log, 0, 0, [start + step])).splitlines()[2]
    assert line.split(",")[0] == expected
    again = text_log(written(log, patch_of(log, 0, 0, [start + step])))
    end = log.read_result.tracks[0].times[-1] - start
    np.testing.assert_allclose(again.read_result.tracks[0].times - start, [0, step, end], atol=1e-6)


@pytest.mark.parametrize(
    ("header", "rows", "options"),
    [
        ("date,time", ["2024-05-04,08:00:00", "2024-05-04,08:01:00", "2024-05-04,08:02:00"], {}),
        ("date,time", ["20240504,080000", "20240504,080100", "20240504,080200"], {}),
        ("time", ["45416.333333333", "45416.334027778", "45416.334722222"], {"time_unit": "excel"}),
        ("time", ["08:00:00", "08:01:00", "08:02:00"], {}),
        ("time", ["03/04/2024 08:00", "03/04/2024 08:01", "03/04/2024 08:02"], {"dates": "dmy"}),
    ],
)
def test_written_times_are_read_as_the_same_times(header, rows, options):
    log = text_log(f"{header},x,y\n" + "".join(f"{row},0,0\n" for row in rows), **options)
    start = log.read_result.tracks[0].times[0]
    again = text_log(written(log, patch_of(log, 0, 0, start + np.array([15.0, 30.0]))), **options)
    np.testing.assert_allclose(
        again.read_result.tracks[0].times - start, [0, 15, 30, 60, 120], atol=2e-3
    )


def test_a_date_and_a_time_of_day_become_iso():
    log = text_log("date,time,x,y\n2024-05-06,07:08:09,0,0\n2024-05-06,07:09:09,1,0\n")
    start = log.read_result.tracks[0].times[0]
    again = text_log(written(log, patch_of(log, 0, 0, [start + 30])))
    np.testing.assert_allclose(again.read_result.tracks[0].times - start, [0, 30, 60])


def test_degrees_and_decimal_commas():
    log = text_log("t;lat;lon\n0;48,1234567;11,5\n60;48,1244567;11,5\n")
    line = written(log, patch_of(log, 0, 0, [30])).splitlines()[2]
    assert line == "30;48,1234567;11,5000000;patched;0.500" or line.startswith(
        "30;48,1234567;11,500000;"
    )


def test_existing_columns_of_the_new_names_are_kept():
    log = text_log("t,x,y,source\n0,0,0,gps\n60,1,0,gps\n")
    assert written(log).splitlines()[:2] == [
        "t,x,y,source,patch_source,confidence",
        "0,0,0,gps,log,1",
    ]


def test_bad_rows_and_comments_stay():
    text = "# made by hand\nt,x,y\n0,0,0\nrubbish\n1,,0\n\n60,1,0\n"
    log = text_log(text)
    assert [len(track) for track in log.read_result.tracks] == [2]
    assert [line.removesuffix(",log,1") for line in written(log).splitlines()] == [
        "# made by hand",
        "t,x,y,source,confidence",
        *text.splitlines()[2:],
    ]


def test_without_a_header():
    log = text_log("0 5 5\n60 6 5\n", columns="t,x,y")
    assert (
        written(log, patch_of(log, 0, 0, [30]))
        == "0 5 5 log 1\n30 5.00 5.00 patched 0.500\n60 6 5 log 1\n"
    )


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1", "utf-16"])
def test_letters_of_any_encoding_survive(encoding):
    data = "id,t,x,y\né,0,0,0\né,60,1,0\n".encode(encoding)
    log = text_log(data)
    out = io.BytesIO()
    log.write([patch_of(log, 0, 0, [30])], out)
    assert out.getvalue().decode(encoding).splitlines()[2] == "é,30,0.00,0.00,patched,0.500"


def test_packed_logs():
    import gzip

    log = text_log(gzip.compress(b"t,x,y\n0,0,0\n60,1,0\n"))
    assert written(log).startswith("t,x,y,source")


def test_sorted_logs_are_filled_in_their_own_order():
    log = text_log("t,x,y\n60,1,0\n0,0,0\n", sort=True)
    assert len(written(log, patch_of(log, 0, 0, [30])).splitlines()) == 4


def test_errors_are_those_of_reading_the_log():
    with pytest.raises(InputError, match=r"columns found: a, b;"):
        text_log("a,b\n0,0\n")
    with pytest.raises(InputError, match="time goes back"):
        text_log("t,x,y\n60,1,0\n0,0,0\n")


def test_only_a_single_csv_log_is_kept_as_text(tmp_path):
    one, other = tmp_path / "one.csv", tmp_path / "other.csv"
    for path in (one, other):
        path.write_text("t,x,y\n0,0,0\n60,1,0\n")
    assert read_for_patching([one])[1] is not None
    reading, text = read_for_patching([one, other])
    assert text is None
    assert len(reading.tracks) == 2


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("t,lat,N/S,lon,E/W\n0,33,S,70,W\n60,33,S,70,W\n", "hemispheres in columns of their own"),
        ("t,lat,lon\n0,33S,70W\n60,33S,70W\n", "coordinates such as '33S'"),
        ("t,x,y,\n0,1,2\n60,1,2\n", "differ by an empty cell"),
        ("t,x,y\n0,1,2,\n60,1,2,\n", "differ by an empty cell"),
    ],
)
def test_tables_to_which_no_row_can_be_added_are_refused(text, says):
    with pytest.raises(InputError, match=says):
        text_log(text)


def test_rows_are_added_with_decimal_commas_within_quotes():
    log = text_log('t,lat,lon\n0,"48,1371","11,575"\n60,"48,1372","11,576"\n')
    rows = written(log, patch_of(log, 0, 0, [30])).splitlines()
    assert rows[2] == '30,"48,137100","11,575000",patched,0.500'
