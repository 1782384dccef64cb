import math

import numpy as np
import pytest

from gpszip.errors import InputError, OptionError
from gpszip.matching.match import match
from gpszip.model import Network, Plane, Track
from gpszip.testing.city import drives


def town(blocks=6, block=120.0):
    """The streets on which :func:`gpszip.testing.city.drives` goes."""
    n = blocks + 1
    nodes = block * (np.array([(x, y) for x in range(n) for y in range(n)], float) - blocks / 2)
    pairs = [(x * n + y, (x + 1) * n + y) for x in range(blocks) for y in range(n)]
    pairs += [(x * n + y, x * n + y + 1) for x in range(n) for y in range(blocks)]
    return network(nodes, pairs)


def network(nodes, pairs, forward=None, backward=None, plane=None):
    nodes, pairs = np.array(nodes, float), np.array(pairs, np.int32).reshape(-1, 2)
    both = np.ones(len(pairs), bool)
    ways = (
        both if forward is None else np.array(forward),
        both if backward is None else np.array(backward),
    )
    offsets = 2 * np.arange(len(pairs) + 1)
    return Network(
        nodes,
        pairs[:, 0].copy(),
        pairs[:, 1].copy(),
        offsets,
        nodes[pairs.ravel()],
        *ways,
        np.full(len(pairs), np.nan),
        None,
        plane,
    )


def along(corners, speed=10.0, period=1.0, noise=0.0, seed=0, name="car"):
    corners = np.array(corners, float)
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
    times = np.arange(0, way[-1] / speed + 1e-9, period)
    places = np.stack([np.interp(speed * times, way, axis) for axis in corners.T], axis=1)
    return Track(
        name, times, places + np.random.default_rng(seed).normal(0, 1, places.shape) * noise
    )


# accuracy on drives whose true places are known


@pytest.mark.parametrize(
    ("period", "noise", "right", "off"),
    [
        (1.0, 2.0, 0.995, 3.0),
        (1.0, 8.0, 0.97, 9.0),
        (1.0, 16.0, 0.93, 20.0),
        (10.0, 8.0, 0.96, 9.0),
        (30.0, 8.0, 0.93, 12.0),
        (60.0, 8.0, 0.8, 25.0),
    ],
)
def test_drives_of_a_town_lie_on_their_streets(period, noise, right, off):
    options = {
        "vehicles": 6,
        "period": period,
        "duration": 3600.0 if period > 5 else 600.0,
        "seed": 3,
    }
    seen, truth = drives(noise=noise, **options), drives(noise=0.0, **options)
    tracks = [Track(name, *one) for name, one in seen.items()]
    streets = town()
    found = match(tracks, streets)
    true = np.concatenate([truth[track.id][1] for track in tracks])
    places = np.concatenate([one.snapped_positions(streets) for one in found])
    apart = np.linalg.norm(places - true, axis=1)
    assert found.share > 0.99
    assert np.mean(apart < 4 * noise) > right
    assert np.sqrt(np.nanmean(np.minimum(apart, 100.0) ** 2)) < off
    driven = sum(
        np.linalg.norm(np.diff(truth[track.id][1], axis=0), axis=1).sum() for track in tracks
    )
    if period == 1.0:
        assert sum(piece.length for one in found for piece in one.pieces) / driven == pytest.approx(
            1.0, abs=0.03
        )


@pytest.mark.parametrize("noise", [0.5, 3.0, 12.0])
def test_scales_follow_from_the_log(noise):
    tracks = [
        Track(name, *one)
        for name, one in drives(vehicles=4, duration=900.0, noise=noise, seed=5).items()
    ]
    scales = match(tracks, town()).scales
    assert 0.5 * noise < scales.error < 1.5 * noise
    assert scales.beta >= scales.error
    assert 6 < scales.median_speed < 20


def test_a_small_world_is_matched_like_a_large_one():
    track = along([(0, 0), (480, 0), (480, 360), (120, 360)], noise=3.0)
    streets, small = town(8), town(8, block=1.2)
    large = match(track, streets)[0]
    tiny = match(Track("robot", track.times, track.positions / 100), small)[0]
    assert tiny.edge.tolist() == large.edge.tolist()
    np.testing.assert_allclose(tiny.along, large.along / 100, rtol=1e-6, atol=1e-9)


def test_scales_are_kept_where_given():
    track = along([(0, 0), (480, 0), (480, 360)], noise=4.0)
    found = match(track, town(8), sigma=9.0, beta=21.0)
    assert (found.scales.sigma, found.scales.beta, found[0].scales.sigma) == (9.0, 21.0, 9.0)


