from collections import Counter
from itertools import pairwise

import numpy as np
import pytest

from gpszip.codec.kernels.walk_model import grown, weigh, weight_below
from gpszip.codec.prior import Past
from gpszip.codec.walks import decode, encode, encode_with_ledger, number_by_visit
from gpszip.errors import CorruptArchiveError
from gpszip.model import LatticeWalk, LatticeWalks
from oracle.walks import assert_same, random_walks, walk


def split(walks, known):
    """The first ``known`` walks as a past, and the others on its nodes and their own."""
    past = number_by_visit(LatticeWalks(walks.nodes, walks.walks[:known], walks.timed))
    # the nodes of the past keep their numbers, as a number by visit is the same for the first walks
    return Past(past), LatticeWalks(walks.nodes, walks.walks[known:], walks.timed)


@pytest.mark.parametrize("seed", range(24))
def test_walks_come_back_after_a_past(seed):
    walks = random_walks(seed)
    for known in {0, len(walks.walks) // 2, len(walks.walks)}:
        past, later = split(walks, known)
        data = encode(later, past)
        assert_same(decode(data, walks.nodes.shape[1], len(later.walks), past), later)


@pytest.mark.parametrize("seed", range(0, 24, 3))
def test_what_follows_costs_what_it_would_have_cost_together(seed):
    walks = random_walks(seed)
    past, later = split(walks, max(1, len(walks.walks) // 2))
    apart = len(encode(past.walks)) + len(encode(later, past))
    # two heads and ends of the coder instead of one, and the flags of the last track's end
    assert abs(apart - len(encode(walks))) <= 8


def test_a_past_may_be_read_again_and_again():
    past, later = split(random_walks(3), 1)
    assert encode(later, past) == encode(later, past)


def test_nodes_of_the_past_that_nobody_visits_again_stay():
    past = Past(LatticeWalks(np.array([[0, 0], [9, 0], [20, 1]]), (walk([0, 1, 2], [0, 4, 9]),)))
    fresh = LatticeWalks(np.array([[0, 0], [9, 0], [20, 1], [5, 5], [7, 7]]), (walk([4, 1, 3], [30, 40, 50]),))
    later = number_by_visit(fresh, known=3)
    assert later.nodes[:3].tolist() == past.walks.nodes.tolist()
    assert later.nodes[3:].tolist() == [[7, 7], [5, 5]]
    assert later.walks[0].nodes.tolist() == [3, 1, 4]
    assert_same(decode(encode(later, past), 2, 1, past), later)


def test_a_repeated_way_costs_less_after_a_past_that_knows_it():
    rng = np.random.default_rng(5)
    nodes = np.cumsum(rng.integers(-40, 41, (60, 2)), axis=0)
    cells = np.cumsum(rng.integers(3, 9, 60))
    there = walk(np.arange(60), cells)
    past = Past(LatticeWalks(nodes, (there,)))
    again = LatticeWalks(nodes, (LatticeWalk(there.nodes, there.cells + 500, there.gaps),))
    assert len(encode(again, past)) < 0.5 * len(encode(again))


def test_the_ledger_counts_what_follows_only():
    past, later = split(random_walks(7), 1)
    data, ledger = encode_with_ledger(later, past)
    assert ledger[:, 0].sum() <= 8 * len(data)
    assert encode_with_ledger(later, past)[1].tolist() == ledger.tolist()


def test_other_walks_than_those_written_after_give_other_walks_or_an_error():
    past, later = split(random_walks(11), 1)
    other = Past(random_walks(12))
    data = encode(later, past)
    try:
        found = decode(data, later.nodes.shape[1], len(later.walks), other)
    except CorruptArchiveError:
        return
    assert found.nodes.tolist() != later.nodes.tolist()


@pytest.mark.parametrize("knots", [7, 8, 9, 64, 1000])
def test_a_grown_model_weighs_nodes_as_before(knots):
    past = Past(random_walks(5))
    model, last = past.model(0), past.nodes
    larger = grown(model, knots)
    assert [weight_below(larger, i) for i in range(last + 1)] == [weight_below(model, i) for i in range(last + 1)]
    weigh(larger, last + knots - 1, 5)
    assert weight_below(larger, last + knots) == weight_below(model, last) + 5


def test_steps_and_visits_are_those_of_the_walks():
    past = Past(random_walks(6))
    pairs, counts = past.steps
    steps = [pair for walk in past.walks.walks for pair, gap in zip(pairwise(walk.nodes.tolist()), walk.gaps, strict=True) if not gap]
    assert dict(zip(map(tuple, pairs.tolist()), counts.tolist(), strict=True)) == dict(Counter(steps))
    assert past.visits.tolist() == [sum(walk.nodes.tolist().count(v) for walk in past.walks.walks) for v in range(past.nodes)]


def test_a_copy_is_as_large_as_what_was_learned_not_as_the_walks_are_long():
    there = LatticeWalk(np.arange(5000, dtype=np.int32) % 10, np.arange(5000), np.zeros(4999, bool))
    model = Past(LatticeWalks(np.arange(20).reshape(10, 2), (there,))).model(7)
    assert max(len(values) for values in model if values is not model.flags) < 100
