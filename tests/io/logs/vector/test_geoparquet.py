import io
import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from gpszip.errors import InputError, OutputError
from gpszip.io.large.store import store_logs
from gpszip.io.logs.read import read_logs
from gpszip.io.logs.write import write_tracks
from gpszip.model import Track
from oracle.geometries import line, point

#: Seconds from 1970 to 2024-05-04.
START = 1_714_780_800
TIMES = START + 10 * np.arange(5)
LON, LAT = 11.5 + np.arange(5) / 1000, 48 + np.arange(5) / 1000


def projjson(code):
    pyproj = pytest.importorskip("pyproj")
    return pyproj.CRS.from_epsg(code).to_json_dict()


def geo(encoding="WKB", types=("Point",), **members):
    column = {"encoding": encoding, "geometry_types": list(types), **members}
    return {"version": "1.1.0", "primary_column": "geom", "columns": {"geom": column}}


def put(path, metadata, geometries, **columns):
    table = pa.table({"when": pa.array(TIMES * 1000, pa.timestamp("ms", "UTC")), **columns})
    table = table.append_column("geom", geometries)
    pq.write_table(table.replace_schema_metadata({b"geo": json.dumps(metadata).encode()}), path)
    return path


def wkb(xs=LON, ys=LAT, zs=None):
    if zs is None:
        return pa.array([point(pair) for pair in zip(xs, ys, strict=True)])
    return pa.array([point(three, axes="z") for three in zip(xs, ys, zs, strict=True)])


def columns_of(path, **options):
    """Times, latitudes and longitudes of the only track, read at once and in batches."""
    options = {"columns": {"t": "when"}, **options}
    track = read_logs(path, **options).tracks[0]
    with store_logs(str(path), rows=1000, **options) as log:
        stored = log.read(log.tracks[0])
        assert stored.times.tolist() == track.times.tolist()
        assert np.allclose(stored.positions, track.positions, atol=1e-5)
    return track


def degrees(track):
    from gpszip.geo.planes import to_geographic

    return np.column_stack(to_geographic(track.positions, track.plane))


def test_points_without_a_crs_are_longitude_and_latitude(tmp_path):
    track = columns_of(put(tmp_path / "a.parquet", geo(), wkb()))
    assert track.times.tolist() == TIMES.tolist()
    np.testing.assert_allclose(degrees(track), np.column_stack([LAT, LON]), atol=1e-9)


@pytest.mark.parametrize("kind", ["struct", "interleaved"])
def test_native_points(tmp_path, kind):
    if kind == "struct":
        geometries = pa.StructArray.from_arrays([pa.array(LON), pa.array(LAT)], ["x", "y"])
    else:
        flat = pa.array(np.column_stack([LON, LAT]).ravel())
        geometries = pa.FixedSizeListArray.from_arrays(flat, 2)
    track = columns_of(put(tmp_path / "a.parquet", geo("point"), geometries))
    np.testing.assert_allclose(degrees(track), np.column_stack([LAT, LON]), atol=1e-9)


def test_another_crs_is_converted(tmp_path):
    from pyproj import Transformer

    to_utm = Transformer.from_crs("EPSG:4326", "EPSG:25832", always_xy=True)
    east, north = to_utm.transform(LON, LAT)
    path = put(tmp_path / "a.parquet", geo(crs=projjson(25832)), wkb(east, north))
    np.testing.assert_allclose(degrees(columns_of(path)), np.column_stack([LAT, LON]), atol=1e-8)


def test_an_unknown_crs_is_metres_and_the_summary_says_so(tmp_path):
    path = put(tmp_path / "a.parquet", geo(crs=None), wkb([0, 1, 2, 3, 4], [5, 6, 7, 8, 9]))
    reading = read_logs(path, columns={"t": "when"})
    assert reading.tracks[0].positions.tolist() == [[i, 5 + i] for i in range(5)]
    assert [repair.what for repair in reading.repairs] == [
        "points without a coordinate system, read as x and y in metres"
    ]
    assert reading.repairs[0].count == 5


@pytest.mark.parametrize("crs", [{"type": "nonsense"}, "\ud800"])
def test_a_crs_that_is_none_is_refused(tmp_path, crs):
    path = put(tmp_path / "a.parquet", geo(crs=crs), wkb())
    with pytest.raises(InputError, match="unknown coordinate system"):
        read_logs(path, columns={"t": "when"})


@pytest.mark.parametrize("types", [["Point Z"], []])
def test_z_is_the_height(tmp_path, types):
    path = put(tmp_path / "a.parquet", geo(types=types), wkb(zs=[500, 501, 502, 503, 504]))
    track = columns_of(path, keep=("ele",))
    assert track.attributes["ele"].tolist() == [500, 501, 502, 503, 504]


def test_a_column_of_heights_comes_before_z(tmp_path):
    path = put(tmp_path / "a.parquet", geo(), wkb(zs=[0] * 5), ele=[1.0, 2, 3, 4, 5])
    track = columns_of(path, keep=("ele",))
    assert track.attributes["ele"].tolist() == [1, 2, 3, 4, 5]


def test_rows_without_a_point_are_dropped_and_counted(tmp_path):
    cells = wkb().to_pylist()
    cells[1], cells[3] = None, line([(1, 2), (3, 4)])
    path = put(tmp_path / "a.parquet", geo(types=[]), pa.array(cells))
    reading = read_logs(path, columns={"t": "when"})
    assert (reading.points, reading.kept) == (5, 3)
    assert reading.repairs[0].what == "rows without a position dropped"


