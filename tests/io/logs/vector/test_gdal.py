"""GeoPackage and FlatGeobuf: what pyogrio writes is read, and what GPSZip writes comes back."""

import gzip
import io
import sqlite3

import numpy as np
import pyarrow as pa
import pytest

from gpszip.errors import InputError, MissingExtraError, OutputError
from gpszip.geo.planes import to_geographic
from gpszip.io.large.store import store_logs
from gpszip.io.logs.formats import format_for_reading
from gpszip.io.logs.read import read_logs
from gpszip.io.logs.write import write_tracks
from gpszip.io.storage.source import Source
from gpszip.model import Track
from oracle.geometries import line, point

pyogrio = pytest.importorskip("pyogrio", reason="needs pyogrio: pip install 'gpszip[gis]'")

#: Seconds from 1970 to 2024-05-04.
START = 1_714_780_800
TIMES = START + 10 * np.arange(5)
LON, LAT = 11.5 + np.arange(5) / 1000, 48 + np.arange(5) / 1000
DRIVERS = {".gpkg": "GPKG", ".fgb": "FlatGeobuf"}


def put(path, geometries, kind="Point", layer="log", crs="EPSG:4326", **columns):
    table = pa.table({**columns, "geometry": pa.array(geometries, pa.binary())})
    pyogrio.write_arrow(
        table,
        path,
        layer=layer,
        driver=DRIVERS[path.suffix],
        geometry_name="geometry",
        geometry_type=kind,
        crs=crs,
        layer_options={"SPATIAL_INDEX": "NO"},
    )
    return path


def points(xs=LON, ys=LAT):
    return [point(pair) for pair in zip(xs, ys, strict=True)]


def dates(zone="UTC"):
    return pa.array(TIMES * 1000, pa.timestamp("ms", zone))


def degrees(track):
    return np.column_stack(to_geographic(track.positions, track.plane))


@pytest.mark.parametrize("suffix", DRIVERS)
def test_points_with_times(tmp_path, suffix):
    path = put(tmp_path / f"a{suffix}", points(), time=dates(), vehicle=list("aabbb"))
    expected = {"a": TIMES[:2].tolist(), "b": TIMES[2:].tolist()}
    for log in (path, io.BytesIO(path.read_bytes()), io.BytesIO(gzip.compress(path.read_bytes()))):
        reading = read_logs(log)
        assert {track.id: track.times.tolist() for track in reading.tracks} == expected
        np.testing.assert_allclose(degrees(reading.tracks[0])[:, 0], LAT[:2], atol=1e-9)
    with store_logs(str(path), rows=1000) as log:
        assert {track.id: log.read(track).times.tolist() for track in log.tracks} == expected


@pytest.mark.parametrize("suffix", DRIVERS)
@pytest.mark.parametrize("zone", ["UTC", "+02:00"])
def test_times_have_their_zone(tmp_path, suffix, zone):
    [track] = read_logs(put(tmp_path / f"a{suffix}", points(), time=dates(zone))).tracks
    assert track.times.tolist() == TIMES.tolist()


@pytest.mark.parametrize("suffix", DRIVERS)
def test_another_crs_is_converted(tmp_path, suffix):
    from pyproj import Transformer

    to_utm = Transformer.from_crs("EPSG:4326", "EPSG:25832", always_xy=True)
    path = tmp_path / f"a{suffix}"
    put(path, points(*to_utm.transform(LON, LAT)), crs="EPSG:25832", time=dates())
    [track] = read_logs(path).tracks
    np.testing.assert_allclose(degrees(track), np.column_stack([LAT, LON]), atol=1e-8)


def test_a_field_named_as_the_geometry_is_a_field(tmp_path):
    path = put(tmp_path / "a.fgb", points(), time=dates(), wkb_geometry=list("abcde"))
    assert read_logs(path, keep=("wkb_geometry",)).tracks[0].attributes["wkb_geometry"][4] == "e"


