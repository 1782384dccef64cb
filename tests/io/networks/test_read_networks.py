import base64
import io
import json
import zlib

import numpy as np
import pyogrio
import pytest
import shapely
from pyproj import Transformer

from gpszip.errors import CorruptArchiveError, InputError, UnknownFormatError
from gpszip.geo.planes import choose_plane, to_plane
from gpszip.io.networks.prepared_file import read_prepared_file, write_prepared_file
from gpszip.io.networks.read import read_network, read_network_result, read_road_graph
from gpszip.model import Plane, Track

STREETS = [
    [[11.0, 48.0], [11.001, 48.0]],
    [[11.001, 48.0], [11.001, 48.001]],
    [[11.001, 48.0], [11.002, 48.0]],
]


def log_at(lat=48.0, lon=11.0, plane=None, name="car"):
    lats, lons = [lat, lat + 0.001], [lon, lon + 0.001]
    plane = plane or choose_plane(lats, lons)
    return Track(name, [0, 60], to_plane(lats, lons, plane), plane=plane)


def geojson(lines, properties=None, **members):
    features = [
        {
            "type": "Feature",
            "properties": properties[i] if properties else {},
            "geometry": {"type": "LineString", "coordinates": line},
        }
        for i, line in enumerate(lines)
    ]
    return json.dumps({"type": "FeatureCollection", **members, "features": features})


@pytest.fixture
def roads(tmp_path):
    path = tmp_path / "roads.geojson"
    path.write_text(geojson(STREETS))
    return path


def test_lines_come_on_the_plane_of_the_log(roads):
    log = log_at()
    network = read_network(roads, near=[log])
    assert network.plane == log.plane
    assert len(network) == 3
    assert len(network.nodes) == 4
    np.testing.assert_allclose(
        network.road(0), to_plane([48.0, 48.0], [11.0, 11.001], log.plane), atol=0.01
    )
    assert network.forward.all()
    assert network.backward.all()
    assert np.isnan(network.speeds).all()
    assert list(network.ids) == ["0", "1", "2"]


def test_without_a_log_a_network_has_a_plane_of_its_own(roads):
    network = read_network(str(roads))
    assert network.lengths.sum() == pytest.approx(74.6 * 2 + 111.2, rel=0.01)


def test_properties_give_directions_speeds_and_ids():
    properties = [
        {"osm_id": "7", "oneway": "yes", "maxspeed": "50", "highway": "primary"},
        {"osm_id": "8", "oneway": "-1", "highway": "residential"},
        {"osm_id": "9", "oneway": None, "highway": "construction"},
    ]
    read = read_network_result(io.BytesIO(geojson(STREETS, properties).encode()), near=log_at())
    network = read.network
    assert list(network.ids) == ["7", "8"]
    assert network.forward.tolist() == [True, False]
    assert network.backward.tolist() == [False, True]
    np.testing.assert_allclose(network.speeds * 3.6, [0.85 * 50, 30])
    assert [(repair.what, repair.count) for repair in read.repairs] == [
        ("roads that nobody may travel dropped", 1)
    ]


@pytest.mark.parametrize("suffix", [".gpkg", ".fgb", ".shp"])
def test_projected_files_are_transformed(tmp_path, suffix):
    path = tmp_path / f"roads{suffix}"
    to_utm = Transformer.from_crs("EPSG:4326", "EPSG:32632", always_xy=True)
    lines = [shapely.LineString([to_utm.transform(*vertex) for vertex in line]) for line in STREETS]
    several = shapely.MultiLineString([lines[1], lines[2]])
    pyogrio.raw.write(
        path,
        np.array([shapely.to_wkb(lines[0]), shapely.to_wkb(several)], object),
        [np.array([1, 0], np.int32)],
        ["oneway"],
        crs="EPSG:32632",
        geometry_type="Unknown" if suffix != ".shp" else "LineString",
    )
    log = log_at()
    network = read_network(path, near=log)
    assert sorted(network.backward.tolist()) == [False, True, True]
    np.testing.assert_allclose(
        np.sort(network.lengths),
        np.sort(read_network(io.BytesIO(geojson(STREETS).encode()), near=log).lengths),
        atol=0.03,
    )


