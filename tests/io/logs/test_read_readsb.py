import gzip
import io
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError
from gpszip.io.logs.formats import format_for_reading
from gpszip.io.logs.raw import Request
from gpszip.io.logs.read import read_logs
from gpszip.io.logs.readsb import read_readsb
from gpszip.io.storage.source import Source

START = 1714780800.123


def entry(offset, lat, lon, alt=30_000, speed=480.0, course=90.0, flags=0, climb=-64):
    return [offset, lat, lon, alt, speed, course, flags, climb, None, "adsb_icao", 30_500]


def trace(*entries, icao="3c6444", **more):
    return {"icao": icao, "r": "D-AIBD", "timestamp": START, "trace": list(entries), **more}


def raw(*traces, **request):
    data = "\n".join(map(json.dumps, traces)).encode()
    return read_readsb(Source("trace_full_3c6444.json", data=data), Request(**request))


@given(
    st.lists(
        st.tuples(
            st.floats(0, 86_400),
            st.floats(-90, 90),
            st.floats(-180, 180),
            st.none() | st.just("ground") | st.integers(-1000, 60_000),
            st.none() | st.floats(0, 600),
            st.none() | st.floats(0, 360),
            st.integers(0, 15),
        ),
        min_size=1,
    )
)
def test_positions_and_legs_are_those_of_a_plain_reader(rows):
    log = raw(trace(*(entry(*row) for row in rows)), keep=("alt", "speed", "course", "ground"))
    leg = 1
    for i, (offset, lat, lon, alt, speed, course, flags) in enumerate(rows):
        leg += bool(flags & 2 and i)
        assert log.times[i] == pytest.approx(START + offset, abs=1e-3)
        assert log.coordinates[i].tolist() == [lat, lon]
        assert log.ids[log.codes[i]] == ("3c6444" if leg == 1 else f"3c6444-{leg}")

        # Missing values, and the altitude on the ground, are none.
        metres = alt * 0.3048 if isinstance(alt, int) else np.nan
        expected = (metres, (speed or 0) * 1852 / 3600 if speed is not None else np.nan)
        found = [log.attributes[name][i] for name in ("alt", "speed")]
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-4)
        assert log.attributes["ground"][i] == (alt == "ground")
        assert np.isnan(log.attributes["course"][i]) == (course is None)


def test_a_file_may_hold_several_traces():
    first, second = trace(entry(0, 48, 11)), trace(entry(5, 49, 12), icao="~2a3b4c")
    log = raw(first, {**second, "timestamp": 10.0}, first)
    assert log.ids == ("3c6444", "~2a3b4c", "3c6444-2")
    assert log.times.tolist() == [START, 15, START]


def test_gzipped_traces_are_known_by_their_content():
    data = gzip.compress(json.dumps(trace(entry(0, 48, 11), entry(9, 48.1, 11))).encode())
    assert format_for_reading(Source("trace_full_3c6444.json", data=data)).name == "readsb"
    assert len(read_logs(io.BytesIO(data)).tracks[0]) == 2
    other = b'{"icao": "x", "type": "FeatureCollection", "features": []}'
    assert format_for_reading(Source("a.json", data=other)).name == "geojson"


@pytest.mark.parametrize("bad", [[1, 2], "x", None, {}])
def test_entries_that_are_none_are_dropped_and_counted(bad):
    log = raw(trace(entry(0, 48, 11), bad, entry(1, 48, 11)))
    assert [(repair.count, repair.drops) for repair in log.repairs] == [(1, True)]
    assert len(log.times) == 2


def test_numbers_of_other_types_are_none():
    log = raw(trace(entry("1", True, 10**400), entry(1, None, [], {}, "x", [], "2", {})))
    assert np.isnan(log.coordinates).all()
    assert log.ids == ("3c6444",)


@pytest.mark.parametrize("start", [None, "x", {}])
def test_a_trace_without_its_time_is_refused(start):
    with pytest.raises(InputError, match="a trace without its timestamp"):
        raw({**trace(entry(0, 48, 11)), "timestamp": start})
    with pytest.raises(InputError, match="no position in this trace"):
        raw(trace())


def test_a_trace_that_is_cut_short_is_refused():
    data = json.dumps(trace(entry(0, 48, 11))).encode()[:-9]
    with pytest.raises(InputError, match="damaged JSON file: it is cut short"):
        read_readsb(Source("a", data=data), Request())
