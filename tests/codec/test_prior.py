from collections import Counter
from itertools import pairwise

import numpy as np
import pytest

from gpszip.codec.kernels.walk_model import add_end_weight, end_weight_below, extended
from gpszip.codec.prior import Prior
from gpszip.codec.walks import decode, encode, encode_with_statistics, number_by_visit
from gpszip.errors import CorruptArchiveError
from gpszip.model import GridWalk, GridWalks
from oracle.walks import assert_same, random_walks, walk


def split(walks, known):
    """The first ``known`` walks as a past, and the others on its nodes and their own."""
    prior = number_by_visit(GridWalks(walks.nodes, walks.walks[:known], walks.timed))
    # the nodes of the past keep their numbers, as a number by visit is the same for the first walks
    return Prior(prior), GridWalks(walks.nodes, walks.walks[known:], walks.timed)


@pytest.mark.parametrize("seed", range(24))
def test_walks_come_back_after_a_past(seed):
    walks = random_walks(seed)
    for known in {0, len(walks.walks) // 2, len(walks.walks)}:
        prior, later = split(walks, known)
        data = encode(later, prior)
        assert_same(decode(data, walks.nodes.shape[1], len(later.walks), prior), later)


@pytest.mark.parametrize("seed", range(0, 24, 3))
def test_what_follows_costs_what_it_would_have_cost_together(seed):
    walks = random_walks(seed)
    prior, later = split(walks, max(1, len(walks.walks) // 2))
    apart = len(encode(prior.walks)) + len(encode(later, prior))
    # two heads and ends of the coder instead of one, and the flags of the last track's end
    assert abs(apart - len(encode(walks))) <= 8


def test_a_past_may_be_read_again_and_again():
    prior, later = split(random_walks(3), 1)
    assert encode(later, prior) == encode(later, prior)


def test_nodes_of_the_past_that_nobody_visits_again_stay():
    prior = Prior(GridWalks(np.array([[0, 0], [9, 0], [20, 1]]), (walk([0, 1, 2], [0, 4, 9]),)))
    fresh = GridWalks(
        np.array([[0, 0], [9, 0], [20, 1], [5, 5], [7, 7]]), (walk([4, 1, 3], [30, 40, 50]),)
    )
    later = number_by_visit(fresh, known=3)
    assert later.nodes[:3].tolist() == prior.walks.nodes.tolist()
    assert later.nodes[3:].tolist() == [[7, 7], [5, 5]]
    assert later.walks[0].nodes.tolist() == [3, 1, 4]
    assert_same(decode(encode(later, prior), 2, 1, prior), later)


def test_a_repeated_way_costs_less_after_a_past_that_knows_it():
    rng = np.random.default_rng(5)
    nodes = np.cumsum(rng.integers(-40, 41, (60, 2)), axis=0)
    cells = np.cumsum(rng.integers(3, 9, 60))
    there = walk(np.arange(60), cells)
    prior = Prior(GridWalks(nodes, (there,)))
    again = GridWalks(nodes, (GridWalk(there.nodes, there.time_steps + 500, there.gaps),))
    assert len(encode(again, prior)) < 0.5 * len(encode(again))


def test_the_ledger_counts_what_follows_only():
    prior, later = split(random_walks(7), 1)
    data, ledger = encode_with_statistics(later, prior)
    assert ledger[:, 0].sum() <= 8 * len(data)
    assert encode_with_statistics(later, prior)[1].tolist() == ledger.tolist()


def test_other_walks_than_those_written_after_give_other_walks_or_an_error():
    prior, later = split(random_walks(11), 1)
    other = Prior(random_walks(12))
    data = encode(later, prior)
    try:
        found = decode(data, later.nodes.shape[1], len(later.walks), other)
    except CorruptArchiveError:
        return
    assert found.nodes.tolist() != later.nodes.tolist()


@pytest.mark.parametrize("knots", [7, 8, 9, 64, 1000])
def test_a_grown_model_weighs_nodes_as_before(knots):
    prior = Prior(random_walks(5))
    model, last = prior.model(0), prior.nodes
    larger = extended(model, knots)
    assert [end_weight_below(larger, i) for i in range(last + 1)] == [
        end_weight_below(model, i) for i in range(last + 1)
    ]
    add_end_weight(larger, last + knots - 1, 5)
    assert end_weight_below(larger, last + knots) == end_weight_below(model, last) + 5


def test_steps_and_visits_are_those_of_the_walks():
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


def test_a_copy_is_as_large_as_what_was_learned_not_as_the_walks_are_long():
    there = GridWalk(np.arange(5000, dtype=np.int32) % 10, np.arange(5000), np.zeros(4999, bool))
    model = Prior(GridWalks(np.arange(20).reshape(10, 2), (there,))).model(7)
    assert max(len(values) for values in model if values is not model.flags) < 100