def test_named_columns_come_before_geometries(tmp_path):
    path = put(tmp_path / "a.parquet", geo(), wkb(), a=LAT + 1, b=LON)
    track = columns_of(path, columns={"t": "when", "lat": "a", "lon": "b"})
    np.testing.assert_allclose(degrees(track)[:, 0], LAT + 1, atol=1e-9)


def test_polygons_beside_columns_of_degrees_are_passed_over(tmp_path):
    polygon = b"\x01\x03\x00\x00\x00" + bytes(4)
    path = put(
        tmp_path / "a.parquet", geo(types=["Polygon"]), pa.array([polygon] * 5), lat=LAT, lon=LON
    )
    np.testing.assert_allclose(degrees(columns_of(path))[:, 0], LAT, atol=1e-9)


def test_lines_are_shapes_and_with_m_tracks(tmp_path):
    shape = line([(11, 48), (11.1, 48.1)])
    timed = line([(11, 48, START), (11.1, 48.1, START + 60)], axes="m")
    path = put(
        tmp_path / "a.parquet",
        geo(types=[]),
        pa.array([shape, timed, None, None, None]),
        track_id=list("abcde"),
    )
    for log in (path, io.BytesIO(path.read_bytes())):
        reading = read_logs(log)
        assert [(track.id, track.timed) for track in reading.tracks] == [("a", False), ("b", True)]
        assert reading.tracks[1].times.tolist() == [START, START + 60]
        [item] = reading.left_out
        assert "3 geometry that is no line" in item.name


def test_an_encoding_that_is_not_read_is_named(tmp_path):
    path = put(tmp_path / "a.parquet", geo("multipoint"), wkb())
    with pytest.raises(InputError, match="encoding 'multipoint'; write them as WKB, or as points"):
        read_logs(path, columns={"t": "when"})


@pytest.mark.parametrize(
    "metadata", [b"", b"{", b"[]", b'{"primary_column": "geom", "columns": {"geom": 7}}']
)
def test_damaged_metadata_count_as_none(tmp_path, metadata):
    table = pa.table({"t": TIMES, "lat": LAT, "lon": LON, "geom": wkb()})
    pq.write_table(table.replace_schema_metadata({b"geo": metadata}), tmp_path / "a.parquet")
    assert read_logs(tmp_path / "a.parquet").kept == 5


# Writing


def tracks_on_earth():
    rows = "".join(
        f"{'ab'[i % 2]},{START + i}.25,{48 + i / 1000},{11 + i / 1000},{500 + i},n{i}\n"
        for i in range(20)
    )
    log = io.BytesIO(f"track_id,t,lat,lon,ele,name\n{rows}".encode())
    return read_logs(log, keep=("ele", "name")).tracks


def test_what_is_written_comes_back(tmp_path):
    tracks = tracks_on_earth()
    write_tracks(tracks, tmp_path / "a.geoparquet")
    back = read_logs(tmp_path / "a.geoparquet", keep=("ele", "name")).tracks
    for track, other in zip(tracks, back, strict=True):
        assert (track.id, track.times.tolist()) == (other.id, other.times.tolist())
        assert track.attributes["name"].tolist() == other.attributes["name"].tolist()
        assert track.attributes["ele"].tolist() == other.attributes["ele"].tolist()
        np.testing.assert_allclose(degrees(track), degrees(other), atol=1e-8)


def test_a_folder_of_files_is_one_log(tmp_path):
    for number, track in enumerate(tracks_on_earth()):
        (tmp_path / f"day={number}").mkdir()
        write_tracks([track], tmp_path / f"day={number}" / "a.geoparquet")
    reading = read_logs(tmp_path, keep=("day",))
    assert [(track.id, set(track.attributes["day"])) for track in reading.tracks] == [
        ("a", {0}),
        ("b", {1}),
    ]


def test_metres_come_back_as_metres(tmp_path):
    track = Track("hall", [0, 1.5], [[0, 0, 1], [1, 2, 3]])
    write_tracks([track], tmp_path / "a.geoparquet")
    reading = read_logs(tmp_path / "a.geoparquet")
    assert reading.tracks[0].positions.tolist() == [[0, 0, 1], [1, 2, 3]]
    assert not reading.repairs


def test_geopandas_reads_it_without_a_warning(tmp_path):
    geopandas = pytest.importorskip("geopandas", reason="needs geopandas")
    write_tracks(tracks_on_earth(), tmp_path / "a.geoparquet")
    frame = geopandas.read_parquet(tmp_path / "a.geoparquet")
    assert frame.crs.to_epsg() == 4326 or frame.crs.to_authority() == ("OGC", "CRS84")
    assert str(frame["t"].dtype) == "datetime64[us, UTC]"
    assert frame.geometry.x[0] == 11
    assert frame.geometry.z[0] == 500
    assert len(geopandas.read_parquet(tmp_path / "a.geoparquet", bbox=(10, 47, 11.0005, 49))) == 1


def test_times_that_no_timestamp_holds_are_refused(tmp_path):
    with pytest.raises(OutputError, match="too far from 1970"):
        write_tracks([Track("a", [0, 1e14], [[0, 0], [1, 1]])], tmp_path / "a.geoparquet")


def test_an_attribute_named_as_the_geometry_is_refused(tmp_path):
    track = Track("a", [0, 1], [[0, 0], [1, 1]], attributes={"geometry": np.array(["p", "q"])})
    with pytest.raises(OutputError, match="attribute named 'geometry'"):
        write_tracks([track], tmp_path / "a.geoparquet")
