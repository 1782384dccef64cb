import numpy as np
import pytest
from scipy.sparse import csr_array

from gpszip.mapping.kernels.rounding import round_node_positions


def system(seed, nodes=30, dimension=2):
    """K and r of the M-step for a loop of nodes with chords, and their solution."""
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
    result = positions.copy()
    round_node_positions(stiffness.indptr, stiffness.indices, stiffness.data, right, result, sweeps)
    return result


def cost(stiffness, right, positions):
    return float((positions * (stiffness @ positions) - 2 * positions * right).sum())


@pytest.mark.parametrize("seed", range(30))
def test_coordinate_descent_is_no_worse_than_rounding_each_node(seed):
    stiffness, right, positions = system(seed)
    result = rounded(stiffness, right, positions)
    np.testing.assert_array_equal(result, np.rint(result))
    assert cost(stiffness, right, result) <= cost(stiffness, right, np.rint(positions))


@pytest.mark.parametrize("seed", range(10))
def test_more_sweeps_never_cost_and_end_in_a_local_optimum(seed):
    stiffness, right, positions = system(seed)
    costs = [
        cost(stiffness, right, rounded(stiffness, right, positions, sweeps))
        for sweeps in (1, 2, 4, 50)
    ]
    assert sorted(costs, reverse=True) == costs
    optimum = rounded(stiffness, right, positions, 50)
    for v in range(len(optimum)):
        for axis in range(2):
            for step in (-1, 1):
                shifted = optimum.copy()
                shifted[v, axis] += step
                assert cost(stiffness, right, shifted) >= costs[-1] - 1e-6


def test_a_node_without_samples_stays():
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
