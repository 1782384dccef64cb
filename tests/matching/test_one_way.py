"""Travel against one-way roads, seen from outside: what is matched, what is not, and why."""

import math

import numpy as np
import pytest

from gpszip.errors import InputError
from gpszip.matching.match import match
from gpszip.matching.patch import patch
from gpszip.model import Network, Track

#: Length of a block of the town in metres, and its number of blocks in a row.
BLOCK, BLOCKS = 100.0, 6


def network(nodes, pairs, forward=None, backward=None, names=None):
    nodes, pairs = np.array(nodes, float), np.array(pairs, np.int32).reshape(-1, 2)
    both = np.ones(len(pairs), bool)
    ways = (
        both if forward is None else np.array(forward),
        both if backward is None else np.array(backward),
    )
    offsets = 2 * np.arange(len(pairs) + 1)
    speeds = np.full(len(pairs), np.nan)
    return Network(
        nodes,
        pairs[:, 0].copy(),
        pairs[:, 1].copy(),
        offsets,
        nodes[pairs.ravel()],
        *ways,
        speeds,
        names=names,
    )


def along(corners, speed=10.0, period=1.0, noise=0.0, seed=0):
    corners = np.array(corners, float)
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
    times = np.arange(0, way[-1] / speed + 1e-9, period)
    places = np.stack([np.interp(speed * times, way, axis) for axis in corners.T], axis=1)
    return Track(
        "car", times, places + np.random.default_rng(seed).normal(0, 1, places.shape) * noise
    )


def town():
    """Streets of which only the middle one, at y = 300, is one-way: eastwards."""
    n = BLOCKS + 1
    nodes = BLOCK * np.array([(x, y) for x in range(n) for y in range(n)], float)
    pairs = [(x * n + y, (x + 1) * n + y) for x in range(BLOCKS) for y in range(n)]
    pairs += [(x * n + y, x * n + y + 1) for x in range(n) for y in range(BLOCKS)]
    ends = nodes[np.array(pairs)]
    middle = (ends[:, :, 1] == 3 * BLOCK).all(axis=1)
    return network(nodes, pairs, backward=~middle), middle


def lane(forward=True):
    """A road of a kilometre that leads east, drawn along its direction or against it."""
    nodes = [(0, 0), (1000, 0)] if forward else [(1000, 0), (0, 0)]
    return network(nodes, [(0, 1)], [forward], [not forward], ["Main St"])


@pytest.mark.parametrize("forward", [True, False])
@pytest.mark.parametrize(
    ("noise", "speed", "period"), [(0.0, 10, 2), (5.0, 10, 1), (5.0, 1.4, 1), (5.0, 10, 10)]
)
def test_a_log_against_a_road_is_on_no_road(forward, noise, speed, period):
    road = lane(forward)
    track = along([(1000, 0), (0, 0)], speed, period, noise)
    found = match(track, road)
    (one,) = found[0].breaks
    assert (found.share, found[0].pieces, found.unmatched) == (0.0, (), {"one-way": len(track)})
    assert (one.after, one.before, one.reason, one.edges, found.wrong_way) == (
        -1,
        len(track),
        "one-way",
        (0,),
        (0,),
    )
    assert road.label(one.edges[0]) == "Main St"
    assert np.isnan(found[0].offset).all()
    walked = match(track, road, ignore_oneway=True)
    assert (walked.share, walked.breaks) == (1.0, {})
    assert walked[0].pieces[0].length == pytest.approx(1000, abs=25)
    legal = match(along([(0, 0), (1000, 0)], speed, period, noise), road)
    assert (legal.share, legal.breaks) == (1.0, {})


@pytest.mark.parametrize(("noise", "period"), [(0.0, 1), (5.0, 1), (5.0, 5), (2.0, 15)])
def test_only_the_stretch_against_a_road_is_left_out(noise, period):
    streets, middle = town()
    track = along([(600, 0), (600, 300), (0, 300), (0, 600)], period=period, noise=noise, seed=3)
    found = match(track, streets)[0]
    against = (track.times * 10 > 300) & (track.times * 10 < 900)
    assert np.mean((found.piece < 0) == against) > 0.97
    (one,) = [one for one in found.breaks if one.reason == "one-way"]
    assert set(one.edges) <= set(np.flatnonzero(middle).tolist())
    assert len(one.edges) >= (BLOCKS - 1 if period <= 5 else 1)
    first, last = found.pieces
    assert (first.reason, last.reason) == ("one-way", "end of track")
    assert first.length == pytest.approx(300, abs=20)
    assert last.length == pytest.approx(300, abs=20)


