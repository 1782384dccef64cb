"""Positions of frames by transforms, beside SciPy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from gpszip.errors import InputError, OptionError
from gpszip.io.large.store import store_logs
from gpszip.io.logs.read import read_logs
from gpszip.io.logs.ros.transforms import Link, LinkTransforms, compose, find_chain
from random_tests import examples
from ros_bags import START, bags, write_bag

#: Where a camera is on the robot.
CAMERA = ((0.1, 0.2, 0.3), Rotation.from_euler("xyz", [10, 20, 30], degrees=True))


def random_moves(n, seed, step):
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.integers(1, 2 * step, n)) * 1_000_000
    positions = np.cumsum(rng.normal(0, 0.1, (n, 3)), axis=0)
    turns = Rotation.from_rotvec(np.cumsum(rng.normal(0, 0.05, (n, 3)), axis=0))
    return times, positions, turns


ODOM = random_moves(60, 1, 100)
BASE = random_moves(300, 2, 20)


def tree(m):
    """Map -> odom -> base_link -> camera, and map -> dock."""
    yield (
        "/tf_static",
        START,
        m.transforms(
            m.transform(0, CAMERA[0], CAMERA[1].as_quat(), "base_link", "camera"),
            m.transform(0, (5, 6, 0), (0, 0, 0, 1), "map", "dock"),
        ),
    )
    moves = []
    for (times, positions, turns), frames in (
        (ODOM, ("map", "odom")),
        (BASE, ("odom", "base_link")),
    ):
        for t, p, q in zip(times.tolist(), positions, turns.as_quat(), strict=True):
            # Two signs of a quaternion mean the same.
            sign = -1 if t % 3 else 1
            moves.append((t, m.transform(START + t, p, sign * q, *frames)))
    for t, move in sorted(moves, key=lambda item: item[0]):
        yield "/tf", START + t, m.transforms(move)


def at(moves, times):
    """Positions and rotations by SciPy, interpolated."""
    t, p, r = moves
    position = np.stack([np.interp(times, t, axis) for axis in p.T], axis=1)
    return position, Slerp(t, r)(times)


def expected():
    """Times, positions and rotations of the camera in the map."""
    times = BASE[0][(BASE[0] >= ODOM[0][0]) & (BASE[0] <= ODOM[0][-1])]
    p1, r1 = at(ODOM, times)
    p2, r2 = at(BASE, times)
    position = p1 + r1.apply(p2 + r2.apply(CAMERA[0]))
    return times, position, r1 * r2 * CAMERA[1]


@bags
@pytest.mark.parametrize("rows", [1 << 17, 40])
def test_transforms_are_composed_as_scipy_does_it(tmp_path, kind, rows, monkeypatch):
    monkeypatch.setattr("gpszip.io.logs.ros.frames._BATCH_ROWS", rows)
    path = write_bag(tmp_path / "log", kind, tree)
    result = read_logs(str(path), frame="map:camera", keep=("qx", "qy", "qz", "qw"))
    (track,) = result
    times, positions, turns = expected()
    assert track.times.tolist() == [(START + t) / 10**9 for t in times.tolist()]
    # Seconds of 64 bits are 2.4e-7 apart, in which the robot moves by less than 1e-6 m.
    np.testing.assert_allclose(track.positions, positions, atol=1e-5)
    kept = np.stack([track.attributes[name] for name in ("qx", "qy", "qz", "qw")], axis=1)
    assert (Rotation.from_quat(kept) * turns.inv()).magnitude().max() < 1e-5
    dropped = [repair.count for repair in result.repairs if repair.drops]
    assert dropped == [len(BASE[0]) - len(times)]
    with store_logs(str(path), rows=1000, frame="map:camera") as log:
        assert np.array_equal(log.read(log.tracks[0]).positions, track.positions)


@bags
def test_the_way_may_lead_up_and_down(tmp_path, kind):
    path = write_bag(tmp_path / "log", kind, tree)
    (track,) = read_logs(str(path), frame="/dock:camera")
    np.testing.assert_allclose(track.positions, expected()[1] - [5, 6, 0], atol=1e-5)
    # The dock as the camera sees it.
    (seen,) = read_logs(str(path), frame="camera:dock")
    _, position, turn = expected()
    np.testing.assert_allclose(seen.positions, turn.inv().apply([5, 6, 0] - position), atol=1e-4)


@bags
@pytest.mark.parametrize(
    ("frame", "reason"),
    [
        ("map:robot", "has no frame 'robot'; its frames: .*base_link"),
        ("base_link:camera", "all transforms between 'base_link' and 'camera' are static"),
    ],
)
def test_frames_that_give_no_track_are_refused(tmp_path, kind, frame, reason):
    path = write_bag(tmp_path / "log", kind, tree)
    with pytest.raises(InputError, match=reason):
        read_logs(str(path), frame=frame)


@pytest.mark.parametrize("frame", ["map", "map:", "map:odom:base", "map:map", ":"])
def test_two_frames_have_to_be_named(tmp_path, frame):
    path = write_bag(tmp_path / "log", "mcap", tree)
    with pytest.raises(OptionError, match="there have to be two frames"):
        read_logs(str(path), frame=frame)


def test_a_bag_without_transforms_names_the_other_option(tmp_path):
    path = write_bag(tmp_path / "a", "bag", lambda m: [("/odom", START, m.odometry(1, (0, 0, 0)))])
    with pytest.raises(InputError, match=r"has no transforms.*--topic"):
        read_logs(str(path), frame="map:base_link")


@bags
def test_transforms_alone_suggest_frames(tmp_path, kind):
    path = write_bag(tmp_path / "log", kind, tree)
    with pytest.raises(InputError, match=r"but there are transforms; .*--frame map:base_link"):
        read_logs(str(path))
    with pytest.raises(InputError, match=r"topic '/tf' holds transforms; .*--frame map:base_link"):
        read_logs(str(path), topics="/tf")


@bags
def test_frames_of_two_robots_are_not_mixed(tmp_path, kind):
    def make(m):
        for i in range(100):
            ns = START + i * 10**8
            yield "/a/tf", ns, m.transforms(m.transform(ns, (i, 0, 0)))
            yield "/b/tf", ns, m.transforms(m.transform(ns, (0, i, 0)))

    path = write_bag(tmp_path / "log", kind, make)
    with pytest.raises(InputError, match="map -> odom are on several topics: /a/tf, /b/tf"):
        read_logs(str(path), frame="map:odom")
    (track,) = read_logs(str(path), frame="map:odom", topics="/b/tf")
    assert track.positions[:, 1].tolist() == list(range(100))


@bags
def test_odd_transforms_are_counted(tmp_path, kind):
    def make(m):
        for i in range(100):
            ns = START + i * 10**8
            q = (0, 0, 0, 0) if i == 7 else (0, 0, 0, 2)
            p = {8: (np.nan, 0, 0), 9: (1e300, 0, 0)}.get(i, (i, 0, 0))
            yield "/tf", ns, m.transforms(m.transform(ns, p, q))
            yield "/tf", ns, m.transforms(m.transform(ns, p, q))
        yield "/tf", ns + 1, m.transforms(m.transform(ns, (5, 5, 5)))

    result = read_logs(str(write_bag(tmp_path / "log", kind, make)), frame="map:odom")
    expected = [i for i in range(100) if i not in (7, 8, 9)]
    assert result[0].positions[:, 0].tolist() == expected
    assert {repair.what: repair.count for repair in result.repairs} == {
        "transforms that are not numbers left out": 6,
        "transforms that differ from one of the same time left out": 1,
    }


# The tree


@pytest.mark.parametrize(
    ("parents", "reason"),
    [
        ({"b": ["a"], "a": ["b"]}, "transforms go in a circle: a -> b -> a"),
        ({"a": ["a"], "b": ["a"]}, "transforms go in a circle: a -> a"),
        ({"b": ["a", "c"]}, "frame 'b' has several parents: a, c"),
        ({"a": ["m"], "b": ["n"]}, "no transform connects 'a' and 'b'.*'m'.*'n'"),
    ],
)
def test_trees_that_are_none_are_refused(parents, reason):
    with pytest.raises(InputError, match=reason):
        find_chain(parents, "a", "b", "log")


@examples(100)
@given(st.lists(st.integers(0, 10**6), min_size=1, max_size=12), st.data())
def test_chains_lead_from_frame_to_frame(numbers, data):
    # Frame i + 1 has a parent among the frames before.
    parents = {str(i + 1): [str(number % (i + 1))] for i, number in enumerate(numbers)}
    frames = [str(i) for i in range(len(numbers) + 1)]
    start, end = data.draw(st.lists(st.sampled_from(frames), min_size=2, max_size=2, unique=True))
    here, seen = start, {start}
    for link in find_chain(parents, start, end, "log"):
        assert parents[link.child] == [link.parent]
        assert here == (link.parent if link.is_down else link.child)
        here = link.child if link.is_down else link.parent
        assert here not in seen
        seen.add(here)
    assert here == end


@examples(60)
@given(st.integers(0, 2**32 - 1), st.booleans(), st.booleans())
def test_composition_is_that_of_scipy(seed, first_down, second_down):
    rng = np.random.default_rng(seed)
    chain = [Link("a", "b", first_down), Link("b", "c", second_down)]
    transforms, together = {}, None
    times = np.sort(rng.uniform(0, 1, 5))
    for link in chain:
        t = np.append(0.0, np.cumsum(rng.uniform(0.1, 1, 6)))
        t /= t[-1]
        p, q = rng.normal(0, 3, (7, 3)), rng.normal(0, 1, (7, 4))
        q /= np.linalg.norm(q, axis=1)[:, None]
        transforms[link] = LinkTransforms(t, p, q, is_static=False)
        position, turn = at((t, p, Rotation.from_quat(q)), times)
        if not link.is_down:
            turn = turn.inv()
            position = -turn.apply(position)
        if together is None:
            together = position, turn
        else:
            together = together[0] + together[1].apply(position), together[1] * turn
    positions, turns = compose(chain, transforms, times)
    np.testing.assert_allclose(positions, together[0], atol=1e-9)
    assert (Rotation.from_quat(turns) * together[1].inv()).magnitude().max() < 1e-6
