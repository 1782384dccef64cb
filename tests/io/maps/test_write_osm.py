"""Maps as OpenStreetMap XML."""

from dataclasses import replace
from itertools import pairwise
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from gpszip.errors import OutputError
from gpszip.io.maps.osm import write_map_osm
from gpszip.io.maps.table import clean_map_table, map_table
from gpszip.io.maps.write import write_map
from gpszip.io.networks.read import read_network
from gpszip.model import CleanMap, Plane, RoadMap

BERLIN = Plane(((525000000, 134000000),))
DATE_LINE = Plane(((-170000000, 1800000000),))


def square(plane=BERLIN):
    """Edges travelled along, against, both ways, and not at all."""
    nodes = np.array([[0.0, 0], [300, 0], [300, 400], [0, 400]])
    edges = np.array([[0, 1], [0, 2], [1, 2], [2, 3]], np.int32)
    return RoadMap(nodes, edges, np.array([3, 0, 2, 0]), np.array([0, 1, 4, 0]), plane)


def way(points, plane=BERLIN, forward=1, backward=1, speed=8.5):
    """A clean map with one edge."""
    line, one = np.array(points, np.float64), np.ones(1)
    return CleanMap(
        line[[0, -1]],
        np.array([[0, 1]], np.int32),
        np.array([0, len(line)]),
        line,
        one,
        np.array([forward]),
        np.array([backward]),
        np.full((1, 3), speed),
        np.zeros((1, 0)),
        one,
        plane,
    )


def read_xml(path):
    """Root; positions of nodes by id; references and tags of ways by id."""
    root = ET.parse(path).getroot()  # our own file
    nodes = {
        int(node.get("id")): (float(node.get("lat")), float(node.get("lon")))
        for node in root.findall("node")
    }
    ways = {
        int(way.get("id")): (
            [int(nd.get("ref")) for nd in way.findall("nd")],
            {tag.get("k"): tag.get("v") for tag in way.findall("tag")},
        )
        for way in root.findall("way")
    }
    return root, nodes, ways


def test_a_way_leads_where_it_was_travelled(tmp_path):
    write_map(square(), tmp_path / "map.osm")
    root, nodes, ways = read_xml(tmp_path / "map.osm")
    assert root.attrib == {"version": "0.6", "generator": "GPSZip", "upload": "never"}
    assert list(nodes) == [-1, -2, -3]
    assert nodes[-1] == (52.5, 13.4)
    assert ways == {
        -1: (
            [-1, -2],
            {
                "highway": "road",
                "oneway": "yes",
                "gpszip:traversals:forward": "3",
                "gpszip:edge": "0",
                "gpszip:length": "300.0",
            },
        ),
        -2: (
            [-3, -1],
            {
                "highway": "road",
                "oneway": "yes",
                "gpszip:traversals:forward": "1",
                "gpszip:edge": "1",
                "gpszip:length": "500.0",
            },
        ),
        -3: (
            [-2, -3],
            {
                "highway": "road",
                "gpszip:traversals:forward": "2",
                "gpszip:traversals:backward": "4",
                "gpszip:edge": "2",
                "gpszip:length": "400.0",
            },
        ),
    }


def test_bounds_hold_all_nodes_and_degrees_have_seven_decimals(tmp_path):
    write_map(square(), tmp_path / "map.osm")
    root, nodes, _ = read_xml(tmp_path / "map.osm")
    lat, lon = zip(*nodes.values(), strict=True)
    bounds = {name: float(value) for name, value in root.find("bounds").attrib.items()}
    assert bounds == {
        "minlat": min(lat),
        "minlon": min(lon),
        "maxlat": max(lat),
        "maxlon": max(lon),
    }
    texts = [node.get(axis) for node in root.findall("node") for axis in ("lat", "lon")]
    assert all(len(text.split(".")[1]) == 7 for text in texts)


def test_a_shape_against_the_edge_is_turned(tmp_path):
    write_map(way([[0, 0], [30, 40], [60, 0]], forward=0), tmp_path / "map.osm")
    _, nodes, ways = read_xml(tmp_path / "map.osm")
    (refs, tags) = ways[-1]
    assert (refs[0], refs[-1]) == (-2, -1)
    assert nodes[refs[1]][0] > nodes[-1][0]
    assert tags["gpszip:speed"] == "8.5"
    assert tags["oneway"] == "yes"


def test_unknown_values_have_no_tag(tmp_path):
    write_map(way([[0, 0], [60, 0]], speed=np.nan), tmp_path / "map.osm")
    *_, ways = read_xml(tmp_path / "map.osm")
    assert [key for key in ways[-1][1] if "speed" in key] == []


