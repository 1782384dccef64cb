import builtins

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, find, given, settings

from gpszip.errors import MissingExtraError
from gpszip.testing import strategies

quick = settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.too_slow])
#: Any example will do; shrinking it would take most of the time.
search = settings(max_examples=5000, deadline=None, database=None, phases=[Phase.generate])


@quick
@given(strategies.tracks(dimension=3, min_points=2, max_points=9))
def test_tracks_respect_bounds(track):
    assert track.dimension == 3
    assert 2 <= len(track) <= 9


@quick
@given(strategies.track_lists(max_tracks=3))
def test_tracks_of_a_list_have_different_names(tracks):
    assert 1 <= len(tracks) <= 3
    assert len({track.id for track in tracks}) == len(tracks)


@quick
@given(strategies.geographic_logs())
def test_geographic_logs_have_valid_degrees(log):
    times, degrees = log
    assert (np.diff(times) > 0).all()
    assert (np.abs(degrees[:, 0]) <= 89).all()
    assert ((degrees[:, 1] >= -180) & (degrees[:, 1] < 180)).all()


@pytest.mark.parametrize(
    "wanted",
    [
        lambda track: len(track) == 1,
        lambda track: len(track) > 5 and (np.diff(track.positions, axis=0) == 0).all(),
        lambda track: track.times[0] > 1e9,
        lambda track: len(track) > 5 and np.diff(track.times).max() > 3600,
        lambda track: len(track) > 2 and np.abs(np.diff(track.positions, axis=0)).max() > 5000,
    ],
    ids=["one point", "stand-still", "epoch seconds", "gap", "jump"],
)
def test_tracks_include_awkward_ones(wanted):
    assert wanted(find(strategies.tracks(dimension=2), wanted, settings=search))


def test_geographic_logs_include_the_antimeridian():
    def crosses(log):
        return len(log[1]) > 1 and np.ptp(log[1][:, 1]) > 300

    assert crosses(find(strategies.geographic_logs(), crosses, settings=search))


def test_missing_hypothesis_names_the_extra(monkeypatch):
    real = builtins.__import__

    def missing(name, *args, **kwargs):
        if name.startswith("hypothesis"):
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(MissingExtraError, match=r"gpszip\[testing\]"):
        strategies.tracks()
