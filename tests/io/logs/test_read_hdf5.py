import io
import sys

import numpy as np
import pytest

from gpszip.errors import InputError, MissingExtraError
from gpszip.io.large.store import store_logs
from gpszip.io.logs.formats import format_for_reading
from gpszip.io.logs.hdf5 import read_hdf5, read_hdf5_batches
from gpszip.io.logs.raw import Request
from gpszip.io.logs.read import read_logs
from gpszip.io.storage.source import Source

h5py = pytest.importorskip("h5py")

T = np.arange(9.0)


def written(fill):
    file = io.BytesIO()
    with h5py.File(file, "w") as opened:
        fill(opened)
    return file.getvalue()


def of_datasets(**datasets):
    def fill(file):
        for path, values in datasets.items():
            file[path.replace("__", "/")] = values

    return written(fill)


def raw(data, **request):
    return read_hdf5(Source("log.h5", data=data), Request(**request))


def test_the_group_that_has_time_and_position_is_read():
    data = of_datasets(
        gps__time=T, gps__lat=T / 10, gps__lon=T / 5, gps__speed=T, imu__time=T[:3], imu__acc=T[:3]
    )
    log = raw(data, keep=("speed",))
    assert log.coordinates.tolist() == np.column_stack([T / 10, T / 5]).tolist()
    assert log.attributes["speed"].tolist() == T.tolist()

    # Datasets at the top count as one group.
    log = raw(of_datasets(t=T, pos=np.column_stack([T, T + 1, T + 2])))
    assert log.axes == ("pos_x", "pos_y", "pos_z")


def test_several_such_groups_are_refused_and_columns_choose():
    data = of_datasets(a__t=T, a__x=T, a__y=T, b__t=T, b__x=T + 1, b__y=T)
    with pytest.raises(InputError, match=r"2 groups have time and position: 'a', 'b'"):
        raw(data)
    log = raw(data, columns={"t": "/b/t", "x": "b/x", "y": "/b/y"}, keep=("/a/x",))
    assert log.coordinates.tolist() == np.column_stack([T + 1, T]).tolist()
    assert log.attributes["a/x"].tolist() == T.tolist()
    with pytest.raises(InputError, match="c/t"):
        raw(data, columns={"t": "c/t", "x": "b/x", "y": "b/y"})


def test_structured_datasets_and_texts():
    rows = np.zeros(9, [("time", ">i8"), ("lat", "<f4"), ("lon", "<f8"), ("name", "S3")])
    rows["time"], rows["name"] = np.arange(9) + 1_700_000_000, b"bus"
    log = raw(
        of_datasets(rows=rows), columns={"t": "rows.time", "lat": "rows.lat", "lon": "rows.lon"}
    )
    assert log.times.tolist() == (np.arange(9) + 1_700_000_000).tolist()

    times = [f"2024-05-04T08:00:0{i}Z" for i in range(9)]
    log = raw(of_datasets(time=np.array(times, "S"), x=T, y=T, id=np.array([b"a", b"b", b"a"] * 3)))
    assert log.times[0] == 1714809600
    assert log.ids == ("a", "b")


def test_packed_numbers_are_unpacked():
    def fill(file):
        file["t"], file["lon"] = T, T
        file["lat"] = np.array([480_000_000, -1, *[481_000_000] * 7], np.int32)
        file["lat"].attrs["scale_factor"] = 1e-7
        file["lat"].attrs["add_offset"] = np.array([1.0])
        file["lat"].attrs["_FillValue"] = np.int32(-1)

    lat = raw(written(fill)).coordinates[:, 0]
    np.testing.assert_allclose(lat, [49.0, np.nan, *[49.1] * 7], rtol=0, atol=1e-9)


