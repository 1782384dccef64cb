import builtins

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from gpszip.errors import MissingExtraError
from gpszip.model import Plane, RoadMap, Track
from gpszip.view.plot import draw_comparison, draw_map

SQUARE = RoadMap(
    nodes=np.array([[0.0, 0.0], [40.0, 0.0], [40.0, 30.0], [0.0, 30.0]]),
    edges=np.array([[0, 1], [0, 3], [1, 1], [1, 2], [2, 3]], np.int32),
    forward=np.array([9, 1, 3, 1, 1]),
    backward=np.array([7, 0, 0, 0, 0]),
)
WALK = Track("walk", np.arange(50.0), np.column_stack([np.linspace(0, 40, 50), np.zeros(50)]))


def drawn(road_map):
    axes = Figure().add_subplot()
    draw_map(road_map, axes)
    return axes


def edge_lines(axes):
    """The collections of edges on some axes."""
    return [item for item in axes.collections if isinstance(item, LineCollection)]


def test_map_draws_each_edge_but_stops():
    (edges,) = edge_lines(drawn(SQUARE))
    assert len(edges.get_segments()) == 4


def test_busy_edges_are_wide():
    (edges,) = edge_lines(drawn(SQUARE))
    widths = edges.get_linewidths()
    busiest = int(np.argmax(widths))
    assert np.array_equal(edges.get_segments()[busiest], SQUARE.nodes[[0, 1]])
    assert max(widths) > 3 * min(widths)


def test_both_axes_have_the_same_scale():
    assert drawn(SQUARE).get_aspect() == 1


def test_scale_bar_has_the_length_of_its_label():
    axes = drawn(SQUARE)
    bar = axes.lines[0].get_xdata()
    left, right = axes.get_xlim()
    assert axes.texts[0].get_text() == "5 m"
    assert (bar[1] - bar[0]) * (right - left) == pytest.approx(5.0)


def test_map_without_edges():
    lonely = RoadMap(
        np.zeros((1, 2)), np.zeros((0, 2), np.int32), np.zeros(0, np.int64), np.zeros(0, np.int64)
    )
    assert not edge_lines(drawn(lonely))


def test_the_plane_with_most_nodes_is_drawn():
    far = RoadMap(
        nodes=np.vstack([[[5.0, 5.0]], SQUARE.nodes + np.array([Plane.SPREAD, 0])]),
        edges=np.vstack([[[0, 1]], SQUARE.edges + 1]).astype(np.int32),
        forward=np.r_[1, SQUARE.forward],
        backward=np.r_[0, SQUARE.backward],
        plane=Plane(((0, 0), (100_000_000, 100_000_000))),
    )
    axes = drawn(far)
    (edges,) = edge_lines(axes)
    assert len(edges.get_segments()) == 4
    assert axes.get_xlim()[1] - axes.get_xlim()[0] < 100


@pytest.mark.parametrize("suffix", ["png", "svg"])
def test_files_are_pictures(tmp_path, suffix):
    draw_map(SQUARE, tmp_path / f"map.{suffix}")
    draw_comparison([WALK], SQUARE, tmp_path / f"comparison.{suffix}")
    start = b"\x89PNG" if suffix == "png" else b"<?xml"
    for name in ("map", "comparison"):
        assert (tmp_path / f"{name}.{suffix}").read_bytes().startswith(start)


def test_three_dimensional_maps_are_drawn_from_above(tmp_path):
    road_map = RoadMap(
        np.column_stack([SQUARE.nodes, [0, 1, 2, 3]]), SQUARE.edges, SQUARE.forward, SQUARE.backward
    )
    track = Track("flight", WALK.times, np.column_stack([WALK.positions, WALK.times]))
    draw_comparison([track], road_map, tmp_path / "flight.png")
    assert (tmp_path / "flight.png").stat().st_size > 5000


def test_missing_matplotlib_names_the_extra(tmp_path, monkeypatch):
    real = builtins.__import__

    def missing(name, *args, **kwargs):
        if name.startswith("matplotlib"):
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(MissingExtraError, match=r"gpszip\[plot\]"):
        draw_map(SQUARE, tmp_path / "map.png")
