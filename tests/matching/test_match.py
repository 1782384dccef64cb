import math

import numpy as np
import pytest

from gpszip.errors import InputError, OptionError
from gpszip.matching.match import match
from gpszip.model import Network, Plane, Track
from gpszip.testing.city import drives
from matching.streets import drive, network, town


def break_tuples(matched):
    return [(break_.after, break_.before, break_.reason) for break_ in matched.breaks]


# accuracy on drives whose true positions are known


@pytest.mark.parametrize(
    ("period", "noise", "share_near", "max_error"),
    [
        (1.0, 2.0, 0.995, 3.0),
        (1.0, 8.0, 0.97, 9.0),
        (1.0, 16.0, 0.93, 20.0),
        (10.0, 8.0, 0.96, 9.0),
        (30.0, 8.0, 0.93, 12.0),
        (60.0, 8.0, 0.8, 25.0),
    ],
)
def test_drives_in_a_town_lie_on_their_streets(period, noise, share_near, max_error):
    options = {
        "vehicles": 6,
        "period": period,
        "duration": 3600.0 if period > 5 else 600.0,
        "seed": 3,
    }
    noisy, exact = drives(noise=noise, **options), drives(noise=0.0, **options)
    streets = town()
    matching = match([Track(name, *bus) for name, bus in noisy.items()], streets)
    assert matching.share > 0.99

    exact_positions = np.concatenate([exact[matched.track][1] for matched in matching])
    snapped = np.concatenate([matched.snapped_positions(streets) for matched in matching])
    errors = np.linalg.norm(snapped - exact_positions, axis=1)
    assert np.mean(errors < 4 * noise) > share_near
    assert np.sqrt(np.nanmean(np.minimum(errors, 100.0) ** 2)) < max_error

    if period == 1.0:
        steps = [np.linalg.norm(np.diff(bus[1], axis=0), axis=1) for bus in exact.values()]
        length = sum(piece.length for matched in matching for piece in matched.pieces)
        assert length / np.concatenate(steps).sum() == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("noise", [0.5, 3.0, 12.0])
def test_scales_follow_from_the_log(noise):
    buses = drives(vehicles=4, duration=900.0, noise=noise, seed=5)
    scales = match([Track(name, *bus) for name, bus in buses.items()], town()).scales
    assert 0.5 * noise < scales.error < 1.5 * noise
    assert scales.beta >= scales.error
    assert 6 < scales.median_speed < 20


def test_a_small_world_is_matched_like_a_large_one():
    track = drive([(0, 0), (480, 0), (480, 360), (120, 360)], noise=3.0)
    large = match(track, town(8))[0]
    small = match(Track("robot", track.times, track.positions / 100), town(8, block=1.2))[0]
    assert small.edge.tolist() == large.edge.tolist()
    np.testing.assert_allclose(small.along, large.along / 100, rtol=1e-6, atol=1e-9)


def test_given_scales_are_kept():
    track = drive([(0, 0), (480, 0), (480, 360)], noise=4.0)
    matching = match(track, town(8), sigma=9.0, beta=21.0)
    assert (matching.scales.sigma, matching.scales.beta) == (9.0, 21.0)
    assert matching[0].scales.sigma == 9.0


def test_autocorrelated_errors_make_sigma_larger():
    rng = np.random.default_rng(2)
    track = drive([(-360, 0), (360, 0), (360, 360), (-360, 360), (-360, 0)] * 2)
    drift = np.cumsum(rng.normal(0, 1.0, (len(track), 2)), axis=0)
    drift -= np.linspace(0, 1, len(track))[:, None] * drift[-1]
    errors = {"drift": drift * 5 / drift.std(), "white": rng.normal(0, 5, drift.shape)}
    drifting, white = (
        match(Track(name, track.times, track.positions + error), town(), gap=math.inf).scales
        for name, error in errors.items()
    )
    assert drifting.sigma / drifting.error > 2 * white.sigma / white.error


# what a match tells


