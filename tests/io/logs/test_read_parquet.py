import gzip
import io
from datetime import UTC, datetime

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from gpszip.errors import InputError
from gpszip.io.logs.read import read_logs


def put(path, **columns):
    pq.write_table(pa.table(columns), path)
    return path


@pytest.mark.parametrize(
    "times",
    [
        pa.array([1.5, 2.5]),
        pa.array([1500, 2500], pa.timestamp("ms")),
        pa.array([1_500_000_000, 2_500_000_000], pa.timestamp("ns", "UTC")),
        pa.array(
            [
                datetime(1970, 1, 1, 0, 0, 1, 500_000, UTC),
                datetime(1970, 1, 1, 0, 0, 2, 500_000, UTC),
            ]
        ),
        pa.array(["1970-01-01T00:00:01.5", "1970-01-01T00:00:02.5"]),
        pa.array([1.5, 2.5], pa.float32()),
    ],
)
def test_times_of_many_types(tmp_path, times):
    track = read_logs(
        put(tmp_path / "a.parquet", T=times, X=[1, 2], Y=pa.array([3, 4], pa.float32()))
    ).tracks[0]
    assert track.times.tolist() == [1.5, 2.5]
    assert track.positions.tolist() == [[1, 3], [2, 4]]


def test_integer_nanoseconds_keep_their_milliseconds(tmp_path):
    ticks = 1211033530077000000 + 1000000 * np.arange(100)
    track = read_logs(
        put(tmp_path / "a.parquet", t=pa.array(ticks), x=np.zeros(100), y=np.zeros(100))
    ).tracks[0]
    assert track.times.tolist() == [round(1211033530.077 + i / 1000, 3) for i in range(100)]


def test_ids_may_be_numbers_texts_or_dictionaries(tmp_path):
    for ids in (
        pa.array([7, 8]),
        pa.array(["7", "8"]),
        pa.array(["7", "8"]).dictionary_encode(),
        pa.array([7, 8]).dictionary_encode(),
    ):
        reading = read_logs(put(tmp_path / "a.parquet", trip_id=ids, t=[0, 1], x=[0, 1], y=[0, 1]))
        assert [track.id for track in reading.tracks] == ["7", "8"]


def test_missing_values_are_dropped_and_counted(tmp_path):
    path = put(
        tmp_path / "a.parquet",
        t=[0.0, None, 2.0, 3.0],
        x=[0.0, 1.0, None, 3.0],
        y=[0.0, 1.0, 2.0, 3.0],
    )
    reading = read_logs(path)
    assert (reading.points, reading.kept, reading.lost) == (4, 2, 2)


def test_missing_timestamps_are_no_times(tmp_path):
    reading = read_logs(
        put(tmp_path / "a.parquet", t=pa.array([1, None], pa.timestamp("s")), x=[0, 1], y=[0, 1])
    )
    assert reading.tracks[0].times.tolist() == [1]


def test_a_folder_of_files_is_one_log_with_the_keys_of_its_partitions(tmp_path):
    for vehicle in ("8", "7"):
        (tmp_path / "log" / f"vehicle={vehicle}").mkdir(parents=True)
        put(
            tmp_path / "log" / f"vehicle={vehicle}" / "part-0.parquet",
            t=[0, 1],
            x=[int(vehicle), 0],
            y=[0, 0],
        )
    reading = read_logs(tmp_path / "log")
    assert [(track.id, track.positions[0, 0]) for track in reading.tracks] == [("7", 7), ("8", 8)]
    assert reading.points == 4


def test_files_of_a_folder_without_names_are_one_track_in_the_order_of_time(tmp_path):
    put(tmp_path / "a.parquet", t=[5, 6], x=[5, 6], y=[0, 0])
    put(tmp_path / "b.parquet", t=[0, 1], x=[0, 1], y=[0, 0])
    (track,) = read_logs(tmp_path).tracks
    assert (track.id, track.times.tolist()) == ("0", [0, 1, 5, 6])


def test_a_bad_file_of_a_folder_is_named_or_left_out(tmp_path):
    put(tmp_path / "a.parquet", t=[5, 6], x=[5, 6], y=[0, 0])
    (tmp_path / "b.parquet").write_bytes(b"PAR1 nothing")
    put(tmp_path / "c.parquet", t=[8], lat=[5], lon=[0])
    put(tmp_path / "d.parquet", t=[9], speed=[5])
    with pytest.raises(InputError, match=r"b\.parquet: damaged"):
        read_logs(tmp_path)
    reading = read_logs(tmp_path, skip_bad=True)
    assert [len(track) for track in reading.tracks] == [2]
    assert [left.name[-9:] for left in reading.left_out] == ["b.parquet", "c.parquet", "d.parquet"]


def test_streams_and_packed_files(tmp_path):
    data = put(tmp_path / "a.parquet", t=[0, 1], x=[0, 1], y=[0, 1]).read_bytes()
    (tmp_path / "b.gz").write_bytes(gzip.compress(data))
    assert (
        len(read_logs(io.BytesIO(data)).tracks[0])
        == len(read_logs(tmp_path / "b.gz").tracks[0])
        == 2
    )


def test_columns_by_position(tmp_path):
    path = put(tmp_path / "a.parquet", a=[0, 1], b=[5, 6], c=[7, 8])
    assert read_logs(path, columns="t,x,y").tracks[0].positions.tolist() == [[5, 7], [6, 8]]


def test_mistakes(tmp_path):
    path = put(tmp_path / "a.parquet", t=[0, 1], x=[0, 1])
    with pytest.raises(InputError, match="no position; columns found: t, x"):
        read_logs(path)
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(InputError, match="damaged Parquet"):
        read_logs(path)
    with pytest.raises(InputError, match="no rows"):
        read_logs(
            put(
                path,
                t=pa.array([], pa.float64()),
                x=pa.array([], pa.float64()),
                y=pa.array([], pa.float64()),
            )
        )
    with pytest.raises(InputError, match="holds bool"):
        read_logs(put(path, t=[True, False], x=[0, 1], y=[0, 1]))
