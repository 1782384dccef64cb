from collections import Counter
from itertools import pairwise

import numpy as np
import pytest

from calling import from_python
from gpszip.codec.kernels.walk_model import add_end_weight, end_weight_below, extended
from gpszip.codec.numbering import number_by_visit
from gpszip.codec.prior import Prior
from gpszip.codec.walks import decode, encode, encode_with_statistics
from gpszip.errors import CorruptArchiveError
from gpszip.model import GridWalk, GridWalks
from oracle.walks import assert_same, random_walks, walk

# Inner kernels, as Python calls them.
end_weight_below = from_python(end_weight_below)
add_end_weight = from_python(add_end_weight)


def split(walks, known):
    """The first ``known`` walks as a prior, and the others on its nodes and their own."""
    prior = number_by_visit(GridWalks(walks.nodes, walks.walks[:known], walks.timed))
    # numbers by visit are the same for the first walks, so that nodes of the prior keep theirs
    return Prior(prior), GridWalks(walks.nodes, walks.walks[known:], walks.timed)


@pytest.mark.parametrize("seed", range(24))
def test_walks_round_trip_after_a_prior(seed):
    walks = random_walks(seed)
    for known in {0, len(walks.walks) // 2, len(walks.walks)}:
        prior, later = split(walks, known)
        data = encode(later, prior)
        assert_same(decode(data, walks.nodes.shape[1], len(later.walks), prior), later)


@pytest.mark.parametrize("seed", range(0, 24, 3))
def test_later_walks_take_the_bytes_that_they_would_take_together(seed):
    walks = random_walks(seed)
    prior, later = split(walks, max(1, len(walks.walks) // 2))
    apart = len(encode(prior.walks)) + len(encode(later, prior))
    # two heads and ends of the coder instead of one, and the flags of the last track's end
    assert abs(apart - len(encode(walks))) <= 8


def test_a_prior_can_be_used_again():
    prior, later = split(random_walks(3), 1)
    assert encode(later, prior) == encode(later, prior)


def test_nodes_of_the_prior_that_are_not_visited_stay():
    prior = Prior(GridWalks(np.array([[0, 0], [9, 0], [20, 1]]), (walk([0, 1, 2], [0, 4, 9]),)))
    fresh = GridWalks(
        np.array([[0, 0], [9, 0], [20, 1], [5, 5], [7, 7]]), (walk([4, 1, 3], [30, 40, 50]),)
    )
    later = number_by_visit(fresh, known=3)
    assert later.nodes[:3].tolist() == prior.walks.nodes.tolist()
    assert later.nodes[3:].tolist() == [[7, 7], [5, 5]]
    assert later.walks[0].nodes.tolist() == [3, 1, 4]
    assert_same(decode(encode(later, prior), 2, 1, prior), later)


def test_a_repeated_route_takes_fewer_bytes_after_its_prior():
    rng = np.random.default_rng(5)
    nodes = np.cumsum(rng.integers(-40, 41, (60, 2)), axis=0)
    time_steps = np.cumsum(rng.integers(3, 9, 60))
    forth = walk(np.arange(60), time_steps)
    prior = Prior(GridWalks(nodes, (forth,)))
    again = GridWalks(nodes, (GridWalk(forth.nodes, forth.time_steps + 500, forth.gaps),))
    assert len(encode(again, prior)) < 0.5 * len(encode(again))


def test_the_statistics_are_those_of_the_later_walks():
    prior, later = split(random_walks(7), 1)
    data, statistics = encode_with_statistics(later, prior)
    assert statistics[:, 0].sum() <= 8 * len(data)
    assert encode_with_statistics(later, prior)[1].tolist() == statistics.tolist()


def test_another_prior_gives_other_walks_or_an_error():
    prior, later = split(random_walks(11), 1)
    other = Prior(random_walks(12))
    data = encode(later, prior)
    try:
        found = decode(data, later.nodes.shape[1], len(later.walks), other)
    except CorruptArchiveError:
        return
    assert found.nodes.tolist() != later.nodes.tolist()


@pytest.mark.parametrize("knots", [7, 8, 9, 64, 1000])
def test_an_extended_model_weighs_nodes_as_before(knots):
    prior = Prior(random_walks(5))
    model, last = prior.model(0), prior.nodes
    larger = extended(model, knots)
    assert [end_weight_below(larger, i) for i in range(last + 1)] == [
        end_weight_below(model, i) for i in range(last + 1)
    ]
    add_end_weight(larger, last + knots - 1, 5)
    assert end_weight_below(larger, last + knots) == end_weight_below(model, last) + 5


def test_traversals_and_visits_are_those_of_the_walks():
    prior = Prior(random_walks(6))
    pairs, counts = prior.edge_traversals
    steps = [
        pair
        for walk in prior.walks.walks
        for pair, gap in zip(pairwise(walk.nodes.tolist()), walk.gaps, strict=True)
        if not gap
    ]
    assert dict(zip(map(tuple, pairs.tolist()), counts.tolist(), strict=True)) == dict(
        Counter(steps)
    )
    assert prior.node_visits.tolist() == [
        sum(walk.nodes.tolist().count(v) for walk in prior.walks.walks) for v in range(prior.nodes)
    ]


def test_a_copy_is_as_large_as_the_map_not_as_the_walks():
    forth = GridWalk(np.arange(5000, dtype=np.int32) % 10, np.arange(5000), np.zeros(4999, bool))
    model = Prior(GridWalks(np.arange(20).reshape(10, 2), (forth,))).model(7)
    assert max(len(values) for values in model if values is not model.bit_counts) < 100
