"""Roads from GeoJSON are those that GDAL reads, whatever features and properties look like."""

import json
import subprocess
import sys
from unittest import mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError
from gpszip.io.networks.features import road_lines
from gpszip.io.networks.geojson import read_geojson_lines
from gpszip.io.networks.read import read_network
from gpszip.io.networks.vector import _read_features
from gpszip.io.storage.source import Source

pyogrio = pytest.importorskip("pyogrio")

DEGREES = st.integers(-80, 80).map(lambda n: n / 8)
POSITION = st.tuples(DEGREES, DEGREES).map(list) | st.tuples(DEGREES, DEGREES, DEGREES).map(list)
LINE = st.lists(POSITION, min_size=2, max_size=5)
GEOMETRY = st.one_of(
    st.none(),
    st.builds(lambda line: {"type": "LineString", "coordinates": line}, LINE),
    st.builds(
        lambda lines: {"type": "MultiLineString", "coordinates": lines},
        st.lists(LINE, min_size=1, max_size=3),
    ),
    st.builds(lambda position: {"type": "Point", "coordinates": position}, POSITION),
)
PROPERTIES = st.fixed_dictionaries(
    {},
    optional={
        "highway": st.sampled_from(["residential", "motorway", "steps", None]),
        "oneway": st.sampled_from(["yes", "no", "-1", None]),
        "maxspeed": st.sampled_from(["50", "30 mph", "walk", None]),
        "Name": st.sampled_from(["Main Street", "Ring; Road", None]),
        "osm_id": st.integers(0, 9),
        "speed_kph": st.sampled_from([30, 30.5, None]),
        "lanes": st.integers(1, 4),
    },
)
FEATURE = st.builds(
    lambda geometry, properties: {
        "type": "Feature",
        "geometry": geometry,
        "properties": properties,
    },
    GEOMETRY,
    PROPERTIES,
)


def lines_of(text):
    return read_geojson_lines(Source("roads.geojson", data=text.encode()))


def lines_by_gdal(text):
    with mock.patch("gpszip.io.networks.vector._choose_layer", return_value=None):
        features, _ = _read_features(pyogrio, text.encode(), "roads.geojson")
    return road_lines(features, "OGC:CRS84", "roads.geojson", is_geojson=True)


def result_or_error(read, text):
    try:
        return read(text)
    except InputError as error:
        return str(error)


@given(st.lists(FEATURE, min_size=1, max_size=6))
def test_roads_are_those_that_gdal_reads(features):
    text = json.dumps({"type": "FeatureCollection", "features": features})
    found, expected = result_or_error(lines_of, text), result_or_error(lines_by_gdal, text)
    if isinstance(expected, str) or isinstance(found, str):
        assert isinstance(found, str), (found, expected)
        assert isinstance(expected, str), (found, expected)
        return
    assert np.array_equal(found.coordinates, expected.coordinates)
    for name in ("offsets", "forward", "backward", "users"):
        assert np.array_equal(getattr(found, name), getattr(expected, name)), name
    assert np.array_equal(found.speeds, expected.speeds, equal_nan=True)
    assert found.ids.to_pylist() == expected.ids.to_pylist()
    assert found.names.to_pylist() == expected.names.to_pylist()
    assert (found.geographic, found.directed, found.repairs) == (
        expected.geographic,
        expected.directed,
        expected.repairs,
    )


LINE_STRING = {"type": "LineString", "coordinates": [[11, 48], [11.001, 48]]}


def test_features_on_lines_and_bare_geometries():
    feature = {"type": "Feature", "id": "a", "properties": {}, "geometry": LINE_STRING}
    text = "\n".join(map(json.dumps, [feature, LINE_STRING]))
    lines = lines_of(text)
    assert np.diff(lines.offsets).tolist() == [2, 2]
    assert lines.ids.to_pylist() == ["a", None]


def test_batches_may_differ_in_their_properties(monkeypatch):
    monkeypatch.setattr("gpszip.io.networks.geojson._BATCH_FEATURES", 2)
    features = [
        {"type": "Feature", "properties": properties, "geometry": LINE_STRING}
        for properties in ({}, {"name": "A"}, {"name": 7}, {"ref": "B 1"}, {"oneway": "yes"})
    ]
    lines = lines_of(json.dumps({"type": "FeatureCollection", "features": features}))
    assert lines.names.to_pylist() == [None, "A", "7", "B 1", None]
    assert lines.backward.tolist() == [True] * 4 + [False]


def test_another_coordinate_system_is_converted():
    line = {"type": "LineString", "coordinates": [[1224514.4, 6106854.8], [1224625.7, 6106854.8]]}
    text = json.dumps(
        {
            "type": "FeatureCollection",
            "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::3857"}},
            "features": [{"type": "Feature", "properties": {}, "geometry": line}],
        }
    )
    assert np.allclose(lines_of(text).coordinates, [[11, 48], [11.001, 48]], atol=1e-6)
    with pytest.raises(InputError, match=r"roads\.geojson: names a coordinate system in a way"):
        lines_of(text.replace('"name": "urn', '"href": "urn'))


def test_vector_formats_name_their_extra(tmp_path):
    """Without pyogrio, GeoJSON is read, and GeoPackage says what to install."""
    roads, package = tmp_path / "roads.geojson", tmp_path / "roads.gpkg"
    roads.write_text(json.dumps(LINE_STRING))
    package.write_bytes(b"SQLite format 3\0" + bytes(200))
    code = (
        "import sys; sys.modules['pyogrio'] = None\n"
        "from gpszip.cli.main import run\n"
        "sys.argv = ['gpszip', 'network', sys.argv[1], '-o', sys.argv[2], '--force']\n"
        "run()\n"
    )
    target = str(tmp_path / "out.gpsz")
    for source, status in ((roads, 0), (package, 1)):
        done = subprocess.run(
            [sys.executable, "-c", code, str(source), target],
            capture_output=True,
            text=True,
            check=False,
        )
        assert (done.returncode != 0) == bool(status), done.stderr
    assert "needs the extra 'gis': pip install 'gpszip[gis]'" in done.stderr
    assert "Traceback" not in done.stderr


def test_vector_files_with_texts_that_are_no_utf8_are_refused(tmp_path):
    path = tmp_path / "roads.fgb"
    line = np.array([bytes.fromhex("010200000002000000" + "00" * 24 + "000000000000f03f")], object)
    pyogrio.raw.write(
        path,
        geometry=line,
        field_data=[np.array(["a street"], object)],
        fields=["name"],
        geometry_type="LineString",
        crs="EPSG:4326",
        driver="FlatGeobuf",
    )
    assert len(read_network(path, near=None)) == 1
    path.write_bytes(path.read_bytes().replace(b"a street", b"a str\xffet"))
    with pytest.raises(InputError, match=r"roads\.fgb: can't be read as lines: .*UTF8"):
        read_network(path, near=None)