def test_shapefile_without_a_coordinate_system_is_read_as_degrees(tmp_path):
    path = tmp_path / "roads.shp"
    lines = np.array([shapely.to_wkb(shapely.LineString(line)) for line in STREETS], object)
    with pytest.warns(UserWarning, match="crs"):
        pyogrio.raw.write(path, lines, [], [], geometry_type="LineString")
    read = read_network_result(path, near=log_at())
    assert len(read.network) == 3
    assert any("without a system" in repair.what for repair in read.repairs)


def test_indoor_networks_are_in_x_and_y():
    lines = [[[0, 0], [40, 0]], [[40, 0], [40, 30]]]
    log = Track("robot", [0, 60], [[0, 0], [40, 30]])
    network = read_network(io.BytesIO(geojson(lines).encode()), near=log)
    assert network.plane is None
    np.testing.assert_allclose(network.lengths, [40, 30])


def test_a_network_in_other_units_than_the_log_is_refused():
    robot = Track("robot", [0, 60], [[0, 0], [40, 30]])
    with pytest.raises(InputError, match="in degrees, but the log in x and y"):
        read_network(io.BytesIO(geojson(STREETS).encode()), near=robot)
    metric = geojson([[[0, 0], [40, 0]]], gpszip={"coordinates": "metres"})
    with pytest.raises(InputError, match="but the log in degrees"):
        read_network(io.BytesIO(metric.encode()), near=log_at())


def test_a_network_far_from_the_log_is_refused(roads):
    with pytest.raises(InputError, match="lies elsewhere than the log"):
        read_network(roads, near=log_at(50.0, 12.0))
    swapped = geojson([[vertex[::-1] for vertex in line] for line in STREETS])
    with pytest.raises(InputError, match="swapped"):
        read_network(io.BytesIO(swapped.encode()), near=log_at())
    line = geojson([[[50.0, 10.01 + 0.001 * i] for i in range(3)]])
    with pytest.raises(InputError, match="swapped"):
        read_network(io.BytesIO(line.encode()), near=log_at(50.001, 10.0))


def test_degrees_with_one_invalid_vertex_stay_degrees():
    broken = geojson([*STREETS, [[float("nan"), 50.0], STREETS[0][0]]])
    read = read_network_result(io.BytesIO(broken.encode()), near=log_at())
    assert len(read.network) == len(read_network(io.BytesIO(geojson(STREETS).encode())))
    assert [repair.count for repair in read.repairs if "no position" in repair.what] == [1]


def test_roads_far_from_the_log_are_left_out():
    far = [[[x + 0.5, y] for x, y in line] for line in STREETS]
    network = read_network(io.BytesIO(geojson([*far, *STREETS]).encode()), near=log_at())
    assert list(network.ids) == ["3", "4", "5"]


def test_long_gaps_make_the_nearby_area_larger():
    plane = Plane(((480_000_000, 110_000_000),))
    log = Track("car", [0, 9000], [[-30000.0, 0.0], [30000.0, 0.0]], plane=plane)
    network = read_network(
        io.BytesIO(
            geojson(
                [*STREETS, [[11.0, 48.15], [11.0, 48.16]], [[11.0, 49.5], [11.0, 49.6]]]
            ).encode()
        ),
        near=log,
    )
    assert list(network.ids) == ["0", "1", "2", "3"]


def test_a_long_straight_road_through_the_nearby_area_is_kept():
    plane = Plane(((480_000_000, 110_000_000),))
    log = Track("car", [0, 1], [[0.0, 0.0], [1.0, 0.0]], plane=plane)
    assert (
        len(read_network(io.BytesIO(geojson([[[10.8, 48.0], [11.2, 48.0]]]).encode()), near=log))
        == 1
    )


