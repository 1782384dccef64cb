"""The bounds of Coreset.cost hold for any track, size and function, in exact arithmetic."""

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from gpszip import CoresetStream, Track, coreset
from gpszip.sketches.pieces import PiecewiseLinear
from gpszip.testing.strategies import tracks
from oracle.coreset import exact_cost


@st.composite
def cases(draw):
    track = draw(tracks(min_points=1, max_points=40))
    if draw(st.booleans()):
        weights = draw(st.lists(st.floats(0.01, 100), min_size=len(track), max_size=len(track)))
        track = Track(track.id, track.times, track.positions, weights)
    size = draw(st.integers(1, 8))
    if draw(st.booleans()):
        small = coreset(track, size=size)
    else:
        stream = CoresetStream(size, id=track.id)
        stream.push(track.times, track.positions, track.weights)
        small = stream.coreset()
    edges = small.edges.ravel()
    times = st.one_of(
        st.sampled_from(track.times.tolist()),
        st.sampled_from(edges.tolist()),
        st.floats(float(track.times[0]) - 1, float(track.times[-1]) + 1),
    )
    knots = np.sort(draw(st.lists(times, min_size=2, max_size=10)))
    if draw(st.booleans()):
        start_times, end_times = knots[:-1], knots[1:]
    else:
        start_times, end_times = knots[::2][: len(knots) // 2], knots[1::2]
    coordinates = st.lists(st.floats(-100, 100), min_size=track.dimension, max_size=track.dimension)
    starts, ends = (
        np.array([draw(coordinates) for _ in start_times]) + track.positions[0] for _ in range(2)
    )
    max_lengths = 1e99 * (end_times - start_times)[:, None]
    assume((np.abs(ends - starts) < max_lengths)[end_times > start_times].all())
    return track, small, PiecewiseLinear(start_times, end_times, starts, ends)


@given(cases())
def test_the_cost_lies_within_the_bounds(case):
    track, small, f = case
    weights = np.ones(len(track)) if track.weights is None else track.weights
    expected = exact_cost(track.times, track.positions, weights, f)
    cost = small.cost(f)
    assert cost.lower <= expected <= cost.upper
    assert cost.lower <= cost.estimate * (1 + 1e-9)
