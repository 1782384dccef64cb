"""Waypoints of walks on the maps of segment means, by the public functions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gpszip
from gpszip.testing import patrol


@pytest.fixture(scope="module")
def mapped():
    track = patrol(3000)
    mean = gpszip.segment_mean(track, k=40, m=12)
    return track, mean, gpszip.make_map(mean), gpszip.build_walk(mean, track)


@pytest.mark.parametrize("bisection", [False, True])
def test_waypoints_give_the_walk_back(mapped, bisection):
    _, _, segment_map, walk = mapped
    found = gpszip.find_waypoints(segment_map.road_map, walk, bisection=bisection)
    back = gpszip.expand_waypoints(segment_map.road_map, found)
    assert back.tolist() == walk.nodes.tolist()
    assert len(found) < len(walk.nodes)


def test_longest_prefixes_need_the_fewest(mapped):
    _, _, segment_map, walk = mapped
    fewest, halved = (
        gpszip.find_waypoints(segment_map.road_map, walk, bisection=bisection)
        for bisection in (False, True)
    )
    assert len(fewest) <= len(halved)


def test_a_walk_of_another_map_is_refused(mapped):
    _, _, segment_map, walk = mapped
    turned = replace(walk, nodes=walk.nodes[::-1].copy())
    with pytest.raises(gpszip.OptionError, match="none on this map"):
        gpszip.find_waypoints(segment_map.road_map, turned)


def test_the_map_counts_the_steps_of_the_walk(mapped):
    _, mean, segment_map, _ = mapped
    assert segment_map.traversals.tolist() == np.bincount(mean.labels, minlength=12).tolist()
    assert segment_map.passages.sum() == mean.k - 1


def test_runs_are_joined_by_gaps_only(mapped):
    track, *_ = mapped
    times = track.times + np.where(np.arange(len(track)) < 1500, 0.0, 1e4)
    broken = gpszip.Track("broken", times, track.positions)
    mean = gpszip.segment_mean(broken, k=20, m=8, gap=60.0)
    segment_map, walk = gpszip.make_map(mean), gpszip.build_walk(mean, broken)
    assert walk.gaps.sum() == 1
    assert segment_map.passages.sum() == 18
    waypoints = gpszip.find_waypoints(segment_map.road_map, walk)
    back = gpszip.expand_waypoints(segment_map.road_map, waypoints)
    assert back.tolist() == walk.nodes.tolist()
    # the position at each sample is that of the segment mean
    before = np.searchsorted(walk.times, times, side="right") - 1
    after = np.minimum(before + 1, len(walk.times) - 1)
    nodes = segment_map.road_map.nodes[walk.nodes]
    steps = np.where(after > before, walk.times[after] - walk.times[before], 1.0)
    share = ((times - walk.times[before]) / steps)[:, None]
    positions = nodes[before] + share * (nodes[after] - nodes[before])
    assert np.square(positions - track.positions).sum() == pytest.approx(mean.cost, rel=1e-4)
