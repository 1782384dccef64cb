import io
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError
from gpszip.io.logs.formats import format_for_reading
from gpszip.io.logs.owntracks import read_owntracks
from gpszip.io.logs.raw import Request
from gpszip.io.logs.read import read_logs
from gpszip.io.storage.source import Source


def message(tst, lat, lon, kind="location", **more):
    return {"_type": kind, "tst": tst, "lat": lat, "lon": lon, "tid": "me", **more}


def line(body, received="2024-05-04T23:00:00Z", topic="*"):
    return f"{received}\t{topic:<18}\t{json.dumps(body)}\n"


def raw(*bodies, **request):
    data = "".join(map(line, bodies)).encode()
    return read_owntracks(Source("phone.rec", data=data), Request(**request))


@given(
    st.lists(
        st.tuples(
            st.integers(0, 2**33),
            st.floats(-90, 90),
            st.floats(-180, 180),
            st.sampled_from(["location", "transition", "waypoint", "lwt"]),
        ),
        min_size=1,
    )
)
def test_locations_are_those_of_the_messages(rows):
    log = raw(message(0, 1, 2), *(message(*row) for row in rows))
    expected = [(0, 1, 2), *(row[:3] for row in rows if row[3] == "location")]
    assert np.column_stack([log.times, log.coordinates]).tolist() == [list(row) for row in expected]
    ignored = sum(row[3] != "location" for row in rows)
    assert sum(repair.count for repair in log.repairs) == ignored


def test_the_time_of_receipt_is_not_read():
    # A phone sends what it has stored, all at once and in any order.
    data = "".join(line(message(t, 48 + t / 1e4, 11)) for t in (30, 10, 20)).encode()
    assert read_logs(io.BytesIO(data), sort=True).tracks[0].times.tolist() == [10, 20, 30]
    with pytest.raises(InputError, match=r"point 2: time goes back 20 s; --sort"):
        read_logs(io.BytesIO(data))


def test_attributes_are_in_metres_and_seconds():
    body = message(5, 48, 11, vel=36, alt=500, acc=7, cog=90, batt=80)
    keep = ("speed", "ele", "accuracy", "course", "battery")
    log = raw(body, message(6, 48, 11), keep=keep)
    assert [log.attributes[name][0] for name in keep] == [10, 500, 7, 90, 80]
    assert all(np.isnan(log.attributes[name][1]) for name in keep)


def test_topics_are_tracks():
    bodies = [message(i, 48, 11, topic=f"owntracks/me/{'ab'[i % 2]}") for i in range(4)]
    log = raw(*bodies, message(9, 48, 11))
    assert log.ids == ("owntracks/me/a", "owntracks/me/b", "phone")
    assert log.codes.tolist() == [0, 1, 0, 1, 2]


@pytest.mark.parametrize(
    "bad", ["no message", "2024-05-04T23:00:00Z\t*\t{", "a\tb\t[1]", "[" * 100_000, "2024"]
)
def test_lines_that_are_no_message_are_counted(bad):
    data = (line(message(1, 48, 11)) + bad + "\n\n").encode()
    log = read_owntracks(Source("a", data=data), Request())
    (repair,) = log.repairs
    assert (repair.what, repair.count) == ("lines that are no message left out", 1)
    assert len(log.times) == 1


def test_values_of_other_types_are_none():
    log = raw(message(1, 48, 11), message(True, None, "x"), message(10**400, [1], {}))
    assert np.isnan(log.coordinates[1:]).all()
    assert np.isnan(log.times[1:]).all()
    assert raw(message("5", "48.1", "11")).coordinates.tolist() == [[48.1, 11]]


def test_encrypted_messages_are_told():
    with pytest.raises(InputError, match=r"no location in this log.*1 message other"):
        raw({"_type": "encrypted", "data": "x"})


def test_files_are_known_by_their_content():
    data = line(message(1, 48, 11)).encode()
    assert format_for_reading(Source("a.txt", data=data)).name == "owntracks"
    table = b"2024-05-04T23:00:00Z\t48.1\t11.5\n"
    assert format_for_reading(Source("a.txt", data=table)).name == "csv"
