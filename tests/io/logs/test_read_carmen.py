import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError
from gpszip.io.logs.carmen import read_carmen
from gpszip.io.logs.formats import format_for_reading
from gpszip.io.logs.raw import Request
from gpszip.io.logs.read import read_logs
from gpszip.io.storage.source import Source

START = 976052857.25


def flaser(time, x, y, theta, readings=5):
    ranges = " ".join(["1.23"] * readings)
    return f"FLASER {readings} {ranges} {x} {y} {theta} {x + 1} {y + 1} 0 {time} nohost 0.5"


def odom(time, x, y, theta):
    return f"ODOM {x} {y} {theta} 0.1 0.2 0 {time} nohost 0.5"


def robotlaser(time, x, y, theta, readings=5, remissions=2):
    ranges, more = " ".join(["1.23"] * readings), " ".join(["7"] * remissions)
    return (
        f"ROBOTLASER1 0 -1.57 3.14 0.01 80 0.1 0 {readings} {ranges} {remissions} {more} "
        f"{x + 1} {y + 1} 0 {x} {y} {theta} 0 0 0.1 0.1 1e9 {time} nohost 0.5"
    ).replace("  ", " ")


def raw(*lines, **request):
    data = "\n".join(["# CARMEN Logfile", "PARAM robot_width 0.4 nohost 0", *lines]).encode()
    return read_carmen(Source("robot.log", data=data), Request(**request))


_POSE = st.tuples(
    st.floats(0, 1e6).map(lambda t: START + t),
    st.floats(-1e4, 1e4),
    st.floats(-1e4, 1e4),
    st.floats(-7, 7),
)


@given(
    st.sampled_from([flaser, odom, robotlaser]),
    st.lists(st.tuples(_POSE, st.integers(0, 9)), min_size=1, max_size=20),
)
def test_poses_are_those_of_the_messages(write, poses):
    lines = [
        write(*pose) if write is odom else write(*pose, readings=readings)
        for pose, readings in poses
    ]
    log = raw(*lines, keep=("theta", "heading"))
    expected = np.array([pose for pose, _ in poses])
    found = np.column_stack([log.times, log.coordinates, log.attributes["theta"]])
    assert found.tolist() == expected.tolist()

    # The heading is clockwise from y, the angle counter-clockwise from x.
    heading = np.radians(log.attributes["heading"])
    np.testing.assert_allclose(np.sin(heading), np.cos(expected[:, 3]), rtol=0, atol=1e-7)
    np.testing.assert_allclose(np.cos(heading), np.sin(expected[:, 3]), rtol=0, atol=1e-7)


def test_scans_come_before_odometry_and_the_rest_is_counted(monkeypatch):
    lines = [odom(START, 0, 0, 0), odom(START + 1, 5, 5, 0), flaser(START + 2, 1, 2, 3)]
    for size in (1 << 22, 60):
        monkeypatch.setattr("gpszip.io.logs.text_lines._CHUNK_BYTES", size)
        log = raw(*lines)
        assert log.coordinates.tolist() == [[1, 2]]
        (repair,) = log.repairs
        assert (repair.what, repair.count) == ("ODOM messages ignored beside FLASER", 2)
        assert not repair.drops


@pytest.mark.parametrize("write", [flaser, odom, robotlaser])
def test_messages_that_lost_words_are_dropped_and_counted(write):
    good = [write(START + i, i, i, 0) for i in range(4)]
    broken = good[0].rsplit(" ", 3)[0]
    log = raw(*good, broken)
    assert [(repair.count, repair.drops) for repair in log.repairs] == [(1, True)]
    assert len(log.times) == 4


def test_scans_without_some_readings_have_no_pose():
    log = raw(flaser(START, 1, 2, 3), flaser(START, 1, 2, 3).replace("1.23 ", "", 1), "FLASER x y")
    assert log.coordinates.tolist() == [[1, 2]]
    assert log.repairs[0].count == 2


def test_messages_of_one_time_are_one_point():
    lines = [flaser(START + i // 2, i // 2, 0, 0) for i in range(20)]
    reading = read_logs(io.BytesIO("\n".join(lines).encode()))
    assert (reading.points, reading.kept) == (20, 10)


def test_values_that_are_no_numbers_are_none():
    log = raw(odom(START, 0, 0, 0), odom(START, "a", 1, 2), odom("now", 1, 1, 2))
    assert np.isnan(log.coordinates[1, 0])
    assert np.isnan(log.times[2])


def test_files_are_known_by_their_content():
    for write in (flaser, odom, robotlaser):
        data = f"# x\nPARAM a b\n{write(START, 0, 0, 0)}\n".encode()
        assert format_for_reading(Source("a.txt", data=data)).name == "carmen"
    assert format_for_reading(Source("a.csv", data=b"ODOM,t\n1,2\n")).name == "csv"
    with pytest.raises(InputError, match="no FLASER, ROBOTLASER1 or ODOM message"):
        raw()
