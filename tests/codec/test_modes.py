"""Ways of coding beside the usual one: each comes back, wins where it should, and holds against forged bytes."""

import numpy as np
import pytest

from gpszip.archive.create import new_archive
from gpszip.codec.kernels.walk_model import SHORTEST_PATHS, SORTED_STARTS, TIME_FIRST
from gpszip.codec.modes import encode_smallest
from gpszip.codec.prior import Prior
from gpszip.codec.walks import MAX_SORTED_TRACKS, decode, encode, encode_in_modes, number_by_visit
from gpszip.errors import CorruptArchiveError
from gpszip.graph.kernels.shortest_paths import write_canonical_path
from gpszip.graph.road_graph import build_road_graph
from gpszip.graph.trees import kernel_arcs, new_search_on
from gpszip.model import GridWalk, GridWalks
from gpszip.model.grid import QuantisationGrid
from oracle import walk_decoder
from oracle.walks import assert_same, random_walks, walk


def knots_of(walks):
    return sum(len(one.nodes) for one in walks.walks)


def in_mode(walks, modes, prior=None):
    spent = np.zeros(knots_of(walks))
    encode_in_modes(walks, prior, 0, spent)
    return encode_in_modes(walks, prior, modes, spent)[0]


def assert_twin_agrees(data, walks):
    places, tracks, _ = walk_decoder.decode(data, walks.nodes.shape[1], len(walks.walks))
    assert places == walks.nodes.tolist()
    for plain, one in zip(tracks, walks.walks, strict=True):
        assert [node for node, _, _ in plain] == one.nodes.tolist()
        assert [cell for _, cell, _ in plain] == one.time_steps.tolist()


@pytest.mark.parametrize("modes", range(1, 8))
@pytest.mark.parametrize("seed", range(8))
def test_random_walks_come_back_in_all_modes(seed, modes):
    walks = random_walks(seed, longest=200)
    if walks.timed or not modes & SORTED_STARTS:
        data = in_mode(walks, modes)
        assert_same(decode(data, walks.nodes.shape[1], len(walks.walks)), walks)
        assert_twin_agrees(data, walks)