def test_each_road_goes_to_the_planes_of_the_tracks_near_it():
    plane = Plane(((480_000_000, 110_000_000), (-330_000_000, 1_510_000_000)))
    there = [[[x + 140.0, y - 81.0] for x, y in line] for line in STREETS]
    tracks = [log_at(plane=plane), log_at(-33.0, 151.0, plane=plane, name="other")]
    network = read_network(io.BytesIO(geojson([*STREETS, *there]).encode()), near=tracks)
    assert len(network) == 6
    assert (network.points[:, 0] > Plane.SPREAD / 2).sum() == 6
    for track in tracks:
        assert np.linalg.norm(network.nodes - track.positions[0], axis=1).min() < 1
    assert len(np.unique(network.nodes, axis=0)) == 8


def test_footways_are_left_out_for_motor_vehicles():
    properties = [{"highway": "residential"}, {"highway": "footway"}, {"highway": "primary"}]
    source = geojson(STREETS, properties).encode()
    walker, car = log_at(), log_at()
    car = Track("car", [0, 5], car.positions, plane=car.plane)
    assert len(read_network(io.BytesIO(source), near=walker)) == 3
    assert len(read_network(io.BytesIO(source), near=car)) == 2


def test_several_sources_are_one_network(tmp_path, roads):
    more = tmp_path / "more.geojson"
    more.write_text(geojson([[[11.002, 48.0], [11.003, 48.0]], STREETS[0]]))
    network = read_network([roads, more], near=log_at())
    assert len(network) == 4
    assert len(network.nodes) == 5


GRAPH = """<?xml version='1.0' encoding='utf-8'?>
<graphml xmlns="http://graphml.graphdrawing.org/xmlns">
<key id="d10" for="edge" attr.name="name" attr.type="string"/>
<key id="d9" for="edge" attr.name="maxspeed" attr.type="string"/>
<key id="d8" for="edge" attr.name="highway" attr.type="string"/>
<key id="d7" for="edge" attr.name="geometry" attr.type="string"/>
<key id="d6" for="edge" attr.name="oneway" attr.type="string"/>
<key id="d5" for="edge" attr.name="osmid" attr.type="string"/>
<key id="d2" for="node" attr.name="x" attr.type="string"/>
<key id="d1" for="node" attr.name="y" attr.type="string"/>
<key id="d0" for="graph" attr.name="crs" attr.type="string"/>
<graph edgedefault="{kind}"><data key="d0">{crs}</data>
<node id="1"><data key="d1">{y0}</data><data key="d2">{x0}</data></node>
<node id="2"><data key="d1">{y1}</data><data key="d2">{x1}</data></node>
<node id="3"><data key="d1">{y1}</data><data key="d2">{x0}</data></node>
<edge source="1" target="2" id="0">
<data key="d5">[5, 6]</data><data key="d6">False</data><data key="d9">['36', '50']</data></edge>
<edge source="2" target="1" id="0">
<data key="d5">[5, 6]</data><data key="d6">False</data><data key="d9">['36', '50']</data></edge>
<edge source="2" target="3" id="0"><data key="d6">True</data>
<data key="d7">LINESTRING ({x1} {y1}, {x2} {y2}, {x0} {y1})</data>
<data key="d8">tertiary</data><data key="d10">['Oak St', 'Elm St']</data></edge>
</graph></graphml>"""


def graph(kind="directed", crs="epsg:4326", scale=1.0):
    return GRAPH.format(
        kind=kind, crs=crs, x0=11.0, y0=48.0, x1=11.001, y1=48.001, x2=11.0005, y2=48.0015
    ).encode()


def test_graphml_of_osmnx():
    network = read_network(io.BytesIO(graph()), near=log_at())
    assert len(network) == 2
    assert network.forward.tolist() == [True, True]
    assert network.backward.tolist() == [True, False]
    np.testing.assert_allclose(network.speeds * 3.6, [0.85 * 36, 45])
    assert np.diff(network.offsets).tolist() == [2, 3]
    assert network.ids[0] == "[5, 6]"
    assert list(network.names) == ["", "Oak St; Elm St"]