def test_batches_are_read_as_the_whole_file_is(tmp_path, monkeypatch):
    monkeypatch.setattr("gpszip.io.logs.arrays._BATCH_ROWS", 4)
    data = of_datasets(time=T, x=T * 3, y=T * 4)
    (tmp_path / "log.h5").write_bytes(data)
    opened = read_hdf5_batches(Source("log.h5", path=tmp_path / "log.h5"), Request())
    assert opened.count_rows() == 9
    batches = list(opened.batches)
    assert [len(batch.times) for batch in batches] == [4, 4, 1]
    with store_logs(str(tmp_path / "log.h5"), rows=4) as stored:
        (track,) = [stored.read(track) for track in stored.tracks]
    assert track.times.tolist() == T.tolist()
    assert len(read_logs(io.BytesIO(data)).tracks[0]) == 9


def test_other_files_are_not_read(tmp_path):
    (tmp_path / "other.h5").write_bytes(of_datasets(t=T, x=T, y=T))

    def fill(file):
        for name in "txy":
            file[name] = h5py.ExternalLink(str(tmp_path / "other.h5"), name)
        file["soft"] = h5py.SoftLink("/t")
        layout = h5py.VirtualLayout((9,), "f8")
        layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "t", (9,))
        file.create_virtual_dataset("time", layout)
        file.create_dataset(
            "lat", (9,), "f8", external=[(str(tmp_path / "secret"), 0, h5py.h5f.UNLIMITED)]
        )

    with pytest.raises(InputError, match="no dataset of numbers"):
        raw(written(fill))


def test_a_dataset_that_claims_any_size_costs_no_memory():
    def fill(file):
        file["t"], file["y"] = T, T
        file.create_dataset("x", (10**12,), "f8", chunks=(1000,))

    with pytest.raises(InputError, match="no position; columns found: t, y;"):
        raw(written(fill))


def test_texts_of_variable_length_are_no_columns():
    with pytest.raises(InputError, match="no time; columns found: x, y"):
        raw(of_datasets(time=["2024-05-04T08:00:00Z"] * 9, x=T, y=T))


def test_damaged_files_are_refused():
    data = of_datasets(time=T, x=T, y=T)
    for damaged in (data[:100], data[:-50], data[:48] + bytes(400) + data[448:]):
        with pytest.raises(InputError):
            raw(damaged)
    assert format_for_reading(Source("a", data=data)).name == "hdf5"


def test_without_h5py_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(MissingExtraError, match=r"reading HDF5 needs the extra 'hdf5'"):
        raw(b"\x89HDF\r\n\x1a\n")


@pytest.mark.parametrize(
    ("units", "seconds", "origin"),
    [
        ("days since 2020-01-01", 86_400, "2020-01-01"),
        ("seconds since 1970-1-1 0:0:0", 1, "1970-01-01"),
        (np.bytes_(b"minutes since 2020-02-03T04:05:06Z"), 60, "2020-02-03T04:05:06"),
        ("hours since 1900-01-01 00:00:00.0", 3600, "1900-01-01"),
        ("microseconds since 2000-01-01 00:00:00 UTC", 1e-6, "2000-01-01"),
    ],
)
def test_times_may_count_from_a_date(units, seconds, origin):
    def fill(file):
        file["time"], file["lat"], file["lon"] = T, T, T
        file["time"].attrs["units"] = units
        file["lat"].attrs["units"] = "degrees_north"

    start = np.datetime64(origin, "s").astype(float)
    assert raw(written(fill)).times.tolist() == (T * seconds + start).tolist()


@pytest.mark.parametrize(
    ("units", "calendar"),
    [
        ("fortnights since 2020-01-01", "standard"),
        ("days since 2020-13-01", "standard"),
        ("days since 2020-01-01 00:00 +05:30", "standard"),
        ("days since 2020-01-01", "360_day"),
    ],
)
def test_times_from_dates_that_cannot_be_read_are_refused(units, calendar):
    def fill(file):
        file["time"], file["lat"], file["lon"] = T, T, T
        file["time"].attrs["units"], file["time"].attrs["calendar"] = units, calendar

    with pytest.raises(InputError, match=r"log.h5: dataset '/time' has times in '.* since 2020"):
        raw(written(fill))

    # They don't matter if they are not used.
    columns = {"t": "lat", "lat": "lat", "lon": "lon"}
    assert len(raw(written(fill), columns=columns).times) == 9