def town(size=14, seed=3):
    """Places on a bent grid, and the ways between neighbours."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(size), np.arange(size))
    places = np.round(
        100 * np.column_stack([x.ravel(), y.ravel()]) + rng.uniform(-35, 35, (size * size, 2))
    ).astype(np.int64)
    at = np.arange(size * size).reshape(size, size)
    return places, np.vstack(
        [
            np.column_stack([at[:, :-1].ravel(), at[:, 1:].ravel()]),
            np.column_stack([at[:-1].ravel(), at[1:].ravel()]),
        ]
    )


def all_ways(places, ways):
    """One long walk over all ways, some of them several times, that a reader may know."""
    size = int(np.sqrt(len(places)))
    rows = [np.arange(size)[:: 1 if row % 2 == 0 else -1] + size * row for row in range(size)]
    back = [at % size * size + at // size for at in np.concatenate(rows)]
    start = np.concatenate(rows)[::-1]
    route = np.concatenate([np.concatenate(rows), start[1:], np.array(back)[1:]])
    return GridWalk(
        route.astype(np.int32), np.arange(len(route)) * 20, np.zeros(len(route) - 1, bool)
    )


def errands(places, ways, count, seed=5):
    """Trips along shortest paths between places anywhere in town."""
    graph = build_road_graph(places.tolist(), ways.tolist())
    arcs, search, rng = kernel_arcs(graph), new_search_on(graph, None), np.random.default_rng(seed)
    nodes, edges = np.zeros(len(places), np.int32), np.zeros(len(places), np.int32)
    here, trips = 0, []
    for trip in range(count):
        there = int(rng.integers(len(places)))
        if there != here:
            end = write_canonical_path(arcs, search, here, there, nodes, edges, 0)
            route = nodes[: end + 1].copy()
            trips.append(
                GridWalk(route, 10_000 * (trip + 1) + np.arange(end + 1) * 20, np.zeros(end, bool))
            )
            here = there
    return tuple(trips)


@pytest.fixture(scope="module")
def on_a_known_town():
    places, ways = town()
    prior = Prior(number_by_visit(GridWalks(places, (all_ways(places, ways),))))
    numbers = {tuple(place): number for number, place in enumerate(prior.walks.nodes.tolist())}
    order = np.array([numbers[tuple(place)] for place in places.tolist()], np.int32)
    trips = tuple(
        GridWalk(order[trip.nodes], trip.time_steps, trip.gaps)
        for trip in errands(places, ways, 60)
    )
    return prior, GridWalks(prior.walks.nodes, trips)


def test_aims_win_on_errands_along_shortest_paths(on_a_known_town):
    prior, trips = on_a_known_town
    aimed, plain = in_mode(trips, SHORTEST_PATHS, prior), encode(trips, prior)
    assert len(aimed) < 0.92 * len(plain)
    assert_same(decode(aimed, 2, len(trips.walks), prior), trips)
    assert len(encode_smallest(trips, prior)) <= len(aimed)


def test_spans_ahead_win_where_the_speed_is_steady():
    rng = np.random.default_rng(2)
    heading = np.cumsum(rng.normal(0, 0.3, 400))
    spans = rng.integers(2, 60, 400)
    places = np.round(
        np.cumsum(
            np.column_stack([np.cos(heading), np.sin(heading)]) * (25.0 * spans)[:, None], axis=0
        )
    ).astype(np.int64)
    walks = GridWalks(places, (walk(np.arange(400), np.cumsum(spans)),))
    paced = in_mode(walks, TIME_FIRST)
    assert len(paced) < 0.97 * len(encode(walks))
    assert_same(decode(paced, 2, 1), walks)
    assert_twin_agrees(paced, walks)
    assert encode_smallest(walks) == paced


def test_sorted_starts_win_where_tracks_follow_each_other():
    rng = np.random.default_rng(4)
    starts = np.cumsum(rng.integers(1, 200_000, 80))
    walks = GridWalks(
        np.array([[0, 0], [40, 9]]), tuple(walk([0, 1], [start, start + 9]) for start in starts)
    )
    ordered = in_mode(walks, SORTED_STARTS)
    assert len(ordered) < len(encode(walks)) - 6
    assert_twin_agrees(ordered, walks)
    assert encode_smallest(walks) == ordered


def test_large_walks_aim_if_it_pays_at_first(on_a_known_town):
    prior, _ = on_a_known_town
    numbers = {tuple(place): number for number, place in enumerate(prior.walks.nodes.tolist())}
    places, ways = town()
    order = np.array([numbers[tuple(place)] for place in places.tolist()], np.int32)
    many = errands(places, ways, 1100)
    trips = GridWalks(
        prior.walks.nodes,
        tuple(GridWalk(order[trip.nodes], trip.time_steps, trip.gaps) for trip in many),
    )
    assert knots_of(trips) > 8192
    data = encode_smallest(trips, prior)
    assert data[:1] == b"\0" and data[1] & SHORTEST_PATHS
    assert_same(decode(data, 2, len(trips.walks), prior), trips)


def test_archives_hold_the_smallest():
    starts = np.cumsum(np.random.default_rng(4).integers(1, 200_000, 80))
    walks = GridWalks(
        np.array([[0, 0], [40, 9]]), tuple(walk([0, 1], [start, start + 9]) for start in starts)
    )
    archive = new_archive(
        QuantisationGrid((0, 0), 0, 128, 128), [str(number) for number in range(80)], walks
    )
    assert (
        archive.contents.groups[0].payload
        == encode_smallest(walks, grid=archive.grid)
        != encode(walks)
    )
    assert_same(archive.grid_walks, walks)


def test_what_needs_no_mode_pays_for_none():
    one = GridWalks(np.array([[0, 0], [30, 4]]), (walk(np.arange(60) % 2, np.arange(60) * 5),))
    assert encode_smallest(one) == encode(one)
    assert encode_smallest(GridWalks(np.zeros((0, 2), np.int64), ())) == b"\x01"


@pytest.mark.parametrize(
    "head", [b"\0", b"\0\0", b"\0\1", b"\0\3", b"\0\x08", b"\0\xff", b"\1", b"\3", b"\0\4"]
)
def test_modes_that_can_not_be_are_refused(head):
    with pytest.raises(CorruptArchiveError, match=r"doesn.t know|no count|lie in"):
        decode(head, 2, 1)


def test_starts_without_times_or_of_too_many_tracks_are_not_sorted():
    payload = encode(random_walks(4))  # without times
    tracks = len(random_walks(4).walks)
    with pytest.raises(CorruptArchiveError, match="sorted"):
        decode(bytes([SORTED_STARTS]) + payload, random_walks(4).nodes.shape[1], tracks)
    many = GridWalks(
        np.array([[0, 0]]), tuple(walk([0], [start]) for start in range(MAX_SORTED_TRACKS + 1))
    )
    with pytest.raises(CorruptArchiveError, match="sorted"):
        decode(bytes([SORTED_STARTS]) + encode(many), 2, MAX_SORTED_TRACKS + 1)
    assert_same(decode(encode_smallest(many), 2, MAX_SORTED_TRACKS + 1), many)


def test_a_walk_may_not_end_on_its_way_to_a_place(on_a_known_town):
    prior, trips = on_a_known_town
    lone = GridWalks(trips.nodes, trips.walks[:1])
    data = in_mode(lone, SHORTEST_PATHS, prior)
    assert_same(decode(data, 2, 1, prior), lone)
    knots = knots_of(lone)
    assert data[:3] == bytes([0, SHORTEST_PATHS, 4 * knots + 1])
    shorter = data[:2] + bytes([4 * (knots - 1) + 1]) + data[3:]
    with pytest.raises(CorruptArchiveError):
        decode(shorter, 2, 1, prior)


def test_a_forged_walk_of_endless_aims_is_read_in_bounded_time():
    # every byte costs at most so many searches as links would; the knots are bounded as ever
    rng = np.random.default_rng(1)
    places, ways = town()
    base = encode(number_by_visit(GridWalks(places, (all_ways(places, ways),))))
    for seed in range(20):
        noise = np.random.default_rng(seed).bytes(400)
        data = (
            bytes([0, SHORTEST_PATHS])
            + bytes([255, 127])
            + base[2:200]
            + noise
            + bytes(rng.integers(0, 256, 8).tolist())
        )
        try:
            found = decode(data, 2, 1)
        except CorruptArchiveError:
            continue
        assert all(node < len(found.nodes) for node in found.walks[0].nodes)
