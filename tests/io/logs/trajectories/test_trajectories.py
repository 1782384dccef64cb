"""TUM, KITTI and EuRoC, read beside plain NumPy."""

import gzip
import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError, OptionError
from gpszip.io.large.store import store_logs
from gpszip.io.logs.formats import format_for_reading
from gpszip.io.logs.read import read_logs
from gpszip.io.storage.source import Source
from random_tests import examples

START = 1_403_636_579.76


def poses(n=300, seed=0):
    """Times, positions and unit quaternions x, y, z, w of a body that turns at random."""
    rng = np.random.default_rng(seed)
    times = START + np.arange(n) / 20
    positions = np.cumsum(rng.normal(0, 0.2, (n, 3)), axis=0).round(6)
    quaternions = rng.normal(0, 1, (n, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1)[:, None]
    return times, positions, quaternions.round(6)


def matrix(q):
    """The rotation matrix of a quaternion x, y, z, w, as textbooks write it."""
    x, y, z, w = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def headings(forward, right, ahead):
    """Degrees clockwise from an axis, by the axes to the right and ahead; NaN if too steep."""
    east, north = forward[:, right], forward[:, ahead]
    degrees = np.degrees(np.angle(north + 1j * east)) % 360
    return np.where(np.hypot(east, north) < 0.1, np.nan, degrees)


def tum(times, positions, quaternions, separator=" ", header="# time x y z qx qy qz qw\n"):
    rows = np.column_stack([times, positions, quaternions])
    return header + "".join(separator.join(f"{v:.6f}" for v in row) + "\n" for row in rows)


def kitti(positions, quaternions):
    blocks = [np.column_stack([matrix(q), p]) for q, p in zip(quaternions, positions, strict=True)]
    return "".join(" ".join(f"{v:.9e}" for v in block.ravel()) + "\n" for block in blocks)


def euroc(times, positions, quaternions, columns=17):
    names = ["#timestamp [ns]"]
    names += [f"p_RS_R_{axis} [m]" for axis in "xyz"] + [f"q_RS_{axis} []" for axis in "wxyz"]
    names += [f"v_RS_R_{axis} [m s^-1]" for axis in "xyz"]
    names += [f"b_w_RS_S_{axis} [rad s^-1]" for axis in "xyz"]
    names += [f"b_a_RS_S_{axis} [m s^-2]" for axis in "xyz"]
    lines = [",".join(names[:columns])]
    for t, p, q in zip(times, positions, quaternions, strict=True):
        cells = [*p, q[3], *q[:3], *p * 2, *[0.5] * 6][: columns - 1]
        lines.append(",".join([str(round(t * 1e9)), *(f"{v:.6f}" for v in cells)]))
    return "\n".join(lines) + "\n"


def read(text, **options):
    data = text if isinstance(text, bytes) else text.encode()
    return read_logs(io.BytesIO(data), **options)


def stored(tmp_path, text, rows=1000, **options):
    path = tmp_path / "log.txt"
    path.write_text(text)
    with store_logs(str(path), rows=rows, **options) as log:
        return [log.read(track) for track in log.tracks], log.read_result


# TUM


@pytest.mark.parametrize("separator", [" ", ",", "  ", "\t", ", ", ";"])
@pytest.mark.parametrize("header", ["", "# time x y z qx qy qz qw\n", "# by SLAM\n#\n\n"])
def test_tum_is_read_as_numpy_reads_it(separator, header):
    times, positions, quaternions = poses()
    (track,) = read(tum(times, positions, quaternions, separator, header), heading=True)
    assert track.times.tolist() == np.round(times, 6).tolist()
    assert track.positions.tolist() == positions.tolist()
    forward = np.array([matrix(q)[:, 0] for q in quaternions])
    expected = headings(forward, 0, 1)
    assert np.isnan(expected).any()
    np.testing.assert_allclose(track.attributes["heading"], expected, atol=1e-9)


def test_tum_is_the_same_in_batches_and_packed(tmp_path, monkeypatch):
    text = tum(*poses(2000))
    (whole,) = read(gzip.compress(text.encode()), keep=("qw", "qx"))
    monkeypatch.setattr("gpszip.io.logs.trajectories.number_lines._BLOCK_BYTES", 1000)
    (track,), _ = stored(tmp_path, text)
    assert np.array_equal(track.positions, whole.positions)
    assert np.array_equal(track.times, whole.times)
    assert whole.attributes["qw"].tolist() == poses(2000)[2][:, 3].tolist()


def test_damaged_lines_are_dropped_and_counted(tmp_path):
    lines = tum(*poses(100)).splitlines()
    lines[10] = lines[10].rsplit(" ", 1)[0]
    lines[20] += " 5"
    lines[30] = "1403636581.2 oops 1 1 0 0 0 1"
    text = "\n".join(lines)
    result = read(text)
    assert (result.points, result.kept) == (100, 97)
    malformed, unreadable = result.repairs
    assert (malformed.what, malformed.count) == ("rows with too many or too few cells dropped", 2)
    assert (unreadable.count, unreadable.value) == (1, "x 'oops'")
    assert "pose 28" in unreadable.where
    (track,), in_batches = stored(tmp_path, text)
    assert np.array_equal(track.positions, result[0].positions)
    assert in_batches.repairs == tuple(
        type(r)(
            r.what, r.count, r.where.replace("stream", str(tmp_path / "log.txt")), r.drops, r.value
        )
        for r in result.repairs
    )


@pytest.mark.parametrize("factor", [1e3, 1e6, 1e9])
def test_units_of_tums_times_are_found_from_their_size(factor):
    times, positions, quaternions = poses(50)
    text = "".join(
        f"{round(t * factor)} {p[0]} {p[1]} {p[2]} {q[0]} {q[1]} {q[2]} {q[3]}\n"
        for t, p, q in zip(times, positions, quaternions, strict=True)
    )
    (track,) = read(text)
    np.testing.assert_allclose(track.times, times, rtol=0, atol=1e-3)


def test_a_header_in_another_order_is_left_to_the_reader_of_tables():
    times, positions, quaternions = poses(20)
    header = "# t qw qx qy qz z y x\n"
    rows = np.column_stack([times, quaternions[:, [3, 0, 1, 2]], positions[:, ::-1]])
    text = header + "".join(" ".join(map(str, row)) + "\n" for row in rows)
    assert format_for_reading(Source("a.txt", data=text.encode())).name == "csv"
    (track,) = read(text)
    assert track.positions.tolist() == positions.tolist()


@pytest.mark.parametrize(
    "text",
    [
        "t,x,y\n0,0,0\n1,1,1\n",
        "t x y z qx qy qz qw\n0 1 2 3 0 0 0 1\n1 1 2 3 0 0 0 1\n",
        "0 1 2 3 4 5 6 7\n1 2 3 4 5 6 7 8\n",
        "# lat lon t alt qx qy qz qw\n48.1 11.5 0 500 0 0 0 1\n48.2 11.5 10 500 0 0 0 1\n",
        "# t x y z qw qx qy qz\n0 1 2 3 1 0 0 0\n1 1 2 3 1 0 0 0\n",
        "1 2 3 4 5 6 7 8 9 10 11 12\n" * 3,
        "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1]\n1,2,3\n",
        "#timestamp,x,y\n0,0,0\n1,1,1\n",
        "# 2024\n0,0,0\n",
    ],
)
def test_other_tables_stay_tables(text):
    assert format_for_reading(Source("a.txt", data=text.encode())).name == "csv"


def test_columns_that_the_user_names_in_order_make_a_plain_table():
    text = tum(*poses(20), header="").replace(" ", ",")
    (track,) = read(text, columns="-,-,t,x,y,-,-,-", sort=True)
    assert track.positions.shape == (20, 2)
    (chosen,) = read(text, columns="x=x,y=z", heading=True)
    assert chosen.positions.tolist() == poses(20)[1][:, [0, 2]].tolist()
    forward = np.array([matrix(q)[:, 0] for q in poses(20)[2]])
    np.testing.assert_allclose(chosen.attributes["heading"], headings(forward, 0, 2), atol=1e-4)


@examples(60)
@given(
    st.lists(
        st.tuples(*[st.floats(-1e6, 1e6)] * 3, *[st.floats(-1, 1)] * 4).filter(
            lambda row: np.linalg.norm(row[3:]) > 1e-3
        ),
        min_size=2,
        max_size=30,
    ),
    st.sampled_from([" ", ",", "\t"]),
)
def test_any_numbers_come_back_exactly(rows, separator):
    array = np.array(rows)
    array[:, 3:] /= np.linalg.norm(array[:, 3:], axis=1)[:, None]
    lines = [[repr(float(i)), *map(repr, row)] for i, row in enumerate(array.tolist())]
    text = "\n".join(separator.join(line) for line in lines)
    assert format_for_reading(Source("a", data=text.encode() + b"\n")).name == "tum"
    (track,) = read(text + "\n", format="tum", keep=("qx", "qy", "qz", "qw"))
    assert track.positions.tolist() == array[:, :3].tolist()
    kept = np.column_stack([track.attributes[name] for name in ("qx", "qy", "qz", "qw")])
    assert kept.tolist() == array[:, 3:].tolist()


@pytest.mark.parametrize("name", ["tum", "euroc", "kitti"])
@pytest.mark.parametrize("data", [b"\n", b"# nothing\n\n", b"1 2 3\n4 5\n", b"\0\1\2", b"a" * 9])
def test_files_without_poses_are_refused(name, data):
    with pytest.raises(InputError) as caught:
        read(data, format=name, rate=10.0 if name == "kitti" else None)
    assert caught.value.path == "stream"


def test_a_line_without_end_takes_bounded_memory(monkeypatch):
    monkeypatch.setattr("gpszip.io.logs.trajectories.number_lines._BLOCK_BYTES", 1000)
    with pytest.raises(InputError, match="a line is longer than"):
        read(b"1 " * 5000, format="tum")


def test_quaternions_that_are_none_have_no_heading():
    rows = ["0 0 0 0 0 0 0 1", "1 1 0 0 0 0 0 0", "2 2 0 0 1e200 1 1 1", "3 3 0 0 nan 0 0 1"]
    (track,) = read("\n".join(rows), format="tum", heading=True)
    assert track.attributes["heading"][0] == 90
    assert np.isnan(track.attributes["heading"][1:]).all()


# EuRoC


@pytest.mark.parametrize("columns", [4, 8, 17])
def test_euroc_is_read_as_numpy_reads_it(columns, tmp_path):
    times, positions, quaternions = poses()
    text = euroc(times, positions, quaternions, columns)
    (track,) = read(text, heading=True)
    expected = [round(t * 1e9) / 1e9 for t in times]
    assert np.abs(track.times - expected).max() < 1e-6
    assert track.positions.tolist() == positions.tolist()
    if columns == 4:
        assert "heading" not in track.attributes
    else:
        forward = np.array([matrix(q)[:, 0] for q in quaternions])
        np.testing.assert_allclose(track.attributes["heading"], headings(forward, 0, 1), atol=1e-9)
    (again,), _ = stored(tmp_path, text)
    assert np.array_equal(again.positions, track.positions)
    assert np.array_equal(again.times, track.times)


def test_eurocs_other_columns_can_be_kept_and_are_named():
    times, positions, quaternions = poses(30)
    result = read(euroc(times, positions, quaternions), keep=("v_RS_R_y",))
    assert result[0].attributes["v_RS_R_y"].tolist() == (2 * positions[:, 1]).round(6).tolist()
    assert result.dropped_columns[:2] == ("q_RS_w", "q_RS_x")
    with pytest.raises(InputError, match=r"no column 'speed'; columns found: .*p_RS_R_x"):
        read(euroc(times, positions, quaternions), keep=("speed",))


def test_euroc_with_a_short_clock_is_still_in_nanoseconds():
    text = "#timestamp,p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m]\n0,0,0,0\n50000000,1,0,0\n"
    (track,) = read(text)
    assert track.times.tolist() == [0.0, 0.05]


# KITTI


def test_kitti_takes_times_from_a_rate():
    _, positions, quaternions = poses()
    (track,) = read(kitti(positions, quaternions), rate=10.0, heading=True)
    assert track.times.tolist() == [i / 10 for i in range(len(positions))]
    np.testing.assert_allclose(track.positions, positions, atol=1e-8)
    forward = np.array([matrix(q)[:, 2] for q in quaternions])
    np.testing.assert_allclose(track.attributes["heading"], headings(forward, 0, 1), atol=1e-4)


@pytest.mark.parametrize("as_text", [lambda t: f"{t:.6e}", lambda t: f"2011-09-26 13:02:{t:09.6f}"])
def test_kitti_takes_times_from_a_file(tmp_path, as_text, monkeypatch):
    _, positions, quaternions = poses()
    file = tmp_path / "times.txt"
    seconds = np.arange(len(positions)) * 0.1 + 5
    file.write_text("".join(as_text(t) + "\n" for t in seconds))
    text = kitti(positions, quaternions)
    (track,) = read(text, times_file=file)
    np.testing.assert_allclose(track.times - track.times[0], seconds - seconds[0], atol=1e-6)
    monkeypatch.setattr("gpszip.io.logs.trajectories.number_lines._BLOCK_BYTES", 1000)
    (again,), _ = stored(tmp_path, text, times_file=file)
    assert np.array_equal(again.times, track.times)

    # One time too few, or too many.
    for lines in (len(seconds) - 1, len(seconds) + 1):
        file.write_text("".join(f"{t}\n" for t in range(lines)))
        with pytest.raises(InputError, match=rf"poses, but .*times.txt {lines} times"):
            read(text, times_file=file)
        with pytest.raises(InputError, match=rf"poses, but .*times.txt {lines} times"):
            stored(tmp_path, text, times_file=file)


def test_kitti_without_times_names_the_options():
    text = kitti(*poses(20)[1:])
    with pytest.raises(InputError) as caught:
        read(text)
    assert "--times FILE" in caught.value.remedy
    assert "--rate 10" in caught.value.remedy
    (shape,) = read(text, times=False)
    assert not shape.timed


def test_a_damaged_line_of_kitti_is_refused_as_it_would_shift_all_times(tmp_path):
    lines = kitti(*poses(20)[1:]).splitlines()
    lines[12] += " 7"
    for reader in (read, lambda text, **options: stored(tmp_path, text, **options)):
        with pytest.raises(InputError) as caught:
            reader("\n".join(lines), rate=10.0)
        assert caught.value.location == "pose 13"
    lines[12] = lines[12].replace(lines[12].split()[3], "nan", 1).removesuffix(" 7")
    result = read("\n".join(lines), rate=10.0)
    assert result.lost == 1
    assert 1.2 not in result[0].times.tolist()


@pytest.mark.parametrize(
    ("data", "reason"),
    [(b"", "has no times"), (b"1\n2\nfive\n", "'five' is no time"), (None, "no such file")],
)
def test_files_of_times_are_checked(tmp_path, data, reason):
    file = tmp_path / "times.txt"
    if data is not None:
        file.write_bytes(data)
    with pytest.raises(InputError, match=reason) as caught:
        read(kitti(*poses(2)[1:]), times_file=file)
    assert caught.value.path == str(file)


# Options


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rate": 10.0}, "--rate is not for tum"),
        ({"times_file": "t.txt"}, "--times is not for tum"),
        ({"topics": "/odom"}, "--topic is not for tum"),
        ({"frame": "map:base_link"}, "--frame is not for tum"),
        ({"rate": -1.0}, "a rate is above 0"),
        ({"rate": float("inf")}, "a rate is above 0"),
        ({"rate": 1.0, "times_file": "t.txt"}, "--times and --rate were both given"),
    ],
)
def test_options_that_say_nothing_are_refused(options, message):
    with pytest.raises(OptionError, match=message):
        read(tum(*poses(3)), **options)
