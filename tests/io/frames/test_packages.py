"""Frames of other packages, where these are installed."""

import subprocess
import sys
import warnings

import numpy as np
import pytest

import gpszip
from frames import package
from gpszip.errors import InputError

TIMES = 1_700_000_000 + 5 * np.arange(6)
TIME_COLUMN = TIMES.astype("M8[s]").astype("M8[ms]")
LAT, LON = 48 + np.arange(6) / 1000, 11 + np.arange(6) / 500
IDS = ["bus", "bus", "bus", "tram", "tram", "tram"]


def columns():
    return {"track_id": IDS, "time": TIME_COLUMN, "lat": LAT, "lon": LON}


def check(result, *, exact=True):
    """Check that these are the tracks of the columns."""
    expected = gpszip.read(columns())
    assert [track.id for track in result] == ["bus", "tram"]
    for track, other in zip(result, expected, strict=True):
        assert track.times.tolist() == other.times.tolist()
        assert np.allclose(track.coordinates, other.coordinates, rtol=0, atol=0 if exact else 1e-9)


@pytest.mark.parametrize("zone", [None, "Europe/Berlin"])
@pytest.mark.parametrize("ids", ["str", "category"])
def test_pandas(zone, ids):
    pd = package("pandas")
    frame = pd.DataFrame(columns()).astype({"track_id": ids})
    frame["time"] = frame["time"].dt.tz_localize("UTC").dt.tz_convert(zone)
    check(gpszip.read(frame))
    check(gpszip.read(frame.set_index("time")))
    check(gpszip.read(frame.set_index(["track_id", "time"])))
    check(gpszip.read(frame.set_index(frame["time"].rename(None)).drop(columns="time")))


def test_pandas_with_missing_values_of_all_kinds():
    pd = package("pandas")
    frame = pd.DataFrame(columns())
    frame["lat"] = frame["lat"].astype("Float64")
    frame.loc[4, "lat"] = pd.NA
    frame.loc[1, "lon"] = np.nan
    with pytest.warns(gpszip.LossWarning):
        result = gpszip.read(frame)
    assert [(repair.count, repair.where) for repair in result.repairs] == [(2, "DataFrame: row 1")]


def test_pandas_periods_are_no_times():
    pd = package("pandas")
    frame = pd.DataFrame(columns())
    frame["time"] = frame["time"].dt.to_period("s")
    with pytest.raises(InputError, match="column 'time' holds periods, not times"):
        gpszip.read(frame)
    frame["time"] = frame["time"].dt.to_timestamp()
    check(gpszip.read(frame))


def test_pandas_refuses_two_columns_of_one_name():
    pd = package("pandas")
    frame = pd.DataFrame([[0, 1.0, 2.0, 3.0]], columns=["t", "x", "y", "x"])
    with pytest.raises(InputError, match="2 columns are named 'x'"):
        gpszip.read(frame)


def test_polars():
    pl = package("polars")
    frame = pl.DataFrame(columns())
    check(gpszip.read(frame))
    check(gpszip.read(frame.lazy()))
    check(gpszip.read(frame.cast({"track_id": pl.Categorical})))
    check(gpszip.read(pl.concat([frame[:2], frame[2:]], rechunk=False)))
    check(
        gpszip.read(
            frame.with_columns(
                pl.col("time").dt.replace_time_zone("Asia/Tokyo").dt.convert_time_zone("UTC")
                + pl.duration(hours=9)
            )
        )
    )
    with pytest.raises(InputError, match="Series: is one column, not a table"):
        gpszip.read(frame["lat"])


def test_duckdb(tmp_path):
    duckdb = package("duckdb")
    pa = pytest.importorskip("pyarrow")
    table = pa.table(columns())
    with duckdb.connect() as connection:
        connection.register("log", table)
        check(gpszip.read(connection.sql("SELECT * FROM log ORDER BY time")))
        relation = connection.sql("SELECT *, lat::DECIMAL(9, 6) AS north FROM log")
        check(gpszip.read(relation, columns="lat=north"), exact=False)
        archive = gpszip.compress(connection.sql("FROM log"), rmse=5.0, effort=1, memory=2**30)
    assert archive.ids == ("bus", "tram")


def points(crs=4326):
    gpd, pd = package("geopandas"), package("pandas")
    frame = pd.DataFrame({"track_id": IDS, "time": TIME_COLUMN, "lat": 0.0})
    return gpd.GeoDataFrame(frame, geometry=gpd.points_from_xy(LON, LAT), crs=crs)


