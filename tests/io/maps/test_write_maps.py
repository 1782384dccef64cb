import csv
import json
import re
import zipfile
from dataclasses import replace
from itertools import pairwise
from xml.etree import ElementTree as ET

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pyogrio
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from gpszip.errors import OutputError
from gpszip.geo.planes import to_plane
from gpszip.io.maps.write import map_suffixes, write_map
from gpszip.io.networks.read import read_network
from gpszip.io.networks.wkb import parse_wkb_lines
from gpszip.model import CleanMap, Plane, RoadMap

#: Suffixes of formats that are written only.
NO_NETWORKS = (".kml", ".png", ".svg", ".pdf")


def square(d=2, plane=None):
    nodes = np.array([[0.0, 0, 1], [300, 0, 2], [300, 400, 3], [0, 400, 4]])[:, :d]
    edges = np.array([[0, 1], [0, 2], [1, 2], [2, 3]], dtype=np.int32)
    return RoadMap(nodes, edges, np.array([3, 0, 2, 0]), np.array([0, 1, 2, 0]), plane)


BERLIN = Plane(((525000000, 134000000),))


def test_geojson_has_a_line_for_each_edge_with_its_traversals(tmp_path):
    write_map(square(plane=BERLIN), tmp_path / "map.geojson", nodes=True)
    data = json.loads((tmp_path / "map.geojson").read_text())
    lines = [feature for feature in data["features"] if feature["geometry"]["type"] == "LineString"]
    assert [line["properties"] for line in lines] == [
        {"u": 0, "v": 1, "forward": 3, "backward": 0, "length": 300.0},
        {"u": 0, "v": 2, "forward": 0, "backward": 1, "length": 500.0},
        {"u": 1, "v": 2, "forward": 2, "backward": 2, "length": 400.0},
        {"u": 2, "v": 3, "forward": 0, "backward": 0, "length": 300.0},
    ]
    assert lines[0]["geometry"]["coordinates"][0] == [13.4, 52.5]
    assert lines[0]["geometry"]["coordinates"][1] == pytest.approx([13.40442, 52.5], abs=1e-5)
    assert [
        f["properties"]["node"] for f in data["features"] if f["geometry"]["type"] == "Point"
    ] == [0, 1, 2, 3]
    assert "gpszip" not in data


def test_geojson_in_metres_has_a_member_that_says_so(tmp_path):
    write_map(square(d=3), tmp_path / "map.geojson")
    data = json.loads((tmp_path / "map.geojson").read_text())
    assert data["gpszip"] == {"coordinates": "metres"}
    assert data["features"][0]["geometry"]["coordinates"] == [[0, 0, 1], [300, 0, 2]]


def test_rarely_travelled_edges_can_be_left_out(tmp_path):
    for least, count in ((0, 4), (1, 3), (3, 2), (4, 1), (9, 0)):
        write_map(square(), tmp_path / "map.json", min_traversals=least)
        assert len(json.loads((tmp_path / "map.json").read_text())["features"]) == count


@pytest.mark.parametrize(("d", "plane"), [(2, None), (3, None), (2, BERLIN)])
def test_geopackage_is_read_by_gdal(tmp_path, d, plane):
    write_map(square(d, plane), tmp_path / "map.gpkg")
    meta, _, geometry, columns = pyogrio.raw.read(tmp_path / "map.gpkg", layer="edges")
    values = dict(zip(meta["fields"].tolist(), columns, strict=True))
    assert values["forward"].tolist() == [3, 0, 2, 0]
    assert values["length"].tolist()[0] == (300.0 if d == 2 else 300.002)
    ends = np.frombuffer(geometry[1][9:], "<f8").reshape(2, d)
    assert np.allclose(ends, square(d).nodes[[0, 2]]) == (plane is None)
    assert (meta["crs"] == "EPSG:4326") == (plane is not None)