@pytest.mark.parametrize("count", [1999, 2000, 2001, 3999, 4000, 6000])
@pytest.mark.parametrize("forward", [0, 1])
def test_long_ways_are_split(tmp_path, count, forward):
    points = np.stack([np.arange(count), np.arange(count) % 7], axis=1)
    write_map(way(points, forward=forward), tmp_path / "map.osm")
    _, nodes, ways = read_xml(tmp_path / "map.osm")
    parts = [refs for refs, _ in ways.values()]
    assert list(ways) == list(range(-1, -1 - len(parts), -1))
    assert all(2 <= len(part) <= 2000 for part in parts)
    assert len(parts) == -(-(count - 1) // 1999)

    # Joined again, they are the edge.
    assert all(a[-1] == b[0] for a, b in pairwise(parts))
    joined = [parts[0][0], *(ref for part in parts for ref in part[1:])]
    assert (joined[0], joined[-1]) == ((-1, -2) if forward else (-2, -1))
    assert len(set(joined)) == len(joined) == count == len(nodes)
    assert np.all(np.diff([nodes[ref][1] for ref in joined]) * (1 if forward else -1) > 0)
    assert len({frozenset(tags.items()) for _, tags in ways.values()}) == 1


def test_no_way_crosses_the_antimeridian(tmp_path):
    around = square(DATE_LINE)
    write_map(replace(around, nodes=around.nodes - [150, 0]), tmp_path / "map.osm")
    _, nodes, ways = read_xml(tmp_path / "map.osm")
    assert len(ways) == 5
    for refs, _ in ways.values():
        assert np.ptp([nodes[ref][1] for ref in refs]) < 1


def test_a_junction_on_the_antimeridian(tmp_path):
    nodes = np.array([[-300.0, 0], [0, 0], [300, 0], [300, 400]])
    edges, one = np.array([[0, 1], [1, 2], [1, 3]], np.int32), np.ones(3, np.int64)
    write_map(RoadMap(nodes, edges, one, one, DATE_LINE), tmp_path / "map.osm")
    _, places, ways = read_xml(tmp_path / "map.osm")
    for refs, _ in ways.values():
        assert np.ptp([places[ref][1] for ref in refs]) < 1

    # Both sides have one node there, and a network joins them.
    assert sorted(lon for _, lon in places.values() if abs(lon) == 180) == [-180, 180]
    network = read_network(tmp_path / "map.osm")
    assert (len(network.nodes), len(network)) == (4, 3)
    assert np.bincount(np.r_[network.starts, network.ends]).max() == 3


def test_names_of_columns_are_escaped(tmp_path):
    table = map_table(square())
    name = "a<b>&\"c'"
    write_map_osm(
        replace(table, properties={**table.properties, name: np.array([name] * 4)}),
        tmp_path / "map.osm",
    )
    *_, ways = read_xml(tmp_path / "map.osm")
    assert [tags[f"gpszip:{name}"] for _, tags in ways.values()] == [name] * 3


def test_columns_of_the_other_formats_are_tags(tmp_path):
    streets = way([[0, 0], [60, 0]])
    write_map(streets, tmp_path / "map.osm")
    *_, ways = read_xml(tmp_path / "map.osm")
    columns = set(clean_map_table(streets).properties) - {"u", "v", "forward", "backward"}
    assert {f"gpszip:{name}" for name in columns} < set(ways[-1][1])


def test_speeds_come_back(tmp_path):
    write_map(way([[0, 0], [60, 0]], speed=3.25), tmp_path / "map.osm")
    assert read_network(tmp_path / "map.osm").speeds.tolist() == [3.25]
    write_map(way([[0, 0], [60, 0]], speed=1e4), tmp_path / "map.osm")
    assert read_network(tmp_path / "map.osm").speeds[0] < 20  # of the class


@pytest.mark.parametrize("road_map", [square(None), way([[0, 0], [60, 0]], plane=None)])
def test_a_map_in_metres_is_refused(tmp_path, road_map):
    with pytest.raises(OutputError) as caught:
        write_map(road_map, tmp_path / "map.osm")
    assert caught.value.path == str(tmp_path / "map.osm")
    assert "in x and y" in caught.value.reason
    others = "geojson, graphml, gpkg, flatgeobuf, shapefile, parquet, csv, png, svg, pdf"
    assert caught.value.remedy == f"write another format: {others}"
    assert list(tmp_path.iterdir()) == []