def test_undirected_graphml_goes_both_ways():
    assert read_network(io.BytesIO(graph("undirected")), near=log_at()).backward.tolist() == [
        True,
        False,
    ]


def test_damaged_graphml():
    with pytest.raises(InputError, match="damaged XML"):
        read_network(io.BytesIO(graph()[: len(graph()) // 2]))
    with pytest.raises(InputError, match="has no position"):
        read_network(io.BytesIO(graph().replace(b'attr.name="y"', b'attr.name="why"')))
    with pytest.raises(InputError, match="leads to a node"):
        read_network(io.BytesIO(graph().replace(b'target="3"', b'target="4"')))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "empty file"),
        (b"t,x,y\n0,0,0\n", "no network"),
        (b"<kml></kml>", "is XML, but neither"),
        (b'{"type": "FeatureCollection", "features": []}', "no features"),
        (
            b'{"type": "Feature", "properties": {}, '
            b'"geometry": {"type": "Point", "coordinates": [1, 2]}}',
            "no line",
        ),
        (b'{"broken', "damaged JSON file"),
    ],
)
def test_files_that_are_no_networks_are_refused(content, message):
    with pytest.raises(InputError, match=message) as caught:
        read_network(io.BytesIO(content))
    assert isinstance(caught.value, UnknownFormatError) == (
        message in ("no network", "is XML, but neither")
    )


def test_unknown_coordinate_system(tmp_path):
    path = tmp_path / "roads.geojson"
    path.write_text(
        geojson(
            [[[500000, 5300000], [500100, 5300000]]],
            crs={"type": "name", "properties": {"name": "EPSG:32632"}},
        )
    )
    assert read_network(path).lengths.tolist() == pytest.approx([100], rel=1e-3)


#: Two roads as the first version of the format has them, without street names.
VERSION_1 = (
    "p1JPQURTCgABAAAAAQAAAAMAAAAAAAAAAgAAAAAAAAABAAAAAAAAABIAAAAAAAAAeyJuYW1lIjogInN0cmVhbSJ9hgAAAAAAAABQAAAAAAAAAAIAAAAEAAAA4/Y4"
    "FAAAAAAAAAAAAAAmQAAAAAAAAEhAjZduEoMAJkDjpZvEIABIQB7ThOGAd44GADicHJCejgYAOJwckJ6OBgA4nByQno4GEF+cHAAAAAABAAAAAQAAAAIAAAACAAAA"
    "AgAAAAAAwH8AAMB/AwAAAAEAAAABA8OpMTIAAA=="
)

NAMES = ("Große Straße", None, "Main St", "7")


def city(size=60):
    rng = np.random.default_rng(3)
    xs, ys = (
        11.0 + 0.002 * (np.arange(size)[:, None] + 0.1 * rng.random((size, size))),
        48.0 + 0.001 * (np.arange(size) + 0.1 * rng.random((size, size))),
    )
    at = lambda i, j: [round(float(xs[i, j]), 7), round(float(ys[i, j]), 7)]  # noqa: E731
    lines = [
        [at(i, j), at(a, b)]
        for i in range(size)
        for j in range(size)
        for a, b in ((i + 1, j), (i, j + 1))
        if a < size and b < size
    ]
    return geojson(
        lines,
        [
            {
                "id": f"é{i}",
                "oneway": "yes" if i % 3 == 0 else "no",
                "maxspeed": "50",
                "name": NAMES[i % 4],
            }
            for i in range(len(lines))
        ],
    )


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    path = tmp_path_factory.mktemp("roads") / "city.gpsz"
    roads = read_road_graph(io.BytesIO(city().encode()))
    with path.open("wb") as file:
        size = write_prepared_file(roads, file)
    assert path.stat().st_size == size
    return path, roads


