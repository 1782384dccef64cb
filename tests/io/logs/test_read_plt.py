import io
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError
from gpszip.io.logs.plt import read_plt
from gpszip.io.logs.raw import Request
from gpszip.io.logs.read import read_logs
from gpszip.io.storage.source import Source
from oracle import plt

START = datetime(2008, 10, 24, 2, 9, 59, tzinfo=UTC)

_POINTS = st.lists(
    st.tuples(
        st.integers(0, 10**8), st.floats(-90, 90), st.floats(-180, 180), st.integers(-777, 9000)
    ),
    min_size=1,
    max_size=20,
)


def raw(text, **request):
    return read_plt(Source("a.plt", data=text.encode()), Request(**request))


@given(_POINTS, st.sampled_from([plt.point, plt.ozi]))
def test_points_are_those_of_a_plain_reader(points, write):
    text = plt.HEADER + "".join(
        write(START + timedelta(seconds=t), *others) for t, *others in points
    )
    log = raw(text, keep=("ele",))
    rows = np.array(plt.read(text))
    np.testing.assert_allclose(log.times, rows[:, 0], rtol=0, atol=1e-3)
    assert log.coordinates.tolist() == rows[:, 1:3].tolist()
    feet = rows[:, 3]
    expected = np.where(feet == -777, np.nan, feet * 0.3048)
    np.testing.assert_allclose(log.attributes["ele"], expected, rtol=0, atol=1e-4)


def test_times_are_whole_seconds_where_the_file_has_them():
    log = raw(plt.HEADER + plt.point(START, 40, 116))
    assert log.times.tolist() == [START.timestamp()]


def test_a_day_of_zero_is_no_time():
    text = plt.HEADER + "".join(plt.point(START + timedelta(seconds=i), 40, 116) for i in range(3))
    reading = read_logs(io.BytesIO((text + "40,116,0,0,0,,\r\n").encode()))
    assert (reading.points, reading.kept) == (4, 3)


def test_lines_that_are_no_points_are_counted():
    text = plt.HEADER + plt.point(START, 40, 116) + "rubbish\r\n\r\n  \r\n" + "x,y,0\r\n"
    log = raw(text)
    assert [(repair.count, repair.value) for repair in log.repairs] == [(1, "rubbish")]
    assert np.isnan(log.coordinates[1]).all()
    with pytest.raises(InputError, match="no point in this track file"):
        raw(plt.HEADER)


@pytest.mark.parametrize("datum", ["Pulkovo 1942 (1)", ""])
def test_other_datums_are_refused(datum):
    with pytest.raises(InputError, match=r"line 2: its datum is .*, not WGS 84"):
        raw(plt.HEADER.replace("WGS 84", datum) + plt.point(START, 40, 116))


def test_chunks_make_no_difference(monkeypatch):
    text = plt.HEADER + "".join(plt.point(START + timedelta(seconds=i), 40, i) for i in range(9))
    expected = raw(text).coordinates.tolist()
    monkeypatch.setattr("gpszip.io.logs.text_lines._CHUNK_BYTES", 150)
    assert raw(text).coordinates.tolist() == expected
