import gzip
import io
import struct
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError
from gpszip.io.logs.fit.read import read_fit
from gpszip.io.logs.formats import format_for_reading
from gpszip.io.logs.raw import Request
from gpszip.io.logs.read import read_logs
from gpszip.io.storage.source import Source
from oracle import fit as f
from random_tests import examples

pytest.importorskip("fitdecode")

T = 1_700_000_000
ROWS = [(T + i, 48 + i / 1e4, 11 - i / 1e4) for i in range(20)]


def records(first=0, last=None):
    return [f.record(*row) for row in ROWS[first:last]]


def raw(*messages, **request):
    return read_fit(Source("ride.fit", data=f.fit(*messages)), Request(**request))


def read(data, **options):
    return read_logs(io.BytesIO(data), **options)


# Positions and times


@examples(50)
@given(
    st.lists(
        st.tuples(
            st.integers(T, T + 10**8),
            st.floats(-90, 90),
            st.floats(-180, 179.9),
            st.booleans(),
        ),
        min_size=1,
        max_size=20,
    ),
    st.sampled_from("<>"),
)
def test_positions_and_times_are_those_written(rows, endian):
    messages = [
        f.record(time, *((lat, lon) if has_position else ()))
        for time, lat, lon, has_position in rows
    ]
    data = f.fit(f.file_id(), f.record(T, 0, 0), *messages, endian=endian)
    log = read_fit(Source("a", data=data), Request())
    assert log.times.tolist() == [T, *(row[0] for row in rows)]
    expected = [
        (f.semicircles(lat) * 180 / 2**31, f.semicircles(lon) * 180 / 2**31)
        if has_position
        else (np.nan, np.nan)
        for _, lat, lon, has_position in rows
    ]
    np.testing.assert_array_equal(log.coordinates[1:], expected)


def test_times_in_headers_count_on_from_the_last_one():
    # 27 seconds later, the lowest five bits have wrapped around.
    later = f.compressed(f.record(None, 48.1, 11), (T - f.EPOCH + 27) % 32)
    log = raw(f.file_id(), f.record(T, 48, 11), later)
    assert log.times.tolist() == [T, T + 27]


def test_records_without_a_position_or_a_time_are_dropped_and_counted():
    data = f.fit(
        f.file_id(),
        *records(),
        f.record(T + 30),
        f.record(None, 48, 11),
        f.record(1000 + f.EPOCH, 48, 11),
    )
    reading = read(data)
    counts = {repair.what: repair.count for repair in reading.repairs}
    assert counts == {"points without a position dropped": 1, "points without a time dropped": 2}
    assert len(reading.tracks[0]) == len(ROWS)


# Tracks


def test_an_activity_is_one_track_whatever_its_laps():
    log = raw(f.file_id(), *records(0, 10), (f.LAP, [(253, f.UINT32, 5)]), *records(10))
    assert log.ids == ()
    assert log.codes is None
    assert raw(f.file_id(), *records(), f.session(T, f.RUNNING)).ids == ()


def test_each_sport_of_a_race_is_a_track():
    log = raw(
        f.file_id(),
        *records(),
        f.session(T + 15, f.RUNNING),
        f.session(T, f.RUNNING),
        f.session(T + 12, f.TRANSITION),
    )
    assert log.ids == ("running", "transition", "running-2")
    assert np.bincount(log.codes).tolist() == [12, 3, 5]


def test_a_chain_of_files_is_read_to_its_end():
    one = f.fit(f.file_id(), *records(0, 5), f.session(T, f.CYCLING))
    other = f.fit(f.file_id(), *records(5, 8), endian=">")
    without = f.fit(f.file_id(f.MONITORING_B))
    log = read_fit(Source("a", data=one + without + other), Request())
    assert log.ids == ("cycling", "activity")
    assert np.bincount(log.codes).tolist() == [5, 3]
    assert len(read(gzip.compress(one)).tracks[0]) == 5


def test_a_course_is_a_shape():
    reading = read(f.fit(f.file_id(f.COURSE), *records()))
    assert not reading.tracks[0].timed
    assert [(repair.count, repair.drops) for repair in reading.repairs] == [(len(ROWS), False)]


# Fields


