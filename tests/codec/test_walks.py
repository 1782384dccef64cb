import numpy as np
import pytest

from gpszip.codec.numbering import number_by_visit
from gpszip.codec.walks import decode, encode, encode_with_statistics
from gpszip.errors import BoundError, CorruptArchiveError
from gpszip.model import GridWalk, GridWalks
from oracle import walk_decoder
from oracle.walks import assert_same, random_walks, walk


def assert_plain_decoder_agrees(data, walks):
    positions, tracks, timed = walk_decoder.decode(data, walks.nodes.shape[1], len(walks.walks))
    assert positions == walks.nodes.tolist()
    assert timed == walks.timed
    for track, walk_ in zip(tracks, walks.walks, strict=True):
        nodes, time_steps, gaps = zip(*track, strict=True)
        assert list(nodes) == walk_.nodes.tolist()
        assert list(time_steps) == walk_.time_steps.tolist()
        assert list(gaps[1:]) == walk_.gaps.tolist()


def assert_round_trip(walks):
    data = encode(walks)
    dimension = walks.nodes.shape[1]
    assert_same(decode(data, dimension, len(walks.walks)), walks)
    assert_plain_decoder_agrees(data, walks)
    return data


@pytest.mark.parametrize("seed", range(24))
def test_random_walks_round_trip_and_the_plain_decoder_agrees(seed):
    assert_round_trip(random_walks(seed))


def test_no_tracks_round_trip():
    empty = GridWalks(np.zeros((0, 2), np.int64), ())
    assert encode(empty) == b"\x01"
    assert_round_trip(empty)


def test_one_knot_round_trips():
    assert_round_trip(GridWalks(np.array([[7, -9]]), (walk([0], [3]),)))


def test_tracks_that_start_where_others_ended_round_trip():
    assert_round_trip(
        GridWalks(
            np.array([[0], [5]]),
            (walk([0, 1], [4, 9]), walk([1, 0], [9, 10]), walk([1], [2]), walk([0], [2])),
        )
    )


@pytest.mark.parametrize("scale", [2**20, 2**26, 2**40])
def test_huge_coordinates_and_times_round_trip(scale):
    rng = np.random.default_rng(4)
    nodes = rng.integers(-scale, scale, (30, 3))
    time_steps = np.cumsum(rng.integers(1, scale, 60)) - 10 * scale
    route = np.concatenate([np.arange(30), rng.integers(0, 30, 30)])
    assert_round_trip(GridWalks(nodes, (walk(route, time_steps, rng.random(59) < 0.2),)))


def test_a_node_of_many_edges_round_trips():
    rng = np.random.default_rng(2)
    out = np.zeros(800, int)
    out[1::2] = np.where(np.arange(400) < 300, np.arange(400) + 1, rng.integers(1, 301, 400))
    assert_round_trip(
        GridWalks(rng.integers(-900, 900, (301, 2)), (walk(out, np.arange(800) * 3),))
    )


def test_new_edges_to_nodes_beyond_the_candidates_round_trip():
    rng = np.random.default_rng(3)
    line = np.column_stack([np.arange(5000) * 3, rng.integers(-2, 3, 5000)])
    route = np.concatenate([np.arange(5000), [10, 4990, 2500, 4000, 3]])
    walks = GridWalks(line, (walk(route, np.arange(len(route)) * 4),))
    assert_same(decode(encode(walks), 2, 1), walks)


def test_a_long_monotonous_walk_takes_few_bytes():
    count = 150_000
    to_and_fro = walk(np.arange(count) % 2, np.arange(count) * 5)
    walks = GridWalks(np.array([[0, 0], [30, 4]]), (to_and_fro,))
    data = encode(walks)
    assert len(data) < 400
    assert_same(decode(data, 2, 1), walks)


def test_a_repeated_loop_takes_few_bytes():
    loop = np.tile(np.arange(40), 50)
    angle = 2 * np.pi * np.arange(40) / 40
    nodes = np.round(100 * np.column_stack([np.cos(angle), np.sin(angle)])).astype(int) - [100, 0]
    time_steps = np.arange(len(loop)) * 7
    rng = np.random.default_rng(1)
    fresh_nodes = rng.integers(-100, 100, (len(loop), 2))
    fresh = GridWalks(fresh_nodes, (walk(np.arange(len(loop)), time_steps),))
    repeated = GridWalks(nodes, (walk(loop, time_steps),))
    assert len(encode(repeated)) < 0.05 * len(encode(fresh))


