"""Logs of robots on the command line."""

import json
import sys

import numpy as np
import pytest


def loop(n=400):
    """Times and positions of a robot that circles, with a little noise."""
    t = np.arange(n) / 10
    rng = np.random.default_rng(1)
    x, y = 20 * np.cos(t / 4), 20 * np.sin(t / 4)
    return t, np.stack([x, y, 0 * t + 0.5], axis=1) + rng.normal(0, 0.02, (n, 3))


@pytest.fixture
def tum_log(tmp_path):
    t, p = loop()
    path = tmp_path / "loop.tum"
    np.savetxt(path, np.column_stack([t, p, 0 * p, 0 * t + 1]), fmt="%.6f")
    return path


@pytest.fixture
def kitti_log(tmp_path):
    _, p = loop()
    path = tmp_path / "00.txt"
    eye = np.broadcast_to(np.eye(3), (len(p), 3, 3))
    np.savetxt(path, np.concatenate([eye, p[:, :, None]], axis=2).reshape(-1, 12), fmt="%.6f")
    return path


def test_a_tum_log_comes_back_as_tum(gpszip, tum_log):
    done = gpszip("compress", tum_log, "--rmse", "10cm", "--effort", "1", "--json")
    assert done.code == 0, done.err
    assert json.loads(done.out)["points"] == 400
    archive = tum_log.with_suffix(".gpsz")
    done = gpszip("decompress", archive, "-o", "back.tum", "--every", "1s")
    assert done.code == 0, done.err
    back = np.loadtxt(tum_log.parent / "back.tum")
    t, p = loop()
    expected = np.stack([np.interp(back[:, 0], t, axis) for axis in p.T], axis=1)
    assert np.sqrt(((back[:, 1:4] - expected) ** 2).sum(axis=1).mean()) < 0.15
    np.testing.assert_allclose(np.linalg.norm(back[:, 4:], axis=1), 1, atol=1e-8)


def test_kitti_needs_times_and_says_how(gpszip, kitti_log):
    done = gpszip("compress", kitti_log, "-o", "a.gpsz")
    assert done.code == 1
    assert "--times FILE" in done.err
    assert "--rate 10" in done.err
    fast = ("--rmse", "10cm", "--effort", "1", "--force", "--json")
    done = gpszip("compress", kitti_log, "-o", "a.gpsz", "--rate", "10", *fast)
    assert done.code == 0, done.err
    (kitti_log.parent / "times.txt").write_text("".join(f"{t}\n" for t in loop()[0]))
    times = kitti_log.parent / "times.txt"
    done = gpszip("compress", kitti_log, "-o", "b.gpsz", "--times", times, *fast)
    assert done.code == 0, done.err
    first, second = ((kitti_log.parent / f"{name}.gpsz").read_bytes() for name in "ab")
    assert first == second
    done = gpszip("compress", kitti_log, "-o", "a.gpsz", "--no-times", *fast)
    assert done.code == 0, done.err


@pytest.mark.parametrize("folder", ["MH_01", "MH_01/mav0"])
def test_the_folder_of_a_euroc_sequence_is_a_log(gpszip, tmp_path, folder):
    file = tmp_path / "MH_01/mav0/state_groundtruth_estimate0/data.csv"
    file.parent.mkdir(parents=True)
    t, p = loop()
    rows = [f"{round(1e9 * a)},{x},{y},{z}" for a, (x, y, z) in zip(t, p, strict=True)]
    file.write_text("\n".join(["#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m]", *rows]))
    done = gpszip("compress", tmp_path / folder, "--rmse", "10cm", "--effort", "1", "--json")
    assert done.code == 0, done.err
    assert json.loads(done.out)["points"] == 400
    assert (tmp_path / f"{folder}.gpsz").exists()


@pytest.mark.parametrize(
    ("command", "more"),
    [
        ("compress", ()),
        ("coreset", ("--size", "4")),
        ("match", ("--network", "roads.geojson")),
        ("patch", ("--network", "roads.geojson")),
    ],
)
def test_options_of_other_formats_are_refused_by_every_command(gpszip, tum_log, command, more):
    done = gpszip(command, tum_log, "-o", "out.csv", "--rate", "10", *more)
    assert done.code != 0
    assert "loop.tum: --rate is not for tum" in done.err


@pytest.fixture
def bag(tmp_path):
    """A folder of ROS 2 with two topics of poses and a tree of frames."""
    from ros_bags import START, write_bag

    def make(m):
        for t, p in zip(*loop(), strict=True):
            ns = START + round(t * 1e9)
            yield "/odom", ns, m.odometry(ns, p)
            yield "/pose", ns, m.pose_stamped(ns, p)
            yield "/tf", ns, m.transforms(m.transform(ns, p))

    return write_bag(tmp_path / "run", "mcap", make)


def test_a_bag_is_compressed_and_shown(gpszip, bag):
    fast = ("--rmse", "10cm", "--effort", "1", "--json")
    done = gpszip("compress", bag, *fast)
    assert done.code == 1
    assert "2 topics hold poses: /odom (nav_msgs/Odometry, 400 messages)" in done.err
    assert "--topic /odom" in done.err
    done = gpszip("compress", bag, "--topic", "/odom", *fast)
    assert done.code == 0, done.err
    assert json.loads(done.out)["points"] == 400
    for choice in (("--topic", "/odom"), ("--frame", "map:odom")):
        done = gpszip("view", f"{bag}.gpsz", "--raw", bag, *choice, "--force", "--json")
        assert done.code == 0, done.err


def test_frames_and_topics_are_the_same_larger_than_memory(gpszip, bag):
    fast = ("--rmse", "10cm", "--effort", "1", "--quiet")
    whole = gpszip("compress", bag, "--frame", "map:odom", "-o", "a.gpsz", *fast)
    small = gpszip("compress", bag, "--topic", "/pose", "-o", "b.gpsz", "--memory", "1GiB", *fast)
    assert (whole.code, small.code) == (0, 0), whole.err + small.err
    first, second = ((bag.parent / f"{name}.gpsz").read_bytes() for name in "ab")
    assert first == second


def test_other_formats_refuse_topics_and_frames(gpszip, tum_log):
    done = gpszip("compress", tum_log, "--topic", "/odom")
    assert "--topic is not for tum; leave it out; it is for ros" in done.err
    assert done.code != 0


def test_the_extra_is_named_where_it_is_missing(gpszip, bag, monkeypatch):
    # Python refuses to import a module that is None, also one that was imported before.
    files = bag, next(bag.glob("*.mcap"))
    for name in ("rosbags", "mcap", *sys.modules):
        if name.partition(".")[0] in ("rosbags", "mcap"):
            monkeypatch.setitem(sys.modules, name, None)
    for file in files:
        done = gpszip("compress", file, "-o", "a.gpsz")
        assert done.code != 0
        assert "needs the extra 'ros': pip install 'gpszip[ros]'" in done.err