def test_the_layer_of_points_with_times_is_taken(tmp_path):
    path = put(tmp_path / "a.gpkg", points(), layer="stops", name=list("abcde"))
    put(path, [line([(11, 48), (12, 49)])], "LineString", "roads", name=["a"])
    put(path, points(), layer="log", time=dates())
    reading = read_logs(path)
    assert reading.tracks[0].times.tolist() == TIMES.tolist()
    assert [(item.name.split(": ")[1], item.reason) for item in reading.left_out] == [
        ("'stops' (Point)", "the log is in layer 'log'"),
        ("'roads' (LineString)", "the log is in layer 'log'"),
    ]


def test_several_logs_in_a_file_are_refused_and_listed(tmp_path):
    path = put(tmp_path / "a.gpkg", points(), layer="one", time=dates())
    put(path, points(), layer="two", time=dates())
    with pytest.raises(InputError, match=r"2 layers may be the log: 'one' \(Point\), 'two'"):
        read_logs(path)


def test_points_without_times_are_refused_with_their_fields(tmp_path):
    path = put(tmp_path / "a.gpkg", points(), layer="stops", label=list("abcde"))
    with pytest.raises(InputError, match="no time; columns found: lon, lat, label"):
        read_logs(path)


def test_polygons_are_refused_with_their_layers(tmp_path):
    ring = b"\x01\x03\x00\x00\x00" + bytes(4)
    path = put(tmp_path / "a.fgb", [ring], "Polygon", "parks", n=[1])
    with pytest.raises(InputError, match=r"no layer has points.*it has: 'parks' \(Polygon\)"):
        read_logs(path)


def test_lines_with_m_are_tracks(tmp_path):
    # GDAL's Python package writes no type with m; the table of a GeoPackage states it.
    cells = [
        line([(11, 48, START), (11.1, 48.1, START + 60)], axes="m"),
        line([(11, 48, 500, START), (11.1, 48.1, 600, START + 60)], axes="zm"),
    ]
    path = put(tmp_path / "a.gpkg", cells, "Unknown", track_id=list("ab"))
    with sqlite3.connect(path) as database:
        database.execute(
            "UPDATE gpkg_geometry_columns SET geometry_type_name='LINESTRING', z=2, m=1"
        )
    database.close()
    reading = read_logs(path)
    assert [(track.id, track.times.tolist()) for track in reading.tracks] == [
        ("a", [START, START + 60]),
        ("b", [START, START + 60]),
    ]


def test_lines_without_m_are_shapes(tmp_path):
    path = put(tmp_path / "a.fgb", [line([(11, 48), (11.1, 48.1)])], "LineString", name=["plan"])
    [track] = read_logs(path).tracks
    assert (track.id, track.timed) == ("plan", False)


def test_rows_without_a_point_are_dropped_and_counted(tmp_path):
    cells = points()
    cells[1], cells[3] = None, line([(1, 2), (3, 4)])
    reading = read_logs(put(tmp_path / "a.gpkg", cells, "Unknown", time=dates()))
    assert (reading.points, reading.kept) == (5, 3)
    assert reading.repairs[0].what == "rows without a position dropped"


@pytest.mark.parametrize("columns", [("t", "lat", "lon"), {"lat": "y"}])
def test_columns_of_coordinates_cannot_be_named(tmp_path, columns):
    path = put(tmp_path / "a.gpkg", points(), time=dates())
    with pytest.raises(InputError, match="positions are geometries"):
        read_logs(path, columns=columns)


@pytest.mark.parametrize("suffix", DRIVERS)
@pytest.mark.parametrize("share", [0.2, 0.6, 0.95])
def test_a_file_that_is_cut_short_is_refused(tmp_path, suffix, share):
    many = np.arange(5000)
    path = tmp_path / f"a{suffix}"
    put(path, points(11 + many / 1e6, 48 + many / 1e6), t=many + START)
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(InputError):
        read_logs(path)


@pytest.mark.parametrize("suffix", DRIVERS)
@pytest.mark.parametrize("kind", ["Point", "Point Z", "Unknown"])
def test_a_layer_without_rows_is_refused(tmp_path, suffix, kind):
    path = put(tmp_path / f"a{suffix}", [], kind, t=pa.array([], pa.float64()))
    with pytest.raises(InputError, match=r"but no rows|no layer has points"):
        read_logs(path)


