"""Travel against one-way roads: what is matched, what is not, and why."""

import math

import numpy as np
import pytest

from gpszip.errors import InputError
from gpszip.matching.match import match
from gpszip.matching.patch import patch
from gpszip.model import Track
from matching.streets import drive, grid, network

BLOCK, BLOCKS = 100.0, 6


def town():
    """Streets of which only the middle one, at y = 300, is one-way: eastward."""
    nodes, pairs = grid(BLOCKS, BLOCK)
    is_middle = (nodes[np.array(pairs)][:, :, 1] == 3 * BLOCK).all(axis=1)
    return network(nodes, pairs, backward=~is_middle), is_middle


def lane(forward=True):
    """A one-way road of a kilometre to the east, drawn in its direction or against it."""
    nodes = [(0, 0), (1000, 0)] if forward else [(1000, 0), (0, 0)]
    return network(nodes, [(0, 1)], [forward], [not forward], names=["Main St"])


@pytest.mark.parametrize("forward", [True, False])
@pytest.mark.parametrize(
    ("noise", "speed", "period"), [(0.0, 10, 2), (5.0, 10, 1), (5.0, 1.4, 1), (5.0, 10, 10)]
)
def test_a_log_against_a_road_is_on_no_road(forward, noise, speed, period):
    road = lane(forward)
    track = drive([(1000, 0), (0, 0)], speed, period, noise)
    matching = match(track, road)
    assert matching.share == 0.0
    assert matching[0].pieces == ()
    assert matching.unmatched == {"one-way": len(track)}
    assert np.isnan(matching[0].offset).all()

    # the break names the road
    (break_,) = matching[0].breaks
    assert (break_.after, break_.before, break_.reason) == (-1, len(track), "one-way")
    assert break_.edges == matching.wrong_way == (0,)
    assert road.label(0) == "Main St"

    # pedestrians, and travel along the road
    walked = match(track, road, ignore_oneway=True)
    assert (walked.share, walked.breaks) == (1.0, {})
    assert walked[0].pieces[0].length == pytest.approx(1000, abs=25)
    legal = match(drive([(0, 0), (1000, 0)], speed, period, noise), road)
    assert (legal.share, legal.breaks) == (1.0, {})


@pytest.mark.parametrize(("noise", "period"), [(0.0, 1), (5.0, 1), (5.0, 5), (2.0, 15)])
def test_only_the_interval_against_a_road_is_left_out(noise, period):
    streets, is_middle = town()
    track = drive([(600, 0), (600, 300), (0, 300), (0, 600)], period=period, noise=noise, seed=3)
    matched = match(track, streets)[0]
    is_wrong_way = (track.times * 10 > 300) & (track.times * 10 < 900)
    assert np.mean((matched.piece < 0) == is_wrong_way) > 0.97
    (break_,) = [break_ for break_ in matched.breaks if break_.reason == "one-way"]
    assert set(break_.edges) <= set(np.flatnonzero(is_middle).tolist())
    assert len(break_.edges) >= (BLOCKS - 1 if period <= 5 else 1)
    first, last = matched.pieces
    assert (first.reason, last.reason) == ("one-way", "end of track")
    assert first.length == pytest.approx(300, abs=20)
    assert last.length == pytest.approx(300, abs=20)


def test_turning_round_on_a_one_way_road_leaves_it():
    there_and_back = drive([(0, 0), (600, 0), (200, 0)], noise=2.0)
    two_way = network([(0, 0), (1000, 0)], [(0, 1)])
    assert match(there_and_back, two_way).unmatched == {}
    matched = match(there_and_back, lane())[0]
    assert matched.unmatched == {"one-way": 40}
    assert matched.pieces[0].length == pytest.approx(600, abs=15)


