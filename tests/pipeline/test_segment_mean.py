from __future__ import annotations

import numpy as np
import pytest

import gpszip
from gpszip.errors import OptionError
from gpszip.pipeline import segment_mean as module
from gpszip.testing import patrol


@pytest.fixture(scope="module")
def track():
    return patrol(2000)


def test_many_samples_are_searched_on_a_coreset_and_solved_on_all(track, monkeypatch):
    monkeypatch.setattr(module, "_MAX_SEARCHED", 1000)
    monkeypatch.setattr(module, "_SEARCH_BLOCKS", 100)
    found = gpszip.segment_mean(track, (2, 30), (1, 10))
    on_coreset = gpszip.segment_mean(track, (2, 30), (1, 10), coreset=100)
    on_all = gpszip.segment_mean(track, found.k, found.m)
    assert (found.k, found.m) == (on_coreset.k, on_coreset.m)
    assert found.costs == on_all.costs


def test_more_parts_than_a_coreset_tells_apart_are_searched_on_all(track, monkeypatch):
    monkeypatch.setattr(module, "_MAX_SEARCHED", 1000)
    monkeypatch.setattr(module, "_SEARCH_BLOCKS", 20)
    signal = module.join_runs(track, None)
    assert module._searched_signal(signal, (2, 11), None) is signal
    assert module._searched_signal(signal, (2, 10), None).coreset is not None


def test_ranges_widen_while_the_elbow_lies_in_their_upper_third(track, monkeypatch):
    monkeypatch.setattr(module, "_MOST_SEGMENTS", 10)
    monkeypatch.setattr(module, "_MOST_DISTINCT", 4)
    narrow = gpszip.segment_mean(track, (1, 10), (1, 4))
    assert (7 < narrow.k <= 10, narrow.m <= 2) == (True, True)
    wide = gpszip.segment_mean(track, (1, 20), (1, 4))
    assert wide.k <= 10
    assert gpszip.segment_mean(track).costs == wide.costs


def test_the_upper_third_of_a_range_begins_after_two_thirds():
    assert [k for k in range(1, 11) if module._in_upper_third(k, (1, 10))] == [8, 9, 10]
    assert not module._in_upper_third(155, (1, 300))


def test_a_range_does_not_go_with_a_bound(track):
    with pytest.raises(OptionError, match="range"):
        gpszip.segment_mean(track, (2, 9), rmse=1.0)


@pytest.mark.parametrize("gap", [0.0, -1.0, np.nan])
def test_a_gap_is_a_duration(track, gap):
    with pytest.raises(OptionError, match="gap is"):
        gpszip.segment_mean(track, 2, 1, gap=gap)
