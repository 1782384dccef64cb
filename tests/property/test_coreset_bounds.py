"""The bounds of a coreset's prices hold for any track, any size and any pieces, in exact arithmetic."""

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
    instants = st.one_of(
        st.sampled_from(track.times.tolist()),
        st.sampled_from(edges.tolist()),
        st.floats(float(track.times[0]) - 1, float(track.times[-1]) + 1),
    )
    knots = np.sort(draw(st.lists(instants, min_size=2, max_size=10)))
    begins, ends = (
        (knots[:-1], knots[1:])
        if draw(st.booleans())
        else (knots[::2][: len(knots) // 2], knots[1::2])
    )
    near = st.lists(st.floats(-100, 100), min_size=track.dimension, max_size=track.dimension)
    starts, stops = (np.array([draw(near) for _ in begins]) + track.positions[0] for _ in range(2))
    assume((np.abs(stops - starts) < 1e99 * (ends - begins)[:, None])[ends > begins].all())
    return track, small, PiecewiseLinear(begins, ends, starts, stops)


@given(cases())
def test_the_cost_lies_within_the_bounds(case):
    track, small, f = case
    weights = np.ones(len(track)) if track.weights is None else track.weights
    truth = exact_cost(track.times, track.positions, weights, f)
    price = small.cost(f)
    assert price.lower <= truth <= price.upper
    assert price.lower <= price.estimate * (1 + 1e-9)