def test_graphml_is_a_directed_graph(tmp_path):
    write_map(square(), tmp_path / "map.graphml", min_traversals=2)
    space = {"g": "http://graphml.graphdrawing.org/xmlns"}
    root = ET.parse(tmp_path / "map.graphml").getroot()  # our own file
    assert [node.get("id") for node in root.findall(".//g:node", space)] == ["0", "1", "2"]
    names = {key.get("id"): key.get("attr.name") for key in root.findall("g:key", space)}
    edges = [
        (
            edge.get("source"),
            edge.get("target"),
            {names[data.get("key")]: data.text for data in edge},
        )
        for edge in root.findall(".//g:edge", space)
    ]
    there = {"traversals": "3", "oneway": "True", "reversed": "False", "length": "300.0"}
    both = {"traversals": "2", "oneway": "False", "length": "400.0"}
    assert edges == [
        ("0", "1", {"edge": "0", **there}),
        ("1", "2", {"edge": "1", "reversed": "False", **both}),
        ("2", "1", {"edge": "1", "reversed": "True", **both}),
    ]
    assert root.find("g:graph", space).get("edgedefault") == "directed"
    assert {key.get("attr.type") for key in root.findall("g:key", space)} == {"string"}
    assert {data.get("key") for data in root.findall(".//g:data", space)} == set(names)


def test_csv_has_the_positions_of_both_ends(tmp_path):
    write_map(square(), tmp_path / "map.csv")
    with (tmp_path / "map.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert rows[1] == {
        **{"u": "0", "v": "2", "forward": "0", "backward": "1", "length": "500"},
        **{"u_x": "0", "u_y": "0", "v_x": "300", "v_y": "400"},
    }


@pytest.mark.parametrize("suffix", map_suffixes())
def test_a_map_without_edges_is_a_valid_file(tmp_path, suffix):
    still = RoadMap(
        np.zeros((1, 2)),
        np.zeros((0, 2), dtype=np.int32),
        np.zeros(0, dtype=np.int64),
        np.zeros(0, dtype=np.int64),
        BERLIN,
    )
    write_map(still, tmp_path / f"map{suffix}")
    assert (tmp_path / f"map{suffix}").stat().st_size > 0


def test_standard_output(capfdbinary):
    write_map(square(), "-", format="csv")
    assert capfdbinary.readouterr().out.startswith(
        b"u,v,forward,backward,length,u_x,u_y,v_x,v_y\n0,1,3,0,300,"
    )


def test_a_shapefile_is_an_archive_of_files(tmp_path):
    write_map(square(plane=BERLIN), tmp_path / "map.shp.zip")
    with zipfile.ZipFile(tmp_path / "map.shp.zip") as archive:
        names = archive.namelist()
    assert {"edges.dbf", "edges.prj", "edges.shp", "edges.shx"} <= set(names)
    assert names == sorted(names)
    with pytest.raises(OutputError, match=r"several files.*end the name with \.shp\.zip"):
        write_map(square(plane=BERLIN), tmp_path / "map.shp")


@pytest.mark.parametrize("suffix", [".fgb", ".shp.zip"])
@pytest.mark.parametrize(("d", "plane"), [(2, None), (3, None), (2, BERLIN)])
def test_vector_files_are_read_by_gdal(tmp_path, suffix, d, plane):
    write_map(square(d, plane), tmp_path / f"map{suffix}")
    meta, _, geometry, columns = pyogrio.raw.read(tmp_path / f"map{suffix}")
    values = dict(zip(meta["fields"].tolist(), columns, strict=True))
    # FlatGeobuf orders features by where they are.
    order = np.lexsort([values["v"], values["u"]])
    assert values["forward"][order].tolist() == [3, 0, 2, 0]
    assert values["length"][order].tolist()[0] == (300.0 if d == 2 else 300.002)
    ends = np.frombuffer(geometry[order][1][9:], "<f8").reshape(2, d)
    assert np.allclose(ends, square(d).nodes[[0, 2]]) == (plane is None)
    assert (meta["crs"] == "EPSG:4326") == (plane is not None)