def test_a_prepared_network_is_the_same_network(prepared):
    path, roads = prepared
    log = log_at(48.03, 11.06)
    direct = read_network(io.BytesIO(city().encode()), near=log)
    loaded = read_network(path, near=log)
    assert 0 < len(loaded) < len(roads)
    assert sorted(loaded.ids) == sorted(direct.ids)
    order, other = np.argsort(list(loaded.ids)), np.argsort(list(direct.ids))
    assert [loaded.names[i] for i in order] == [direct.names[i] for i in other]
    assert set(loaded.names) == {name or "" for name in NAMES}
    for name in ("forward", "backward", "speeds", "lengths"):
        np.testing.assert_allclose(
            getattr(loaded, name)[order], getattr(direct, name)[other], atol=1e-4
        )
    np.testing.assert_allclose(
        loaded.nodes[loaded.starts[order]], direct.nodes[direct.starts[other]], atol=0.01
    )
    assert len(loaded.nodes) == len(direct.nodes)
    assert len(read_network(path)) == len(roads)


@pytest.mark.parametrize(
    ("properties", "names"),
    [
        ([{"name": "A St"}, {"name": None}, {"name": " B  St "}], ["A St", "", "B St"]),
        ([{"Name": "A St"}, {"Name": ""}, {}], ["A St", "", ""]),
        ([{"street": "A St", "ref": "B 2"}, {"ref": "B 2"}, {}], ["A St", "B 2", ""]),
        (
            [{"name": ["A St", "B St"]}, {"name": ["A St"]}, {"name": []}],
            ["A St; B St", "A St", ""],
        ),
        ([{"name": 5}, {"name": 7}, {"name": None}], ["5", "7", ""]),
        (
            [{"name": "[not a list"}, {"name": "['"}, {"name": "[1, ("}],
            ["[not a list", "['", "[1, ("],
        ),
        ([{"name": None}, {"name": "nan"}, {"name": " "}], None),
        ([{}, {}, {}], None),
    ],
)
def test_streets_have_names(properties, names):
    found = read_network(io.BytesIO(geojson(STREETS, properties).encode()), near=log_at()).names
    assert (found if found is None else list(found)) == names


def test_prepared_networks_of_version_1_are_read(tmp_path):
    path = tmp_path / "old.gpsz"
    path.write_bytes(base64.b64decode(VERSION_1))
    network = read_network(path)
    assert (list(network.ids), network.names, network.backward.tolist()) == (
        ["é1", "2"],
        None,
        [False, True],
    )


def test_a_block_that_contradicts_itself_is_refused(tmp_path):
    data = bytearray(base64.b64decode(VERSION_1))
    at = data.index(bytes([2, 0, 0, 0] * 3)) + 4  # numbers of vertices, behind the last node
    for value in (1, 3, 255):
        forged = data.copy()
        forged[at] = value
        size = int.from_bytes(forged[74:82], "little")
        forged[90:94] = zlib.crc32(forged[-size:]).to_bytes(4, "little")
        front = len(data) - size - 4
        forged[front : front + 4] = zlib.crc32(forged[:front]).to_bytes(4, "little")
        path = tmp_path / "forged.gpsz"
        path.write_bytes(forged)
        with pytest.raises(CorruptArchiveError, match="contradicts itself"):
            read_network(path)


def test_only_chosen_blocks_are_read(prepared):
    path, roads = prepared
    first = read_prepared_file(path, "city", lambda boxes, degrees: np.arange(len(boxes)) == 0)
    assert len(first) == 2048 < len(roads)
    assert (
        len(read_prepared_file(path, "city", lambda boxes, degrees: np.zeros(len(boxes), bool)))
        == 0
    )


def test_a_prepared_network_far_from_the_log_is_refused(prepared):
    with pytest.raises(InputError, match="near the log"):
        read_network(prepared[0], near=log_at(10.0, 10.0))


