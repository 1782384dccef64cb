"""Tracks written in TUM's format."""

import io

import numpy as np
import pytest

from gpszip.errors import OutputError
from gpszip.io.logs.read import read_logs
from gpszip.io.logs.write import write_tracks
from gpszip.model import Plane, Track


def written(tracks, **options):
    stream = io.BytesIO()
    write_tracks(tracks, stream, "tum", **options)
    return stream.getvalue().decode()


def table(text):
    header, *lines = text.splitlines()
    assert header == "# timestamp tx ty tz qx qy qz qw"
    return np.array([[float(cell) for cell in line.split(" ")] for line in lines])


@pytest.mark.parametrize("d", [2, 3])
def test_positions_and_times_come_back(d):
    rng = np.random.default_rng(d)
    times = 1.7e9 + np.cumsum(rng.integers(1, 5000, 200)) / 1000
    track = Track("robot", times, rng.integers(-(10**7), 10**7, (200, d)) / 1000)
    text = written([track])
    (back,) = read_logs(io.BytesIO(text.encode()))
    assert back.times.tolist() == times.tolist()
    assert back.positions[:, :d].tolist() == track.positions.tolist()
    if d == 2:
        assert not back.positions[:, 2].any()


def test_the_orientation_is_the_direction_of_travel():
    # At rest, east, at rest, north, west, at rest.
    positions = [[0, 0], [0, 0], [1, 0], [1, 0], [1, 1], [0, 1], [0, 1]]
    rows = table(written([Track("robot", range(7), positions)]))
    yaw = 2 * np.degrees(np.arctan2(rows[:, 6], rows[:, 7]))
    np.testing.assert_allclose(yaw, [0, 0, 0, 90, 180, 180, 180], atol=1e-6)
    assert not rows[:, 4:6].any()
    np.testing.assert_allclose(np.linalg.norm(rows[:, 4:], axis=1), 1, atol=1e-8)


def test_a_track_at_rest_points_along_x():
    rows = table(written([Track("robot", [0, 1], [[5, 5], [5, 5]])]))
    assert rows[:, 4:].tolist() == [[0, 0, 0, 1]] * 2


def test_the_orientation_that_was_kept_is_written():
    quaternion = {"qx": [0.6, 0.0], "qy": [0.0, 0.6], "qz": [0.8, 0.8], "qw": [0.0, 0.0]}
    quaternion = {name: np.array(values) for name, values in quaternion.items()}
    rows = table(written([Track("robot", [0, 1], [[0, 0], [1, 1]], attributes=quaternion)]))
    assert rows[:, 4:].tolist() == [[0.6, 0, 0.8, 0], [0, 0.6, 0.8, 0]]


def test_pieces_of_one_track_follow_each_other():
    pieces = [Track(f"robot/{i}", [i, i + 0.5], [[i, 0], [i + 1, 0]]) for i in range(3)]
    rows = table(written(pieces, pieces={piece.id: "robot" for piece in pieces}))
    assert rows[:, 0].tolist() == [0, 0.5, 1, 1.5, 2, 2.5]


@pytest.mark.parametrize(
    ("tracks", "reason"),
    [
        (
            [Track("a", [0, 1], [[0, 0], [1, 1]]), Track("b", [0, 1], [[0, 0], [1, 1]])],
            "tum holds one track, but there are 'a' and 'b'; write one with --track",
        ),
        (
            [Track("a", [0, 1], [[0, 0], [1, 1]], plane=Plane(((480_000_000, 110_000_000),)))],
            "tum holds metres",
        ),
        (
            [Track("a", [0, 1], [[0, 0], [1, 1]], timed=False)],
            "tum holds times, and the track is a shape",
        ),
    ],
)
def test_what_tum_cannot_hold_is_refused(tracks, reason):
    with pytest.raises(OutputError, match=reason):
        written(tracks)
