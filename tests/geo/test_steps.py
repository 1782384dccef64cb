"""Steps of many tracks."""

import numpy as np
import pytest

from gpszip.geo.steps import group_medians, steps_between


@pytest.mark.parametrize("seed", range(20))
def test_steps_and_medians_are_those_of_each_track(seed):
    rng = np.random.default_rng(seed)
    longest = (8, 4000)[seed % 2]
    tracks = [rng.normal(0, 9, int(n)) for n in rng.integers(1, longest, int(rng.integers(1, 9)))]
    steps = steps_between(tracks)
    assert steps.tolist() == np.concatenate([np.diff(track) for track in tracks]).tolist()
    positions = [np.stack([track, -track], axis=1) for track in tracks]
    assert np.array_equal(steps_between(positions), np.stack([steps, -steps], axis=1))
    medians = group_medians(np.concatenate(tracks), [len(track) for track in tracks])
    assert medians.tolist() == [float(np.median(track)) for track in tracks]
