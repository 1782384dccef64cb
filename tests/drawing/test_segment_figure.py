from __future__ import annotations

import numpy as np
import pytest

from gpszip.drawing.segment_figure import draw_segment_mean
from gpszip.drawing.style import Layout, style
from gpszip.model import MarkovModel, Plane, Track


def model_of(starts, ends, transitions, plane=None):
    starts, ends = np.array(starts, float), np.array(ends, float)
    pairs = np.array(transitions, np.int32).reshape(-1, 2)
    firsts = np.zeros(len(starts), np.int64)
    return MarkovModel(starts, ends, firsts, pairs, np.ones(len(pairs), np.int64), 0.1, plane)


def drawn(model, parts, tracks):
    with style():
        figure = draw_segment_mean(model, np.array(parts), tracks, Layout())
    (axes,) = figure.axes
    lines = {each.get_gid(): each.get_segments() for each in axes.collections}
    arrows = [
        (tuple(map(float, each.xyann)), tuple(map(float, each.xy)))
        for each in axes.texts
        if getattr(each, "arrow_patch", None) is not None
    ]
    return arrows, lines["transitions"], [text.get_text() for text in figure.texts]


def test_segments_are_arrows_and_transitions_lines():
    model = model_of([[0, 0], [9, 1], [5, 5]], [[9, 0], [0, 1], [5, 5]], [[0, 1], [1, 0], [1, 2]])
    track = Track("a", range(3), [[0, 0], [9, 0], [0, 1]])
    arrows, transitions, texts = drawn(model, [3, 1, 1], [track])
    # the third has no length: a stop, which is a dot
    assert arrows == [((0, 0), (9, 0)), ((9, 1), (0, 1))]
    assert [line.tolist() for line in transitions] == [
        [[9, 0], [9, 1]],
        [[0, 1], [0, 0]],
        [[0, 1], [5, 5]],
    ]
    assert "5 parts on 3 segments" in texts


def test_a_segment_without_parts_is_left_out():
    model = model_of([[0, 0], [9, 1]], [[9, 0], [0, 1]], [[0, 1], [1, 0]])
    arrows, transitions, _ = drawn(model, [2, 0], [])
    assert len(arrows) == 1
    assert not len(transitions)


def test_of_several_planes_the_one_with_most_samples_is_drawn():
    plane, far = Plane(((0, 0), (0, 900_000_000))), Plane.SPREAD
    model = model_of([[0, 0], [far, 0]], [[9, 0], [far + 9, 0]], [[0, 1]], plane)
    track = Track("a", range(3), [[far, 0], [far + 9, 0], [0, 0]], plane=plane)
    arrows, transitions, texts = drawn(model, [1, 1], [track])
    assert arrows == [((far, 0), (far + 9, 0))]
    assert not len(transitions)
    assert "the largest of 2 areas" in texts


@pytest.mark.parametrize("dimension", [1, 4])
def test_any_number_of_coordinates_is_seen_from_above(dimension):
    ends = np.arange(dimension, dtype=float)[None, :] + 1
    model = model_of(np.zeros((1, dimension)), ends, [])
    arrows, _, _ = drawn(model, [1], [])
    assert arrows == [((0, 0), (1, 2 if dimension > 1 else 0))]
