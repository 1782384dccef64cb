import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.colors import to_hex

from gpszip.drawing.style import CYCLE
from gpszip.view.plot import plot
from gpszip.view.plots.segments import _edges
from view_logs import LAPS, laps_archive


def edges_one_by_one(pieces):
    """The twin of _edges, in plain Python."""
    found, count = [], 0
    for piece in pieces:
        knots = [tuple(knot) for knot in piece.tolist()]
        for one, other in zip(knots, knots[1:], strict=False):
            if one != other:
                count += 1
                edge = sorted([one, other])
                if edge not in found:
                    found.append(edge)
    return found, count


corners = st.tuples(st.integers(0, 3), st.integers(0, 3))


@given(st.lists(st.lists(corners, min_size=1, max_size=12), max_size=4))
def test_each_edge_is_drawn_once_in_the_order_of_its_first_travel(pieces):
    arrays = [np.array(piece, float) for piece in pieces]
    edges, count = _edges(arrays)
    expected, expected_count = edges_one_by_one(arrays)
    assert [[tuple(end) for end in edge] for edge in edges.tolist()] == expected
    assert count == expected_count


def test_edges_that_follow_each_other_differ_in_color():
    figure = plot(laps_archive(), kind="segments", raw=LAPS)
    (edges,) = [item for item in figure.axes[0].collections if item.get_gid() == "map"]
    colors = [to_hex(color).upper() for color in edges.get_colors()]
    assert set(colors) <= set(CYCLE)
    assert all(one != next_one for one, next_one in zip(colors, colors[1:], strict=False))


def test_the_caption_counts_segments_and_edges():
    pieces = [piece.positions for piece in laps_archive().decompress()]
    expected, count = edges_one_by_one(pieces)
    texts = [text.get_text() for text in plot(laps_archive(), kind="segments").texts]
    assert f"{count} segments on {len(expected)} edges" in texts
