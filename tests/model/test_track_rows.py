"""Tracks that share arrays."""

import numpy as np
import pytest

from gpszip.errors import TrackError
from gpszip.model import Track
from gpszip.model.track import tracks_from_rows

COUNTS = [3, 1, 2]
TIMES = np.array([0.0, 1.0, 2.0, -5.0, 7.0, 8.0])


def test_shared_tracks_are_those_made_one_by_one():
    positions, speeds = np.arange(12.0).reshape(6, 2), np.arange(6)
    tracks = tracks_from_rows(["a", "b", "c"], COUNTS, TIMES, positions, {"speed": speeds}, None)
    for track, rows in zip(tracks, (slice(0, 3), slice(3, 4), slice(4, 6)), strict=True):
        alone = Track(track.id, TIMES[rows], positions[rows], attributes={"speed": speeds[rows]})
        assert track.times.tolist() == alone.times.tolist()
        assert track.positions.tolist() == alone.positions.tolist()
        assert track.attributes["speed"].tolist() == alone.attributes["speed"].tolist()
        assert not track.times.flags.writeable
        assert vars(track).keys() == vars(alone).keys()
    positions[:] = 0.0
    assert tracks[1].positions.tolist() == [[6.0, 7.0]]


@pytest.mark.parametrize(
    ("row", "time", "problem"), [(2, np.nan, "'a'"), (5, 7.0, "'c'"), (4, np.inf, "'c'")]
)
def test_a_wrong_track_among_many_is_named(row, time, problem):
    times = TIMES.copy()
    times[row] = time
    with pytest.raises(TrackError, match=problem):
        tracks_from_rows(["a", "b", "c"], COUNTS, times, np.zeros((6, 1)), {}, None)


def test_a_track_without_rows_is_named():
    with pytest.raises(TrackError, match="'b'"):
        tracks_from_rows(["a", "b"], [1, 0], [0.0], [[0.0]], {}, None)