def test_route_and_positions_agree():
    streets = town()
    track = drive([(-360, -360), (0, -360), (0, 0), (240, 0)], noise=3.0)
    matched = match(track, streets)[0]
    (piece,) = matched.pieces
    assert (piece.first, piece.last, piece.reason) == (0, len(track) - 1, "end of track")
    assert matched.breaks == ()

    # along the route
    assert (np.diff(matched.along) >= 0).all()
    assert matched.along[0] == 0
    assert matched.along[-1] == pytest.approx(piece.length)
    steps = np.linalg.norm(np.diff(piece.line, axis=0), axis=1)
    assert steps.sum() == pytest.approx(piece.length)

    # legs
    route = piece.route
    np.testing.assert_array_equal(route.edges[matched.leg], matched.edge)
    np.testing.assert_array_equal(route.forward[matched.leg], matched.forward)
    road_ends = np.where(route.forward[:-1], streets.lengths[route.edges[:-1]], 0.0)
    np.testing.assert_allclose(road_ends, route.end[:-1])

    # positions
    snapped = matched.snapped_positions(streets)
    distance = np.linalg.norm(snapped - track.positions, axis=1)
    np.testing.assert_allclose(distance, matched.distance, atol=1e-6)
    vertices = np.append(0.0, np.cumsum(steps))
    on_line = np.stack([np.interp(matched.along, vertices, axis) for axis in piece.line.T], axis=1)
    np.testing.assert_allclose(on_line, snapped, atol=1e-6)

    assert (matched.confidence > 0.5).mean() > 0.9
    assert piece.confidence == pytest.approx(matched.confidence.mean())


def test_samples_of_a_standing_car_stay_where_it_stands():
    rng = np.random.default_rng(1)
    there = drive([(0, 0), (240, 0)], noise=2.0).positions
    standing = np.tile([240.0, 0.0], (300, 1)) + rng.normal(0, 2, (300, 2))
    onward = drive([(240, 0), (360, 0), (360, 240)], noise=2.0, seed=4).positions
    positions = np.concatenate((there, standing, onward))
    matched = match(Track("car", np.arange(len(positions)), positions), town())[0]
    assert sum(piece.length for piece in matched.pieces) == pytest.approx(600, abs=20)


def test_a_car_turns_round_on_a_road():
    roads = network([(0, 0), (600, 0), (600, 300)], [(0, 1), (1, 2)])
    matched = match(drive([(100, 0), (400, 0), (50, 0)], noise=2.0), roads)[0]
    (piece,) = matched.pieces
    assert piece.route.edges.tolist() == [0, 0]
    assert piece.route.forward.tolist() == [True, False]
    assert piece.route.end[0] == piece.route.begin[1] == pytest.approx(400, abs=15)
    assert piece.length == pytest.approx(650, abs=20)


def test_one_way_streets_are_driven_in_their_direction():
    nodes = [(0, 0), (500, 0), (0, 20), (500, 20), (-100, 10), (600, 10)]
    pairs = [(0, 1), (3, 2), (4, 0), (1, 5), (5, 3), (2, 4)]
    positions = np.stack([np.linspace(-90, 590, 70), np.full(70, 13.0)], axis=1)
    eastward = Track("east", np.arange(0, 70.0), positions)
    one_way = network(nodes, pairs, backward=[False] * 6)
    assert set(match(eastward, one_way, sigma=12.0)[0].edge.tolist()) == {2, 0, 3}
    assert 1 in match(eastward, network(nodes, pairs), sigma=12.0)[0].edge


# breaks


def test_a_gap_breaks_the_route():
    track = drive([(-360, 0), (360, 0)], noise=2.0)
    kept = (track.times < 20) | (track.times > 50)
    log = Track("car", track.times[kept], track.positions[kept])
    matched = match(log, town(), gap=20.0)[0]
    assert break_tuples(matched) == [(19, 20, "gap")]
    assert [piece.reason for piece in matched.pieces] == ["gap", "end of track"]
    assert [piece.length for piece in matched.pieces] == pytest.approx([190, 210], abs=12)
    (piece,) = match(log, town(), gap=math.inf)[0].pieces
    assert piece.length == pytest.approx(720, abs=12)


def test_an_interval_far_from_roads_is_named():
    track = drive([(-300, 0), (300, 0), (300, 2000), (340, 2000), (340, 0), (0, 0)], noise=2.0)
    matched = match(track, network([(-360, 0), (360, 0)], [(0, 1)]))[0]
    (break_,) = matched.breaks
    assert break_.reason == "no road near"
    assert 50 < break_.after < 70
    inside = slice(break_.after + 1, break_.before)
    assert (matched.piece[inside] == -1).all()
    assert np.isnan(matched.offset[inside]).all()
    assert matched.share == pytest.approx((matched.piece >= 0).mean())
    assert [piece.length for piece in matched.pieces] == pytest.approx([600, 340], abs=25)


