import numpy as np
import pytest

from gpszip.codec.walks import decode, encode, encode_with_statistics, number_by_visit
from gpszip.errors import BoundError, CorruptArchiveError
from gpszip.model import GridWalk, GridWalks
from oracle import walk_decoder
from oracle.walks import assert_same, random_walks, walk


def assert_comes_back(walks):
    data = encode(walks)
    dimension = walks.nodes.shape[1]
    assert_same(decode(data, dimension, len(walks.walks)), walks)
    places, tracks, timed = walk_decoder.decode(data, dimension, len(walks.walks))
    assert places == walks.nodes.tolist()
    assert timed == walks.timed
    for plain, one in zip(tracks, walks.walks, strict=True):
        assert [node for node, _, _ in plain] == one.nodes.tolist()
        assert [cell for _, cell, _ in plain] == one.time_steps.tolist()
        assert [gap for _, _, gap in plain[1:]] == one.gaps.tolist()
    return data


@pytest.mark.parametrize("seed", range(24))
def test_random_maps_come_back_from_the_coder_and_from_its_plain_twin(seed):
    assert_comes_back(random_walks(seed))


def test_no_tracks_come_back():
    empty = GridWalks(np.zeros((0, 2), np.int64), ())
    assert encode(empty) == b"\x01"
    assert_comes_back(empty)


def test_one_knot_comes_back():
    assert_comes_back(GridWalks(np.array([[7, -9]]), (walk([0], [3]),)))


def test_every_track_may_start_where_one_ended():
    assert_comes_back(
        GridWalks(
            np.array([[0], [5]]),
            (walk([0, 1], [4, 9]), walk([1, 0], [9, 10]), walk([1], [2]), walk([0], [2])),
        )
    )


@pytest.mark.parametrize("scale", [2**20, 2**26, 2**40])
def test_huge_coordinates_and_times_come_back(scale):
    rng = np.random.default_rng(4)
    nodes = rng.integers(-scale, scale, (30, 3))
    cells = np.cumsum(rng.integers(1, scale, 60)) - 10 * scale
    route = np.concatenate([np.arange(30), rng.integers(0, 30, 30)])
    assert_comes_back(GridWalks(nodes, (walk(route, cells, rng.random(59) < 0.2),)))


def test_a_star_of_many_ways_comes_back():
    rng = np.random.default_rng(2)
    out = np.zeros(800, int)
    out[1::2] = np.where(np.arange(400) < 300, np.arange(400) + 1, rng.integers(1, 301, 400))
    assert_comes_back(
        GridWalks(rng.integers(-900, 900, (301, 2)), (walk(out, np.arange(800) * 3),))
    )


def test_more_nodes_than_are_looked_at_for_a_link_come_back():
    rng = np.random.default_rng(3)
    line = np.column_stack([np.arange(5000) * 3, rng.integers(-2, 3, 5000)])
    route = np.concatenate([np.arange(5000), [10, 4990, 2500, 4000, 3]])
    walks = GridWalks(line, (walk(route, np.arange(len(route)) * 4),))
    assert_same(decode(encode(walks), 2, 1), walks)


def test_a_long_monotonous_walk_comes_back():
    count = 150_000
    to_and_fro = walk(np.arange(count) % 2, np.arange(count) * 5)
    walks = GridWalks(np.array([[0, 0], [30, 4]]), (to_and_fro,))
    data = encode(walks)
    assert len(data) < 400
    assert_same(decode(data, 2, 1), walks)


def test_a_repeated_way_costs_little():
    loop = np.tile(np.arange(40), 50)
    angle = 2 * np.pi * np.arange(40) / 40
    nodes = np.round(100 * np.column_stack([np.cos(angle), np.sin(angle)])).astype(int) - [100, 0]
    cells = np.arange(len(loop)) * 7
    rng = np.random.default_rng(1)
    fresh = GridWalks(rng.integers(-100, 100, (len(loop), 2)), (walk(np.arange(len(loop)), cells),))
    assert len(encode(GridWalks(nodes, (walk(loop, cells),)))) < 0.05 * len(encode(fresh))


def test_the_ledger_adds_up_to_the_file():
    walks = random_walks(10)
    data, ledger = encode_with_statistics(walks)
    assert 0.8 * len(data) < ledger[:, 0].sum() / 8 <= len(data)
    # kinds and gaps, starts: every knot was reached once
    knots = sum(len(one.nodes) for one in walks.walks)
    assert ledger[:5, 1].sum() + ledger[11:, 1].sum() == knots


def test_nodes_are_numbered_by_visit_and_unvisited_ones_dropped():
    rng = np.random.default_rng(6)
    places = rng.integers(-50, 50, (20, 2))
    routes = [rng.integers(0, 15, 12), rng.integers(0, 15, 7)]
    walks = GridWalks(places, tuple(walk(route, np.arange(len(route))) for route in routes))
    numbered = number_by_visit(walks)
    seen = list(dict.fromkeys(np.concatenate(routes).tolist()))
    np.testing.assert_array_equal(numbered.nodes, places[seen])
    for old, new in zip(routes, numbered.walks, strict=True):
        np.testing.assert_array_equal(numbered.nodes[new.nodes], places[old])
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
def test_counts_that_can_not_be_are_refused(data, tracks):
    with pytest.raises(CorruptArchiveError):
        decode(data, 2, tracks)


def test_a_forged_count_gets_no_memory_beyond_its_bytes():
    # 4096 knots and 512 for each byte of payload are believed, one more is not
    for payload in (b"", b"abc"):
        for more, refused in ((0, False), (1, True)):
            count = 4 * (4096 + 512 * len(payload) + more)
            data = bytes([count & 127 | 128, count >> 7 & 127 | 128, count >> 14]) + payload
            with pytest.raises(CorruptArchiveError) as error:
                decode(data, 1, 2)
            assert ("can't lie in" in str(error.value)) == refused


def test_a_link_with_nowhere_to_go_is_no_trap():
    # a gap to a known node where there is only the one the track is at
    for seed in range(400):
        noise = np.random.default_rng(seed).bytes(12)
        try:
            found = decode(bytes([4 * 20 + 3]) + noise, 1, 1)
        except CorruptArchiveError:
            continue
        assert sum(len(one.nodes) for one in found.walks) == 20


@pytest.mark.parametrize(("place", "cell"), [(2**45, 5), (-(2**50), 5), (7, 2**45)])
def test_what_no_reader_would_take_is_not_written(place, cell):
    walk = GridWalk(np.array([0, 1], np.int32), np.array([0, cell]), np.zeros(1, bool))
    with pytest.raises(BoundError, match="too far apart"):
        encode(GridWalks(np.array([[0, 0], [place, 3]]), (walk,)))


def test_many_new_ways_that_cost_next_to_nothing_come_back():
    # to and fro over gaps between two of seventy places, so often that few places are weighed any more
    line = np.column_stack([np.arange(70) * 9, np.zeros(70)]).astype(np.int64)
    route = np.concatenate([np.arange(70), np.tile([3, 66], 8300)])
    gaps = np.arange(len(route) - 1) >= 69
    walks = GridWalks(line, (walk(route, np.arange(len(route)) * 4, gaps),))
    data = assert_comes_back(walks)
    assert len(data) < 8 * 8300
