"""Roads of generated logs are closed and slowed as told."""

import numpy as np
import pytest

from gpszip.errors import OptionError
from gpszip.testing import close_road, fleet, ring, slow_road


@pytest.fixture(scope="module")
def vans():
    return fleet(2, lines=1, points=600, blocks=3, seed=2)


def passages(log, road, since=-np.inf, until=np.inf):
    """Times at which passages of a road begin, forward and backward."""
    u, v = log.road_map.edges[road]
    found = [], []
    for walk in log.walks:
        for a, b, time in zip(walk.nodes[:-1], walk.nodes[1:], walk.times[:-1], strict=True):
            if since <= time < until and {a, b} == {u, v}:
                found[int(a == v)].append(time)
    return found


def test_closed_roads_have_no_passages(vans):
    road = int((vans.road_map.forward + vans.road_map.backward).argmax())
    closed = close_road(vans, road, since=1000.0, until=2000.0)
    assert passages(closed, road, 1000.0, 2000.0) == ([], [])
    assert sum(map(len, passages(closed, road, until=1000.0))) == sum(
        map(len, passages(vans, road, until=1000.0))
    )
    assert passages(closed, road, 2000.0) != ([], [])
    one_way = close_road(vans, road, forward=True)
    assert not passages(one_way, road)[0]
    assert passages(one_way, road)[1]

    # Roads that exist, times that grow, and the errors of the samples.
    edges = {tuple(pair) for pair in vans.road_map.edges.tolist()}
    for walk in closed.walks:
        moved = walk.nodes[1:] != walk.nodes[:-1]
        pairs = np.sort(np.stack([walk.nodes[:-1], walk.nodes[1:]], axis=1), axis=1)[moved]
        assert {tuple(pair) for pair in pairs.tolist()} <= edges
        assert (np.diff(walk.times) > 0).all()
    for before, after in zip(vans.errors, closed.errors, strict=True):
        assert after == pytest.approx(before)
    assert (closed.tracks[0].times == vans.tracks[0].times).all()


def test_slow_roads_take_longer(vans):
    road = int((vans.road_map.forward + vans.road_map.backward).argmax())
    slow = slow_road(vans, road, 3.0, since=500.0)
    u, v = vans.road_map.edges[road]
    for before, after in zip(vans.walks, slow.walks, strict=True):
        mine = ((before.nodes[:-1] == u) & (before.nodes[1:] == v)) | (
            (before.nodes[:-1] == v) & (before.nodes[1:] == u)
        )
        ratio = np.diff(after.times) / np.diff(before.times)
        expected = np.where(mine & (after.times[:-1] >= 500.0), 3.0, 1.0)
        assert ratio == pytest.approx(expected)


def test_what_can_not_be_closed(vans):
    with pytest.raises(OptionError, match="no road 9999"):
        close_road(vans, 9999)
    degree = np.bincount(vans.road_map.edges.ravel())
    ends = np.flatnonzero((degree[vans.road_map.edges] == 1).any(axis=1))
    if len(ends):
        with pytest.raises(OptionError, match="no other way"):
            close_road(vans, int(ends[0]))
    assert close_road(ring(4, laps=1), 0).road_map.forward[0] == 0
