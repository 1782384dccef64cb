"""Positions of topics, from bags that the writers of rosbags and mcap made."""

import gzip
import io
import zipfile

import numpy as np
import pytest

from gpszip.errors import InputError, OptionError
from gpszip.io.large.store import store_logs
from gpszip.io.logs.read import read_logs
from ros_bags import START, bags, loop, write_bag, write_json_mcap

#: A quarter turn to the left.
LEFT = (0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5))


def nanoseconds(t):
    return START + round(t * 1e9)


def of_loop(make):
    """Messages of one topic at the positions of the loop."""

    def messages(m):
        for t, p in zip(*loop(), strict=True):
            yield "/robot", nanoseconds(t) + 7_000_000, make(m, nanoseconds(t), p)

    return messages


def both_ways(path, tmp_path=None, **options):
    """Read a log in memory and in batches; both have to be the same."""
    result = read_logs(str(path), **options)
    with store_logs(str(path), rows=1000, **options) as log:
        stored = [log.read(track) for track in log.tracks]
        assert [track.id for track in stored] == [track.id for track in result]
        for track, other in zip(result, stored, strict=True):
            assert np.array_equal(track.times, other.times)
            np.testing.assert_allclose(track.positions, other.positions, atol=1e-7)
        assert log.read_result.repairs == result.repairs
        assert log.read_result.points == result.points
    return result


POSES = {
    "Odometry": lambda m, ns, p: m.odometry(ns, p, LEFT),
    "PoseStamped": lambda m, ns, p: m.pose_stamped(ns, p, LEFT),
    "PoseWithCovarianceStamped": lambda m, ns, p: m.pose_with_covariance(ns, p, LEFT),
    "TransformStamped": lambda m, ns, p: m.transform(ns, p, LEFT),
}


@bags
@pytest.mark.parametrize("name", POSES)
def test_poses_come_back(tmp_path, kind, name):
    path = write_bag(tmp_path / "log", kind, of_loop(POSES[name]))
    result = both_ways(path, keep=("qz",))
    (track,) = result
    t, p = loop()
    assert track.id == "0"
    assert track.times.tolist() == [(START + round(a * 1e9)) / 10**9 for a in t]
    assert track.positions.tolist() == p.tolist()
    assert set(track.attributes["qz"].tolist()) == {LEFT[2]}
    (said,) = result.repairs
    assert name in said.what
    assert said.where.endswith(": /robot")
    (turned,) = read_logs(str(path), heading=True)
    np.testing.assert_allclose(turned.attributes["heading"] % 360, 0, atol=1e-9)


@bags
def test_points_come_back(tmp_path, kind):
    path = write_bag(tmp_path / "log", kind, of_loop(lambda m, ns, p: m.point(ns, p)))
    (track,) = both_ways(path)
    assert track.positions.tolist() == loop()[1].tolist()


@bags
def test_fixes_come_back_and_those_without_a_fix_are_counted(tmp_path, kind):
    def make(m, ns, p):
        return m.fix(ns, 48 + p[1] / 1e5, 11 + p[0] / 1e5, 500 + p[2], -1 if p[2] == 0 else 0)

    result = both_ways(write_bag(tmp_path / "log", kind, of_loop(make)), keep=("ele",))
    (track,) = result
    assert result.geographic
    _, p = loop()
    expected = np.stack([48 + p[1:, 1] / 1e5, 11 + p[1:, 0] / 1e5], axis=1)
    np.testing.assert_allclose(track.coordinates, expected, atol=1e-9)
    assert track.attributes["ele"].tolist() == (500 + p[1:, 2]).tolist()
    lost = [repair for repair in result.repairs if repair.drops]
    assert [(repair.what, repair.count) for repair in lost] == [
        ("positions without a fix dropped", 1)
    ]
    assert (result.points, result.kept) == (200, 199)


@bags
def test_the_last_path_is_read(tmp_path, kind):
    def make(m):
        t, p = loop(50)
        poses = [m.pose_stamped(nanoseconds(a), b) for a, b in zip(t, p, strict=True)]
        for n in range(1, 51):
            yield "/path", nanoseconds(t[n - 1]), m.path(poses[:n])

    result = both_ways(write_bag(tmp_path / "log", kind, make))
    (track,) = result
    assert track.positions.tolist() == loop(50)[1].tolist()
    assert [repair.count for repair in result.repairs if "later one" in repair.what] == [49]


@bags
def test_a_path_without_stamps_is_refused(tmp_path, kind):
    def make(m):
        yield "/path", START, m.path([m.pose_stamped(0, (i, 0, 0)) for i in range(9)])

    path = write_bag(tmp_path / "log", kind, make)
    with pytest.raises(InputError, match="the poses of a path on /path have no stamps"):
        read_logs(str(path))


