import io
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError
from gpszip.io.logs.formats import format_for_reading
from gpszip.io.logs.raw import Request
from gpszip.io.logs.read import read_logs
from gpszip.io.logs.tlog import read_tlog
from gpszip.io.storage.source import Source
from oracle import mavlink
from oracle.mavlink import GLOBAL, GPS, HEARTBEAT, frame

START = 1_700_000_000.0
BEAT = frame(START - 1, HEARTBEAT, bytes(range(1, 10)))


def raw(*frames, **request):
    return read_tlog(Source("flight.tlog", data=b"".join(frames)), Request(**request))


_ROWS = st.lists(
    st.tuples(
        st.integers(0, 10**9),
        st.integers(-9 * 10**8, 9 * 10**8),
        st.integers(1, 18 * 10**8),
        st.integers(0, 6),
        st.sampled_from([1, 2]),
        st.booleans(),
    ),
    min_size=1,
    max_size=20,
)


@given(_ROWS, st.integers(50, 2000))
def test_positions_are_those_written(rows, chunk):
    rows = [(0, 1, 1, 3, 1, False), *rows]
    frames = [BEAT] + [
        frame(
            START + t / 1e6,
            GPS,
            mavlink.gps(lat / 1e7, lon / 1e7, fix=fix),
            version,
            signed=signed and version == 2,
        )
        for t, lat, lon, fix, version, signed in rows
    ]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gpszip.io.logs.tlog._CHUNK_BYTES", chunk)
        log = raw(*frames)
    fixes = [row for row in rows if row[3] >= 2]
    expected = [[lat / 1e7, lon / 1e7] for _, lat, lon, *_ in fixes]
    np.testing.assert_allclose(log.coordinates, expected, rtol=0, atol=1e-12)
    assert log.times.tolist() == [round((START + t / 1e6) * 1e6) / 1e6 for t, *_ in fixes]
    assert sum(repair.count for repair in log.repairs) == len(rows) - len(fixes)


def test_attributes():
    keep = ("alt", "speed", "course", "satellites")
    log = raw(frame(START, GPS, mavlink.gps(48, 11, 512.25)), keep=keep)
    assert [log.attributes[name][0] for name in keep] == [512.25, 12.34, 90, 9]
    log = raw(frame(START, GPS, mavlink.gps(48, 11, speed=65_535, course=65_535)), keep=keep)
    assert np.isnan(log.attributes["speed"][0])
    assert np.isnan(log.attributes["course"][0])
    log = raw(frame(START, GLOBAL, mavlink.position(48, 11)), keep=("speed",), heading=True)
    assert log.attributes["speed"][0] == math.hypot(3, 4)
    assert log.attributes["heading"][0] == 90


def test_measured_positions_come_before_estimates():
    estimates = [frame(START + i, GLOBAL, mavlink.position(48, 11)) for i in range(3)]
    log = raw(*estimates, frame(START, GPS, mavlink.gps(49, 12)))
    assert log.coordinates.tolist() == [[49, 12]]
    (repair,) = log.repairs
    assert repair.what == "positions of GLOBAL_POSITION_INT ignored beside GPS_RAW_INT"
    assert (repair.count, repair.drops) == (3, False)
    assert len(raw(*estimates, frame(START, GPS, mavlink.gps(0, 0, fix=0))).times) == 3


def test_vehicles_are_tracks():
    frames = [frame(START + i, GPS, mavlink.gps(48, 11), system=1 + i % 2) for i in range(4)]
    log = raw(*frames)
    assert log.ids == ("vehicle 1", "vehicle 2")
    assert log.codes.tolist() == [0, 1, 0, 1]
    assert raw(*frames[::2]).ids == ()


def test_damaged_frames_and_bytes_between_are_counted():
    good = [frame(START + i, GPS, mavlink.gps(48 + i / 1e3, 11)) for i in range(4)]
    damaged = bytearray(good[0])
    damaged[30] ^= 4
    reading = read_logs(
        io.BytesIO(
            good[0] + good[1] + bytes(damaged) + bytes(40) + good[2] + good[3] + good[0][:20]
        )
    )
    counts = {repair.what: repair.count for repair in reading.repairs}
    assert counts["messages with a wrong checksum dropped"] == 1
    assert counts["bytes that are no message passed over"] == 60
    assert (reading.points, reading.kept) == (5, 4)


def test_a_log_without_positions_is_refused():
    with pytest.raises(InputError, match="no position with a fix in this telemetry log"):
        raw(BEAT, BEAT)


def test_files_are_known_by_their_content():
    assert format_for_reading(Source("a", data=BEAT * 5)).name == "tlog"
    assert format_for_reading(Source("a", data=b"t,x,y\n0,0,0\n")).name == "csv"