def test_the_statistics_add_up_to_the_file():
    walks = random_walks(10)
    data, statistics = encode_with_statistics(walks)
    assert 0.8 * len(data) < statistics[:, 0].sum() / 8 <= len(data)
    # each knot is a step of some kind, a gap or a start
    knots = sum(len(walk_.nodes) for walk_ in walks.walks)
    assert statistics[:5, 1].sum() + statistics[11:, 1].sum() == knots


def test_nodes_are_numbered_by_visit_and_others_dropped():
    rng = np.random.default_rng(6)
    positions = rng.integers(-50, 50, (20, 2))
    routes = [rng.integers(0, 15, 12), rng.integers(0, 15, 7)]
    walks = GridWalks(positions, tuple(walk(route, np.arange(len(route))) for route in routes))
    numbered = number_by_visit(walks)
    seen = list(dict.fromkeys(np.concatenate(routes).tolist()))
    np.testing.assert_array_equal(numbered.nodes, positions[seen])
    for old, new in zip(routes, numbered.walks, strict=True):
        np.testing.assert_array_equal(numbered.nodes[new.nodes], positions[old])
    assert_same(number_by_visit(numbered), numbered)


@pytest.mark.parametrize(
    ("data", "tracks"),
    [
        (b"", 1),
        (b"\x81", 1),
        (b"\xff" * 9, 1),
        (b"\x05", 0),  # a knot of no track
        (b"\x01", 1),  # no knot of a track
        (b"\x05", 2),  # fewer knots than tracks
        (b"\xff\xff\xff\xff\xff\xff\xff\x7f", 1),
        (bytes([1 | 4 * 30 & 127 | 128, 1]), 3),
    ],
)
def test_impossible_counts_are_refused(data, tracks):
    with pytest.raises(CorruptArchiveError):
        decode(data, 2, tracks)


def test_a_forged_count_of_knots_is_refused():
    # 4096 knots and 512 for each byte of payload are accepted, one more is not
    for payload in (b"", b"abc"):
        for more, is_refused in ((0, False), (1, True)):
            count = 4 * (4096 + 512 * len(payload) + more)
            data = bytes([count & 127 | 128, count >> 7 & 127 | 128, count >> 14]) + payload
            with pytest.raises(CorruptArchiveError) as error:
                decode(data, 1, 2)
            assert ("can't lie in" in str(error.value)) == is_refused


def test_a_gap_to_a_known_node_where_there_is_none_ends():
    # a gap to a known node where there is only the one the track is at
    for seed in range(400):
        noise = np.random.default_rng(seed).bytes(12)
        try:
            found = decode(bytes([4 * 20 + 3]) + noise, 1, 1)
        except CorruptArchiveError:
            continue
        assert sum(len(walk_.nodes) for walk_ in found.walks) == 20


@pytest.mark.parametrize(("coordinate", "time_step"), [(2**45, 5), (-(2**50), 5), (7, 2**45)])
def test_walks_out_of_bounds_are_not_written(coordinate, time_step):
    walk = GridWalk(np.array([0, 1], np.int32), np.array([0, time_step]), np.zeros(1, bool))
    with pytest.raises(BoundError, match="too far apart"):
        encode(GridWalks(np.array([[0, 0], [coordinate, 3]]), (walk,)))


def test_many_cheap_choices_round_trip():
    # over gaps between two of seventy nodes, so often that few candidates are weighed any more
    line = np.column_stack([np.arange(70) * 9, np.zeros(70)]).astype(np.int64)
    route = np.concatenate([np.arange(70), np.tile([3, 66], 8300)])
    gaps = np.arange(len(route) - 1) >= 69
    walks = GridWalks(line, (walk(route, np.zeros(len(route)), gaps),), False)
    data = assert_round_trip(walks)
    assert len(data) < 8 * 8300