def test_errors_alike_from_sample_to_sample_make_sigma_larger():
    rng = np.random.default_rng(2)
    track = along([(-360, 0), (360, 0), (360, 360), (-360, 360), (-360, 0)] * 2)
    drift = np.cumsum(rng.normal(0, 1.0, (len(track), 2)), axis=0)
    drift -= np.linspace(0, 1, len(track))[:, None] * drift[-1]
    slow = match(
        Track("slow", track.times, track.positions + drift * 5 / drift.std()), town(), gap=math.inf
    ).scales
    quick = match(
        Track("quick", track.times, track.positions + rng.normal(0, 5, drift.shape)),
        town(),
        gap=math.inf,
    ).scales
    assert slow.sigma / slow.error > 2 * quick.sigma / quick.error


# what a match tells


def test_route_and_places_agree():
    streets = town()
    track = along([(-360, -360), (0, -360), (0, 0), (240, 0)], noise=3.0)
    found = match(track, streets)[0]
    (piece,) = found.pieces
    assert (piece.first, piece.last, piece.reason, found.breaks) == (
        0,
        len(found) - 1,
        "end of track",
        (),
    )
    assert (np.diff(found.along) >= 0).all()
    assert found.along[0] == 0
    assert found.along[-1] == pytest.approx(piece.length)
    steps = np.linalg.norm(np.diff(piece.line, axis=0), axis=1)
    assert steps.sum() == pytest.approx(piece.length)
    np.testing.assert_array_equal(piece.route.edges[found.leg], found.edge)
    np.testing.assert_array_equal(piece.route.forward[found.leg], found.forward)
    np.testing.assert_allclose(
        np.linalg.norm(found.snapped_positions(streets) - track.positions, axis=1),
        found.distance,
        atol=1e-6,
    )
    on_line = np.stack(
        [np.interp(found.along, np.append(0.0, np.cumsum(steps)), axis) for axis in piece.line.T],
        axis=1,
    )
    np.testing.assert_allclose(on_line, found.snapped_positions(streets), atol=1e-6)
    ends = piece.route.end[:-1]
    np.testing.assert_allclose(
        np.where(piece.route.forward[:-1], streets.lengths[piece.route.edges[:-1]], 0.0), ends
    )
    assert (found.confidence > 0.5).mean() > 0.9
    assert piece.confidence == pytest.approx(found.confidence.mean())


def test_samples_of_a_standing_car_stay_where_it_stands():
    drive, rng = along([(0, 0), (240, 0)], noise=2.0), np.random.default_rng(1)
    still = np.tile([240.0, 0.0], (300, 1)) + rng.normal(0, 2, (300, 2))
    on = along([(240, 0), (360, 0), (360, 240)], noise=2.0, seed=4).positions
    places = np.concatenate((drive.positions, still, on))
    found = match(Track("car", np.arange(len(places)), places), town())[0]
    assert sum(piece.length for piece in found.pieces) == pytest.approx(600, abs=20)


def test_a_car_turns_inside_a_road():
    road = network([(0, 0), (600, 0), (600, 300)], [(0, 1), (1, 2)])
    found = match(along([(100, 0), (400, 0), (50, 0)], noise=2.0), road)[0]
    (piece,) = found.pieces
    assert piece.route.edges.tolist() == [0, 0]
    assert piece.route.forward.tolist() == [True, False]
    assert piece.route.end[0] == piece.route.begin[1] == pytest.approx(400, abs=15)
    assert piece.length == pytest.approx(650, abs=20)


def test_one_way_streets_are_driven_one_way():
    nodes = [(0, 0), (500, 0), (0, 20), (500, 20), (-100, 10), (600, 10)]
    pairs = [(0, 1), (3, 2), (4, 0), (1, 5), (5, 3), (2, 4)]
    streets = network(nodes, pairs, backward=[False] * 6)
    east = Track(
        "east", np.arange(0, 70.0), np.stack([np.linspace(-90, 590, 70), np.full(70, 13.0)], axis=1)
    )
    assert set(match(east, streets, sigma=12.0)[0].edge.tolist()) == {2, 0, 3}
    both = network(nodes, pairs)
    assert 1 in match(east, both, sigma=12.0)[0].edge


# breaks


def test_a_silence_breaks_and_matching_goes_on():
    track = along([(-360, 0), (360, 0)], noise=2.0)
    kept = (track.times < 20) | (track.times > 50)
    found = match(Track("car", track.times[kept], track.positions[kept]), town(), gap=20.0)[0]
    assert [(one.after, one.before, one.reason) for one in found.breaks] == [(19, 20, "gap")]
    assert [piece.reason for piece in found.pieces] == ["gap", "end of track"]
    assert [piece.length for piece in found.pieces] == pytest.approx([190, 210], abs=12)
    (whole,) = match(Track("car", track.times[kept], track.positions[kept]), town(), gap=math.inf)[
        0
    ].pieces
    assert whole.length == pytest.approx(720, abs=12)


