"""Parquet logs whose values --lossless keeps, as a user keeps them and gets them back."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import gpszip
from gpszip.errors import InputError, OptionError
from gpszip.io.storage.source import Source
from gpszip.pipeline.exact_frames import check_frames
from gpszip.pipeline.exact_logs import check_exact, exact_logs

ROWS = 600


def table():
    """Rows of three vehicles in turn, with types, missing values, a dictionary and metadata."""
    random = np.random.default_rng(3)
    vehicle = random.integers(0, 3, ROWS)
    way = np.cumsum(random.normal(0, 1e-4, (2, 3, ROWS)), axis=2)
    rows = np.arange(ROWS)
    times = pa.array(10**9 * rows + 17 * 10**17).cast(pa.timestamp("ns", tz="UTC"))
    hr = pa.array(90 + random.integers(0, 9, ROWS), pa.int16(), mask=random.random(ROWS) < 0.2)
    columns = {
        "vehicle": pa.array([f"car {v}" for v in vehicle]).dictionary_encode(),
        "time": times,
        "lat": np.round(52 + way[0, vehicle, rows], 6),
        "lon": np.round(13 + way[1, vehicle, rows], 6),
        "hr": hr,
        "speed": random.normal(9, 2, ROWS).astype(np.float32),
        "height": np.where(rows % 50 == 7, np.nan, -0.0 * rows),
    }
    made = pa.table(columns)
    return made.replace_schema_metadata({"made by": "hand"})


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The table, its file, and an archive of it."""
    path = tmp_path_factory.mktemp("parquet") / "fleet.parquet"
    pq.write_table(table(), path, row_group_size=250, compression="zstd")
    return table(), path, gpszip.compress(path, rmse=20, effort=1, lossless=True)


def test_values_schema_and_row_groups_come_back(made, tmp_path):
    given, path, archive = made
    (tmp_path / "back.parquet").write_bytes(archive.exact_log("fleet.parquet"))
    back = pq.ParquetFile(tmp_path / "back.parquet")
    assert back.schema_arrow.equals(given.schema, check_metadata=True)
    groups = [back.metadata.row_group(i).num_rows for i in range(back.num_row_groups)]
    assert groups == [250, 250, 100]
    assert back.metadata.row_group(0).column(1).compression == "ZSTD"
    found = back.read()
    for name in given.schema.names:
        assert repr(found[name].to_pylist()) == repr(given[name].to_pylist())
    assert archive.size < path.stat().st_size / 2


def test_the_archive_is_proved_to_hold_all_values(gpszip, made, tmp_path):
    _, path, archive = made
    archive.save(tmp_path / "a.gpsz")
    (tmp_path / "fleet.parquet").write_bytes(path.read_bytes())
    assert gpszip("diff --exact a.gpsz fleet.parquet").code == 0
    assert gpszip("verify a.gpsz").code == 0
    done = gpszip("decompress a.gpsz --exact -o again.parquet")
    assert done.code == 0, done.err
    # A file that was written from the archive holds the same, too.
    assert gpszip("diff --exact a.gpsz again.parquet").code == 0


def change(name, row, value):
    """The table with another value in a place."""
    given = table()
    values = given[name].to_pylist()
    values[row] = value
    place = given.schema.names.index(name)
    return given.set_column(place, given.schema.field(name), [pa.array(values, given[name].type)])


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (lambda: change("hr", 300, 99), "row 301: the log has 99 for hr"),
        (lambda: change("height", 7, 1.0), "row 8: the log has 1.0 for height, the archive nan"),
        (lambda: change("height", 9, 0.0), r"row 10: the log has 0.0 for height, the archive -0.0"),
        (lambda: change("vehicle", 599, None), "row 600: the log has None for vehicle"),
        (lambda: table().slice(0, 599), "has other row groups"),
        (lambda: table().replace_schema_metadata({}), "has other columns"),
    ],
)
def test_any_other_value_is_found(made, tmp_path, other, message):
    _, _, archive = made
    path = tmp_path / "fleet.parquet"
    pq.write_table(other(), path, row_group_size=250)
    logs = exact_logs(archive)
    with pytest.raises(InputError, match=message.replace(".", r"\.")):
        check_frames(Source(str(path), path), logs.frames[0])


def test_rows_of_a_track_have_the_types_of_the_log(gpszip, made, tmp_path):
    given, _, archive = made
    wanted = given.filter(pa.array([name == "car 1" for name in given["vehicle"].to_pylist()]))
    rows = archive.exact_rows("car 1", ["hr", "time"])
    assert rows.equals(wanted.select(["hr", "time"]))
    assert archive.exact_rows(columns=["lat"]).equals(given.select(["lat"]))
    archive.save(tmp_path / "a.gpsz")
    done = gpszip("decompress a.gpsz --exact --columns hr,time -o car.parquet --track", "car 1")
    assert done.code == 0, done.err
    assert pq.read_table(tmp_path / "car.parquet").equals(rows)
    done = gpszip("decompress a.gpsz --exact --columns hr -o hr.csv")
    assert (done.code, "are written as Parquet; name the output .parquet" in done.err) == (2, True)
    assert gpszip("decompress a.gpsz --exact --columns hr").code == 0
    assert pq.read_table(tmp_path / "a.parquet").equals(given.select(["hr"]))
    with pytest.raises(OptionError, match="no column 'power'; it has vehicle, time, lat"):
        archive.exact_rows("car 1", ["power"])


def test_values_stay_after_another_track_is_appended(made, tmp_path):
    given, path, archive = made
    rows = "".join(f"new,{17 * 10**8 + i},52.001,13.0{i}\n" for i in range(9))
    (tmp_path / "new.csv").write_text("id,t,lat,lon\n" + rows)
    grown = gpszip.append(archive, tmp_path / "new.csv")
    assert check_exact(grown, [Source(str(path), path)]) > 0
    assert grown.exact_rows("car 2", ["time"]).equals(archive.exact_rows("car 2", ["time"]))
    assert grown.size < archive.size + given.nbytes / 2
