"""Maps as graphs: what osmnx, networkx and geopandas make of them, without a warning."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from frames import package
from gpszip.errors import MissingExtraError
from gpszip.io.maps.directed import directed_table
from gpszip.io.maps.table import learned_table
from gpszip.io.maps.write import write_map
from gpszip.model import CleanMap, Plane, RoadMap

BERLIN = Plane(((525000000, 134000000),))
DATE_LINE = Plane(((-170000000, 1800000000),))


def square(plane=BERLIN):
    """Edges travelled along, against, both ways, and not at all."""
    nodes = np.array([[0.0, 0], [300, 0], [300, 400], [0, 400]])
    edges = np.array([[0, 1], [0, 2], [1, 2], [2, 3]], np.int32)
    return RoadMap(nodes, edges, np.array([3, 0, 2, 0]), np.array([0, 1, 4, 0]), plane)


def streets(plane=BERLIN, *, shift=0.0):
    """Two streets between the same junctions, one of them a bow whose speed is unknown."""
    points = np.array([[0, 0], [300, 0], [0, 0], [100, 90], [300, 0]])
    points = points + np.array([shift, 0.0])
    speed = np.array([[8.0, 10.0, 12.0], [np.nan] * 3])
    return CleanMap(
        points[:2],
        np.array([[0, 1], [0, 1]], np.int32),
        np.array([0, 2, 5]),
        points,
        np.array([300.0, 354.0]),
        np.array([5, 1]),
        np.array([2, 0]),
        speed,
        np.zeros((2, 0)),
        np.array([1.5, np.nan]),
        plane,
    )


def line_of(table, row):
    return table.points[table.offsets[row] : table.offsets[row + 1]].tolist()


def test_a_street_is_a_line_for_each_direction():
    table = directed_table(learned_table(streets(None)))
    columns = {name: values.tolist() for name, values in table.properties.items()}
    assert (columns["u"], columns["v"], columns["key"]) == ([0, 1, 0], [1, 0, 1], [0, 0, 1])
    assert (columns["edge"], columns["traversals"]) == ([0, 0, 1], [5, 2, 1])
    assert (columns["oneway"], columns["reversed"]) == ([False, False, True], [False, True, False])
    assert columns["speed_kph"][:2] == [36.0, 36.0]
    assert columns["travel_time"][:2] == [30.0, 30.0]
    assert np.isnan([columns["speed_kph"][2], columns["travel_time"][2]]).all()
    assert line_of(table, 0) == line_of(table, 1)[::-1] == [[0, 0], [300, 0]]
    assert line_of(table, 2) == [[0, 0], [100, 90], [300, 0]]


counts = st.integers(0, 3)


@given(st.lists(st.tuples(st.integers(2, 5), counts, counts), max_size=5))
def test_directed_lines_are_those_of_a_loop(edges):
    """A plain twin: one row after another."""
    offsets = np.append(0, np.cumsum([count for count, _, _ in edges])).astype(np.int64)
    points = np.arange(2.0 * offsets[-1]).reshape(-1, 2)
    ends = np.zeros((len(edges), 2), np.int32) + np.array([0, 1], np.int32)
    forward = np.array([there for _, there, _ in edges], np.int64)
    backward = np.array([back for _, _, back in edges], np.int64)
    unknown = np.full(len(edges), np.nan)
    learned = CleanMap(
        *(np.zeros((2, 2)), ends, offsets, points, unknown, forward, backward),
        *(np.full((len(edges), 3), np.nan), np.zeros((len(edges), 0)), unknown),
    )
    cuts = offsets[:-1] + 1
    table = directed_table(replace(learned_table(learned), cuts=cuts))
    expected, expected_cuts = [], []
    for edge, (count, there, back) in enumerate(edges):
        line = points[offsets[edge] : offsets[edge] + count].tolist()
        for is_travelled, vertices, cut in ((there, line, 1), (back, line[::-1], count - 1)):
            if is_travelled:
                expected_cuts.append(sum(len(each) for each in expected) + cut)
                expected.append(vertices)
    assert [line_of(table, row) for row in range(len(table))] == expected
    assert table.cuts.tolist() == expected_cuts


MAPS = {
    "edges": square(),
    "streets": streets(),
    "metres": streets(None),
    "antimeridian": streets(DATE_LINE, shift=-150.0),
}


@pytest.mark.parametrize("name", MAPS)
def test_osmnx_takes_the_graph(name):
    package("networkx")
    osmnx = package("osmnx")
    learned = MAPS[name]
    graph, (nodes, edges) = learned.to_networkx(), learned.to_geopandas()
    again = osmnx.graph_from_gdfs(nodes, edges)
    assert sorted(again.edges(keys=True)) == sorted(graph.edges(keys=True))
    node_frame, edge_frame = osmnx.graph_to_gdfs(graph)
    assert edge_frame.crs == edges.crs
    assert np.allclose(node_frame.loc[nodes.index, ["x", "y"]], nodes[["x", "y"]])
    assert edge_frame["length"].to_dict() == edges["length"].to_dict()
    assert graph.number_of_edges() == len(learned.directed())


def test_osmnx_finds_the_quickest_way():
    package("networkx")
    osmnx = package("osmnx")
    graph = streets().to_networkx()
    assert osmnx.shortest_path(graph, 0, 1, weight="length") == [0, 1]
    assert graph.edges[0, 1, 0]["travel_time"] == 30.0
    assert "speed" not in graph.edges[0, 1, 1]
    assert osmnx.project_graph(graph).graph["crs"].is_projected


@pytest.mark.parametrize("name", MAPS)
def test_osmnx_loads_the_graphml(tmp_path, name):
    package("networkx")
    osmnx = package("osmnx")
    learned = MAPS[name]
    learned.save(tmp_path / "map.graphml")
    loaded, graph = osmnx.load_graphml(tmp_path / "map.graphml"), learned.to_networkx()
    assert loaded.graph["crs"] == graph.graph["crs"]
    assert dict(loaded.nodes(data=True)) == dict(graph.nodes(data=True))
    assert sorted(loaded.edges(keys=True)) == sorted(graph.edges(keys=True))
    for u, v, key, data in graph.edges(keys=True, data=True):
        same = loaded.edges[u, v, key]
        for column in ("length", "oneway", "reversed", "speed_kph", "travel_time"):
            assert same.get(column) == data.get(column)
        assert same["traversals"] == str(data["traversals"])
        if "geometry" in data:
            assert same["geometry"].equals(data["geometry"])
    osmnx.graph_to_gdfs(loaded)


def test_networkx_reads_the_graphml(tmp_path):
    networkx = package("networkx")
    square().save(tmp_path / "map.graphml")
    graph = networkx.read_graphml(tmp_path / "map.graphml", node_type=int)
    assert sorted(graph.edges) == [(0, 1), (1, 2), (2, 0), (2, 1)]
    assert graph.is_directed()
    assert graph.edges[1, 2]["traversals"] == "2"


def test_osmnx_reads_openstreetmap_xml(tmp_path):
    package("networkx")
    osmnx = package("osmnx")
    square().save(tmp_path / "map.osm")
    graph = osmnx.graph_from_xml(tmp_path / "map.osm", retain_all=True, simplify=False)
    assert sorted(graph.edges()) == [(-3, -2), (-3, -1), (-2, -3), (-1, -2)]


@pytest.mark.parametrize("suffix", [".geojson", ".gpkg", ".fgb", ".shp.zip"])
@pytest.mark.parametrize("name", MAPS)
def test_geopandas_reads_the_files(tmp_path, suffix, name):
    geopandas = package("geopandas")
    learned = MAPS[name]
    learned.save(tmp_path / f"map{suffix}")
    frame = geopandas.read_file(tmp_path / f"map{suffix}")
    assert sorted(frame["forward"]) == sorted(learned.forward)
    if suffix != ".geojson":
        assert frame.crs.is_geographic == (name != "metres")


@pytest.mark.parametrize("name", MAPS)
def test_geopandas_reads_geoparquet(tmp_path, name):
    geopandas = package("geopandas")
    learned = MAPS[name]
    learned.save(tmp_path / "map.parquet")
    frame = geopandas.read_parquet(tmp_path / "map.parquet")
    assert frame.crs.is_geographic == (name != "metres")
    assert frame["backward"].tolist() == learned.backward.tolist()
    kind = "MultiLineString" if name == "antimeridian" else "LineString"
    assert (frame.geometry.geom_type == kind).all()


@pytest.mark.parametrize(
    ("method", "missing", "extra"),
    [
        ("to_networkx", "networkx", "networkx"),
        ("to_networkx", "shapely", "networkx"),
        ("to_geopandas", "geopandas", "geopandas"),
    ],
)
def test_a_missing_package_is_named(monkeypatch, method, missing, extra):
    monkeypatch.setitem(__import__("sys").modules, missing, None)
    with pytest.raises(MissingExtraError, match=rf"pip install 'gpszip\[{extra}\]'"):
        getattr(square(), method)()


@pytest.mark.parametrize("suffix", [".gpkg", ".fgb", ".shp.zip"])
def test_vector_formats_name_their_extra(monkeypatch, tmp_path, suffix):
    monkeypatch.setitem(__import__("sys").modules, "pyogrio", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'gpszip\[gis\]'"):
        write_map(square(), tmp_path / f"map{suffix}")
    assert list(tmp_path.iterdir()) == []


def test_a_map_without_edges_is_an_empty_graph():
    package("networkx")
    package("geopandas")
    none = np.zeros(0, np.int64)
    still = RoadMap(np.zeros((1, 2)), np.zeros((0, 2), np.int32), none, none, BERLIN)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert still.to_networkx().number_of_nodes() == 0
        assert [len(frame) for frame in still.to_geopandas()] == [0, 0]
