"""Modes round-trip, win where they should, and hold against forged bytes."""

import numpy as np
import pytest

from calling import from_python
from gpszip.archive.create import new_archive
from gpszip.codec.kernels.walk_model import SHORTEST_PATHS, SORTED_STARTS, TIME_FIRST
from gpszip.codec.modes import encode_smallest
from gpszip.codec.numbering import number_by_visit
from gpszip.codec.payload_head import MAX_SORTED_TRACKS
from gpszip.codec.prior import Prior
from gpszip.codec.walks import decode, encode, encode_in_modes
from gpszip.errors import CorruptArchiveError
from gpszip.graph.kernels.shortest_paths import write_canonical_path
from gpszip.graph.road_graph import build_road_graph
from gpszip.graph.trees import kernel_arcs, new_search_on
from gpszip.model import GridWalk, GridWalks
from gpszip.model.grid import QuantisationGrid
from oracle import walk_decoder
from oracle.walks import assert_same, random_walks, walk

# Inner kernels, as Python calls them.
write_canonical_path = from_python(write_canonical_path)


def count_knots(walks):
    return sum(len(one.nodes) for one in walks.walks)


def encode_with_mode(walks, modes, prior=None):
    step_bits = np.zeros(count_knots(walks))
    encode_in_modes(walks, prior, 0, step_bits)
    return encode_in_modes(walks, prior, modes, step_bits)[0]


def assert_plain_decoder_agrees(data, walks):
    positions, tracks, _ = walk_decoder.decode(data, walks.nodes.shape[1], len(walks.walks))
    assert positions == walks.nodes.tolist()
    for track, walk_ in zip(tracks, walks.walks, strict=True):
        assert [node for node, _, _ in track] == walk_.nodes.tolist()
        assert [time_step for _, time_step, _ in track] == walk_.time_steps.tolist()


@pytest.mark.parametrize("modes", range(1, 8))
@pytest.mark.parametrize("seed", range(5))
def test_random_walks_round_trip_in_all_modes(seed, modes):
    walks = random_walks(seed, longest=100)
    if walks.timed or not modes & SORTED_STARTS:
        data = encode_with_mode(walks, modes)
        assert_same(decode(data, walks.nodes.shape[1], len(walks.walks)), walks)
        assert_plain_decoder_agrees(data, walks)