@pytest.mark.parametrize("plane", [None, BERLIN], ids=["metres", "degrees"])
def test_geoparquet_names_its_lines(tmp_path, plane):
    write_map(square(plane=plane), tmp_path / "map.parquet")
    table = pq.read_table(tmp_path / "map.parquet")
    assert table.column("forward").to_pylist() == [3, 0, 2, 0]
    geo = json.loads(table.schema.metadata[b"geo"])
    column = geo["columns"][geo["primary_column"]]
    assert (column["encoding"], column["geometry_types"]) == ("WKB", ["LineString"])
    # The default of the format is longitude and latitude.
    assert column.get("crs", {}).get("type") == (None if plane else "EngineeringCRS")
    points, offsets, _, _ = parse_wkb_lines(table.column("geometry").combine_chunks())
    assert offsets.tolist() == [0, 2, 4, 6, 8]
    assert column["bbox"] == [*points.min(axis=0).tolist(), *points.max(axis=0).tolist()]


@pytest.mark.parametrize("plane", [None, BERLIN], ids=["metres", "degrees"])
@pytest.mark.parametrize("suffix", [s for s in map_suffixes() if s not in NO_NETWORKS])
def test_a_map_is_read_as_a_network(tmp_path, suffix, plane):
    if suffix == ".osm" and plane is None:
        pytest.skip("this format holds degrees only")
    write_map(square(plane=plane), tmp_path / f"map{suffix}", min_traversals=1)
    network = read_network(tmp_path / f"map{suffix}")
    assert (len(network.nodes), len(network.starts)) == (3, 3)
    steps = network.nodes[network.ends] - network.nodes[network.starts]
    lengths = sorted(np.hypot(*steps.T).tolist())
    assert lengths == pytest.approx([300, 400, 500], abs=0.05)
    assert (network.plane is None) == (plane is None)


def test_a_map_is_saved_once_unless_it_is_forced(tmp_path):
    square().save(tmp_path / "map.csv")
    written = (tmp_path / "map.csv").read_bytes()
    write_map(square(), tmp_path / "other.csv")
    assert written == (tmp_path / "other.csv").read_bytes()
    with pytest.raises(OutputError):
        square(3).save(tmp_path / "map.csv")
    assert (tmp_path / "map.csv").read_bytes() == written
    square(3).save(tmp_path / "map.csv", force=True)
    assert (tmp_path / "map.csv").read_bytes() != written


def test_unknown_formats_are_named(tmp_path):
    with pytest.raises(OutputError, match=r"end it with one of \.geojson"):
        write_map(square(), tmp_path / "map.dwg")
    assert list(tmp_path.iterdir()) == []


DATE_LINE = Plane(((-170000000, 1800000000),))


def test_geojson_cuts_edges_at_the_antimeridian(tmp_path):
    around = square(plane=DATE_LINE)
    write_map(replace(around, nodes=around.nodes - [150, 0]), tmp_path / "map.geojson")
    lines = [
        feature["geometry"]
        for feature in json.loads((tmp_path / "map.geojson").read_text())["features"]
    ]
    assert [line["type"] for line in lines] == [
        "MultiLineString",
        "MultiLineString",
        "LineString",
        "MultiLineString",
    ]
    (west, (lon, lat)), ((again, same), east) = lines[0]["coordinates"]
    assert (lon, again, lat) == (180, -180, same)
    assert west[0] == pytest.approx(179.99859, abs=1e-5)
    assert east[0] == pytest.approx(-179.99859, abs=1e-5)


def test_geopackage_cuts_edges_at_the_antimeridian(tmp_path):
    around = square(plane=DATE_LINE)
    write_map(replace(around, nodes=around.nodes - [150, 0]), tmp_path / "map.gpkg")
    meta, _, geometry, _ = pyogrio.raw.read(tmp_path / "map.gpkg", layer="edges")
    assert meta["geometry_type"] == "MultiLineString"
    points, offsets, rows, others = parse_wkb_lines(pa.array(geometry.tolist(), pa.binary()))
    assert (rows.tolist(), others) == ([0, 0, 1, 1, 2, 3, 3], 0)
    assert all(np.ptp(points[a:b, 0]) < 1 for a, b in pairwise(offsets.tolist()))