def test_a_stretch_far_from_roads_is_named():
    track = along([(-300, 0), (300, 0), (300, 2000), (340, 2000), (340, 0), (0, 0)], noise=2.0)
    roads = network([(-360, 0), (360, 0)], [(0, 1)])
    found = match(track, roads)[0]
    (gap,) = found.breaks
    assert gap.reason == "no road near"
    assert 50 < gap.after < 70
    assert (found.piece[gap.after + 1 : gap.before] == -1).all()
    assert np.isnan(found.offset[gap.after + 1 : gap.before]).all()
    assert found.share == pytest.approx(1 - (gap.before - gap.after - 1) / len(found))
    assert [piece.length for piece in found.pieces] == pytest.approx([600, 340], abs=25)


def test_disconnected_roads_break_the_route():
    roads = network([(0, 0), (400, 0), (408, 0), (800, 0)], [(0, 1), (2, 3)])
    found = match(along([(10, 1), (790, 1)], noise=1.0), roads)[0]
    assert [one.reason for one in found.breaks] == ["no route"]
    assert [piece.route.edges.tolist() for piece in found.pieces] == [[0], [1]]


def test_a_far_detour_breaks_the_route():
    roads = network(
        [(0, 0), (400, 0), (400, 800), (408, 800), (408, 0), (800, 0)],
        [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5)],
    )
    found = match(along([(10, 1), (790, 1)], noise=1.0), roads)[0]
    assert [one.reason for one in found.breaks] == ["detour"]
    assert sum(piece.length for piece in found.pieces) == pytest.approx(760, abs=30)


def test_a_teleport_breaks_the_route():
    track = along([(-300, 0), (0, 0), (300, 0)], noise=2.0)
    positions = track.positions.copy()
    positions[30:] += [0, 360]
    found = match(Track("car", track.times, positions), town(), gap=math.inf)[0]
    assert len(found.breaks) <= 1
    far, east = positions.copy(), np.array([30_000.0, 0.0])
    far[30:] += east
    streets = town()
    twin = Network(
        np.concatenate((streets.nodes, streets.nodes + east)),
        np.concatenate((streets.starts, streets.starts + len(streets.nodes))).astype(np.int32),
        np.concatenate((streets.ends, streets.ends + len(streets.nodes))).astype(np.int32),
        np.concatenate((streets.offsets, streets.offsets[1:] + len(streets.points))),
        np.concatenate((streets.points, streets.points + east)),
        *(np.tile(one, 2) for one in (streets.forward, streets.backward, streets.speeds)),
    )
    found = match(Track("car", track.times, far), twin, gap=math.inf)[0]
    assert [one.reason for one in found.breaks] == ["too fast"]
    assert found.share == 1.0


def drive_beside(metres=3.0):
    """Thirty samples exactly so many metres beside a street: every error is the same, so that many of them tell hardly more than one."""
    track = along([(-300, 0), (280, 0)], period=2.0)
    return Track("car", track.times, track.positions + np.array([0.0, metres]))


def moved(track, samples, metres):
    positions = track.positions.copy()
    positions[samples] += metres
    return Track(track.id, track.times, positions)


@pytest.mark.parametrize("run", [1, 2, 4])
def test_samples_that_leap_away_and_back_are_on_no_road_and_the_piece_goes_on(run):
    track = drive_beside()
    far = np.arange(12, 12 + run)
    found, alone = (
        match(moved(track, far, [90_000.0, 50_000.0]), town())[0],
        match(track, town())[0],
    )
    assert [(one.after, one.before, one.reason) for one in found.breaks] == [(11, 12 + run, "leap")]
    assert np.flatnonzero(found.piece < 0).tolist() == far.tolist()
    assert (found.confidence[far] == 0).all()
    assert np.isnan(found.distance[far]).all()
    rest = np.delete(np.arange(len(track)), far)
    np.testing.assert_array_equal(found.edge[rest], alone.edge[rest])
    np.testing.assert_allclose(found.along[rest], alone.along[rest], atol=1e-6)
    assert [(one.first, one.last) for one in found.pieces] == [(0, len(track) - 1)]


@pytest.mark.parametrize(
    "far", [[0], [29], [10, 11, 12, 13, 14, 15], [0, 1, 20, 21, 22, 23, 24, 25]]
)
def test_a_short_log_that_is_elsewhere_for_a_while_is_matched_for_the_rest(far):
    track = drive_beside()
    found = match(moved(track, far, [90_000.0, 50_000.0]), town(), gap=math.inf)[0]
    assert np.flatnonzero(found.piece < 0).tolist() == far
    assert {one.reason for one in found.breaks} == {"no road near"}


