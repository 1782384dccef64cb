"""Frames of archives, logs and tracks have the rows that commands write, and are read back."""

import csv
import sys
import warnings
from datetime import UTC, datetime

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given

import gpszip
from frames import package
from gpszip.cli.main import main
from gpszip.errors import MissingExtraError, OptionError, UnknownTrackError
from gpszip.geo.planes import choose_plane
from gpszip.testing.strategies import tracks

START = datetime(2024, 5, 1, 10, tzinfo=UTC).timestamp()
PLANE = choose_plane([48.0], [11.0])


def fleet(*, plane=PLANE, start=START):
    """A bus with a gap and a kept column, and a route without times."""
    times = start + np.array([*range(0, 200, 5), *range(1000, 1200, 5)])
    along = 10.0 * np.arange(len(times))
    positions = np.stack([along, 20 * np.sin(along / 300)], axis=1)
    bus = gpszip.Track("bus", times, positions, attributes={"stop": along.astype(int)}, plane=plane)
    beside = positions + np.array([0.0, 9.0])
    return [bus, gpszip.Track("tram", times, beside, attributes=bus.attributes, plane=plane)]


def route():
    corners = [[0, 0], [500, 0], [500, 200]]
    return gpszip.Track("route", [0, 500, 700], corners, plane=PLANE, timed=False)


@pytest.fixture(scope="module")
def archive():
    return gpszip.compress(fleet(), rmse=2.0, gap=60.0, keep=["stop"], effort=1)


@pytest.fixture(scope="module")
def with_shape():
    return gpszip.compress([fleet()[0], route()], rmse=2.0, gap=60.0, effort=1)


SELECTIONS = {
    (): {},
    ("--every", "7"): {"every": 7.0},
    ("--at", "2024-05-01T10:01:00Z,2024-05-01T10:17:00Z"): {
        "at": ["2024-05-01T10:01:00Z", "2024-05-01T10:17:00Z"]
    },
    ("--samples",): {"samples": True},
    ("--track", "tram"): {"track": "tram"},
}


@pytest.mark.parametrize("options", SELECTIONS, ids=" ".join)
def test_a_table_has_the_rows_that_decompress_writes(archive, tmp_path, options):
    archive.save(tmp_path / "fleet.gpsz")
    paths = [str(tmp_path / name) for name in ("fleet.gpsz", "log.csv")]
    assert main(["decompress", paths[0], "-o", paths[1], *options]) == 0
    with (tmp_path / "log.csv").open(newline="") as file:
        written = list(csv.DictReader(file))

    table = archive.to_arrow(**SELECTIONS[options])
    rows = table.to_pylist()
    assert len(rows) == len(written) > 0
    for row, expected in zip(rows, written, strict=True):
        piece = f"/{row['piece']}" if "piece" in row else ""
        assert row["track_id"] + piece == expected["track_id"]
        assert row["t"].timestamp() == pytest.approx(float(expected["t"]), abs=1e-6)
        # Samples are not rounded, as their columns are exact.
        tolerance = 1e-7 if "--samples" in options else 0
        assert row["lat"] == pytest.approx(float(expected["lat"]), abs=tolerance)
        assert row["lon"] == pytest.approx(float(expected["lon"]), abs=tolerance)
        assert row.get("stop") == (int(expected["stop"]) if "stop" in expected else None)


def test_types_of_a_table(archive):
    schema = archive.to_arrow(samples=True).schema
    assert schema.names == ["track_id", "t", "lat", "lon", "stop"]
    assert schema.field("t").type == pa.timestamp("us", "UTC")
    assert pa.types.is_dictionary(schema.field("track_id").type)
    assert pa.types.is_integer(schema.field("stop").type)


def test_times_of_a_log_from_its_own_zero_are_seconds():
    archive = gpszip.compress(fleet(plane=None, start=0.0), rmse=2.0, gap=60.0, effort=1)
    table = archive.to_arrow(every=5.0)
    assert table.schema.names == ["track_id", "piece", "t", "x", "y"]
    assert table.column("t").to_pylist()[:3] == [0.0, 5.0, 10.0]


def test_tracks_without_times_have_null_times(with_shape):
    rows = with_shape.to_arrow().to_pylist()
    assert {row["track_id"] for row in rows if row["t"] is None} == {"route"}
    assert {row["track_id"] for row in rows if row["t"] is not None} == {"bus"}
    assert {row["track_id"] for row in with_shape.to_arrow(every=60.0).to_pylist()} == {"bus"}


def test_a_table_without_rows_has_all_columns(archive):
    table = archive.to_arrow(at=["2024-05-01T10:10:00Z"])
    assert (table.num_rows, table.schema.names) == (0, ["track_id", "piece", "t", "lat", "lon"])


def test_selections_that_do_not_go_together(archive):
    with pytest.raises(OptionError, match="several of every, at and samples"):
        archive.to_arrow(every=5.0, samples=True)
    with pytest.raises(UnknownTrackError):
        archive.to_arrow(track="metro")