def test_fields_can_be_kept_by_several_names():
    more = [(3, f.UINT8, 120), (4, f.UINT8, 80), (7, f.UINT16, 250), (2, f.UINT16, 5 * (500 + 12))]
    messages = [
        *f.developer_field("Doughnuts"),
        f.record(T, 48, 11, more, [(0, 7)]),
        f.record(T + 1, 48, 11),
    ]
    names = ("hr", "cadence", "watts", "ele", "Doughnuts")
    kept = raw(f.file_id(), *messages, keep=names).attributes
    assert [kept[name][0] for name in names] == [120, 80, 250, 12, 7]
    assert all(np.isnan(kept[name][1]) for name in names)

    log = raw(f.file_id(), *messages, keep=("alt",))
    assert log.dropped_columns == ("heart_rate", "cadence", "power", "Doughnuts")
    with pytest.raises(InputError, match=r"no 'speed' to keep; its records have: .*, power"):
        raw(f.file_id(), *messages, keep=("speed",))


def test_altitude_and_speed_come_from_their_finer_fields():
    more = [
        (2, f.UINT16, 5 * 600),
        (78, f.UINT32, 5 * 600 + 1),
        (6, f.UINT16, 3000),
        (73, f.UINT32, 3001),
    ]
    # Some devices write the coarse fields, too: the first field of a name counts.
    kept = raw(f.file_id(), f.record(T, 48, 11, more[1::2]), keep=("alt", "speed")).attributes
    assert [kept["alt"][0], kept["speed"][0]] == [100.2, 3.001]
    kept = raw(f.file_id(), f.record(T, 48, 11, more[::2]), keep=("alt", "speed")).attributes
    assert [kept["alt"][0], kept["speed"][0]] == [100, 3]


# Files that can't be used


@pytest.mark.parametrize(
    ("messages", "words"),
    [
        (
            [f.file_id(f.MONITORING_B), (f.MONITORING, [(3, f.UINT32, 5)])],
            "in this monitoring_b file",
        ),
        ([f.file_id(), f.record(T)], "1 record without one, 1 file_id"),
        ([f.file_id(f.COURSE)], "in this course file, only messages: 1 file_id"),
        ([], "in this FIT file, only messages: none"),
    ],
)
def test_files_without_positions_say_what_they_hold(messages, words):
    with pytest.raises(InputError, match=words):
        read(f.fit(*messages))


@pytest.mark.parametrize(
    ("data", "records_read", "reason"),
    [
        (f.fit(f.file_id(), *records())[:-40], 17, "cut short"),
        (f.fit(f.file_id(), *records(), crc=1), 20, "checksum is wrong"),
        (f.fit(f.file_id(), *records()) + b"more of something", 20, "not a FIT file"),
        (f.fit(f.file_id(), *records())[:-2] + b"\x05\0\0", 20, ""),
    ],
)
def test_damaged_files_are_refused_or_read_up_to_the_damage(data, records_read, reason):
    with pytest.raises(
        InputError, match=f"after record {records_read}: damaged FIT file: .*{reason}"
    ):
        read(data)
    reading = read(data, skip_bad=True)
    assert len(reading.tracks[0]) == records_read
    (left_out,) = reading.left_out
    assert left_out.name == f"stream: all after record {records_read}"
    assert reason in left_out.reason


def test_a_damaged_file_without_positions_is_refused_anyway():
    with pytest.raises(InputError, match="after record 0: damaged FIT file"):
        read(f.fit(f.file_id(), *records())[:30], skip_bad=True)


def test_fit_is_recognised_by_its_signature():
    data = f.fit(f.file_id(), *records())
    assert format_for_reading(Source("a.csv", data=data)).name == "fit"
    short = struct.pack("<2BHI4s", 12, 0x10, 100, len(data) - 16, b".FIT") + data[14:]
    assert format_for_reading(Source("a.csv", data=short)).name == "fit"


def test_without_the_extra_the_error_names_it(tmp_path):
    # The module exists, but can't be imported.
    (tmp_path / "fitdecode.py").write_text("raise ImportError\n")
    (tmp_path / "ride.fit").write_bytes(f.fit(f.file_id(), *records()))
    code = (
        f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import gpszip.cli.main as m; m.run()"
    )
    run = subprocess.run(
        [sys.executable, "-c", code, "compress", str(tmp_path / "ride.fit")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode != 0
    assert "reading FIT files needs the extra 'fit': pip install 'gpszip[fit]'" in run.stderr