def way(nodes, plane):
    """A clean map with one edge."""
    line, one = np.array(nodes, dtype=np.float64), np.ones(1, np.int64)
    ends, none = np.array([[0, 1]], np.int32), np.zeros((1, 0))
    return CleanMap(
        line[[0, -1]],
        ends,
        np.array([0, len(line)]),
        line,
        np.ones(1),
        one,
        one,
        np.ones((1, 3)),
        none,
        np.ones(1),
        plane,
    )


def test_well_known_text_is_cut_at_the_antimeridian(tmp_path):
    write_map(way([[-100, 0], [-50, 0], [50, 0]], DATE_LINE), tmp_path / "map.csv")
    with (tmp_path / "map.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert row["line"].startswith("MULTILINESTRING ((179.99")
    assert "180.0 -17.0), (-180.0 -17.0, -179.9995" in row["line"]


def test_lines_of_graphml_lead_from_source_to_target(tmp_path):
    write_map(way([[-100, 0], [-50, 7], [50, 0]], DATE_LINE), tmp_path / "cut.graphml")
    write_map(way([[0, 0], [30, 40], [60, 0]], None), tmp_path / "map.graphml")
    assert graphml_lines(tmp_path / "map.graphml") == [
        ("0", "1", "LINESTRING (0.0 0.0, 30.0 40.0, 60.0 0.0)"),
        ("1", "0", "LINESTRING (60.0 0.0, 30.0 40.0, 0.0 0.0)"),
    ]
    there, back = (numbers(line) for *_, line in graphml_lines(tmp_path / "cut.graphml"))
    assert len(there) > 3
    assert there == back[::-1]


def graphml_lines(path):
    space = {"g": "http://graphml.graphdrawing.org/xmlns"}
    root = ET.parse(path).getroot()
    key = root.find("g:key[@attr.name='geometry']", space).get("id")
    return [
        (edge.get("source"), edge.get("target"), edge.find(f"g:data[@key='{key}']", space).text)
        for edge in root.findall(".//g:edge", space)
    ]


def numbers(line):
    """Positions of a line in well-known text, whatever its parts are."""
    return re.findall(r"-?[\d.]+ -?[\d.]+", line)


@pytest.mark.parametrize(
    "suffix", [".geojson", ".gpkg", ".fgb", ".shp.zip", ".parquet", ".graphml", ".osm"]
)
def test_lines_cut_at_the_antimeridian_are_joined_in_a_network(tmp_path, suffix):
    around = square(plane=DATE_LINE)
    write_map(replace(around, nodes=around.nodes - [150, 0]), tmp_path / f"map{suffix}")
    network = read_network(tmp_path / f"map{suffix}")
    graph = coo_array(
        (np.ones(len(network.starts)), (network.starts, network.ends)),
        shape=(len(network.nodes),) * 2,
    )
    assert connected_components(graph, directed=False)[0] == 1
    assert np.ptp(network.points[:, 0]) == pytest.approx(300, abs=0.1)


def test_long_edges_get_vertices_in_degrees(tmp_path):
    nodes = np.array([[-150_000.0, 0.0], [150_000.0, 0.0]])
    write_map(
        RoadMap(nodes, np.array([[0, 1]], np.int32), np.ones(1, int), np.zeros(1, int), BERLIN),
        tmp_path / "map.geojson",
    )
    (feature,) = json.loads((tmp_path / "map.geojson").read_text())["features"]
    lon, lat = np.array(feature["geometry"]["coordinates"]).T
    number = np.linspace(0, len(lon) - 1, 20_000)
    drawn = to_plane(*(np.interp(number, np.arange(len(lon)), axis) for axis in (lat, lon)), BERLIN)
    assert np.abs(drawn[:, 1]).max() < 0.1