@bags
def test_stamps_that_are_zero_are_replaced_and_counted(tmp_path, kind):
    def make(m, ns, p):
        return m.odometry(0 if p[2] < 1.0 else ns, p)

    result = both_ways(write_bag(tmp_path / "log", kind, of_loop(make)))
    expected = [ns + 7_000_000 * (i < 100) for i, ns in enumerate(map(nanoseconds, loop()[0]))]
    assert result[0].times.tolist() == [ns / 10**9 for ns in expected]
    zero = [repair for repair in result.repairs if "zero" in repair.what]
    assert [(repair.count, repair.drops) for repair in zero] == [(100, False)]


# Several topics, several agents


def two_topics(m):
    for t, p in zip(*loop(), strict=True):
        yield "/odom", nanoseconds(t), m.odometry(nanoseconds(t), p)
        yield "/amcl_pose", nanoseconds(t), m.pose_with_covariance(nanoseconds(t), p + 1)
        yield "/gps", nanoseconds(t), m.fix(nanoseconds(t), 48.0, 11.0)
        yield "/talk", nanoseconds(t), m.text("hello")


@bags
def test_without_a_choice_the_topics_are_listed(tmp_path, kind):
    path = write_bag(tmp_path / "log", kind, two_topics)
    with pytest.raises(InputError) as caught:
        read_logs(str(path))
    assert "3 topics hold poses: /amcl_pose (geometry_msgs/PoseWithCovarianceStamped, 200 " in str(
        caught.value
    )
    assert "--topic /amcl_pose" in caught.value.remedy


@bags
def test_each_topic_is_a_track(tmp_path, kind):
    path = write_bag(tmp_path / "log", kind, two_topics)
    result = both_ways(path, topics=["odom", "/amcl_pose"])
    assert sorted(track.id for track in result) == ["/amcl_pose", "/odom"]
    positions = {track.id: track.positions.tolist() for track in result}
    assert positions == {"/odom": loop()[1].tolist(), "/amcl_pose": (loop()[1] + 1).tolist()}
    (note,) = [repair for repair in result.repairs if "different frames" in repair.what]
    assert "/odom in 'odom'" in note.what
    assert "/amcl_pose in 'map'" in note.what


@bags
@pytest.mark.parametrize(
    ("topics", "reason"),
    [
        ("/odm", "has no topic '/odm'"),
        ("/talk", "topic '/talk' holds std_msgs/String, which is no pose"),
        (["/odom", "/gps"], "/gps holds latitude and longitude, but /odom metres"),
    ],
)
def test_wrong_choices_are_refused(tmp_path, kind, topics, reason):
    path = write_bag(tmp_path / "log", kind, two_topics)
    with pytest.raises(InputError, match=reason) as caught:
        read_logs(str(path), topics=topics)
    assert caught.value.remedy is not None
    with pytest.raises(InputError, match="no column 'speed'"):
        read_logs(str(path), topics="/odom", keep=("speed",))
    with pytest.raises(OptionError, match="--rate is not for ros"):
        read_logs(str(path), topics="/odom", rate=10.0)


@bags
def test_a_bag_without_poses_lists_its_topics(tmp_path, kind):
    path = write_bag(tmp_path / "log", kind, lambda m: [("/talk", START, m.text("hello"))])
    with pytest.raises(InputError, match=r"no topic holds poses; its topics: /talk \(std_msgs/Str"):
        read_logs(str(path))


@bags
def test_robots_on_one_topic_are_told_apart(tmp_path, kind):
    def make(m):
        for t, p in zip(*loop(), strict=True):
            yield "/odom", nanoseconds(t), m.odometry(nanoseconds(t), p, child="a")
            yield "/odom", nanoseconds(t), m.odometry(nanoseconds(t), p + 5, child="b")

    result = both_ways(write_bag(tmp_path / "log", kind, make))
    assert {track.id: track.positions.tolist() for track in result} == {
        "a": loop()[1].tolist(),
        "b": (loop()[1] + 5).tolist(),
    }
    assert any("tracks of their own: 'a', 'b'" in repair.what for repair in result.repairs)


@bags
def test_a_robot_that_appears_late_is_no_part_of_another(tmp_path, kind, monkeypatch):
    monkeypatch.setattr("gpszip.io.logs.ros.topics._BATCH_ROWS", 50)

    def make(m):
        for t, p in zip(*loop(), strict=True):
            child = "a" if t < 12 else "b"
            yield "/odom", nanoseconds(t), m.odometry(nanoseconds(t), p, child=child)

    path = write_bag(tmp_path / "log", kind, make)
    with pytest.raises(InputError, match="poses of a second frame 'b' begin on /odom"):
        read_logs(str(path))


