import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gpszip.walks import polylines
from gpszip.walks.polylines import polyline_distances, thin_polyline
from oracle.polylines import dense_hausdorff, densify, discrete_frechet, far_from_segments
from random_tests import examples

coordinates = st.integers(-8, 8).map(float)


def lines(min_size=1, max_size=6):
    return st.integers(min_size, max_size).flatmap(
        lambda n: arrays(np.float64, (n, 2), elements=coordinates)
    )


@examples(60)
@given(lines(), lines())
def test_distances_are_those_of_dense_points(p, q):
    found = polyline_distances(p, q)
    (dense_p, step_p), (dense_q, step_q) = densify(p, 24), densify(q, 24)
    slack = max(step_p, step_q) + 1e-3
    frechet = discrete_frechet(dense_p, dense_q)
    assert frechet - slack <= found.frechet <= frechet + 1e-3
    assert abs(found.hausdorff - dense_hausdorff(dense_p, dense_q)) <= slack
    if len(p) > 1 < len(q):
        assert found.discrete_frechet == pytest.approx(discrete_frechet(p, q))


@examples(60)
@given(lines(2), lines(2))
def test_distances_are_symmetric_and_ordered(p, q):
    there, back = polyline_distances(p, q), polyline_distances(q, p)
    assert there.frechet == pytest.approx(back.frechet, abs=3e-4)
    assert there.hausdorff <= there.frechet + 1e-9
    assert there.frechet <= there.discrete_frechet + 1e-9
    assert polyline_distances(p, p).frechet == 0


def test_between_vertices_a_point_may_be_the_farthest():
    # The middle of the first line is farthest from both ends of the U around it.
    p = np.array([[-4.0, 0.0], [4.0, 0.0]])
    q = np.array([[-4.0, 0.0], [-4.0, -9.0], [4.0, -9.0], [4.0, 0.0]])
    assert polyline_distances(p, q).hausdorff == pytest.approx(9.0, abs=1e-3)
    q = np.array([[-4.0, 1.0], [-4.0, 9.0], [4.0, 9.0], [4.0, 1.0]])
    p = np.array([[-4.0, 1.0], [4.0, 1.0], [4.0, 9.0], [-4.0, 9.0]])
    assert polyline_distances(p, q).hausdorff == pytest.approx(4.0, abs=1e-3)


def test_few_vertices_are_compared_exactly_with_many():
    rng = np.random.default_rng(7)
    p = np.array([[0.0, 0.0], [300.0, 20.0], [280.0, 250.0], [0.0, 240.0]])
    q = densify(p, 700)[0]
    q = q + rng.normal(size=q.shape)
    found = polyline_distances(p, q)
    assert found.within == pytest.approx(1e-4)

    # Plain: distances of dense points of each line from all segments of the other.
    (dense_p, step_p), (dense_q, _) = densify(p, 1000), densify(q, 2)
    there, back = far_from_segments(dense_p, q), far_from_segments(dense_q, p)
    assert found.hausdorff == pytest.approx(max(there, back), abs=step_p / 2 + 1e-3)


@given(lines(1, 40), lines(2, 40))
def test_boxes_leave_out_no_nearest_segment(points, line):
    found, _ = polylines._find_nearest(points, polylines._with_boxes(line))
    assert found.distances.max() == pytest.approx(far_from_segments(points, line), abs=1e-9)


def test_lines_with_enormous_coordinates_are_compared():
    # Numbers this large lie metres apart, so that no bisection comes to 0.1 mm.
    p = 1e16 * np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
    q = 1e16 * np.array([[0.0, 0.0], [7.0, 1.0], [3.0, -1.0], [10.0, 9.0], [1.0, 11.0]])
    found = polyline_distances(p, q)
    near = polyline_distances(p / 1e16, q / 1e16)
    assert found.frechet / 1e16 == pytest.approx(near.frechet, abs=near.within)


@given(lines(3, 12), st.integers(2, 5))
def test_thinning_moves_no_more_than_it_says(line, step):
    thinned = thin_polyline(line, step)
    exact = polyline_distances(line, thinned.vertices)
    assert exact.frechet <= thinned.moved + 1e-3
    assert exact.discrete_frechet <= thinned.discrete_moved + 1e-3


def test_long_lines_are_thinned_and_say_so(monkeypatch):
    rng = np.random.default_rng(3)
    p = np.cumsum(rng.normal(size=(300, 2)), axis=0)
    q = p[::2] + rng.normal(size=(150, 2)) / 5
    exact = polyline_distances(p, q)
    monkeypatch.setattr(polylines, "MAX_PAIRS", 2000)
    rough = polyline_distances(p, q)
    assert rough.within > exact.within == pytest.approx(1e-4)
    assert abs(rough.frechet - exact.frechet) <= rough.within
    assert abs(rough.hausdorff - exact.hausdorff) <= rough.within
    assert abs(rough.discrete_frechet - exact.discrete_frechet) <= rough.discrete_within
