"""Walks payloads of version 2: later versions read them, and this one writes the same bytes."""

import numpy as np
import pytest

from gpszip.codec.numbering import number_by_visit
from gpszip.codec.plain.decode import decode_plain
from gpszip.codec.plain.work import WorkLimit
from gpszip.codec.walks import decode, encode, encode_in_modes
from gpszip.model import GridWalks, QuantisationGrid
from gpszip.model.grid_walks import PieceEnds
from oracle import walk_decoder
from oracle.walks import assert_same, walk


def random_numbers(seed):
    """Pseudo-random numbers from 0 to 2**23 - 1 that depend on no library."""
    while True:
        seed = (1103515245 * seed + 12345) % 2**31
        yield seed >> 8


def random_walks(seed, *, dimension=2, tracks=3, knots=25, timed=True, gapped=True, scale=200):
    """Walks along a line of nodes that now and then jump, stop or have a gap."""
    numbers = random_numbers(seed)
    nodes = np.array(
        [[next(numbers) % (2 * scale) - scale for _ in range(dimension)] for _ in range(12)]
    )
    walks = []
    for _ in range(tracks):
        node, time_step = next(numbers) % 12, next(numbers) % 100
        route, time_steps, gaps = [node], [time_step], []
        for _ in range(knots):
            event = next(numbers) % 16
            node = (
                next(numbers) % 12
                if event == 0
                else node
                if event == 1
                else (node + (1 if event < 12 else 11)) % 12
            )
            time_step += (1 + next(numbers) % 20 + 400 * (event == 1)) * timed
            route.append(node)
            time_steps.append(time_step)
            gaps.append(gapped and event == 2)
        walks.append(walk(route, time_steps if timed else [0] * len(time_steps), gaps))
    return number_by_visit(GridWalks(nodes, tuple(walks), timed))


CASES = {
    "empty": GridWalks(np.zeros((0, 2), np.int64), ()),
    "one knot": GridWalks(np.array([[3, -4]]), (walk([0], [7]),)),
    "plane": random_walks(1),
    "space": random_walks(2, dimension=3),
    "line": random_walks(3, dimension=1, tracks=1, knots=60),
    "five axes": random_walks(4, dimension=5, tracks=1),
    "no times": random_walks(5, timed=False),
    "no gaps": random_walks(6, gapped=False, tracks=1, knots=80),
    "far": random_walks(7, scale=2**40, tracks=1),
    "to and fro": GridWalks(
        np.array([[0, 0], [30, 4]]), (walk(np.arange(6000) % 2, np.arange(6000) * 5),)
    ),
}

WRITTEN = {
    "empty": ("01"),
    "one knot": ("05efbdc0"),
    "plane": (
        "bb02fe13d25020c30829154ed503a90af6e0e9860d4f2a8c40682ca43b654553722d610776c8e70aeef5a63a4c9c9f6e11860a9321f164"
        "e8e24c59187c3c6145fc2559554f3964b63609075edcbc1d5b9e6d434b072da08a46fbb96a2742be046152e9ee40fb39ef0ce0"
    ),
    "space": (
        "bb02e3fe6be90187a88e7777f21cd80344d44dbfdc0ed93e4543dec2e65040ec2c5219e65217cd636033f6fd9a66373966f2bf943ca115"
        "c60912f0d0c65f272f3755d2bdd54afdc480495b2d81ccce9f4404972c84baac37fca6584d0f8b16fdc699bf7e4c98a1981a6c200a37d0"
        "4f86ae0ee463fdc478b3e82ef5a2e657b6ee"
    ),
    "line": (
        "f701fd1fdcea8a6c14671dd76aa74919a32eb53439ffb3927d290c9dda606a33169d866f72fdee9423d068b7ef0ad43ed7d93acd366315"
        "d1cf20f1bc283a7a11cf849f5075d174093ac7716a88a2e73a5b"
    ),
    "five axes": (
        "6bfe7ffd27bb610f882d1ea30c6808a56e521706d5f64ba383d295b14f46fa1aa135f9857a844936fe4d5030fed46cebc87f6264578607"
        "4346a7bb2147863a42a49674a5f242f51bdea42f1e3b6aaed33baaaa6eff9280fc31573e2958"
    ),
    "no times": (
        "ba02fadf4d1fa8d2743346d65488b51463cb191bd47ecff6445b7ef550aaa68c86d690430e294c0834ea3cdf1d227b3d5e2653d7d0bbe3057d675b"
    ),
    "no gaps": (
        "c502f8bfe50e685d7ff4eaaa692c4dd587b30fdcd81306126bcf6a1381819fa3036f25509f685af79cab1b6eecd31def67ae2e4dbaf42f"
        "28c7921fc0bf4519dffc1a06097e1eac4361abcc5c986c2814ea99df66748c7152dbd928903895384e59f20e550c5fc1c1218b6d09"
    ),
    "far": (
        "6bfcdffffffffffbbffc07638417ff6f1a46c6507a3660a858b1ef9c27eb91224c4d2c2b83335065e306056d274c8e68f492a4a9f6f9eb"
        "8837c50621c63941538a08d9bd11fb1fb24bee1176766a535cadde4cf48645b6b5ad0ec8ce6ad2aa38c1e8529b7724c1dee7fa21b59051"
        "5ca706f8d9f0"
    ),
    "to and fro": ("c1bb0120696f3733ab87d06cbe2132b82c6258d476"),
}


