"""Walks payloads of version 1 as they were written once: every later version reads them, and this one writes the same bytes."""

import numpy as np
import pytest

from gpszip.coding.walks import decode, encode, number_by_visit
from gpszip.model import LatticeWalks
from oracle import walk_decoder
from oracle.walks import assert_same, walk


def draws(seed):
    """Numbers that no library decides, from 0 to 2**31 - 1."""
    while True:
        seed = (1103515245 * seed + 12345) % 2**31
        yield seed >> 8


def made(seed, *, dimension=2, tracks=3, knots=25, timed=True, gapped=True, scale=200):
    """Strolls along a line of places that now and then jump, stop or leave a gap."""
    numbers = draws(seed)
    nodes = np.array([[next(numbers) % (2 * scale) - scale for _ in range(dimension)] for _ in range(12)])
    walks = []
    for _ in range(tracks):
        here, cell = next(numbers) % 12, next(numbers) % 100
        route, cells, gaps = [here], [cell], []
        for _ in range(knots):
            what = next(numbers) % 16
            here = next(numbers) % 12 if what == 0 else here if what == 1 else (here + (1 if what < 12 else 11)) % 12
            cell += (1 + next(numbers) % 20 + 400 * (what == 1)) * timed
            route.append(here)
            cells.append(cell)
            gaps.append(gapped and what == 2)
        walks.append(walk(route, cells if timed else [0] * len(cells), gaps))
    return number_by_visit(LatticeWalks(nodes, tuple(walks), timed))


CASES = {
    "empty": LatticeWalks(np.zeros((0, 2), np.int64), ()),
    "one knot": LatticeWalks(np.array([[3, -4]]), (walk([0], [7]),)),
    "plane": made(1),
    "space": made(2, dimension=3),
    "line": made(3, dimension=1, tracks=1, knots=60),
    "five axes": made(4, dimension=5, tracks=1),
    "no times": made(5, timed=False),
    "no gaps": made(6, gapped=False, tracks=1, knots=80),
    "far": made(7, scale=2**40, tracks=1),
    "to and fro": LatticeWalks(np.array([[0, 0], [30, 4]]), (walk(np.arange(6000) % 2, np.arange(6000) * 5),)),
}

VERSION_1 = {
    "empty": ("01"),
    "one knot": ("05efbdc0"),
    "plane": (
        "bb02fe13d254227d2078d76179417a001757a0b70da53d59275d5be895efba39cd134611baf15741e1fa3b44c08ae77756ec2c4868a258"
        "9d108fbf8fdc989b88d04fc7b7c422f488f2ad9855f8ab024e7db2c9dec0f00d4f6d79ee0ee154a809eaa4807acd2c813e9c0658"
    ),
    "space": (
        "bb02e3fe6be90187b55f38bbd7a1f7b888656011471bee5352b53ca862449c15c5aef69ce64fcfc7cabab1ccb7b7753012cf345aae13c9"
        "f74aa0e77fd2b18d313878be26e3be86d3dfcc74965ae5fdc4203268f0eae8f85ade8b777cd8bcccf6c07afea6a4acda91bcc31b23401f"
        "01abcbe96b66ec6b50ea07244000f7e18a7a2c"
    ),
    "line": (
        "f701fd1fdcf419cd4efca11cff10caa98ef512a49832f1f53b491c47e11abd72b61c6a42e102443829d5a4c7cff6fdce551b36dd09cb28"
        "10bd9eb0e1b9a3bc7dd790e472aca63a07664915f0739da87a597152"
    ),
    "five axes": (
        "6bfe7ffd27bb610f882d43f0be9f58938dea74de36cad9b72248cac0ff942fc8a67c6a9e7099ea7fd32ddfafaf15dc160bd94d12458e56"
        "636d770924752a7ec624a9197b6b0e5ecfbbeb2e5eaf7c9dc3401e9223b6b1fcbdd4a21517531c"
    ),
    "no times": ("ba02fadf4d0a109bc999a97111b1b5d1cf9aed29887b23b94ebcbed1e2dbe38dff35fc1d9389998b86f3bed37e033d9f7430a9eb6b58c46f45e491"),
    "no gaps": (
        "c502f8bfe50e680ccca091ba1f7a8237781f8a5f5a5743c3f8ab6f4fa37aff3e107c4852956064b582b993a154082f1fb2ef13173d7e42"
        "7106ee086489e094db71ca28e080f6d37e0d52691babbb86b9bfb9ec7bd0aad0b144475fedf08bd0e4b3764b7bff13a612b4c2ee68"
    ),
    "far": (
        "6bfcdffffffffffbbffc07638417ff6f1a46c652a034f6c2c77bb161d38f691c6a494d45097684e5300349f5aeba51d18696aeca29e5c7"
        "da95a8b05fb46000eacb7cee678cbb79e36166b2c245bc4dabcfe71b91a4f6dd25b2d5aac67589167005226f9fbc3a35e973d6b6ef5080"
        "aaea270ef974b66c"
    ),
    "to and fro": ("c1bb010bc646cd91130c002b36db12d3d9005978"),
}


@pytest.mark.parametrize("name", CASES)
def test_version_1_is_written(name):
    assert encode(CASES[name]).hex() == VERSION_1[name]


@pytest.mark.parametrize("name", CASES)
def test_version_1_is_read(name):
    walks, data = CASES[name], bytes.fromhex(VERSION_1[name])
    dimension, tracks = walks.nodes.shape[1], len(walks.walks)
    assert_same(decode(data, dimension, tracks), walks)
    places, plain, _ = walk_decoder.decode(data, dimension, tracks)
    assert places == walks.nodes.tolist()
    assert [[node for node, _, _ in one] for one in plain] == [one.nodes.tolist() for one in walks.walks]


def test_payloads_of_version_1_hold_all_kinds_of_steps():
    walks = CASES["plane"].walks
    assert any(one.gaps.any() for one in walks)
    assert any((np.diff(one.nodes) == 0).any() for one in walks)
    assert any((one.nodes[2:] == one.nodes[:-2]).any() for one in walks)