def test_disconnected_roads_break_the_route():
    roads = network([(0, 0), (400, 0), (408, 0), (800, 0)], [(0, 1), (2, 3)])
    matched = match(drive([(10, 1), (790, 1)], noise=1.0), roads)[0]
    assert [break_.reason for break_ in matched.breaks] == ["no route"]
    assert [piece.route.edges.tolist() for piece in matched.pieces] == [[0], [1]]


def test_a_far_detour_breaks_the_route():
    roads = network(
        [(0, 0), (400, 0), (400, 800), (408, 800), (408, 0), (800, 0)],
        [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5)],
    )
    matched = match(drive([(10, 1), (790, 1)], noise=1.0), roads)[0]
    assert [break_.reason for break_ in matched.breaks] == ["detour"]
    assert sum(piece.length for piece in matched.pieces) == pytest.approx(760, abs=30)


def test_a_jump_to_another_town_breaks_the_route():
    streets, east = town(), np.array([30_000.0, 0.0])
    pairs = np.stack((streets.starts, streets.ends), axis=1)
    two_towns = network(
        np.concatenate((streets.nodes, streets.nodes + east)),
        np.concatenate((pairs, pairs + len(streets.nodes))),
    )
    track = drive([(-300, 0), (0, 0), (300, 0)], noise=2.0)
    jump = east + np.array([0, 360])
    positions = track.positions + np.where(track.times >= 30, 1, 0)[:, None] * jump
    matched = match(Track("car", track.times, positions), two_towns, gap=math.inf)[0]
    assert [break_.reason for break_ in matched.breaks] == ["too fast"]
    assert matched.share == 1.0


def drive_beside(metres=3.0):
    """Thirty samples exactly three metres beside a street.

    All errors are the same, so that many samples tell hardly more than one.
    """
    track = drive([(-300, 0), (280, 0)], period=2.0)
    return Track("car", track.times, track.positions + np.array([0.0, metres]))


def displace(track, samples, metres):
    positions = track.positions.copy()
    positions[samples] += metres
    return Track(track.id, track.times, positions)


FAR = [90_000.0, 50_000.0]


@pytest.mark.parametrize("count", [1, 2, 4])
def test_outliers_are_on_no_road_and_the_piece_goes_on(count):
    track = drive_beside()
    outliers = np.arange(12, 12 + count)
    matched = match(displace(track, outliers, FAR), town())[0]
    assert break_tuples(matched) == [(11, 12 + count, "leap")]
    assert np.flatnonzero(matched.piece < 0).tolist() == outliers.tolist()
    assert (matched.confidence[outliers] == 0).all()
    assert np.isnan(matched.distance[outliers]).all()

    # the others are matched as without outliers
    without = match(track, town())[0]
    others = np.delete(np.arange(len(track)), outliers)
    np.testing.assert_array_equal(matched.edge[others], without.edge[others])
    np.testing.assert_allclose(matched.along[others], without.along[others], atol=1e-6)
    assert [(piece.first, piece.last) for piece in matched.pieces] == [(0, len(track) - 1)]


@pytest.mark.parametrize(
    "away", [[0], [29], [10, 11, 12, 13, 14, 15], [0, 1, 20, 21, 22, 23, 24, 25]]
)
def test_a_short_log_that_is_away_for_a_while_is_matched_for_the_rest(away):
    track = displace(drive_beside(), away, FAR)
    matched = match(track, town(), gap=math.inf)[0]
    assert np.flatnonzero(matched.piece < 0).tolist() == away
    assert {break_.reason for break_ in matched.breaks} == {"no road near"}


def test_outliers_shift_the_samples_of_breaks_behind_them():
    track = displace(drive_beside(), [5, 9], FAR)
    times = track.times + np.where(np.arange(len(track)) >= 20, 900.0, 0.0)
    matched = match(Track("car", times, track.positions), town(), gap=60.0)[0]
    assert break_tuples(matched) == [(4, 6, "leap"), (8, 10, "leap"), (19, 20, "gap")]
    assert [(piece.first, piece.last, piece.reason) for piece in matched.pieces] == [
        (0, 19, "gap"),
        (20, 29, "end of track"),
    ]