@bags
def test_frames_of_positions_are_not_mixed(tmp_path, kind):
    def make(m, ns, p):
        return m.pose_stamped(ns, p, frame="map" if p[2] < 1 else "odom")

    path = write_bag(tmp_path / "log", kind, of_loop(make))
    with pytest.raises(InputError, match="positions on /robot are in two frames, 'map' and 'odom'"):
        read_logs(str(path))


@bags
def test_batches_are_joined(tmp_path, kind, monkeypatch):
    monkeypatch.setattr("gpszip.io.logs.ros.topics._BATCH_ROWS", 70)
    path = write_bag(tmp_path / "log", kind, two_topics)
    result = both_ways(path, topics=["/odom", "/amcl_pose"], keep=("qw",))
    assert {track.id: len(track) for track in result} == {"/odom": 200, "/amcl_pose": 200}


# Files


@pytest.mark.parametrize(
    ("kind", "compression"),
    [
        ("bag", "bz2"),
        ("bag", "lz4"),
        ("sqlite", "message"),
        ("sqlite", "file"),
        ("mcap", "message"),
        ("mcap", "file"),
        ("mcap", "storage"),
    ],
)
def test_compressed_bags_are_read(tmp_path, kind, compression):
    path = write_bag(tmp_path / "log", kind, of_loop(POSES["Odometry"]), compression)
    (track,) = both_ways(path)
    assert track.positions.tolist() == loop()[1].tolist()


@bags
def test_files_streams_and_archives_are_read(tmp_path, kind):
    path = write_bag(tmp_path / "log", kind, of_loop(POSES["Odometry"]))
    file = (
        path if kind == "bag" else next(file for file in path.iterdir() if file.suffix != ".yaml")
    )
    odd = tmp_path / "a?b%20#.dat"
    odd.write_bytes(file.read_bytes())
    packed = tmp_path / "log.gz"
    packed.write_bytes(gzip.compress(file.read_bytes()))
    with zipfile.ZipFile(tmp_path / "log.zip", "w") as archive:
        archive.write(file, file.name)
    for source in (file, odd, packed, tmp_path / "log.zip"):
        (track,) = both_ways(source)
        assert track.positions.tolist() == loop()[1].tolist()
    (track,) = read_logs(io.BytesIO(file.read_bytes()))
    assert len(track) == 200


@pytest.mark.parametrize("kind", ["sqlite", "mcap"])
def test_a_folder_in_a_zip_archive_is_read_by_its_files(tmp_path, kind):
    path = write_bag(tmp_path / "log", kind, of_loop(POSES["Odometry"]))
    with zipfile.ZipFile(tmp_path / "log.zip", "w") as archive:
        for file in path.iterdir():
            archive.write(file, f"log/{file.name}")
    result = both_ways(tmp_path / "log.zip")
    assert result[0].positions.tolist() == loop()[1].tolist()
    assert [each.kinds for each in result.other_files] == [((".yaml", 1),)]


@pytest.mark.parametrize("kind", ["sqlite", "mcap"])
def test_a_folder_counts_all_of_its_bytes(tmp_path, kind):
    path = write_bag(tmp_path / "log", kind, of_loop(POSES["Odometry"]))
    for name in (path, path / "metadata.yaml"):
        result = read_logs(str(name))
        assert result.bytes == sum(file.stat().st_size for file in path.iterdir())


@pytest.mark.parametrize("kind", ["sqlite", "mcap"])
def test_a_folder_without_metadata_is_read_by_its_files(tmp_path, kind):
    path = write_bag(tmp_path / "log", kind, of_loop(POSES["Odometry"]))
    (path / "metadata.yaml").unlink()
    result = read_logs(str(path))
    assert [track.positions.tolist() for track in result] == [loop()[1].tolist()]
    assert result.complete


@bags
@pytest.mark.parametrize("share", [0.001, 0.3, 0.6, 0.95, 0.999])
def test_truncated_files_are_refused_with_a_remedy(tmp_path, kind, share):
    path = write_bag(tmp_path / "log", kind, of_loop(POSES["Odometry"]))
    file = (
        path if kind == "bag" else next(file for file in path.iterdir() if file.suffix != ".yaml")
    )
    data = file.read_bytes()
    # The first page of SQLite shows what it is.
    file.write_bytes(data[: max(int(share * len(data)), 5000 if kind == "sqlite" else 20)])
    for name in {file, path}:
        try:
            result = read_logs(str(name))
        except InputError as error:
            assert error.path is not None
            assert error.remedy is not None
        else:
            # The last page of SQLite may hold nothing that is read.
            assert (kind, share, result.kept) == ("sqlite", 0.999, 200)


