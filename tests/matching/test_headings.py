"""Headings of a log: they help where samples are sparse, and wrong ones do no harm."""

import math
from functools import cache

import numpy as np
import pytest

from gpszip.geo.planes import to_geographic, to_plane
from gpszip.matching.headings import heading_vectors
from gpszip.matching.live import LiveMatcher
from gpszip.matching.match import match
from gpszip.model import Plane, Track
from matching.streets import network

BLOCK = 90.0


def one_way_city(n=14):
    """A grid whose avenues are pairs of one-way roads 24 m apart; streets across are two-way."""
    columns = BLOCK * np.arange(n)
    rows = np.sort(np.concatenate((columns, columns + 24.0)))
    nodes = np.array([(x, y) for x in columns for y in rows])
    streets = [(i * 2 * n + k, i * 2 * n + k + 1) for i in range(n) for k in range(2 * n - 1)]
    avenues = [(i * 2 * n + k, (i + 1) * 2 * n + k) for i in range(n - 1) for k in range(2 * n)]
    is_eastward = [k % 2 == 0 for _ in range(n - 1) for k in range(2 * n)]
    forward = np.array([True] * len(streets) + is_eastward)
    backward = np.array([True] * len(streets) + [not eastward for eastward in is_eastward])
    return network(nodes, streets + avenues, forward, backward)


def drive_city(city, rng, seconds, speed=8.0):
    """True positions, directed roads and headings at each second of a random drive.

    The driver seldom turns off, and never turns round unless a road ends.
    """
    # a path as long as the drive; the road ahead is twice as likely as the others
    heads = np.stack((city.ends, city.starts), 1).ravel()
    tails = np.stack((city.starts, city.ends), 1).ravel()
    is_open = np.stack((city.forward, city.backward), 1).ravel()
    steps = city.nodes[heads] - city.nodes[tails]
    road, path = int(rng.choice(np.flatnonzero(is_open))), []
    while sum(city.lengths[a >> 1] for a in path) < seconds * speed:
        path.append(road)
        choices = np.flatnonzero(is_open & (tails == heads[road]))
        if (choices != road ^ 1).any():
            choices = choices[choices != road ^ 1]
        weights = np.where(steps[choices] @ steps[road] > 0, 2.0, 1.0)
        road = int(rng.choice(choices, p=weights / weights.sum()))

    # positions along it
    ends = np.cumsum([city.lengths[a >> 1] for a in path])
    along = speed * np.arange(0.0, seconds)
    leg = np.searchsorted(ends, along, side="right")
    roads = np.array(path)[leg]
    share = (1 - (ends[leg] - along) / city.lengths[roads >> 1])[:, None]
    positions = city.nodes[tails[roads]] + share * steps[roads]
    return positions, roads, np.degrees(np.arctan2(*steps[roads].T)) % 360


@cache
def log(period, noise=18.0, seed=5, vehicles=5):
    """A city, noisy tracks with headings, and the true directed roads of their samples."""
    city, rng = one_way_city(), np.random.default_rng(seed)
    tracks, true_roads = [], []
    for name in range(vehicles):
        positions, roads, heading = (
            column[::period] for column in drive_city(city, rng, 60 * period)
        )
        seen = (heading + rng.normal(0, 12, len(heading))) % 360
        seen[rng.random(len(seen)) < 0.05] = rng.uniform(0, 360)
        seen[rng.random(len(seen)) < 0.1] = np.nan
        positions = positions + rng.normal(0, noise, positions.shape)
        times = float(period) * np.arange(len(positions))
        tracks.append(Track(str(name), times, positions, attributes={"heading": seen}))
        true_roads.append(roads)
    return city, tuple(tracks), np.concatenate(true_roads)


@cache
def match_log(period, heading=None):
    city, tracks, _ = log(period)
    return match(tracks, city, heading=heading)


def directed_roads(matching):
    return np.concatenate(
        [
            np.where(matched.edge >= 0, 2 * matched.edge + ~matched.forward, -1)
            for matched in matching
        ]
    )


def share_wrong(matching, period):
    return np.mean(directed_roads(matching) != log(period)[2])


def change_headings(tracks, change):
    return [
        Track(
            track.id,
            track.times,
            track.positions,
            attributes={"heading": change(track.attributes["heading"])},
        )
        for track in tracks
    ]


@pytest.mark.parametrize("period", [15, 45])
def test_headings_distinguish_streets_that_positions_do_not(period):
    without, with_headings = match_log(period, math.inf), match_log(period)
    assert share_wrong(with_headings, period) < 0.75 * share_wrong(without, period)
    assert (without.scales.heading, without.headings_ignored) == (math.inf, ())
    assert with_headings.headings_ignored == ()
    assert 5 < with_headings.scales.heading < 40


@pytest.mark.parametrize(
    "change",
    [
        lambda heading: np.full_like(heading, 137.0),
        lambda heading: heading + 180,
        lambda heading: 90 - heading,
        np.radians,
        lambda heading: np.random.default_rng(1).uniform(0, 360, len(heading)),
        lambda heading: np.roll(heading, len(heading) // 2),
    ],
    ids=["constant", "backward", "counterclockwise", "radians", "noise", "delayed"],
)
def test_headings_that_do_not_follow_the_roads_are_ignored(change):
    city, tracks, _ = log(15)
    matching = match(change_headings(tracks, change), city)
    np.testing.assert_array_equal(directed_roads(matching), directed_roads(match_log(15, math.inf)))
    assert matching.scales.heading == math.inf
    assert matching.headings_ignored == tuple(track.id for track in tracks)


def test_one_broken_compass_does_not_harm_the_others():
    city, tracks, _ = log(15)
    broken = change_headings(tracks[:1], lambda heading: np.full_like(heading, 45.0))
    matching = match([*broken, *tracks[1:]], city)
    assert matching.headings_ignored == ("0",)
    assert matching[0].scales.heading == math.inf
    assert share_wrong(matching, 15) < share_wrong(match_log(15, math.inf), 15)


def test_unknown_headings_are_no_headings():
    city, tracks, _ = log(15)
    unknown = change_headings(tracks, lambda heading: np.full_like(heading, np.nan))
    matching = match(unknown, city)
    assert (matching.scales.heading, matching.headings_ignored) == (math.inf, ())


def test_a_given_spread_is_kept():
    matching = match_log(45, 20.0)
    assert matching.scales.heading == matching[3].scales.heading == 20.0
    assert share_wrong(matching, 45) < share_wrong(match_log(45, math.inf), 45)


def test_the_live_matcher_uses_headings():
    city, tracks, _ = log(45)
    scales = match_log(45).scales

    def share_right(*, with_headings):
        roads = []
        for track in tracks:
            matcher = LiveMatcher(city, scales)
            headings = track.attributes["heading"].tolist()
            for time, position, heading in zip(
                track.times.tolist(), track.positions, headings, strict=True
            ):
                here = matcher.push(time, position, heading if with_headings else None)
                roads.append(2 * here.edge + (not here.forward) if here.edge >= 0 else -1)
        return np.mean(np.array(roads) == log(45)[2])

    assert share_right(with_headings=True) > share_right(with_headings=False) + 0.1


def test_north_follows_the_meridian():
    plane = Plane(((600_000_000, 100_000_000),))
    east = np.array([[200_000.0, 0.0]])
    (vector,) = heading_vectors(np.array([0.0]), east, plane)
    lat, lon = to_geographic(east, plane)
    step = to_plane(lat + 1e-4, lon, plane)[0] - east[0]
    np.testing.assert_allclose(vector, step / np.linalg.norm(step), atol=1e-5)