@pytest.mark.parametrize("noise", [3.0, 8.0])
def test_one_way_carriageways_are_kept_apart(noise):
    nodes = [(0, 0), (2000, 0), (0, 15), (2000, 15), (-300, 0), (-300, 15)]
    dual = network(
        nodes, [(4, 0), (0, 1), (3, 2), (1, 3), (2, 5)], backward=[False, False, False, True, False]
    )
    track = drive([(-300, 0), (2000, 0), (2000, 15), (-300, 15)], speed=20, noise=noise)
    matching = match(track, dual)
    assert (matching.share, matching.breaks) == (1.0, {})
    is_far_from_ends = np.abs(track.positions[:, 0] - 1000) < 900
    is_outward = track.times * 20 < 2300
    assert (matching[0].edge[is_far_from_ends & is_outward] == 1).all()
    assert (matching[0].edge[is_far_from_ends & ~is_outward] == 2).all()


def test_roundabouts_are_legal():
    angles = np.linspace(0, 2 * math.pi, 13)[:-1]
    ring = 40 * np.stack((np.cos(angles), np.sin(angles)), axis=1)
    nodes = np.concatenate((ring, [(400, 0), (-400, 0)]))
    pairs = [(i, (i + 1) % 12) for i in range(12)] + [(12, 0), (6, 13)]
    roundabout = network(nodes, pairs, backward=[False] * 12 + [True, True])
    through = drive([(400, 0), *ring[:7], (-400, 0)], noise=2.0)
    twice_round = drive([(400, 0), *ring, *ring[:7], (-400, 0)], noise=2.0)
    assert match(through, roundabout).unmatched == {}
    assert match(twice_round, roundabout).unmatched == {}


def test_a_gap_over_a_road_that_leads_the_other_direction_is_named():
    road = network(
        [(0, 0), (400, 0), (600, 0), (1000, 0)],
        [(0, 1), (1, 2), (2, 3)],
        backward=[True, False, True],
    )
    before, after = drive([(1000, 0), (600, 0)]), drive([(400, 0), (0, 0)])
    track = Track(
        "car",
        np.append(before.times, after.times + 60),
        np.concatenate((before.positions, after.positions)),
    )
    matched = match(track, road)[0]
    (break_,) = matched.breaks
    assert (break_.reason, break_.edges, matched.unmatched) == ("one-way", (1,), {})
    assert [piece.reason for piece in matched.pieces] == ["one-way", "end of track"]


def test_samples_that_move_are_not_matched_to_one_position():
    road = network([(0, 0), (30, 0)], [(0, 1)])
    beside = drive([(15, -200), (15, 200)], speed=3, noise=1.0)
    for piece in match(beside, road)[0].pieces:
        moved = np.ptp(beside.positions[piece.first : piece.last + 1], axis=0).max()
        assert piece.length > 0.1 * moved or moved < 20
    positions = np.random.default_rng(1).normal((15, 2), 1.0, (60, 2))
    parked = match(Track("parked", np.arange(60.0), positions), road)
    assert (parked.share, len(parked[0].pieces)) == (1.0, 1)


def test_a_shape_without_times_is_matched_but_not_patched():
    streets, _ = town()
    timed = drive([(0, 0), (200, 0), (200, 500), (600, 500)], period=10)
    steps = np.linalg.norm(np.diff(timed.positions, axis=0), axis=1)
    shape = Track("plan", np.append(0.0, np.cumsum(steps)), timed.positions, timed=False)
    matching = match(shape, streets)
    assert (matching.share, matching.breaks) == (1.0, {})
    assert matching[0].pieces[0].length == pytest.approx(1100, abs=1)
    with pytest.raises(InputError, match="track 'plan' has no times, so there are no gaps to fill"):
        patch([timed, shape], streets)


def test_gaps_of_pedestrians_are_filled_against_one_way_roads():
    track = drive([(1000, 0), (0, 0)], speed=5)
    kept = np.r_[:60, 140 : len(track)]
    log = Track("walker", track.times[kept], track.positions[kept])
    assert patch(log, lane(), gap=30.0).filled == 0
    walked = patch(log, lane(), gap=30.0, ignore_oneway=True)
    assert (walked.filled, len(walked.to_tracks()[0])) == (1, len(track))