def test_an_index_changes_the_order_which_sorting_repairs(tmp_path):
    # FlatGeobuf with an index has its rows along a curve through the plane.
    xs = 11 + np.array([0, 9, 1, 8, 2]) / 10
    cells = pa.array(points(xs, LAT))
    table = pa.table({"t": TIMES, "geometry": cells})
    path = tmp_path / "a.fgb"
    pyogrio.write_arrow(
        table,
        path,
        driver="FlatGeobuf",
        geometry_name="geometry",
        geometry_type="Point",
        crs="EPSG:4326",
    )
    with pytest.raises(InputError, match="--sort"):
        read_logs(path)
    [track] = read_logs(path, sort=True).tracks
    np.testing.assert_allclose(degrees(track)[:, 1], xs, atol=1e-9)


def test_another_database_is_no_geopackage(tmp_path):
    with sqlite3.connect(tmp_path / "a.gpkg") as database:
        database.execute("CREATE TABLE log (t, lat, lon)")
    database.close()
    with pytest.raises(InputError, match="is a database"):
        read_logs(tmp_path / "a.gpkg")


def test_without_pyogrio_the_extra_is_named(tmp_path, monkeypatch):
    path = put(tmp_path / "a.gpkg", points(), time=dates())
    monkeypatch.setitem(__import__("sys").modules, "pyogrio", None)
    with pytest.raises(MissingExtraError, match="gis"):
        read_logs(path)


# Writing


def tracks_on_earth():
    rows = "".join(
        f"{'ab'[i % 2]},{START + i}.123456,{48 + i / 1000},{11 + i / 1000},{500 + i},n{i}\n"
        for i in range(20)
    )
    log = io.BytesIO(f"track_id,t,lat,lon,ele,name\n{rows}".encode())
    return read_logs(log, keep=("ele", "name")).tracks


@pytest.mark.parametrize("suffix", DRIVERS)
def test_what_is_written_comes_back(tmp_path, suffix):
    tracks = tracks_on_earth()
    path = tmp_path / f"a{suffix}"
    write_tracks(tracks, path)
    assert suffix in format_for_reading(Source("a", path)).suffixes
    back = read_logs(path, keep=("ele", "name")).tracks
    for track, other in zip(tracks, back, strict=True):
        assert (track.id, track.times.tolist()) == (other.id, other.times.tolist())
        assert track.attributes["name"].tolist() == other.attributes["name"].tolist()
        assert track.attributes["ele"].tolist() == other.attributes["ele"].tolist()
        np.testing.assert_allclose(degrees(track), degrees(other), atol=1e-8)


@pytest.mark.parametrize("suffix", DRIVERS)
def test_metres_come_back_as_metres(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    write_tracks([Track("hall", [0, 1.5], [[0, 0, 1], [1, 2, 3]])], path)
    reading = read_logs(path)
    assert reading.tracks[0].positions.tolist() == [[0, 0, 1], [1, 2, 3]]
    assert not reading.repairs


@pytest.mark.parametrize("suffix", DRIVERS)
def test_equal_tracks_are_equal_files(suffix):
    written = []
    for _ in range(2):
        written.append(io.BytesIO())
        write_tracks(tracks_on_earth(), written[-1], suffix)
    assert written[0].getvalue() == written[1].getvalue()


@pytest.mark.parametrize("suffix", DRIVERS)
def test_geopandas_reads_it(tmp_path, suffix):
    geopandas = pytest.importorskip("geopandas", reason="needs geopandas")
    write_tracks(tracks_on_earth(), tmp_path / f"a{suffix}")
    frame = geopandas.read_file(tmp_path / f"a{suffix}")
    assert frame.crs.to_epsg() == 4326
    assert str(frame["time"].dtype) == "datetime64[ms, UTC]"
    assert (frame.geometry.x[0], frame.geometry.z[0]) == (11, 500)


def test_names_that_differ_in_case_alone_are_refused(tmp_path):
    attributes = {"speed": np.array([1, 2]), "SPEED": np.array([1, 2])}
    track = Track("a", [0, 1], [[0, 0], [1, 1]], attributes=attributes)
    with pytest.raises(OutputError, match="write this"):
        write_tracks([track], tmp_path / "a.gpkg")