def test_an_outlier_in_a_break_is_no_break_of_its_own():
    away = displace(drive_beside(), np.arange(10, 20), [0.0, 20_000.0])
    matched = match(displace(away, [14], [90_000.0, 0.0]), town(), gap=math.inf)[0]
    assert break_tuples(matched) == [(9, 20, "no road near")]


# bad input


def test_a_log_in_another_region_is_not_matched():
    track = drive([(0, 0), (500, 0)], noise=1.0)
    matching = match(Track("far", track.times, track.positions + 1e6), town())
    assert (matching.share, matching[0].pieces) == (0.0, ())
    assert matching.breaks == {"no road near": 1}


def test_tracks_and_roads_are_required():
    with pytest.raises(InputError, match="no tracks"):
        match([], town())
    with pytest.raises(InputError, match="no roads"):
        match(drive([(0, 0), (9, 0)]), network(np.zeros((0, 2)), np.zeros((0, 2))))


def test_planes_must_agree():
    in_degrees = network([(0, 0), (9, 0)], [(0, 1)], plane=Plane(((0, 0),)))
    with pytest.raises(OptionError, match="different planes"):
        match(drive([(0, 0), (9, 0)]), in_degrees)


@pytest.mark.parametrize("name", ["sigma", "beta", "gap"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan])
def test_scales_must_be_positive(name, value):
    with pytest.raises(OptionError, match=name):
        match(drive([(0, 0), (9, 0)]), town(), **{name: value})


def test_roads_without_length_and_duplicate_roads_do_no_harm():
    nodes = [(0, 0), (200, 0), (200, 0), (400, 0)]
    messy = network(nodes, [(0, 1), (0, 1), (1, 2), (1, 0), (2, 3), (3, 3)])
    (piece,) = match(drive([(10, 0), (390, 0)], noise=2.0), messy)[0].pieces
    assert piece.length == pytest.approx(380, abs=8)


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_short_tracks(samples):
    positions = np.stack([5.0 * np.arange(samples) + 7, np.ones(samples)], axis=1)
    matched = match(Track("short", np.arange(samples), positions), town())[0]
    assert matched.share == 1.0
    assert len(matched.pieces) == 1
    assert matched.pieces[0].length == pytest.approx(5.0 * (samples - 1), abs=1e-6)


def test_a_standing_log_is_in_one_position():
    track = Track("still", np.arange(50.0), np.tile([33.0, 1.0], (50, 1)))
    matched = match(track, town())[0]
    assert matched.share == 1.0
    assert matched.pieces[0].length == 0.0


def line_along_x(dimension):
    """A road of 300 m on the x axis, and positions along it."""
    points = np.zeros((2, dimension))
    points[1, 0] = 300.0
    start, end, both = np.zeros(1, np.int32), np.ones(1, np.int32), np.ones(1, bool)
    road = Network(points, start, end, np.array([0, 2]), points, both, both, np.full(1, np.nan))
    positions = np.zeros((28, dimension))
    positions[:, 0] = np.linspace(10, 280, 28)
    return road, positions


@pytest.mark.parametrize("dimension", [1, 3])
def test_other_dimensions(dimension):
    road, positions = line_along_x(dimension)
    matched = match(Track("lift", np.arange(28.0), positions), road)[0]
    np.testing.assert_allclose(matched.offset, positions[:, 0])


def test_another_floor_is_far_unless_the_track_has_no_heights():
    road, positions = line_along_x(3)
    times = np.arange(28.0)
    low, high = (
        Track("low", times, positions),
        Track("high", times, positions + np.array([0, 0, 5.0])),
    )
    assert match([low, high], road, sigma=0.1)[1].share == 0.0
    assert match(Track("flat", times, positions[:, :2]), road)[0].share == 1.0


def test_matches_come_in_the_order_of_tracks_and_are_deterministic():
    tracks = [
        drive([(-360, y), (360, y)], noise=2.0, seed=y + 240, name=str(y)) for y in (-240, 0, 240)
    ]
    matching, again = match(tracks, town()), match(tracks, town())
    assert [matched.track for matched in matching] == ["-240", "0", "240"]
    assert matching.points == sum(map(len, tracks))
    for a, b in zip(matching, again, strict=True):
        np.testing.assert_array_equal(a.offset, b.offset)


def test_progress_is_reported():
    shares = []
    tracks = [drive([(0, 0), (100, 0)], name="a"), drive([(0, 0), (300, 0)], name="b")]
    match(tracks, town(), progress=shares.append)
    assert shares == pytest.approx([11 / 42, 1.0])
