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
from gpszip.io.logs.ulog import read_ulog
from gpszip.io.storage.source import Source
from oracle import ulog

UTC = 1_700_000_000_000_000
BOOT = 5_000_000


def gps(number, i, lat=480_000_000, fields=ulog.GPS, fix=3, utc=None):
    time = BOOT + i * 200_000
    utc = UTC + time if utc is None else utc
    if fields == ulog.NEW_GPS:
        at = (lat / 1e7, 11.5 + i / 1e4, 500.25)
    else:
        at = (lat, 115_000_000 + i * 1000, 500_250)
    return ulog.data(number, fields, time, utc, *at, 12.5, math.pi / 2, fix, 9)


def start(fields=ulog.GPS, *topics):
    topics = topics or (("vehicle_gps_position", fields),)
    formats = [ulog.topic(name, fields) for name, fields in dict(topics).items()]
    named = [ulog.subscription(i, name) for i, (name, _) in enumerate(topics)]
    return b"".join([ulog.header(), ulog.flags(), *formats, *named])


def raw(data, **request):
    return read_ulog(Source("flight.ulg", data=data), Request(**request))


@given(
    st.lists(st.tuples(st.integers(1, 9 * 10**8), st.integers(0, 4)), min_size=1, max_size=20),
    st.sampled_from([ulog.GPS, ulog.NEW_GPS]),
)
def test_positions_are_those_of_pyulog(rows, fields):
    pyulog = pytest.importorskip("pyulog")
    data = start(fields) + gps(0, 0, fields=fields)
    for i, (lat, fix) in enumerate(rows):
        data += ulog.dropout(30) + gps(0, i + 1, lat, fields, fix)
    log = raw(data, keep=("alt", "speed", "course", "satellites"))

    (topic,) = pyulog.ULog(io.BytesIO(data)).data_list
    has_fix = topic.data["fix_type"] >= 2
    lat = topic.data["lat"] / 1e7 if fields == ulog.GPS else topic.data["latitude_deg"]
    times = (topic.data["timestamp"] + UTC) / 1e6
    np.testing.assert_allclose(log.coordinates[:, 0], lat[has_fix], rtol=0, atol=1e-12)
    np.testing.assert_allclose(log.times, times[has_fix], rtol=0, atol=1e-5)
    values = {name: values[0] for name, values in log.attributes.items()}
    assert values == {"alt": 500.25, "speed": 12.5, "course": 90, "satellites": 9}
    counts = {repair.what: repair.count for repair in log.repairs}
    assert counts["dropouts of the logger"] == len(rows)
    dropped = counts.get("positions of vehicle_gps_position without a fix dropped", 0)
    assert dropped == (~has_fix).sum()


def test_measured_positions_come_before_estimates():
    topics = (
        ("vehicle_global_position", ulog.GLOBAL),
        ("vehicle_gps_position", ulog.GPS),
        ("vehicle_local_position", ulog.LOCAL),
    )
    data = start("", *topics)
    for i in range(4):
        data += ulog.data(0, ulog.GLOBAL, BOOT + i, 48.5, 11.5, 500)
        data += ulog.data(2, ulog.LOCAL, BOOT + i, 3, 4, -5, 1, 1, 0, True)
    measured = raw(data + gps(1, 0))
    assert measured.coordinates.tolist() == [[48.0, 11.5]]
    ignored = [repair.what for repair in measured.repairs if "ignored" in repair.what]
    assert len(ignored) == 2

    # GPS without a fix sets the clock, but has no position.
    estimated = raw(data + gps(1, 0, fix=1))
    assert estimated.coordinates.tolist() == [[48.5, 11.5]] * 4
    assert estimated.times[0] == pytest.approx((UTC + BOOT) / 1e6, abs=1e-5)


def test_local_positions_are_east_and_north():
    data = start("", ("vehicle_local_position", ulog.LOCAL))
    data += ulog.data(0, ulog.LOCAL, BOOT, 3, 4, -5, 3, 4, math.pi, True)
    data += ulog.data(0, ulog.LOCAL, BOOT + 1, 0, 0, 0, 0, 0, 0, False)
    log = raw(data, keep=("alt", "speed"), heading=True)
    assert not log.geographic
    assert log.coordinates.tolist() == [[4, 3]]
    assert log.times.tolist() == [BOOT / 1e6]
    assert {name: values[0] for name, values in log.attributes.items()} == {
        "alt": 5,
        "speed": 5,
        "heading": 180,
    }
    assert any("from the start of the autopilot" in repair.what for repair in log.repairs)


def test_clocks_that_were_not_set_are_not_read():
    # A few messages come before GPS knows the time.
    data = start() + gps(0, 0, utc=0) + b"".join(gps(0, i) for i in range(1, 4))
    expected = [(UTC + BOOT + i * 200_000) / 1e6 for i in range(4)]
    np.testing.assert_allclose(raw(data).times, expected, rtol=0, atol=1e-5)
    assert raw(start() + gps(0, 0, utc=0)).times.tolist() == [BOOT / 1e6]


def test_times_of_gps_that_are_no_numbers_count_as_none():
    number, text = "uint64_t time_utc_usec", "char time_utc_usec;uint8_t[7] rest"
    fields = ulog.GPS.replace(number, text)
    log = raw(start(fields) + gps(0, 0))
    assert log.times.tolist() == [BOOT / 1e6]


def test_receivers_are_tracks():
    data = start() + ulog.subscription(1, "vehicle_gps_position", 1)
    data += b"".join(gps(i % 2, i) for i in range(6))
    log = raw(data)
    assert log.ids == ("flight-0", "flight-1")
    assert log.codes.tolist() == [0, 0, 0, 1, 1, 1]


def test_appended_data_follow_whatever_message_they_cut():
    head = start()
    data = head + gps(0, 0) + gps(0, 1)[:30]
    appended = ulog.flags(len(data))
    data = data.replace(ulog.flags(), appended, 1) + gps(0, 2)
    log = raw(data)
    assert len(log.times) == 2
    assert [repair.count for repair in log.repairs] == [1]

    # No message is cut if the logger ended well.
    whole = (head + gps(0, 0)).replace(ulog.flags(), ulog.flags(len(head + gps(0, 0))), 1)
    assert len(raw(whole + gps(0, 1)).times) == 2


def test_a_log_that_is_cut_short_is_read_and_told():
    data = start() + gps(0, 0) + gps(0, 1)
    log = raw(data[:-5])
    assert len(log.times) == 1
    assert [repair.what for repair in log.repairs] == ["messages that are cut short dropped"]


def test_a_damaged_log_is_refused_unless_its_start_will_do():
    data = start() + gps(0, 0) + gps(0, 1) + b"\x05\x00\xff" + bytes(9) + gps(0, 2)
    with pytest.raises(InputError, match=r"byte \d+: damaged ULog file: a message of an unknown"):
        raw(data)
    reading = read_logs(io.BytesIO(data), skip_bad=True)
    assert reading.kept == 2
    assert len(reading.left_out) == 1


def test_messages_that_do_not_fit_their_formats_are_dropped():
    short = ulog.message("D", b"\0\0abc")
    log = raw(start() + gps(0, 0) + short + gps(0, 1))
    assert len(log.times) == 2
    assert [repair.count for repair in log.repairs] == [1]
    with pytest.raises(InputError, match="no position in any of vehicle_gps_position"):
        raw(start())
    with pytest.raises(InputError, match="no point has a time"):
        read_logs(io.BytesIO(start() + short))
    assert format_for_reading(Source("a", data=start())).name == "ulog"