@pytest.mark.parametrize("name", CASES)
def test_golden_payloads_are_written(name):
    assert encode(CASES[name]).hex() == WRITTEN[name]


@pytest.mark.parametrize("name", CASES)
def test_golden_payloads_are_read(name):
    walks, data = CASES[name], bytes.fromhex(WRITTEN[name])
    dimension, tracks = walks.nodes.shape[1], len(walks.walks)
    assert_same(decode(data, dimension, tracks), walks)
    assert_same(decode_plain(data, dimension, tracks, None, WorkLimit(10**9)), walks)


# the plain decoder takes long for the 6,000 knots of the last one
@pytest.mark.parametrize("name", [name for name in CASES if name != "to and fro"])
def test_the_plain_decoder_reads_golden_payloads(name):
    walks, data = CASES[name], bytes.fromhex(WRITTEN[name])
    dimension, tracks = walks.nodes.shape[1], len(walks.walks)
    positions, plain, _ = walk_decoder.decode(data, dimension, tracks)
    assert positions == walks.nodes.tolist()
    assert [[node for node, _, _ in track] for track in plain] == [
        walk_.nodes.tolist() for walk_ in walks.walks
    ]


def test_golden_payloads_hold_all_kinds_of_steps():
    walks = CASES["plane"].walks
    assert any(one.gaps.any() for one in walks)
    assert any((np.diff(one.nodes) == 0).any() for one in walks)
    assert any((one.nodes[2:] == one.nodes[:-2]).any() for one in walks)


#: A walk with a gap and one without times, and their payload of version 3 with ends of pieces.
GRID = QuantisationGrid((0, 0), 0, 128, 150)
WITH_ENDS = GridWalks(
    np.array([[0, 0], [40, 9], [90, 9]]),
    (walk([0, 1, 0, 2], [0, 5, 9, 20], [False, True, False]), walk([2, 1], [0, 1], [False])),
    True,
    PieceEnds(9, np.array([6, 310, 0]), np.array([78, 600, 0])),
    frozenset({1}),
)
WITH_ENDS_BYTES = "1b1a7a259e1d042eb81ee402c61ce9c4ce40"


def test_the_tail_of_version_3_is_written_and_read():
    assert encode_in_modes(WITH_ENDS, None, 0, np.zeros(0), GRID)[0].hex() == WITH_ENDS_BYTES
    data = bytes.fromhex(WITH_ENDS_BYTES)
    assert_is_with_ends(decode(data, 2, 2, grid=GRID))
    assert_is_with_ends(decode_plain(data, 2, 2, GRID, WorkLimit(10**9)))


def assert_is_with_ends(back):
    assert (back.ends.tick, back.untimed) == (9, {1})
    assert back.ends.first.tolist()[:2] == [6, 310]
    assert back.ends.last.tolist()[:2] == [78, 600]