def test_a_bag_that_was_never_closed_is_refused_with_a_remedy(tmp_path):
    path = write_bag(tmp_path / "log", "bag", of_loop(POSES["Odometry"]))
    data = bytearray(path.read_bytes())
    # The place of the index is 0 until the writer closes the bag.
    at = data.index(b"index_pos=") + len(b"index_pos=")
    data[at : at + 8] = bytes(8)
    path.write_bytes(data)
    with pytest.raises(InputError, match="not indexed") as caught:
        read_logs(str(path))
    assert "rosbag reindex" in caught.value.remedy


def test_a_database_that_was_never_closed_is_refused(tmp_path):
    import sqlite3

    path = write_bag(tmp_path / "log", "sqlite", of_loop(POSES["Odometry"]))
    (file,) = path.glob("*.db3")
    with sqlite3.connect(file) as database:
        database.execute("PRAGMA journal_mode=WAL")
        database.execute("DELETE FROM messages WHERE id > 100")
        database.commit()
        # While it is open, the change is in the file beside it alone.
        for name in (path, file):
            with pytest.raises(InputError, match=r"log\.db3-wal holds messages") as caught:
                read_logs(str(name))
            assert "wal_checkpoint" in caught.value.remedy
    database.close()
    (track,) = read_logs(str(file))
    assert len(track) == 100


@bags
def test_messages_that_cannot_be_decoded_are_counted(tmp_path, kind):
    path = write_bag(tmp_path / "log", kind, of_loop(POSES["Odometry"]))
    file = (
        path if kind == "bag" else next(file for file in path.iterdir() if file.suffix != ".yaml")
    )
    # The length of the second frame's name.
    data = file.read_bytes()
    at = data.index(b"base_link")
    file.write_bytes(data[: at - 4] + b"\xff\xff\xff\x7f" + data[at:])
    try:
        result = read_logs(str(path))
    # MCAP has checksums, which find the change first.
    except InputError as error:
        assert error.remedy is not None
        return
    assert (result.points, result.kept) == (200, 199)
    assert any("can't be decoded" in repair.what for repair in result.repairs)


# MCAP without ROS


def json_rows():
    for t, p in zip(*loop(), strict=True):
        stamp = {"sec": nanoseconds(t) // 10**9, "nsec": nanoseconds(t) % 10**9}
        pose = {
            "position": dict(zip("xyz", p.tolist(), strict=True)),
            "orientation": {"x": 0, "y": 0, "z": 0, "w": 1},
        }
        row = {"timestamp": stamp, "frame_id": "map", "pose": pose}
        yield "/pose", "foxglove.PoseInFrame", nanoseconds(t), row
        row = {"timestamp": stamp, "latitude": 48 + p[0] / 1e5, "longitude": 11 + p[1] / 1e5}
        yield "/fix", "foxglove.LocationFix", nanoseconds(t), row


@pytest.mark.parametrize("finished", [True, False])
def test_mcap_of_json_is_read(tmp_path, finished):
    path = write_json_mcap(tmp_path / "log.mcap", json_rows(), finished=finished)
    if not finished:
        with pytest.raises(InputError, match="mcap recover"):
            read_logs(str(path), topics="/pose")
        return
    (track,) = both_ways(path, topics="/pose")
    assert track.positions.tolist() == loop()[1].tolist()
    assert track.times[1] == nanoseconds(loop()[0][1]) / 10**9
    (fix,) = both_ways(path, topics="/fix")
    expected = np.array([48, 11]) + loop()[1][:, :2] / 1e5
    np.testing.assert_allclose(fix.coordinates, expected, atol=1e-9)


@pytest.mark.parametrize(
    "message",
    [
        {},
        [],
        3,
        None,
        {"latitude": "x", "longitude": 1},
        {"latitude": 1, "timestamp": [1]},
        {"latitude": 1, "longitude": 1, "timestamp": {"sec": 10**400}},
        {"latitude": 10**400, "longitude": 1},
    ],
)
def test_json_that_is_no_position_is_counted(tmp_path, message):
    rows = [*json_rows(), ("/fix", "foxglove.LocationFix", START + 10**12, message)]
    result = both_ways(write_json_mcap(tmp_path / "log.mcap", rows), topics="/fix")
    assert (result.points, result.kept) == (201, 200)