def test_who_turns_round_leaves_the_road_where_he_may_not():
    there_and_back = along([(0, 0), (600, 0), (200, 0)], noise=2.0)
    two_way = network([(0, 0), (1000, 0)], [(0, 1)])
    assert match(there_and_back, two_way).unmatched == {}
    found = match(there_and_back, lane())[0]
    assert found.unmatched == {"one-way": 40}
    assert found.pieces[0].length == pytest.approx(600, abs=15)


@pytest.mark.parametrize("noise", [3.0, 8.0])
def test_carriageways_of_one_way_each_are_told_apart(noise):
    nodes = [(0, 0), (2000, 0), (0, 15), (2000, 15), (-300, 0), (-300, 15)]
    dual = network(
        nodes, [(4, 0), (0, 1), (3, 2), (1, 3), (2, 5)], backward=[False, False, False, True, False]
    )
    track = along([(-300, 0), (2000, 0), (2000, 15), (-300, 15)], speed=20, noise=noise)
    found = match(track, dual)
    assert (found.share, found.breaks) == (1.0, {})
    sure = np.abs(track.positions[:, 0] - 1000) < 900
    there = track.times * 20 < 2300
    assert np.mean(found[0].edge[sure & there] == 1) == 1.0
    assert np.mean(found[0].edge[sure & ~there] == 2) == 1.0


def test_legal_drives_of_one_way_towns_and_roundabouts_are_matched():
    angles = np.linspace(0, 2 * math.pi, 13)[:-1]
    ring = 40 * np.stack((np.cos(angles), np.sin(angles)), axis=1)
    nodes = np.concatenate((ring, [(400, 0), (-400, 0)]))
    pairs = [(i, (i + 1) % 12) for i in range(12)] + [(12, 0), (6, 13)]
    roundabout = network(nodes, pairs, backward=[False] * 12 + [True, True])
    through = along([(400, 0), *ring[:7], (-400, 0)], noise=2.0)
    twice = along([(400, 0), *ring, *ring[:7], (-400, 0)], noise=2.0)
    assert [match(one, roundabout).unmatched for one in (through, twice)] == [{}, {}]


def test_a_gap_over_a_road_that_leads_the_other_way_is_named():
    road = network(
        [(0, 0), (400, 0), (600, 0), (1000, 0)],
        [(0, 1), (1, 2), (2, 3)],
        backward=[True, False, True],
    )
    track = along([(1000, 0), (600, 0)], period=1)
    rest = along([(400, 0), (0, 0)], period=1)
    both = Track(
        "car",
        np.append(track.times, rest.times + 60),
        np.concatenate((track.positions, rest.positions)),
    )
    found = match(both, road)[0]
    (one,) = found.breaks
    assert (one.reason, one.edges, found.unmatched) == ("one-way", (1,), {})
    assert [piece.reason for piece in found.pieces] == ["one-way", "end of track"]


def test_samples_that_move_are_not_said_to_be_at_one_place():
    road = network([(0, 0), (30, 0)], [(0, 1)])
    beside = along([(15, -200), (15, 200)], speed=3, noise=1.0)
    for piece in match(beside, road)[0].pieces:
        moved = np.ptp(beside.positions[piece.first : piece.last + 1], axis=0).max()
        assert piece.length > 0.1 * moved or moved < 20
    parked = Track(
        "parked", np.arange(60.0), np.random.default_rng(1).normal((15, 2), 1.0, (60, 2))
    )
    found = match(parked, road)
    assert (found.share, len(found[0].pieces)) == (1.0, 1)


def test_shapes_are_matched_without_times():
    streets, _ = town()
    timed = along([(0, 0), (200, 0), (200, 500), (600, 500)], period=10)
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(timed.positions, axis=0), axis=1)))
    shape = Track("plan", way, timed.positions, timed=False)
    found = match(shape, streets)
    assert (found.share, found.breaks) == (1.0, {})
    assert found[0].pieces[0].length == pytest.approx(1100, abs=1)
    with pytest.raises(InputError, match="track 'plan' has no times, so there are no gaps to fill"):
        patch([timed, shape], streets)


def test_gaps_are_filled_over_one_way_roads_for_those_who_walk():
    track = along([(1000, 0), (0, 0)], speed=5)
    torn = Track(
        "walker",
        *(np.delete(values, np.s_[60:140], axis=0) for values in (track.times, track.positions)),
    )
    assert patch(torn, lane(), gap=30.0).filled == 0
    walked = patch(torn, lane(), gap=30.0, ignore_oneway=True)
    assert (walked.filled, len(walked.to_tracks()[0])) == (1, len(track))
