"""Traversals of edges against the drives that were generated."""

import numpy as np
import pytest

import gpszip
from gpszip.errors import InputError
from gpszip.history.traversals import History, read_history
from gpszip.testing import LogWithTruth
from gpszip.testing.roads import positions_on


def ends_of(history: History) -> tuple[np.ndarray, np.ndarray]:
    """Nodes at which each traversal would begin and end if it were of the entire edge."""
    network, rows = history.network, history.traversals
    starts, ends = network.starts[rows.edge], network.ends[rows.edge]
    return np.where(rows.forward, starts, ends), np.where(rows.forward, ends, starts)


def crossings(history: History, track: int) -> np.ndarray:
    """Traversals of a track that begin at a node, and not where it turned round on an edge."""
    rows = history.traversals
    other_edge = np.append(False, rows.edge[1:] != rows.edge[:-1])
    return np.flatnonzero((rows.track == track) & ~rows.starts & other_edge)


def test_vehicles_are_at_nodes_when_traversals_meet(
    vans: LogWithTruth, van_history: History
) -> None:
    network, rows = van_history.network, van_history.traversals
    first, _ = ends_of(van_history)
    for number, walk in enumerate(vans.walks):
        passes = crossings(van_history, number)
        truth = positions_on(walk, vans.road_map.nodes, rows.enter[passes])
        distance = np.linalg.norm(network.nodes[first[passes]] - truth, axis=1)
        assert len(passes) > 30
        # Two errors of a sample and a second of travel.
        assert np.quantile(distance, 0.9) < 25


def test_nodes_have_the_order_of_the_true_drives(vans: LogWithTruth, van_history: History) -> None:
    # True nodes that are nodes of the map; others have two roads, which the map joins to one edge.
    network = van_history.network
    first, _ = ends_of(van_history)
    gaps = np.linalg.norm(vans.road_map.nodes[:, None] - network.nodes[None], axis=2)
    number = np.where(gaps.min(axis=1) < 40, gaps.argmin(axis=1), -1)
    for track, walk in enumerate(vans.walks):
        told = first[crossings(van_history, track)]
        told = told[np.append(True, np.diff(told) != 0)]
        true = number[walk.nodes]
        true = true[(true >= 0)]
        true = true[np.append(True, np.diff(true) != 0)]
        # Where the vehicle turned at a dead end, it did not cross the node there.
        true, told = without_ends(true, network), without_ends(told, network)
        assert common_length(true, told) > 0.95 * len(true)
        assert len(told) < 1.05 * len(true)


def without_ends(nodes: np.ndarray, network: gpszip.Network) -> list[int]:
    """The nodes in their order, without dead ends and then without repetitions."""
    degrees = np.bincount(np.concatenate([network.starts, network.ends]))
    nodes = nodes[degrees[nodes] > 1]
    return [int(n) for n in nodes[np.append(True, np.diff(nodes) != 0)]]


def common_length(first: list[int], second: list[int]) -> int:
    row = [0] * (len(second) + 1)
    for a in first:
        before = row
        row = [0]
        for j, b in enumerate(second):
            row.append(before[j] + 1 if a == b else max(before[j + 1], row[j]))
    return row[-1]


def test_traversals_go_on_from_each_other(van_history: History) -> None:
    network, rows = van_history.network, van_history.traversals
    first, last = ends_of(van_history)
    length = network.lengths[rows.edge]
    at = rows.follows
    before = at - 1
    from_node = np.where(rows.forward, 0, length)
    to_node = np.where(rows.forward, length, 0)
    crosses = (
        (last[before] == first[at])
        & np.isclose(rows.end[before], to_node[before], atol=1e-3)
        & np.isclose(rows.begin[at], from_node[at], atol=1e-3)
    )
    turns = (rows.edge[before] == rows.edge[at]) & (rows.forward[before] != rows.forward[at])
    assert (crosses | turns).all()
    assert (rows.enter[at] == rows.leave[before]).all()
    assert (rows.track[at] == rows.track[before]).all()


def test_durations_and_standing(van_history: History) -> None:
    rows = van_history.traversals
    assert (rows.leave >= rows.enter).all()
    assert (rows.standing >= 0).all()
    assert (rows.standing <= rows.leave - rows.enter + 1e-6).all()
    # Vehicles wait for half a minute at each stop, in a tenth to a third of their time.
    share = rows.standing.sum() / (rows.leave - rows.enter).sum()
    assert 0.03 < share < 0.4


