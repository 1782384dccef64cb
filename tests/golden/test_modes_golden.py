"""Walks payloads in modes: every later version reads them, and this one writes the same bytes."""

import numpy as np
import pytest

from gpszip.codec.numbering import number_by_visit
from gpszip.codec.plain.decode import decode_plain
from gpszip.codec.plain.work import WorkLimit
from gpszip.codec.walks import decode, encode_in_modes
from gpszip.model import GridWalks
from oracle import walk_decoder
from oracle.walks import assert_same, walk


def block_walks():
    """Three tracks: round a block, across it, and out of it."""
    nodes = np.array(
        [[50 * (i % 4), 60 * (i // 4) + 7 * (i % 3)] for i in range(16)] + [[300, 90], [420, 140]]
    )
    block = [0, 1, 2, 3, 7, 11, 15, 14, 13, 12, 8, 4]
    routes = [
        [*block, *block, 0, 1],
        [3, 2, 6, 10, 14, 13, 12, 8, 4, 0, 1, 2, 3, 7],
        [0, 4, 8, 12, 13, 14, 15, 16, 17, 17, 16, 15, 11, 7, 3],
    ]
    tracks = []
    for route, first in zip(routes, (500, 90, 1300), strict=True):
        time_steps = first + np.cumsum([0, *(3 + 5 * (i % 3) for i in range(len(route) - 1))])
        tracks.append(walk(route, time_steps, np.arange(len(route) - 1) == 20))
    return number_by_visit(GridWalks(nodes, tuple(tracks)))


WRITTEN = {
    1: (
        "01df01fe6bfe9bfb678388e31cc1f1e09d3a789059b97bc21522e9df2d64e7c8c6fc027a9b65c7e44f16eb6f0e21a1bc08cfbb9fa35f25"
        "17793c895c51897ee19ad6"
    ),
    2: (
        "02df01ffbd2142a76e2304ec27b7c4311f7ae0f09eb2c78c59f136e439969d24b94e34468326e3556e230d49b24ab9b11bb39df28dfc23"
        "7747e48cb77f511e65c2eea9bad4"
    ),
    3: (
        "03df01fe6bfe9bfb677ae6e08d0a3604e28d98096ffa4469c80b227896c8f1704935d8fa9aa19d803d5519e35a36d937e8b6bfa3776310"
        "4deea999fc1a71777f028f66ae2c68"
    ),
    4: (
        "0004df01ffbd26a634ff74d54e4fd085598f85e716355824cdda506e9f83b46a6dd1ea407c9ab56b64090d16d15d2664d6090a3f83508b"
        "365b7a9f37e3d0c031649c292403"
    ),
    5: (
        "0005df01fe6bfe9bfb678388e317e5efd95f1b2e60b1b6ac71107ec6de7864a17f61e6aeab97978142699ba231f426bb50131d932c7f4f"
        "cd22f0d20a9a3cb91dbf4be1f947"
    ),
    6: (
        "0006df01ffbd2142a76bb55ca4e9b56f1b1210e1bbbe14ea2e28b4ce281f4ef908ed2ded8b1f55f10749dbd61586409f8669de05a99bfc"
        "1882b92845fabf8b08cbf41df087f1b49189"
    ),
    7: (
        "0007df01fe6bfe9bfb677ae6e08927ff5ed4faa4047007c8e7c14be111843d18bd10bb1dab9bb33d311cf2654bc84f49c3d17ea6923ba3"
        "b1e0ac619f9a1a61d1d845f68b84031032317e"
    ),
}


def encode_with_targets(walks, modes):
    # expensive steps make the encoder take targets
    return encode_in_modes(
        walks, None, modes, np.full(sum(len(one.nodes) for one in walks.walks), 9.0)
    )[0]


@pytest.mark.parametrize("modes", WRITTEN)
def test_golden_payloads_are_written(modes):
    assert encode_with_targets(block_walks(), modes).hex() == WRITTEN[modes]


@pytest.mark.parametrize("modes", WRITTEN)
def test_golden_payloads_are_read(modes):
    walks, data = block_walks(), bytes.fromhex(WRITTEN[modes])
    assert_same(decode(data, 2, 3), walks)
    assert_same(decode_plain(data, 2, 3, None, WorkLimit(10**9)), walks)
    positions, plain, _ = walk_decoder.decode(data, 2, 3)
    assert positions == walks.nodes.tolist()
    assert [[node for node, _, _ in track] for track in plain] == [
        walk_.nodes.tolist() for walk_ in walks.walks
    ]
    assert [[time_step for _, time_step, _ in track] for track in plain] == [
        walk_.time_steps.tolist() for walk_ in walks.walks
    ]