def test_leaps_shift_the_samples_of_breaks_behind_them():
    track = drive_beside()
    times = track.times.copy()
    times[20:] += 900
    torn = Track("car", times, moved(track, [5, 9], [90_000.0, 50_000.0]).positions)
    found = match(torn, town(), gap=60.0)[0]
    assert [(one.after, one.before, one.reason) for one in found.breaks] == [
        (4, 6, "leap"),
        (8, 10, "leap"),
        (19, 20, "gap"),
    ]
    assert [(one.first, one.last, one.reason) for one in found.pieces] == [
        (0, 19, "gap"),
        (20, 29, "end of track"),
    ]


def test_a_leap_in_a_break_is_no_break_of_its_own():
    track = drive_beside()
    away = moved(track, np.arange(10, 20), [0.0, 20_000.0])
    found = match(moved(away, [14], [90_000.0, 0.0]), town(), gap=math.inf)[0]
    assert [(one.after, one.before, one.reason) for one in found.breaks] == [
        (9, 20, "no road near")
    ]


# bad input


def test_a_log_elsewhere_is_matched_nowhere():
    track = along([(0, 0), (500, 0)], noise=1.0)
    found = match(Track("far", track.times, track.positions + 1e6), town())
    assert (found.share, found[0].pieces, found.breaks) == (0.0, (), {"no road near": 1})


def test_tracks_and_roads_must_be_there():
    with pytest.raises(InputError, match="no tracks"):
        match([], town())
    with pytest.raises(InputError, match="no roads"):
        match(along([(0, 0), (9, 0)]), network(np.zeros((0, 2)), np.zeros((0, 2))))


def test_planes_must_agree():
    with pytest.raises(OptionError, match="different planes"):
        match(along([(0, 0), (9, 0)]), network([(0, 0), (9, 0)], [(0, 1)], plane=Plane(((0, 0),))))


@pytest.mark.parametrize("name", ["sigma", "beta", "gap"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan])
def test_scales_must_be_positive(name, value):
    with pytest.raises(OptionError, match=name):
        match(along([(0, 0), (9, 0)]), town(), **{name: value})


def test_roads_without_length_and_twice_do_no_harm():
    nodes = [(0, 0), (200, 0), (200, 0), (400, 0)]
    messy = network(nodes, [(0, 1), (0, 1), (1, 2), (1, 0), (2, 3), (3, 3)])
    track = along([(10, 0), (390, 0)], noise=2.0)
    (piece,) = match(track, messy)[0].pieces
    assert piece.length == pytest.approx(380, abs=8)


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_short_tracks(samples):
    track = Track(
        "short",
        np.arange(samples),
        np.stack([5.0 * np.arange(samples) + 7, np.ones(samples)], axis=1),
    )
    found = match(track, town())[0]
    assert found.share == 1.0
    assert len(found.pieces) == 1
    assert found.pieces[0].length == pytest.approx(5.0 * (samples - 1), abs=1e-6)


def test_a_standing_log_is_one_place():
    track = Track("still", np.arange(50.0), np.tile([33.0, 1.0], (50, 1)))
    found = match(track, town())[0]
    assert found.share == 1.0
    assert found.pieces[0].length == 0.0


@pytest.mark.parametrize("dimension", [1, 3])
def test_other_dimensions(dimension):
    line = np.zeros((2, dimension))
    line[1, 0] = 300.0
    one = np.ones(1, bool)
    road = Network(
        line,
        np.zeros(1, np.int32),
        np.ones(1, np.int32),
        np.array([0, 2]),
        line,
        one,
        one,
        np.full(1, np.nan),
    )
    places = np.zeros((28, dimension))
    places[:, 0] = np.linspace(10, 280, 28)
    found = match(Track("lift", np.arange(28.0), places), road)[0]
    np.testing.assert_allclose(found.offset, places[:, 0])
    if dimension == 3:  # another floor is far
        high = Track("high", np.arange(28.0), places + np.array([0, 0, 5.0]))
        assert (
            match([Track("lift", np.arange(28.0), places), high], road, sigma=0.1)[1].share == 0.0
        )
        assert match(Track("flat", np.arange(28.0), places[:, :2]), road)[0].share == 1.0


def test_tracks_are_matched_as_one_log_and_stay_apart():
    tracks = [
        along([(-360, y), (360, y)], noise=2.0, seed=y + 240, name=str(y)) for y in (-240, 0, 240)
    ]
    together = match(tracks, town())
    assert [one.track for one in together] == ["-240", "0", "240"]
    assert together.points == sum(map(len, tracks))
    again = match(tracks, town())
    for a, b in zip(together, again, strict=True):
        np.testing.assert_array_equal(a.offset, b.offset)


def test_progress_is_told():
    told = []
    match(
        [along([(0, 0), (100, 0)], name="a"), along([(0, 0), (300, 0)], name="b")],
        town(),
        progress=told.append,
    )
    assert told == pytest.approx([11 / 42, 1.0])