def test_no_traversal_is_faster_than_its_knots(
    van_archive: gpszip.Archive, van_history: History
) -> None:
    # Stops at dead ends belong to the way there, and slow ways take some time.
    rows = van_history.traversals
    speeds = rows.metres / (rows.leave - rows.enter - rows.standing)
    steps = [
        np.linalg.norm(np.diff(piece.positions, axis=0), axis=1) / np.diff(piece.times)
        for piece in van_archive.decompress()
    ]
    assert np.nanmax(speeds) < 1.5 * np.concatenate(steps).max()


def test_edges_are_those_of_matching(
    vans: LogWithTruth, van_archive: gpszip.Archive, van_history: History
) -> None:
    # A short part of one track is matched to edges of the same numbers.
    rows, track = van_history.traversals, vans.tracks[1]
    part = gpszip.Track("part", track.times[200:260], track.positions[200:260])
    (matched,) = gpszip.match(part, van_archive)
    mine = np.flatnonzero(rows.track == 1)
    at = np.searchsorted(rows.enter[mine], part.times, side="right") - 1
    agree = rows.edge[mine][at] == matched.edge
    assert agree.mean() > 0.85


def test_numbers_do_not_depend_on_the_log(van_archive: gpszip.Archive) -> None:
    # Two cities a thousand kilometres apart in one archive: a log of one meets the numbers of both.
    berlin = gpszip.Track(
        "a", np.arange(40) * 5.0, [[0.0, 20.0 * abs(i % 20 - 10)] for i in range(40)]
    )
    rome = gpszip.Track("b", berlin.times, berlin.positions + np.array([1e6, 0.0]))
    archive = gpszip.compress([berlin, rome], max_error=2.0)
    history = read_history(archive)
    network, rows = history.network, history.traversals
    (matched,) = gpszip.match(rome, archive)
    assert len(network) == 2
    assert set(matched.edge.tolist()) == set(rows.edge[rows.track == 1].tolist())


def test_parked_vehicle_is_one_traversal() -> None:
    # Ten minutes of noise in the middle of a street of 400 m.
    rng = np.random.default_rng(5)
    x = np.concatenate([np.linspace(0, 200, 40), np.full(300, 200.0), np.linspace(200, 400, 40)])
    positions = np.stack([x, np.zeros(len(x))], axis=1) + rng.normal(0, 2, (len(x), 2))
    track = gpszip.Track("van", np.arange(len(x)) * 2.0, positions)
    rows = read_history(gpszip.compress([track], rmse=2.0, effort=1)).traversals
    assert len(rows) == 1
    assert rows.leave[0] - rows.enter[0] > 740
    assert 500 < rows.standing[0] < 700


def test_tracks_without_times_have_none() -> None:
    shape = gpszip.Track("plan", [0, 50, 100], [[0, 0], [50, 0], [100, 0]], timed=False)
    rows = read_history(gpszip.compress([shape], max_error=1.0)).traversals
    assert len(rows) >= 1
    assert np.isnan([rows.enter, rows.leave, rows.standing]).all()


def test_nothing_moves() -> None:
    still = gpszip.Track("box", range(30), [[0.0, 0.0]] * 30)
    with pytest.raises(InputError, match="no edges"):
        read_history(gpszip.compress([still], max_error=1.0))


def test_take_starts_anew_after_what_is_left_out(van_history: History) -> None:
    rows = van_history.traversals
    some = rows.take(np.arange(len(rows)) % 3 != 1)
    assert len(some) == len(rows) - len(rows) // 3 - (len(rows) % 3 > 1)
    assert some.starts[1::2][: len(some) // 2].all()


def test_laps_told_by_few_knots_are_all_found():
    corners = np.array([[0, 0], [90, 0], [90, 60], [0, 60]] * 40, float)
    guard = gpszip.Track("guard", 30.0 * np.arange(len(corners)), corners)
    traversals = read_history(gpszip.compress(guard, rmse=6.0, effort=1)).traversals
    assert 39 <= len(traversals) <= 41
    assert len(set(traversals.forward.tolist())) == 1