@pytest.mark.parametrize("at", [9, 30, 60, 200, 5000, -20])
def test_any_damage_is_detected(prepared, tmp_path, at):
    data = bytearray(prepared[0].read_bytes())
    data[at] ^= 16
    path = tmp_path / "damaged.gpsz"
    path.write_bytes(data)
    with pytest.raises(CorruptArchiveError):
        read_network(path)
    path.write_bytes(prepared[0].read_bytes()[: len(data) // 2 if at > 0 else 50])
    with pytest.raises(CorruptArchiveError):
        read_network(path)


def test_a_prepared_network_in_metres(tmp_path):
    path = tmp_path / "building.gpsz"
    with path.open("wb") as file:
        write_prepared_file(
            read_road_graph(io.BytesIO(geojson([[[0.1234, 0], [40, 0]]]).encode()), metric=True),
            file,
        )
    robot = Track("robot", [0, 60], [[0, 0], [40, 30]])
    assert read_network(path, near=robot).lengths[0] == pytest.approx(39.877)
    with pytest.raises(InputError, match="metres"):
        read_network(path, near=log_at())


def test_the_layer_of_lines_is_read(tmp_path):
    path = tmp_path / "atlas.gpkg"
    points = np.array([shapely.to_wkb(shapely.Point(11.0, 48.0))], object)
    pyogrio.raw.write(path, points, [], [], layer="places", crs="EPSG:4326", geometry_type="Point")
    lines = np.array([shapely.to_wkb(shapely.LineString(line)) for line in STREETS], object)
    pyogrio.raw.write(
        path, lines, [], [], layer="roads", crs="EPSG:4326", geometry_type="LineString", append=True
    )
    assert len(read_network(path, near=log_at())) == 3


def test_a_damaged_file_is_named(tmp_path):
    path = tmp_path / "roads.gpkg"
    path.write_bytes(b"SQLite format 3\0" + bytes(200))
    with pytest.raises(InputError, match=r"roads\.gpkg: can't be read as lines"):
        read_network(path)


LINE = {"type": "LineString", "coordinates": [[11.0, 48.0], [11.001, 48.0]]}


def one_feature(coordinates, kind="LineString"):
    geometry = f'{{"type": "{kind}", "coordinates": {coordinates}}}'
    return f'{{"type": "Feature", "properties": {{}}, "geometry": {geometry}}}'


@pytest.mark.parametrize(
    ("coordinates", "words"),
    [
        ('[["11", "48"], ["11.001", "48"]]', "no line that can be read"),
        ("[[11], [12]]", "no line that can be read"),
        ("[[NaN, 48], [11, 48]]", "holds no road"),
        ("[[1e400, 48], [11, 48]]", "holds no road"),
        ("[[1e300, 48], [1e301, 48]]", "holds no road"),
        ("[[11, 48]]", "holds no road"),
        ("[]", "holds no road"),
    ],
)
def test_networks_without_a_usable_line_are_refused(tmp_path, coordinates, words):
    path = tmp_path / "bad.geojson"
    path.write_text(one_feature(coordinates))
    with pytest.raises(InputError, match=f"bad.geojson: .*{words}"):
        read_network(path)


@pytest.mark.parametrize(
    ("coordinates", "what", "value"),
    [
        (
            '[["11", "48"], ["11.001", "48"]]',
            "features that are no lines dropped",
            "feature 1, counted from 0",
        ),
        ("[[NaN, 48], [11, 48]]", "roads with a vertex that is no position dropped", "road '1'"),
        ("[[11, 48]]", "roads without a length dropped", "road '1'"),
    ],
)
def test_a_feature_that_is_no_road_is_named(tmp_path, coordinates, what, value):
    path = tmp_path / "roads.geojson"
    features = ", ".join(
        [
            json.dumps({"type": "Feature", "properties": {}, "geometry": LINE}),
            one_feature(coordinates),
        ]
    )
    path.write_text(f'{{"type": "FeatureCollection", "features": [{features}]}}')
    read = read_network_result(path, near=log_at())
    assert len(read.network) == 1
    assert [(one.what, one.count, one.value) for one in read.repairs] == [(what, 1, value)]


def test_entities_of_xml_are_not_expanded():
    bomb = b"<!DOCTYPE g [<!ENTITY a 'aaaa'><!ENTITY b '&a;&a;'>]>" + graph().partition(b"?>")[2]
    with pytest.raises(InputError, match="declares XML entities"):
        read_network(io.BytesIO(bomb))
