"""Headings of a log: what they bring where samples are sparse, and that wrong ones do no harm."""

import math
from functools import cache

import numpy as np
import pytest

from gpszip.matching.headings import heading_vectors
from gpszip.matching.live import LiveMatcher
from gpszip.matching.match import match
from gpszip.model import Network, Plane, Track

BLOCK = 90.0


def one_way_city(n=14):
    """A grid whose avenues are pairs of one-way roads 24 m apart; the streets across are two-way."""
    across = BLOCK * np.arange(n)
    rows = np.sort(np.concatenate((across, across + 24.0)))
    nodes = np.array([(x, y) for x in across for y in rows])
    streets = [(i * 2 * n + k, i * 2 * n + k + 1) for i in range(n) for k in range(2 * n - 1)]
    avenues = [(i * 2 * n + k, (i + 1) * 2 * n + k) for i in range(n - 1) for k in range(2 * n)]
    pairs = np.array(streets + avenues, np.int32)
    eastward = np.array(
        [True] * len(streets) + [k % 2 == 0 for _ in range(n - 1) for k in range(2 * n)]
    )
    westward = np.array(
        [True] * len(streets) + [k % 2 == 1 for _ in range(n - 1) for k in range(2 * n)]
    )
    offsets = 2 * np.arange(len(pairs) + 1)
    speeds = np.full(len(pairs), np.nan)
    return Network(
        nodes,
        pairs[:, 0].copy(),
        pairs[:, 1].copy(),
        offsets,
        nodes[pairs.ravel()],
        eastward,
        westward,
        speeds,
    )


def drive(city, rng, seconds, speed=8.0):
    """True places, directed roads and headings each second of somebody who seldom turns and never turns round."""
    heads, tails = (
        np.stack((city.ends, city.starts), 1).ravel(),
        np.stack((city.starts, city.ends), 1).ravel(),
    )
    open_ = np.stack((city.forward, city.backward), 1).ravel()
    road, way = int(rng.choice(np.flatnonzero(open_))), []
    while sum(city.lengths[one >> 1] for one in way) < seconds * speed:
        way.append(road)
        outs = np.flatnonzero(open_ & (tails == heads[road]))
        outs = outs[outs != road ^ 1] if (outs != road ^ 1).any() else outs
        ahead = [
            (city.nodes[heads[one]] - city.nodes[tails[one]])
            @ (city.nodes[heads[road]] - city.nodes[tails[road]])
            > 0
            for one in outs
        ]
        road = int(rng.choice(outs, p=np.where(ahead, 2.0, 1.0) / np.where(ahead, 2.0, 1.0).sum()))
    ends = np.cumsum([city.lengths[one >> 1] for one in way])
    along = speed * np.arange(0.0, seconds)
    leg = np.searchsorted(ends, along, side="right")
    directed = np.array(way)[leg]
    begin, end = city.nodes[tails[directed]], city.nodes[heads[directed]]
    share = (1 - (ends[leg] - along) / city.lengths[directed >> 1])[:, None]
    return begin + share * (end - begin), directed, np.degrees(np.arctan2(*(end - begin).T)) % 360


@cache
def log(period, noise=18.0, seed=5, vehicles=8):
    city, rng = one_way_city(), np.random.default_rng(seed)
    tracks, truth = [], []
    for name in range(vehicles):
        places, directed, heading = (one[::period] for one in drive(city, rng, 60 * period))
        told = (heading + rng.normal(0, 12, len(heading))) % 360
        told[rng.random(len(told)) < 0.05] = rng.uniform(0, 360)
        told[rng.random(len(told)) < 0.1] = np.nan
        times = float(period) * np.arange(len(places))
        tracks.append(
            Track(
                str(name),
                times,
                places + rng.normal(0, noise, places.shape),
                attributes={"heading": told},
            )
        )
        truth.append(directed)
    return city, tuple(tracks), np.concatenate(truth)


