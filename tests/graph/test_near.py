import numpy as np
import pytest

from gpszip.graph.near import index_edges, index_nodes, near_edges, near_nodes


def plain_projection(point, start, end):
    along = end - start
    length = along @ along
    fraction = min(max((point - start) @ along / length, 0.0), 1.0) if length > 0 else 0.0
    return fraction, float(np.linalg.norm(start + fraction * along - point))


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("radius", [0.0, 3.0, 40.0, 1e4])
@pytest.mark.parametrize("count", [1, 3])
def test_near_edges_are_those_that_a_scan_finds(dimension, radius, count):
    rng = np.random.default_rng(5)
    nodes = rng.uniform(-100, 100, (40, dimension))
    nodes[:8] = np.round(nodes[:8], -1)
    edges = rng.integers(0, 40, (60, 2))  # some are self-loops, of no length
    points = np.concatenate((rng.uniform(-130, 130, (50, dimension)), nodes[:10]))
    found, fractions, distances = near_edges(index_edges(nodes, edges), points, radius, count)
    for row, point in enumerate(points):
        every = [(*plain_projection(point, nodes[u], nodes[v])[::-1], edge) for edge, (u, v) in enumerate(edges)]
        near = sorted((round(distance, 9), edge, fraction) for distance, fraction, edge in every if distance <= radius)[:count]
        size = len(near)
        assert np.allclose(distances[row, :size], [distance for distance, _, _ in near])
        for place in range(size):
            fraction, distance = plain_projection(point, *nodes[edges[found[row, place]]])
            assert distance == pytest.approx(distances[row, place], abs=1e-9)
            assert fraction == pytest.approx(fractions[row, place])
        assert len(set(found[row, :size].tolist())) == size
        assert found[row, size:].tolist() == [-1] * (count - size)
        assert np.isinf(distances[row, size:]).all()


def test_equally_near_edges_come_by_index():
    index = index_edges([[0, 0], [10, 0], [0, 10]], [[0, 1], [0, 2], [1, 0], [0, 1]])
    edges, _, distances = near_edges(index, [[0, 0], [5, 0]], radius=1, count=3)
    assert edges.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert not distances.any()


@pytest.mark.parametrize("cell", [None, 0.001, 7.0, 1e6])
def test_the_cell_changes_nothing_that_is_found(cell):
    rng = np.random.default_rng(8)
    nodes, edges = rng.normal(0, 50, (30, 2)) + 1e7, rng.integers(0, 30, (50, 2))
    points = rng.normal(0, 60, (40, 2)) + 1e7
    expected = near_edges(index_edges(nodes, edges), points, 25, 4)
    for got, want in zip(near_edges(index_edges(nodes, edges, cell=cell), points, 25, 4), expected, strict=True):
        assert got.tolist() == want.tolist()


def test_long_edges_do_not_fill_the_index():
    nodes = np.array([[0.0, 0.0], [1e6, 1e6], [0.0, 1.0]])
    assert len(index_edges(nodes, [[0, 1]] + [[0, 2]] * 999, cell=0.5).grid.members) < 10_000


def test_no_edges_at_all():
    edges, _, distances = near_edges(index_edges(np.zeros((0, 2)), []), [[0, 0]], 10, 2)
    assert edges.tolist() == [[-1, -1]]
    assert np.isinf(distances).all()


@pytest.mark.parametrize("count", [1, 4])
def test_near_nodes_are_those_that_a_scan_finds(count):
    rng = np.random.default_rng(6)
    nodes = rng.integers(0, 6, (30, 2)).astype(float)
    points = rng.integers(0, 6, (20, 2)).astype(float)
    found, distances = near_nodes(index_nodes(nodes), points, 2.0, count)
    for row, point in enumerate(points):
        every = np.linalg.norm(nodes - point, axis=1)
        near = np.sort(every[every <= 2.0])[:count]
        assert distances[row, : len(near)].tolist() == near.tolist()
        assert every[found[row, : len(near)]].tolist() == near.tolist()
        assert found[row, len(near) :].tolist() == [-1] * (count - len(near))


def test_no_nodes_at_all():
    nodes, distances = near_nodes(index_nodes(np.zeros((0, 2))), [[0, 0]], 10, 2)
    assert nodes.tolist() == [[-1, -1]]
    assert np.isinf(distances).all()