def town(size=14, seed=3):
    """Positions on a bent grid of streets, and the edges between neighbours."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(size), np.arange(size))
    positions = np.round(
        100 * np.column_stack([x.ravel(), y.ravel()]) + rng.uniform(-35, 35, (size * size, 2))
    ).astype(np.int64)
    at = np.arange(size * size).reshape(size, size)
    return positions, np.vstack(
        [
            np.column_stack([at[:, :-1].ravel(), at[:, 1:].ravel()]),
            np.column_stack([at[:-1].ravel(), at[1:].ravel()]),
        ]
    )


def walk_all_edges(positions, edges):
    """One long walk over all edges, some of them several times, as a prior."""
    size = int(np.sqrt(len(positions)))
    rows = [np.arange(size)[:: 1 if row % 2 == 0 else -1] + size * row for row in range(size)]
    back = [at % size * size + at // size for at in np.concatenate(rows)]
    start = np.concatenate(rows)[::-1]
    route = np.concatenate([np.concatenate(rows), start[1:], np.array(back)[1:]])
    return GridWalk(
        route.astype(np.int32), np.arange(len(route)) * 20, np.zeros(len(route) - 1, bool)
    )


def trips_in_town(positions, edges, count, seed=5):
    """Trips along shortest paths between nodes anywhere in town."""
    graph = build_road_graph(positions.tolist(), edges.tolist())
    arcs, search, rng = kernel_arcs(graph), new_search_on(graph, None), np.random.default_rng(seed)
    nodes, edges = np.zeros(len(positions), np.int32), np.zeros(len(positions), np.int32)
    here, trips = 0, []
    for trip in range(count):
        end_node = int(rng.integers(len(positions)))
        if end_node != here:
            end = write_canonical_path(arcs, search, here, end_node, nodes, edges, 0)
            route = nodes[: end + 1].copy()
            trips.append(
                GridWalk(route, 10_000 * (trip + 1) + np.arange(end + 1) * 20, np.zeros(end, bool))
            )
            here = end_node
    return tuple(trips)


@pytest.fixture(scope="module")
def known_town():
    positions, edges = town()
    prior = Prior(number_by_visit(GridWalks(positions, (walk_all_edges(positions, edges),))))
    numbers = {
        tuple(position): number for number, position in enumerate(prior.walks.nodes.tolist())
    }
    order = np.array([numbers[tuple(position)] for position in positions.tolist()], np.int32)
    trips = tuple(
        GridWalk(order[trip.nodes], trip.time_steps, trip.gaps)
        for trip in trips_in_town(positions, edges, 60)
    )
    return prior, GridWalks(prior.walks.nodes, trips)


def test_targets_win_on_trips_along_shortest_paths(known_town):
    prior, trips = known_town
    with_targets, plain = encode_with_mode(trips, SHORTEST_PATHS, prior), encode(trips, prior)
    assert len(with_targets) < 0.92 * len(plain)
    assert_same(decode(with_targets, 2, len(trips.walks), prior), trips)
    assert len(encode_smallest(trips, prior)) <= len(with_targets)


def test_time_first_wins_where_the_speed_is_steady():
    rng = np.random.default_rng(2)
    heading = np.cumsum(rng.normal(0, 0.3, 400))
    durations = rng.integers(2, 60, 400)
    positions = np.round(
        np.cumsum(
            np.column_stack([np.cos(heading), np.sin(heading)]) * (25.0 * durations)[:, None],
            axis=0,
        )
    ).astype(np.int64)
    walks = GridWalks(positions, (walk(np.arange(400), np.cumsum(durations)),))
    timed_first = encode_with_mode(walks, TIME_FIRST)
    assert len(timed_first) < 0.97 * len(encode(walks))
    assert_same(decode(timed_first, 2, 1), walks)
    assert_plain_decoder_agrees(timed_first, walks)
    assert encode_smallest(walks) == timed_first


def test_sorted_starts_win_where_tracks_follow_each_other():
    rng = np.random.default_rng(4)
    starts = np.cumsum(rng.integers(1, 200_000, 80))
    walks = GridWalks(
        np.array([[0, 0], [40, 9]]), tuple(walk([0, 1], [start, start + 9]) for start in starts)
    )
    ordered = encode_with_mode(walks, SORTED_STARTS)
    assert len(ordered) < len(encode(walks)) - 6
    assert_plain_decoder_agrees(ordered, walks)
    assert encode_smallest(walks) == ordered


def test_large_walks_take_shortest_paths_if_the_sample_pays(known_town):
    prior, _ = known_town
    numbers = {
        tuple(position): number for number, position in enumerate(prior.walks.nodes.tolist())
    }
    positions, edges = town()
    order = np.array([numbers[tuple(position)] for position in positions.tolist()], np.int32)
    many = trips_in_town(positions, edges, 1100)
    trips = GridWalks(
        prior.walks.nodes,
        tuple(GridWalk(order[trip.nodes], trip.time_steps, trip.gaps) for trip in many),
    )
    assert count_knots(trips) > 8192
    data = encode_smallest(trips, prior)
    assert data[:1] == b"\0" and data[1] & SHORTEST_PATHS
    assert_same(decode(data, 2, len(trips.walks), prior), trips)


def test_archives_hold_the_smallest_payload():
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


def test_walks_without_modes_take_no_byte_for_them():
    one = GridWalks(np.array([[0, 0], [30, 4]]), (walk(np.arange(60) % 2, np.arange(60) * 5),))
    assert encode_smallest(one) == encode(one)
    assert encode_smallest(GridWalks(np.zeros((0, 2), np.int64), ())) == b"\x01"


@pytest.mark.parametrize(
    "head", [b"\0", b"\0\0", b"\0\1", b"\0\3", b"\0\x08", b"\0\xff", b"\1", b"\3", b"\0\4"]
)
def test_impossible_modes_are_refused(head):
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


def test_a_walk_may_not_end_on_its_path_to_a_target(known_town):
    prior, trips = known_town
    lone = GridWalks(trips.nodes, trips.walks[:1])
    data = encode_with_mode(lone, SHORTEST_PATHS, prior)
    assert_same(decode(data, 2, 1, prior), lone)
    knots = count_knots(lone)
    assert data[:3] == bytes([0, SHORTEST_PATHS, 4 * knots + 1])
    shorter = data[:2] + bytes([4 * (knots - 1) + 1]) + data[3:]
    with pytest.raises(CorruptArchiveError):
        decode(shorter, 2, 1, prior)


def test_forged_walks_of_many_targets_are_decoded_or_refused():
    # each byte costs at most so many searches, and the knots are bounded as always
    rng = np.random.default_rng(1)
    positions, edges = town()
    base = encode(number_by_visit(GridWalks(positions, (walk_all_edges(positions, edges),))))
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
