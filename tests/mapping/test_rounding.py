import numpy as np
import pytest
from scipy.sparse import csr_array

from gpszip.mapping.kernels.rounding import round_node_positions


def system(seed, nodes=30, dimension=2):
    """K and r of a loop of nodes with chords, as the M-step makes them, and their solution."""
    rng = np.random.default_rng(seed)
    dense = np.zeros((nodes, nodes))
    right = np.zeros((nodes, dimension))
    ring = np.column_stack([np.arange(nodes), (np.arange(nodes) + 1) % nodes])
    for u, v in np.concatenate([ring, [rng.choice(nodes, 2, replace=False) for _ in range(nodes)]]):
        for share in rng.random(rng.integers(1, 6)):
            row = np.zeros(nodes)
            row[u], row[v] = 1 - share, share
            dense += np.outer(row, row)
            right += np.outer(row, rng.normal(0, 20, dimension))
    dense += 1e-5 * np.eye(nodes)
    return csr_array(dense), right, np.linalg.solve(dense, right)


def rounded(stiffness, right, positions, sweeps=4):
    out = positions.copy()
    round_node_positions(stiffness.indptr, stiffness.indices, stiffness.data, right, out, sweeps)
    return out


def cost(stiffness, right, positions):
    return float((positions * (stiffness @ positions) - 2 * positions * right).sum())


@pytest.mark.parametrize("seed", range(30))
def test_rounding_in_turn_is_no_worse_than_rounding_each(seed):
    stiffness, right, positions = system(seed)
    found = rounded(stiffness, right, positions)
    np.testing.assert_array_equal(found, np.rint(found))
    assert cost(stiffness, right, found) <= cost(stiffness, right, np.rint(positions))


@pytest.mark.parametrize("seed", range(10))
def test_more_sweeps_never_harm_and_the_last_leaves_nothing_to_one_node(seed):
    stiffness, right, positions = system(seed)
    costs = [
        cost(stiffness, right, rounded(stiffness, right, positions, sweeps))
        for sweeps in (1, 2, 4, 50)
    ]
    assert sorted(costs, reverse=True) == costs
    settled = rounded(stiffness, right, positions, 50)
    for v in range(len(settled)):
        for axis in range(2):
            for step in (-1, 1):
                other = settled.copy()
                other[v, axis] += step
                assert cost(stiffness, right, other) >= costs[-1] - 1e-6


def test_a_node_that_nothing_binds_stays():
    positions = np.array([[0.4], [7.3]])
    round_node_positions(
        np.array([0, 0, 1], np.int32),
        np.array([1], np.int32),
        np.array([2.0]),
        np.array([[0.0], [9.2]]),
        positions,
        2,
    )
    assert positions.tolist() == [[0.4], [5.0]]
