from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calling import from_python
from gpszip.mapping.initial_map import allocate_working_map
from gpszip.mapping.kernels.initial_map import (
    HALF_EDGE_COUNT,
    add_node,
    cluster_by_leader,
    count_step,
    count_walks,
    find_near_nodes,
    free_capacity,
    index_node,
    index_nodes,
    merge_disjoint_pairs,
    release_node,
    step_count,
)
from random_tests import examples

# Inner kernels, as Python calls them.
step_count = from_python(step_count)
count_step = from_python(count_step)
free_capacity = from_python(free_capacity)
add_node = from_python(add_node)
release_node = from_python(release_node)
find_near_nodes = from_python(find_near_nodes)
index_node = from_python(index_node)


def assert_steps_are(working_map, counted, nodes):
    for u in range(nodes):
        outgoing = sum(n for (a, b), n in counted.items() if a == u != b)
        incoming = sum(n for (a, b), n in counted.items() if b == u != a)
        assert working_map.outgoing_weight[u] == outgoing + 0.5 * incoming
        for v in range(nodes):
            assert step_count(working_map, u, v) == counted[u, v]


def list_neighbours(working_map, u):
    half, neighbours = working_map.first_half_edge[u], []
    while half >= 0:
        neighbours.append(int(working_map.end_node[half]))
        half = working_map.next_half_edge[half]
    return neighbours


@given(st.lists(st.tuples(st.integers(0, 7), st.integers(0, 7)), max_size=80), st.data())
def test_steps_are_counted_as_a_dictionary_does(pairs, data):
    working_map, counted, done = allocate_working_map(2, 8, 200, 1.0), Counter(), []
    for u, v in pairs:
        count_step(working_map, u, v, 1)
        counted[u, v] += 1
        done.append((u, v))
        if data.draw(st.booleans()):
            gone = done.pop(data.draw(st.integers(0, len(done) - 1)))
            count_step(working_map, *gone, -1)
            counted[gone] -= 1
    assert_steps_are(working_map, counted, 8)
    for u in range(8):
        neighbours = list_neighbours(working_map, u)
        assert len(neighbours) == len(set(neighbours))
        assert set(neighbours) == {
            v for a, b in pairs for v in ({b} if a == u else set()) | ({a} if b == u else set())
        }


def test_the_free_capacity_suffices():
    working_map = allocate_working_map(2, 40, 30, 1.0)
    rng, steps = np.random.default_rng(1), 0
    while free_capacity(working_map) > 0:
        count_step(working_map, *rng.integers(0, 40, 2), 1)
        steps += 1
    assert steps >= 30
    assert working_map.counters[HALF_EDGE_COUNT] <= len(working_map.end_node)
    working_map = allocate_working_map(2, 3, 100, 1.0)
    for expected in (3, 2, 1, 0):
        assert free_capacity(working_map) == expected
        if expected:
            add_node(working_map, np.zeros(2))


def nearest(positions, alive, position, reach, max_near):
    squares = [(float(((positions[node] - position) ** 2).sum()), node) for node in alive]
    return [node for square, node in sorted(squares) if square <= reach * reach][:max_near]


@given(
    st.integers(0, 10_000),
    st.integers(1, 5),
    st.sampled_from([0.3, 2.0, 9.0]),
    st.sampled_from([0.0, 1e6, -3e9]),
)
@examples(100)
def test_near_nodes_are_those_of_brute_force_while_nodes_come_and_go(seed, dimension, reach, shift):
    rng = np.random.default_rng(seed)
    working_map, alive = allocate_working_map(dimension, 80, 8, reach), {}
    near, distances = np.empty(5, np.int64), np.empty(5)
    for _ in range(120):
        if alive and (rng.random() < 0.3 or len(alive) > 60):
            node = int(rng.choice(list(alive)))
            release_node(working_map, node)
            del alive[node]
        else:
            # On a grid of halves, many nodes are at the same distance.
            position = shift + np.round(2 * rng.uniform(-6, 6, dimension)) / 2
            node = add_node(working_map, position)
            assert node not in alive
            alive[node] = position
        max_near = int(rng.integers(1, 6))
        position = shift + np.round(2 * rng.uniform(-7, 7, dimension)) / 2
        count = find_near_nodes(working_map, position, max_near, near, distances)
        assert near[:count].tolist() == nearest(alive, alive, position, reach, max_near)
        assert distances[:count].tolist() == [
            float(((alive[n] - position) ** 2).sum()) for n in near[:count].tolist()
        ]


def test_no_step_is_counted_across_a_gap():
    working_map = allocate_working_map(1, 6, 40, 1.0)
    slot_nodes = np.array([0, -1, 1, 1, 0, -1, 0, 2, -1, 1, 3])
    count_walks(working_map, slot_nodes, np.array([4, 7, 10]))
    # The first slot of the third piece has no knot: no step leads there from the second piece.
    counted = Counter([(0, 1), (1, 1), (1, 0), (0, 2), (1, 3)])
    assert working_map.uses.tolist() == [3, 3, 1, 1, 0, 0]
    assert_steps_are(working_map, counted, 6)


def test_indexed_nodes_are_found():
    working_map = allocate_working_map(2, 10, 8, 1.0)
    working_map.positions[:3] = [[0, 0], [5, 5], [0.5, 0]]
    index_nodes(working_map, 2)
    near, distances = np.empty(4, np.int64), np.empty(4)
    assert find_near_nodes(working_map, np.zeros(2), 4, near, distances) == 1
    index_node(working_map, 2)
    assert find_near_nodes(working_map, np.zeros(2), 4, near, distances) == 2
    assert near[:2].tolist() == [0, 2]


@pytest.mark.parametrize("seed", range(5))
def test_every_knot_gets_the_nearest_leader_within_reach(seed):
    rng = np.random.default_rng(seed)
    positions, slot_nodes = rng.uniform(0, 30, (200, 2)), np.where(rng.random(200) < 0.7, 0, -1)
    working_map, is_knot = allocate_working_map(2, 200, 8, 2.5), slot_nodes >= 0
    cluster_by_leader(working_map, positions, slot_nodes)
    assert ((slot_nodes >= 0) == is_knot).all()
    leaders = []
    for position, node in zip(positions[is_knot], slot_nodes[is_knot].tolist(), strict=True):
        squares = [float(((leader - position) ** 2).sum()) for leader in leaders]
        if squares and min(squares) <= 2.5**2:
            assert node == int(np.argmin(squares))
        else:
            assert node == len(leaders)
            leaders.append(position)
    np.testing.assert_array_equal(working_map.positions[: len(leaders)], leaders)


@given(
    st.lists(
        st.tuples(st.integers(0, 9), st.integers(0, 9)).filter(lambda p: p[0] != p[1]),
        min_size=1,
        max_size=30,
    )
)
def test_a_node_takes_part_in_at_most_one_merge(pairs):
    target = np.arange(10)
    count = merge_disjoint_pairs(np.array(pairs), target)
    merged, expected = set(), np.arange(10)
    for u, v in pairs:
        if not {u, v} & merged:
            merged |= {u, v}
            expected[v] = u
    np.testing.assert_array_equal(target, expected)
    assert count == len(merged) // 2