def test_geopandas():
    frame = points()
    check(gpszip.read(frame))
    assert gpszip.read(frame).dropped_columns == ("lat",)
    check(gpszip.read(frame.to_crs("EPSG:32632")), exact=False)
    check(gpszip.read(frame.rename_geometry("where")))
    check(gpszip.read(frame.to_arrow()))
    check(gpszip.read(frame.to_arrow(geometry_encoding="geoarrow")))


def test_geopandas_without_points():
    gpd = package("geopandas")
    frame = points()
    lines = gpd.GeoSeries.from_wkt(
        ["LINESTRING (11 48, 11.1 48)"] * 5 + ["POINT (11 48)"], crs=4326
    )
    with pytest.raises(InputError, match="column 'geometry': row 0: holds a LineString beside"):
        gpszip.read(frame.set_geometry(lines))
    shapes = gpszip.read(frame.set_geometry(lines)[:5])
    assert [track.id for track in shapes] == ["bus", "bus-2", "bus-3", "tram", "tram-2"]
    with pytest.raises(InputError, match="no coordinate system"):
        gpszip.read(points(crs=None))


def test_geopandas_with_empty_points():
    gpd = package("geopandas")
    cells = gpd.GeoSeries.from_wkt(["POINT EMPTY", None, "POINT (11 48)"] * 2, crs=4326)
    with pytest.warns(gpszip.LossWarning):
        result = gpszip.read(points().set_geometry(cells))
    assert [repair.count for repair in result.repairs] == [4]


def test_geopandas_with_some_heights():
    gpd = package("geopandas")
    cells = gpd.GeoSeries.from_wkt(["POINT Z (11 48 500)", "POINT (11.1 48)"] * 3, crs=4326)
    track = gpszip.read(points().set_geometry(cells), keep="alt")[0]
    assert np.array_equal(track.attributes["alt"], [500, np.nan, 500], equal_nan=True)


def test_movingpandas():
    mpd = package("movingpandas")
    frame = points().drop(columns="lat")
    with warnings.catch_warnings():
        # movingpandas causes warnings of pandas.
        warnings.simplefilter("ignore")
        collection = mpd.TrajectoryCollection(frame, "track_id", t="time", min_length=0)
    check(gpszip.read(collection))
    assert [track.id for track in gpszip.read(collection.trajectories[1])] == ["tram"]
    archive = gpszip.compress(collection, rmse=5.0, effort=1)
    assert archive.to_bytes() == gpszip.compress(gpszip.read(frame), rmse=5.0, effort=1).to_bytes()


def test_xarray():
    xr = package("xarray")
    values = {name: ("time", cells) for name, cells in columns().items() if name != "time"}
    dataset = xr.Dataset(values, coords={"time": columns()["time"]})
    check(gpszip.read(dataset))

    # A single value holds for all rows.
    bus = dataset.isel(time=slice(0, 3)).drop_vars("track_id").assign_coords(track_id="bus")
    assert [(track.id, len(track)) for track in gpszip.read(bus)] == [("bus", 3)]


def test_xarray_of_several_dimensions():
    xr = package("xarray")
    lat = xr.DataArray(np.zeros((3, 2)), dims=("time", "vehicle"))
    dataset = xr.Dataset({"lat": lat, "lon": lat}, coords={"time": TIMES[:3]})
    with pytest.raises(InputError, match="variable 'lat': has the dimensions time, vehicle"):
        gpszip.read(dataset)
    with pytest.raises(InputError, match="holds variables along time, vehicle"):
        gpszip.read(dataset.assign_coords(vehicle=["a", "b"]))


def test_xarray_with_times_that_are_not_decoded():
    xr = package("xarray")
    dataset = xr.Dataset(
        {"lat": ("time", LAT), "lon": ("time", LON)},
        coords={"time": ("time", np.arange(6), {"units": "seconds since 2020-01-01"})},
    )
    with pytest.raises(InputError, match=r"holds seconds since 2020-01-01; xarray\.decode_cf"):
        gpszip.read(dataset)
    assert gpszip.read(xr.decode_cf(dataset))[0].times[0] == 1577836800


def test_no_package_of_frames_is_imported_for_files():
    code = (
        "import sys, gpszip; gpszip.read({'t': [0, 1], 'x': [0, 1], 'y': [0, 1]});"
        "print({'polars', 'geopandas', 'xarray', 'duckdb'} & set(sys.modules))"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == "set()"