def test_a_track_of_an_archive_is_a_part_of_its_table(archive):
    table = archive.to_arrow()
    part = table.filter(pa.compute.equal(table.column("track_id").cast(pa.string()), "tram"))
    assert archive["tram"].to_arrow().to_pylist() == part.to_pylist()


def test_samples_of_a_log_are_a_table_as_they_are():
    columns = {
        "track_id": ["a", "a", "b"],
        "t": [0.5, 1.5, 2.0],
        "x": [1.0, 2.0, 3.0],
        "y": [4.0, 5.0, 6.0],
    }
    log = gpszip.read(columns)
    assert log.to_arrow().to_pydict() == columns
    assert log[1].to_arrow().to_pylist() == log.to_arrow().to_pylist()[2:]


@given(tracks())
def test_a_track_comes_back_from_its_table(track):
    rows = track.to_arrow().to_pydict()
    assert rows["track_id"] == [track.id] * len(track)
    if track.timed and not isinstance(rows["t"][0], datetime):
        assert rows["t"] == track.times.tolist()
    names = [name for name in rows if name not in ("track_id", "t", *track.attributes)]
    assert [rows[name] for name in names] == track.coordinates.T.tolist()


def test_attributes_that_some_tracks_lack_are_null():
    x = [[0.0], [1.0]]
    tracks = [
        gpszip.Track("a", [0, 1], x, attributes={"hr": np.array([60, 61]), "t": np.array([7, 8])}),
        gpszip.Track("b", [0, 1], x, attributes={"hr": np.array([60.5, np.nan])}),
        gpszip.Track("c", [0, 1], x),
    ]
    result = gpszip.ReadResult(tuple(tracks), 6, 0, geographic=False)
    table = result.to_arrow()
    assert table.column("hr").to_pylist() == [60, 61, 60.5, None, None, None]
    assert table.column("t-2").to_pylist() == [7, 8, None, None, None, None]


KINDS = {
    "to_arrow": "pyarrow",
    "to_pandas": "pandas",
    "to_polars": "polars",
    "to_geopandas": "geopandas",
}


@pytest.mark.parametrize("method", KINDS)
@pytest.mark.parametrize("plane", [PLANE, None], ids=["degrees", "metres"])
def test_frames_are_read_back(method, plane):
    package(KINDS[method])
    archive = gpszip.compress(fleet(plane=plane), rmse=2.0, gap=60.0, keep=["stop"], effort=1)
    expected = archive.samples()
    result = gpszip.read(getattr(archive, method)(samples=True), keep=["stop"])
    assert (result.lost, result.dropped_columns) == (0, ())
    for track, other in zip(result, expected, strict=True):
        assert (track.id, track.times.tolist()) == (other.id, other.times.tolist())
        assert np.allclose(track.coordinates, other.coordinates, rtol=0, atol=1e-12)
        assert track.attributes["stop"].tolist() == other.attributes["stop"].tolist()


def test_geodataframes_know_where_they_are(archive):
    package("geopandas")
    frame = archive.to_geopandas()
    assert frame.crs.to_epsg() == 4326
    assert list(frame.columns) == ["track_id", "piece", "t", "geometry"]
    assert frame.total_bounds.round(1).tolist() == [11.0, 48.0, 11.0, 48.0]
    metres = fleet(plane=None)[0].to_geopandas()
    assert metres.crs.is_engineering
    assert metres.total_bounds[2] == 790.0


def test_trajectories_are_the_pieces(archive):
    package("movingpandas")
    collection = archive.to_movingpandas(every=10.0)
    assert [each.id for each in collection.trajectories] == ["bus/0", "bus/1", "tram/0", "tram/1"]
    first = collection.trajectories[0]
    assert str(first.df.index[0]) == "2024-05-01 10:00:00"
    # movingpandas measures on the globe, GPSZip on the plane.
    assert first.get_length() == pytest.approx(380, rel=0.005)
    assert [each.id for each in archive.to_movingpandas(samples=True).trajectories] == [
        "bus",
        "tram",
    ]
    assert [each.id for each in fleet()[0].to_movingpandas().trajectories] == ["bus"]


def test_trajectories_need_times(with_shape):
    package("movingpandas")
    ids = [each.id for each in with_shape.to_movingpandas().trajectories]
    assert ids == ["bus/0", "bus/1"]
    with pytest.raises(OptionError, match="no track has times and two positions"):
        route().to_movingpandas()


@pytest.mark.parametrize("name", ["pandas", "polars", "geopandas", "movingpandas"])
def test_a_missing_package_is_named(monkeypatch, archive, name):
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingExtraError, match=rf"pip install 'gpszip\[{name}\]'"):
        getattr(archive, f"to_{name}")()


def test_no_frame_causes_a_warning(archive):
    for name in ("pandas", "polars", "geopandas", "movingpandas"):
        package(name)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for method in ("to_pandas", "to_polars", "to_geopandas", "to_movingpandas"):
            gpszip.read(getattr(archive, method)())