def directed(matching):
    return np.concatenate(
        [np.where(one.edge >= 0, 2 * one.edge + ~one.forward, -1) for one in matching]
    )


def with_headings(tracks, change):
    return [
        Track(
            one.id,
            one.times,
            one.positions,
            attributes={"heading": change(one.attributes["heading"])},
        )
        for one in tracks
    ]


@pytest.mark.parametrize("period", [15, 45])
def test_headings_tell_streets_apart_that_places_do_not(period):
    city, tracks, truth = log(period)
    without, found = match(tracks, city, heading=math.inf), match(tracks, city)
    wrong, fewer = (np.mean(directed(one) != truth) for one in (without, found))
    assert fewer < 0.75 * wrong
    assert (without.scales.heading, found.headings_ignored, without.headings_ignored) == (
        math.inf,
        (),
        (),
    )
    assert 5 < found.scales.heading < 40


@pytest.mark.parametrize(
    "change",
    [
        lambda heading: np.full_like(heading, 0.0),
        lambda heading: np.full_like(heading, 137.0),
        lambda heading: heading + 180,
        lambda heading: 90 - heading,
        np.radians,
        lambda heading: np.random.default_rng(1).uniform(0, 360, len(heading)),
        lambda heading: np.roll(heading, len(heading) // 2),
    ],
    ids=["nought", "constant", "backwards", "counterclockwise", "radians", "noise", "late"],
)
def test_headings_that_do_not_follow_the_roads_are_left_out(change):
    city, tracks, _ = log(15)
    found = match(with_headings(tracks, change), city)
    np.testing.assert_array_equal(directed(found), directed(match(tracks, city, heading=math.inf)))
    assert found.scales.heading == math.inf
    assert found.headings_ignored == tuple(track.id for track in tracks)


def test_one_broken_compass_does_not_harm_the_others():
    city, tracks, truth = log(15)
    broken = with_headings(tracks[:1], lambda heading: np.full_like(heading, 45.0))
    found = match([*broken, *tracks[1:]], city)
    assert found.headings_ignored == ("0",)
    assert found[0].scales.heading == math.inf
    assert np.mean(directed(found) != truth) < np.mean(
        directed(match(tracks, city, heading=math.inf)) != truth
    )


def test_unknown_headings_are_none():
    city, tracks, _ = log(15)
    found = match(with_headings(tracks, lambda heading: np.full_like(heading, np.nan)), city)
    assert (found.scales.heading, found.headings_ignored) == (math.inf, ())


def test_a_spread_is_taken_as_given():
    city, tracks, truth = log(45)
    found = match(tracks, city, heading=20.0)
    assert found.scales.heading == found[3].scales.heading == 20.0
    assert np.mean(directed(found) != truth) < np.mean(
        directed(match(tracks, city, heading=math.inf)) != truth
    )


def test_live_headings_tell_the_road_at_once():
    city, tracks, truth = log(45)
    scales = match(tracks, city).scales
    right = []
    for told in (True, False):
        now = []
        for track in tracks:
            matcher = LiveMatcher(city, scales)
            for time, place, heading in zip(
                track.times.tolist(),
                track.positions,
                track.attributes["heading"].tolist(),
                strict=True,
            ):
                here = matcher.push(time, place, heading if told else None)
                now.append(2 * here.edge + (not here.forward) if here.edge >= 0 else -1)
        right.append(np.mean(np.array(now) == truth))
    assert right[0] > right[1] + 0.1


def test_north_is_where_the_meridians_go():
    plane = Plane(((600_000_000, 100_000_000),))
    east = np.array([[200_000.0, 0.0]])
    (vector,) = heading_vectors(np.array([0.0]), east, plane)
    from gpszip.geo.planes import to_geographic, to_plane

    lat, lon = to_geographic(east, plane)
    step = to_plane(lat + 1e-4, lon, plane)[0] - east[0]
    np.testing.assert_allclose(vector, step / np.linalg.norm(step), atol=1e-5)
