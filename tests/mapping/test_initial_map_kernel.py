from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpszip.mapping.initial_map import empty_draft
from gpszip.mapping.kernels.initial_map import (
    count_step,
    drop,
    enter_nodes,
    enter_walks,
    insert,
    keep_disjoint,
    lead_clusters,
    near,
    room,
    steps,
    take_node,
)


def assert_steps_are(draft, counted, nodes):
    for u in range(nodes):
        out = sum(n for (a, b), n in counted.items() if a == u != b)
        into = sum(n for (a, b), n in counted.items() if b == u != a)
        assert draft.leaving[u] == out + 0.5 * into
        for v in range(nodes):
            assert steps(draft, u, v) == counted[u, v]


def found_ways(draft, u):
    half, out = draft.head[u], []
    while half >= 0:
        out.append(int(draft.into[half]))
        half = draft.following[half]
    return out


@given(st.lists(st.tuples(st.integers(0, 7), st.integers(0, 7)), max_size=80), st.data())
def test_steps_are_counted_as_a_dictionary_does(pairs, data):
    draft, counted, done = empty_draft(2, 8, 200, 1.0), Counter(), []
    for u, v in pairs:
        count_step(draft, u, v, 1)
        counted[u, v] += 1
        done.append((u, v))
        if data.draw(st.booleans()):
            gone = done.pop(data.draw(st.integers(0, len(done) - 1)))
            count_step(draft, *gone, -1)
            counted[gone] -= 1
    assert_steps_are(draft, counted, 8)
    for u in range(8):
        ways = found_ways(draft, u)
        assert len(ways) == len(set(ways))
        assert set(ways) == {v for a, b in pairs for v in ({b} if a == u else set()) | ({a} if b == u else set())}


def test_room_is_told_before_it_runs_out():
    draft = empty_draft(2, 40, 30, 1.0)
    rng, taken = np.random.default_rng(1), 0
    while room(draft) > 0:
        count_step(draft, *rng.integers(0, 40, 2), 1)
        taken += 1
    assert taken >= 30
    assert draft.scalars[2] <= len(draft.into)
    draft = empty_draft(2, 3, 100, 1.0)
    for expected in (3, 2, 1, 0):
        assert room(draft) == expected
        if expected:
            take_node(draft, np.zeros(2))


def nearest(places, alive, place, reach, most):
    away = [(float(((places[node] - place) ** 2).sum()), node) for node in alive]
    return [node for square, node in sorted(away) if square <= reach * reach][:most]


@given(st.integers(0, 10_000), st.integers(1, 5), st.sampled_from([0.3, 2.0, 9.0]), st.sampled_from([0.0, 1e6, -3e9]))
@settings(max_examples=200)
def test_near_nodes_are_those_of_brute_force_while_nodes_come_and_go(seed, dimension, reach, far):
    rng = np.random.default_rng(seed)
    draft, alive = empty_draft(dimension, 80, 8, reach), {}
    found, distances = np.empty(5, np.int64), np.empty(5)
    for _ in range(120):
        if alive and (rng.random() < 0.3 or len(alive) > 60):
            node = int(rng.choice(list(alive)))
            drop(draft, node)
            del alive[node]
        else:
            # on a half grid there are many at the same distance
            place = far + np.round(2 * rng.uniform(-6, 6, dimension)) / 2
            node = take_node(draft, place)
            assert node not in alive
            alive[node] = place
        most = int(rng.integers(1, 6))
        place = far + np.round(2 * rng.uniform(-7, 7, dimension)) / 2
        count = near(draft, place, most, found, distances)
        assert found[:count].tolist() == nearest(alive, alive, place, reach, most)
        assert distances[:count].tolist() == [float(((alive[n] - place) ** 2).sum()) for n in found[:count].tolist()]


def test_walks_are_entered_piece_by_piece():
    draft = empty_draft(1, 6, 40, 1.0)
    at = np.array([0, -1, 1, 1, 0, -1, 0, 2, -1, 1, 3])
    enter_walks(draft, at, np.array([4, 7, 10]))
    # the third piece's first slot carries no knot: nothing leads there from the second
    counted = Counter([(0, 1), (1, 1), (1, 0), (0, 2), (1, 3)])
    assert draft.uses.tolist() == [3, 3, 1, 1, 0, 0]
    assert_steps_are(draft, counted, 6)


def test_entered_nodes_are_found():
    draft = empty_draft(2, 10, 8, 1.0)
    draft.places[:3] = [[0, 0], [5, 5], [0.5, 0]]
    enter_nodes(draft, 2)
    found, distances = np.empty(4, np.int64), np.empty(4)
    assert near(draft, np.zeros(2), 4, found, distances) == 1
    insert(draft, 2)
    assert near(draft, np.zeros(2), 4, found, distances) == 2
    assert found[:2].tolist() == [0, 2]


@pytest.mark.parametrize("seed", range(5))
def test_every_knot_gets_a_leader_within_reach(seed):
    rng = np.random.default_rng(seed)
    places, at = rng.uniform(0, 30, (200, 2)), np.where(rng.random(200) < 0.7, 0, -1)
    draft, carries = empty_draft(2, 200, 8, 2.5), at >= 0
    lead_clusters(draft, places, at)
    assert ((at >= 0) == carries).all()
    leaders = []
    for place, node in zip(places[carries], at[carries].tolist(), strict=True):
        away = [float(((leader - place) ** 2).sum()) for leader in leaders]
        if away and min(away) <= 2.5**2:
            assert node == int(np.argmin(away))
        else:
            assert node == len(leaders)
            leaders.append(place)
    np.testing.assert_array_equal(draft.places[: len(leaders)], leaders)


@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)).filter(lambda p: p[0] != p[1]), min_size=1, max_size=30))
def test_a_node_takes_part_in_one_merger_at_most(pairs):
    target = np.arange(10)
    count = keep_disjoint(np.array(pairs), target)
    taken, expected = set(), np.arange(10)
    for u, v in pairs:
        if not {u, v} & taken:
            taken |= {u, v}
            expected[v] = u
    np.testing.assert_array_equal(target, expected)
    assert count == len(taken) // 2
