"""Small payloads are decoded without the compiler, larger and forged ones with it."""

import subprocess
import sys

import numpy as np
import pytest

from gpszip.codec.prior import Prior
from gpszip.codec.walks import encode
from gpszip.model import GridWalks
from oracle.walks import random_walks, walk

SCRIPT = """
import sys
from gpszip.codec.decode import decode_walks
from gpszip.errors import CorruptArchiveError
data = sys.stdin.buffer.read()
try:
    walks = decode_walks(data, 2, 1)
    print(walks.walks[0].nodes.sum(), walks.walks[0].time_steps.sum(), end=" ")
except CorruptArchiveError as error:
    print(error, end=" ")
print([name for name in ("numba", "gpszip.codec.walks") if name in sys.modules])
"""


def decode_in_new_process(data):
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], input=data, capture_output=True, check=True
    )
    return done.stdout.decode().strip()


def test_small_payloads_need_no_compiler():
    walks = GridWalks(
        np.array([[0, 0], [30, 4], [50, 9]]), (walk([0, 1, 2, 1, 0], [0, 5, 11, 18, 22]),)
    )
    assert decode_in_new_process(encode(walks)) == "4 56 []"


def test_payloads_that_are_no_walks_need_no_compiler():
    assert decode_in_new_process(b"\x81") == "the walks have no count []"


def test_large_payloads_are_decoded_by_the_compiled_decoder():
    rng = np.random.default_rng(5)
    nodes = rng.integers(-(2**30), 2**30, (2400, 2))
    walks = GridWalks(nodes, (walk(np.arange(2400), np.zeros(2400)),), False)
    data = encode(walks)
    assert len(data) > 1 << 14
    assert decode_in_new_process(data) == (f"{2400 * 2399 // 2} 0 ['numba', 'gpszip.codec.walks']")


def test_payloads_of_many_knots_are_decoded_by_the_compiled_decoder():
    count = 200_000
    walks = GridWalks(
        np.array([[0, 0], [30, 4]]), (walk(np.arange(count) % 2, np.arange(count) * 5),)
    )
    data = encode(walks)
    assert len(data) < 1000
    found = decode_in_new_process(data)
    assert found == f"{count // 2} {5 * count * (count - 1) // 2} ['numba', 'gpszip.codec.walks']"


@pytest.mark.parametrize("seed", [1, 5])
def test_walks_on_a_prior_are_decoded(seed):
    from gpszip.codec.decode import decode_walks

    walks = random_walks(seed)
    prior = Prior(walks)
    again = decode_walks(encode(walks, prior), walks.nodes.shape[1], len(walks.walks), prior)
    np.testing.assert_array_equal(again.nodes, walks.nodes)
    assert [one.nodes.tolist() for one in again.walks] == [
        one.nodes.tolist() for one in walks.walks
    ]
