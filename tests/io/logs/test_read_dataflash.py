import io
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError
from gpszip.io.logs.dataflash import read_dataflash
from gpszip.io.logs.formats import format_for_reading
from gpszip.io.logs.raw import Request
from gpszip.io.logs.read import read_logs
from gpszip.io.storage.source import Source
from oracle import dataflash
from oracle.dataflash import NEW, OLD

START = datetime(2024, 5, 4, 23, 59, 58, tzinfo=UTC)


def new(i, lat=48.1, lon=11.5, receiver=0, status=3):
    clock = dataflash.gps_time(START + timedelta(seconds=i))
    return (5_000_000 + i, receiver, status, *clock, 9, 1.2, lat, lon, 512.25, 12.5, 90.0)


def old(i, lat=48.1, lon=11.5, status=3):
    clock = dataflash.gps_time(START + timedelta(seconds=i))
    return (status, *clock, 9, 1.2, lat, lon, 3.5, 512.25, 12.5, 90.0)


def binary(*rows, layout=NEW, between=b""):
    head = dataflash.start() + dataflash.describe(130, "GPS", *layout)
    return head + b"".join(between + dataflash.message(130, layout[0], *row) for row in rows)


def text(*rows, layout=NEW, name="GPS"):
    head = "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\r\n"
    head += f"FMT, 130, 50, {name}, {layout[0]}, {layout[1]}\r\n"
    return (head + "".join(dataflash.text(name, layout[0], *row) for row in rows)).encode()


def raw(data, **request):
    return read_dataflash(Source("flight.bin", data=data), Request(**request))


_ROWS = st.lists(
    st.tuples(
        st.integers(0, 10**7),
        st.integers(1, 9 * 10**8),
        st.integers(-18 * 10**8, 18 * 10**8),
        st.integers(0, 6),
    ),
    min_size=1,
    max_size=20,
)


@given(_ROWS, st.sampled_from([binary, text]), st.sampled_from([(NEW, new), (OLD, old)]))
def test_positions_and_times_are_those_written(rows, write, layout):
    types, make = layout
    values = [
        make(i, lat / 1e7, lon / 1e7, status=status)
        for i, lat, lon, status in [(0, 1, 1, 3), *rows]
    ]
    log = raw(write(*values, layout=types), keep=("alt", "speed", "course", "satellites", "hdop"))
    fixes = [(0, 1, 1), *(row[:3] for row in rows if row[3] >= 2)]
    expected = [[lat / 1e7, lon / 1e7] for _, lat, lon in fixes]
    np.testing.assert_allclose(log.coordinates, expected, rtol=0, atol=1e-12)
    assert log.times.tolist() == [START.timestamp() + i for i, *_ in fixes]
    assert [log.attributes[name][0] for name in log.attributes] == [512.25, 12.5, 90, 9, 1.2]
    dropped = sum(repair.count for repair in log.repairs)
    assert dropped == sum(row[3] < 2 for row in rows)


@pytest.mark.parametrize(
    ("date", "behind"),
    [("2008-12-31", 14), ("2009-01-02", 15), ("2016-12-31", 17), ("2017-01-02", 18)],
)
def test_times_of_gps_are_brought_to_utc(date, behind):
    start = datetime(1980, 1, 6, tzinfo=UTC)
    week, rest = divmod(
        datetime.fromisoformat(f"{date}T12:00:00+00:00") - start, timedelta(weeks=1)
    )
    row = (3, rest // timedelta(milliseconds=1), week, *old(0)[3:])
    noon = np.datetime64(f"{date}T12:00:00").astype(float)
    assert raw(binary(row, layout=OLD)).times.tolist() == [noon - behind]


def test_receivers_are_tracks():
    rows = [new(i, receiver=i % 2) for i in range(4)]
    for write in (binary, text):
        log = raw(write(*rows))
        assert log.ids == ("flight", "flight-GPS2")
        assert log.codes.tolist() == [0, 1, 0, 1]

    # Older logs have a message for the second one.
    data = binary(old(0), layout=OLD) + dataflash.describe(131, "GPS2", *OLD)
    log = raw(data + dataflash.message(131, OLD[0], *old(1)))
    assert log.ids == ("flight", "flight-GPS2")


def test_zeros_before_a_fix_are_dropped_and_counted():
    rows = [new(0, 0, 0), new(1, status=1), (1, 0, 3, 0, 0, *new(2)[5:]), *map(new, range(3, 6))]
    for write in (binary, text):
        reading = read_logs(io.BytesIO(write(*rows)))
        assert (reading.points, reading.kept) == (6, 3)
    with pytest.raises(InputError, match=r"no position with a fix.*3 positions without"):
        raw(binary(*rows[:3]))


def test_other_messages_and_damage_are_passed_over(monkeypatch):
    noise = bytes(5) + b"\xa3\x95\x07\xa3" + dataflash.describe(131, "IMU", "QB", "TimeUS,I")
    noise += dataflash.message(131, "QB", 7, 1)
    for size in (1 << 22, 50):
        monkeypatch.setattr("gpszip.io.logs.dataflash._CHUNK_BYTES", size)
        log = raw(binary(*map(new, range(5)), between=noise) + b"\xa3\x95\x82 cut")
        assert log.times.tolist() == [START.timestamp() + i for i in range(5)]
        (repair,) = log.repairs
        assert repair.what == "bytes that are no message passed over"
        assert repair.count == 5 * 9 + 7


def test_texts_in_whole_numbers_are_in_1e7_degrees():
    lines = text(new(0)).decode().replace("48.1000000", "481000000")
    assert raw(lines.encode()).coordinates.tolist() == [[48.1, 11.5]]


def test_lines_that_lost_cells_are_dropped_and_counted():
    log = raw(text(*map(new, range(3))) + b"GPS, 5, 0, 3\r\nGPSX, 1\r\n")
    assert [(repair.count, repair.drops) for repair in log.repairs] == [(1, True)]
    assert len(log.times) == 3


def test_descriptions_that_lie_do_no_harm():
    # Sizes smaller than the fields, types that don't exist, and no position.
    for types, labels in (("QZ!", "TimeUS,Lat,Lng"), ("BB", "Lat,Lng"), ("", "")):
        body = dataflash.describe(130, "GPS", types, labels)
        body = body[:4] + bytes([20]) + body[5:]
        with pytest.raises(InputError):
            read_logs(io.BytesIO(dataflash.start() + body + b"\xa3\x95\x82" + bytes(17)))
    reading = read_logs(
        io.BytesIO(binary(*map(new, range(3))) + dataflash.describe(130, "GPS", *OLD))
    )
    assert reading.kept == 3


def test_files_are_known_by_their_content():
    for write in (binary, text):
        assert format_for_reading(Source("a", data=write(new(0)))).name == "dataflash"
