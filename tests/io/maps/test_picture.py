import numpy as np
import pytest

from gpszip.drawing.style import PICTURE_FORMATS
from gpszip.io.maps.picture import _lines_on_main_plane
from gpszip.io.maps.table import map_table
from gpszip.io.maps.write import MAP_FORMATS, write_map
from gpszip.model import Plane, RoadMap


def loop(plane=None, shift=0.0):
    """A map of a triangle with a stop at its first corner."""
    nodes = np.array([[0.0, 0], [300, 0], [300, 400]]) + np.array([shift, 0.0])
    edges = np.array([[0, 0], [0, 1], [1, 2], [0, 2]], np.int32)
    return RoadMap(nodes, edges, np.array([90, 3, 2, 0]), np.array([0, 1, 2, 1]), plane)


def test_formats_of_maps_have_all_formats_of_pictures():
    assert [each.name for each in MAP_FORMATS][-3:] == list(PICTURE_FORMATS)


@pytest.mark.parametrize(
    ("kind", "start"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")]
)
def test_a_map_is_written_as_a_picture(tmp_path, kind, start):
    write_map(loop(), tmp_path / f"map.{kind}")
    assert (tmp_path / f"map.{kind}").read_bytes().startswith(start)


def test_the_format_may_be_named(tmp_path):
    write_map(loop(), tmp_path / "map.out", format="svg")
    assert (tmp_path / "map.out").read_bytes().startswith(b"<?xml")


def test_stops_and_rare_edges_are_left_out():
    lines = _lines_on_main_plane(map_table(loop(), 2))
    assert lines.traversals.tolist() == [4, 4]
    assert [line.tolist() for line in lines.vertices] == [
        [[0, 0], [300, 0]],
        [[300, 0], [300, 400]],
    ]


@pytest.mark.parametrize("longitude", [13.4, 180.0])
def test_degrees_are_drawn_in_metres_also_across_the_antimeridian(longitude):
    plane = Plane(((525000000, round(longitude * 1e7)),))
    lines = _lines_on_main_plane(map_table(loop(plane, shift=-150.0)))
    lengths = [np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in lines.vertices]
    assert lengths == pytest.approx([300, 400, 500], abs=1)


def test_of_several_planes_the_largest_is_drawn():
    plane = Plane(((525000000, 134000000), (-300000000, 1000000000)))
    near, far = loop(), loop(shift=Plane.SPREAD)
    both = RoadMap(
        np.concatenate([near.nodes[:2], far.nodes]),
        np.concatenate([[[0, 1]], far.edges + 2]).astype(np.int32),
        np.append(7, far.forward),
        np.append(0, far.backward),
        plane,
    )
    assert _lines_on_main_plane(map_table(both)).traversals.tolist() == [4, 4, 1]
