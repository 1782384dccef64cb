"""Maps as KML."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from gpszip.errors import OutputError
from gpszip.io.logs.read import read_logs
from gpszip.io.maps.write import write_map
from gpszip.model import Plane, RoadMap

BERLIN = Plane(((525000000, 134000000),))
DATE_LINE = Plane(((-170000000, 1800000000),))
KML = "{http://www.opengis.net/kml/2.2}"


def corner(plane):
    nodes = np.array([[-150.0, 0], [150, 0], [150, 400]])
    edges = np.array([[0, 1], [1, 2]], np.int32)
    return RoadMap(nodes, edges, np.array([3, 0]), np.array([0, 1]), plane)


def placemarks(path):
    """Data and lines of each placemark."""
    return [
        (
            {data.get("name"): data.findtext(f"{KML}value") for data in mark.iter(f"{KML}Data")},
            [
                [tuple(map(float, position.split(","))) for position in line.text.split()]
                for line in mark.iter(f"{KML}coordinates")
            ],
        )
        for mark in ET.parse(path).iter(f"{KML}Placemark")
    ]


def test_each_edge_is_a_line_with_its_columns(tmp_path):
    write_map(corner(BERLIN), tmp_path / "map.kml")
    (first, [line]), (second, _) = placemarks(tmp_path / "map.kml")
    assert first == {"u": "0", "v": "1", "forward": "3", "backward": "0", "length": "300.0"}
    assert second["backward"] == "1"
    assert line[0] == pytest.approx((13.4 - 150 / 67_870, 52.5), abs=1e-4)
    assert len(line) == 2
    assert len(read_logs(tmp_path / "map.kml").tracks) == 2


def test_an_edge_across_the_antimeridian_is_cut(tmp_path):
    write_map(corner(DATE_LINE), tmp_path / "map.kml")
    (_, lines), (_, others) = placemarks(tmp_path / "map.kml")
    assert (len(lines), len(others)) == (2, 1)
    assert (lines[0][-1][0], lines[1][0][0]) == (180, -180)


def test_an_empty_map_is_a_valid_file_and_metres_are_refused(tmp_path):
    empty = corner(BERLIN)
    write_map(empty, tmp_path / "map.kml", min_traversals=9)
    assert placemarks(tmp_path / "map.kml") == []
    with pytest.raises(OutputError):
        write_map(replace(empty, plane=None), tmp_path / "metres.kml")
    assert not (tmp_path / "metres.kml").exists()
