"""Logs larger than memory: the samples are those of read_logs for any order of rows and files."""

import gzip
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gpszip
from gpszip import InputError
from gpszip.io.large import outliers, store
from gpszip.io.large.store import count_rows, store_logs
from gpszip.io.logs.read import read_logs

TINY = 1000  # rows in memory, the fewest that are possible


def fleet(seed=0, vehicles=5, n=2300):
    """Rows of several vehicles, in the order of time."""
    rng = np.random.default_rng(seed)
    ids = np.repeat([f"bus {i}" for i in range(vehicles)], n)
    times = np.concatenate([np.cumsum(rng.exponential(1, n) + 0.01) for _ in range(vehicles)])
    order = np.argsort(times)
    return {
        "track_id": ids[order],
        "t": times[order],
        "x": rng.normal(0, 9, len(ids)),
        "y": rng.normal(0, 9, len(ids)),
    }


def csv(rows, path, pack=False):
    text = (
        "\n".join(
            [",".join(rows), *(",".join(map(str, row)) for row in zip(*rows.values(), strict=True))]
        )
        + "\n"
    )
    path.write_bytes(gzip.compress(text.encode()) if pack else text.encode())
    return str(path)


def part(rows, which):
    return {name: values[which] for name, values in rows.items()}


def check_same_as_read_logs(sources, **options):
    expected = read_logs(sources, **options)
    expected_tracks = {track.id: track for track in expected.tracks}
    with store_logs(sources, rows=TINY, **options) as log:
        assert {track.id for track in log.tracks} == expected_tracks.keys()
        assert log.read_result.points == expected.points
        for track in log.tracks:
            expected_track = expected_tracks[track.id]
            stored = log.read(track)
            assert np.array_equal(stored.times, expected_track.times)
            assert np.abs(stored.positions - expected_track.positions).max() < 1e-6
            assert np.array_equal(log.read(track, 3, 9).times, expected_track.times[3:9])
        return log.sample_count


@pytest.mark.parametrize("pack", [False, True])
def test_csv_with_interleaved_tracks(tmp_path, pack):
    assert check_same_as_read_logs(csv(fleet(), tmp_path / "fleet.csv", pack)) == 5 * 2300


def test_a_folder_of_parquet_in_any_order(tmp_path):
    rows = fleet()
    (logs := tmp_path / "logs").mkdir()
    middle = len(rows["t"]) // 3
    for name, which in (
        ("c", slice(0, middle)),
        ("a", slice(middle, 2 * middle)),
        ("b", slice(2 * middle, None)),
    ):
        pq.write_table(pa.table(part(rows, which)), logs / f"{name}.parquet", row_group_size=700)
    reading = read_logs(csv(rows, tmp_path / "whole.csv"))
    with store_logs(logs, rows=TINY) as log:
        assert log.read_result.points == len(rows["t"])
        for track in log.tracks:
            assert np.array_equal(
                log.read(track).times,
                next(one.times for one in reading.tracks if one.id == track.id),
            )
        folder = log._path.parent
        assert [file.name for file in folder.iterdir()] == ["samples"]
    assert not folder.exists()


def test_files_of_a_folder_without_names_are_one_track(tmp_path):
    for name, start in (("b", 0), ("a", 50)):
        pq.write_table(
            pa.table({"t": np.arange(start, start + 20.0), "x": np.zeros(20), "y": np.zeros(20)}),
            tmp_path / f"{name}.parquet",
        )
    assert check_same_as_read_logs(tmp_path) == 40


def test_keys_of_partitions_are_columns(tmp_path):
    rows = fleet(vehicles=2)
    names = rows.pop("track_id")
    for name in np.unique(names):
        (tmp_path / f"track_id={name}").mkdir()
        pq.write_table(
            pa.table(part(rows, names == name)), tmp_path / f"track_id={name}" / "0.parquet"
        )
    with store_logs(tmp_path, rows=TINY) as log:
        assert sorted(track.id for track in log.tracks) == ["bus 0", "bus 1"]


def test_rows_that_cannot_be_used_are_counted(tmp_path):
    rows = {name: values.astype(object) for name, values in fleet().items()}
    rows["t"][[5, 4000]] = ""
    rows["x"][[7, 9000]] = "nowhere"
    path = Path(csv(rows, tmp_path / "fleet.csv"))
    path.write_text(path.read_text() + "bus 1,5\n")
    check_same_as_read_logs(str(path))
    with store_logs(str(path), rows=TINY) as log:
        counts = {repair.what: repair.count for repair in log.read_result.repairs}
    assert counts == {
        "rows without a time dropped": 2,
        "rows without a position dropped": 2,
        "rows with too many or too few cells dropped": 1,
    }


def test_degrees_get_the_same_plane(tmp_path):
    rng = np.random.default_rng(1)
    n = 3000
    rows = {
        "t": np.arange(n),
        "lat": 48 + rng.normal(0, 0.02, n),
        "lon": 11 + rng.normal(0, 0.02, n),
    }
    assert check_same_as_read_logs(csv(rows, tmp_path / "log.csv")) == n


def test_the_unit_of_time_is_found_once_for_all_batches(tmp_path):
    n = 3000
    rows = {"t": 1_700_000_000_000 + 500 * np.arange(n), "x": np.zeros(n), "y": np.arange(n)}
    assert check_same_as_read_logs(csv(rows, tmp_path / "log.csv")) == n


def test_sorting_merges_runs(tmp_path):
    rows = fleet(vehicles=2)
    shuffled = part(rows, np.random.default_rng(3).permutation(len(rows["t"])))
    path = csv(shuffled, tmp_path / "log.csv")
    with pytest.raises(InputError, match=r"log\.csv: row \d+: time goes back [\d.]+ s; --sort"):
        store_logs(path, rows=TINY)
    assert check_same_as_read_logs(path, sort=True) == 2 * 2300


def test_backward_steps_are_counted_across_batches(tmp_path):
    """After a step back, a batch may begin before the latest time without another step back."""
    order = np.random.default_rng(3).permutation(2 * 2300)
    table = pa.table(part(fleet(vehicles=2), order))
    pq.write_table(table, tmp_path / "log.parquet", row_group_size=70)
    counts = []
    for result in (
        read_logs(str(tmp_path / "log.parquet"), sort=True),
        store_logs(str(tmp_path / "log.parquet"), rows=TINY, sort=True).read_result,
    ):
        repairs = [r for r in result.repairs if r.what == "points put in the order of time"]
        counts.append(sum(repair.count for repair in repairs))
    assert counts[0] == counts[1] > 0


def test_repeated_times_are_dropped(tmp_path):
    rows = {"t": np.repeat(np.arange(1500), 2), "x": np.arange(3000.0), "y": np.zeros(3000)}
    with store_logs(csv(rows, tmp_path / "log.csv"), rows=TINY) as log:
        assert log.sample_count == 1500
        assert log.read_result.lost == 1500
        assert log.read(log.tracks[0]).positions[:3, 0].tolist() == [0, 2, 4]


def two_files(tmp_path, second, name="b.parquet"):
    (tmp_path / "in").mkdir()
    pq.write_table(
        pa.table(
            {"track_id": ["v"] * 5, "t": np.arange(5.0), "x": np.arange(5.0), "y": np.zeros(5)}
        ),
        tmp_path / "in/a.parquet",
    )
    if isinstance(second, bytes):
        (tmp_path / "in" / name).write_bytes(second)
    else:
        pq.write_table(second, tmp_path / "in" / name)
    return tmp_path / "in"


BAD = {
    "read": b"PAR1 no parquet",
    "lat,lon": pa.table({"track_id": ["w"], "t": [1.0], "lat": [48.0], "lon": [11.0]}),
    "no position": pa.table({"track_id": ["w"], "t": [1.0], "speed": [48.0]}),
    "coordinate system": pa.table(
        {"track_id": ["w"], "t": [1.0], "x": [48.0], "y": [11.0]}
    ).replace_schema_metadata({b"geo": b'{"columns": {"geometry": {"crs": "EPSG:25832"}}}'}),
    "no row has a time that": pa.table(
        {"track_id": ["w"], "t": [np.nan], "x": [48.0], "y": [11.0]}
    ),
    "time goes back": pa.table(
        {"track_id": ["w"] * 2, "t": [3.0, 1.0], "x": [48.0, 1.0], "y": [11.0, 1.0]}
    ),
}


@pytest.mark.parametrize("what", BAD)
def test_a_bad_file_is_named_and_refused_or_left_out(tmp_path, what):
    folder = two_files(tmp_path, BAD[what])
    with pytest.raises(InputError, match=rf"b\.parquet: .*{what}"):
        store_logs(folder, rows=TINY)
    with store_logs(folder, rows=TINY, skip_bad=True) as log:
        assert [(track.id, track.count) for track in log.tracks] == [("v", 5)]
        (left,) = log.read_result.left_out
        assert left.name.endswith("b.parquet")
        assert log.read_result.points == 5 + log.read_result.lost


def test_tracks_of_one_name_that_overlap_are_renamed(tmp_path):
    other = pa.table({"track_id": ["v"] * 2, "t": [2.5, 9.0], "x": [48.0, 1.0], "y": [11.0, 1.0]})
    folder = two_files(tmp_path, other)
    whole = read_logs(folder)
    with store_logs(folder, rows=TINY) as log:
        assert [(track.id, track.count) for track in log.tracks] == [("v", 5), ("v-2", 2)]
        assert log.read(log.tracks[1]).times.tolist() == [2.5, 9.0]
        assert log.read_result.repairs == whole.repairs
        assert whole.repairs[0].what == "track renamed to 'v-2', as there is another 'v'"


def test_a_file_damaged_in_the_middle_is_left_out_completely(tmp_path):
    data = tmp_path / "good.parquet"
    table = pa.table(
        {
            "track_id": ["w"] * 9000,
            "t": np.arange(9000.0),
            "x": np.random.default_rng(0).random(9000),
            "y": np.zeros(9000),
        }
    )
    pq.write_table(table, data, row_group_size=1000)
    raw = bytearray(data.read_bytes())
    raw[len(raw) // 3 : len(raw) // 2] = b"\xff" * (len(raw) // 2 - len(raw) // 3)
    folder = two_files(tmp_path, bytes(raw))
    with store_logs(folder, rows=TINY, skip_bad=True) as log:
        assert [track.id for track in log.tracks] == ["v"]
        assert len(log.read_result.left_out) == 1
        assert log.read_result.points == 5


def test_nothing_to_read(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        store_logs(tmp_path / "none.csv", rows=TINY)
    with pytest.raises(InputError, match="no log given"):
        store_logs([], rows=TINY)
    folder = two_files(tmp_path, BAD["read"])
    (folder / "a.parquet").unlink()
    with pytest.raises(InputError, match=r"b\.parquet"):
        store_logs(folder, rows=TINY, skip_bad=True)


def test_temporary_files_are_removed_when_reading_fails(tmp_path, monkeypatch):
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    with pytest.raises(InputError):
        store_logs(two_files(tmp_path, BAD["time goes back"]), rows=TINY)
    assert list(folder.iterdir()) == []


def test_rows_are_counted_without_reading_them(tmp_path):
    folder = two_files(tmp_path, BAD["read"])
    assert count_rows(folder) == 5
    assert 200 < count_rows(csv(part(fleet(), slice(0, 500)), tmp_path / "log.csv")) < 2000


def test_other_formats_are_read_file_by_file(tmp_path):
    from gpszip.io.logs.write import write_tracks

    (track,) = gpszip.read(
        csv(
            {"t": np.arange(9), "lat": 48 + np.arange(9) / 1e4, "lon": np.full(9, 11.0)},
            tmp_path / "log.csv",
        )
    )
    write_tracks([track], tmp_path / "log.gpx")
    with store_logs(tmp_path / "log.gpx", rows=TINY) as log:
        assert [one.count for one in log.tracks] == [9]


def read_kept_columns(sources, keep, **options):
    """Columns of each track, read at once and in batches."""
    whole = {
        track.id: track.attributes for track in read_logs(sources, keep=keep, **options).tracks
    }
    with store_logs(sources, rows=TINY, keep=keep, **options) as log:
        columns = {column.name: column for column in log.columns}
        values = {name: np.concatenate(list(column.chunks())) for name, column in columns.items()}
        batches = {}
        for track in log.tracks:
            rows = slice(track.offset, track.offset + track.count)
            batches[track.id] = {
                name: np.array(columns[name].texts)[own[rows]]
                if columns[name].kind == "U"
                else own[rows]
                for name, own in values.items()
            }
        assert np.array_equal(
            np.concatenate(list(log.times())),
            np.concatenate([log.read(track).times for track in log.tracks]),
        )
    return whole, batches


def check_same_columns(whole, batches):
    assert whole.keys() == batches.keys()
    for name, columns in whole.items():
        for column, values in columns.items():
            found = batches[name][column]
            assert found.dtype.kind == values.dtype.kind
            assert np.array_equal(found, values, equal_nan=values.dtype.kind == "f")


def test_kept_columns_of_interleaved_tracks_in_files_of_any_order(tmp_path):
    rows = fleet()
    n = len(rows["t"])
    rng = np.random.default_rng(2)
    rows |= {
        "fuel": rng.normal(50, 9, n),
        "gear": rng.integers(-5, 1 << 60, n),
        "note": rng.choice(["", "stop", "é"], n),
    }
    for number, cut in enumerate((slice(n // 2, n), slice(0, n // 2))):
        pq.write_table(pa.table(part(rows, cut)), tmp_path / f"{number}.parquet")
    whole, batches = read_kept_columns(str(tmp_path), ("note", "gear", "fuel"))
    check_same_columns(whole, batches)


def test_a_column_of_several_kinds_gets_the_kind_that_read_logs_gives(tmp_path):
    """Integers in one file, missing values in the next, texts in the last; files not in order."""
    for number, values in enumerate(([1, 2, 3], [4, None, 6], ["7", "eight", ""])):
        times = [float(3 * number + i) for i in range(3)]
        table = {
            "t": times,
            "x": times,
            "y": times,
            "a": values,
            "b": values if number < 2 else [1, 2, 3],
        }
        pq.write_table(pa.table(table), tmp_path / f"{9 - number}.parquet")
    whole, batches = read_kept_columns(str(tmp_path), ("a", "b"), sort=True)
    check_same_columns(whole, batches)


@pytest.mark.parametrize(
    "late", ["7", "7.25", "seven", "", "true", "2024-05-01", "2024-05-01 10:00:00"]
)
@pytest.mark.parametrize("cell", ["3", "3.5", "", "False", "2024-05-01", "2024-05-01T10:00:00Z"])
def test_all_cells_of_a_column_decide_on_its_kind(tmp_path, late, cell):
    (tmp_path / "log.csv").write_text(
        "t,x,y,c\n"
        + "".join(f"{i},{i},0,{late if i == 79 else cell}\n" for i in range(80))
        + "1,2\n"
    )
    whole, batches = read_kept_columns(str(tmp_path / "log.csv"), ("c",))
    check_same_columns(whole, batches)
    values = whole["0"]["c"]
    if values.dtype.kind == "U":
        assert values.tolist() == [cell] * 79 + [late]


def test_too_many_distinct_texts_and_a_missing_column_are_named(tmp_path, monkeypatch):
    path = csv(
        {
            "t": range(3000),
            "x": range(3000),
            "y": range(3000),
            "c": [f"row {i}" for i in range(3000)],
        },
        tmp_path / "log.csv",
    )
    monkeypatch.setattr(store, "_TEXT_BYTES_PER_ROW", 5)
    with pytest.raises(InputError, match="'c' holds more distinct texts than there is memory for"):
        store_logs(path, rows=TINY, keep=("c",))
    with pytest.raises(InputError, match="no column 'd'"):
        store_logs(path, rows=TINY, keep=("d",))


def test_a_file_left_out_does_not_change_the_kind_of_a_column(tmp_path):
    good, bad = (
        {"t": [0.0, 1.0], "track_id": ["a", "a"], "x": [0, 1], "y": [0, 1], "c": values}
        for values in ([1, 2], ["x", "y"])
    )
    pq.write_table(pa.table(good), tmp_path / "a.parquet")
    pq.write_table(pa.table(bad | {"t": [1.0, 0.0]}), tmp_path / "b.parquet")
    whole, batches = read_kept_columns(str(tmp_path), ("c",), skip_bad=True)
    check_same_columns(whole, batches)
    assert whole["a"]["c"].dtype.kind == "i"


def walk_with_outliers(n=7000, seed=4):
    """A slow walk with single and double outliers, some at the borders of blocks of 1,000."""
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.choice([0.5, 1.0, 1.5], n))
    positions = np.cumsum(rng.normal(0, 1, (n, 2)), axis=0)
    outliers = np.unique(np.concatenate([rng.integers(5, n - 9, 40), [998, 999, 1999, 2001, 3000]]))
    positions[outliers] += 900
    positions[outliers[::3] + 1] += 900
    return times, positions


@pytest.mark.parametrize("degrees", [False, True])
def test_outliers_of_long_tracks_are_those_that_read_logs_drops(tmp_path, degrees):
    times, positions = walk_with_outliers()
    names, positions = (
        (("lat", "lon"), 48 + positions / 1e5) if degrees else (("x", "y"), positions)
    )
    rows = {
        "t": times,
        names[0]: positions[:, 0],
        names[1]: positions[:, 1],
        "row": np.arange(len(times)),
    }
    path = csv(rows, tmp_path / "log.csv")
    whole = read_logs(path, clean=True, keep=("row",))
    with store_logs(path, rows=TINY, clean=True, keep=("row",)) as log:
        found = log.read(log.tracks[0])
        kept = np.concatenate(list(log.columns[0].chunks()))
        assert log.plane == whole.tracks[0].plane
    assert 20 < len(times) - len(found) < 100
    assert np.array_equal(kept, whole.tracks[0].attributes["row"])
    assert np.array_equal(found.times, whole.tracks[0].times)
    assert np.abs(found.positions - whole.tracks[0].positions).max() < 1e-6
    assert [(one.what, one.count) for one in log.read_result.repairs] == [
        (one.what, one.count) for one in whole.repairs
    ]


def test_outliers_do_not_count_for_the_plane(tmp_path):
    lat, lon = np.full(3000, 48.0) + np.arange(3000) / 1e6, np.full(3000, 11.0)
    lat[1500], lon[1500] = 0.0, 0.0
    path = csv({"t": np.arange(3000), "lat": lat, "lon": lon}, tmp_path / "log.csv")
    with store_logs(path, rows=TINY, clean=True) as log:
        assert len(log.plane.centers) == 1
        assert log.sample_count == 2999
    with store_logs(path, rows=TINY) as log:
        assert len(log.plane.centers) == 2


def test_a_track_that_stands_still_has_no_outliers(tmp_path):
    path = csv(
        {"t": np.arange(2500), "x": np.zeros(2500), "y": np.zeros(2500)}, tmp_path / "log.csv"
    )
    with store_logs(path, rows=TINY, clean=True) as log:
        assert log.sample_count == 2500


@given(st.lists(st.floats(0, 1e300), min_size=1, max_size=60), st.floats(0, 1))
def test_quantiles_of_blocks_are_those_of_numpy(numbers, share):
    pieces = [np.array(numbers[a : a + 7]) for a in range(0, len(numbers), 7)]
    assert outliers._quantile(lambda: iter(pieces), share) == pytest.approx(
        float(np.quantile(numbers, share)), rel=1e-12
    )


def test_a_file_without_rows_says_so(tmp_path):
    pq.write_table(
        pa.table({"t": [0.0], "x": [0.0], "y": [0.0]}).slice(0, 0), tmp_path / "a.parquet"
    )
    with pytest.raises(InputError, match=r"a\.parquet: columns, but no rows"):
        store_logs(str(tmp_path), rows=TINY)


def test_all_dates_of_a_file_decide_on_the_order_of_day_and_month(tmp_path, monkeypatch):
    monkeypatch.setattr("gpszip.io.logs.csv.BLOCK", 4096)
    days = [f"{day:02d}/01/2024" for day in range(1, 32)]
    dates = [f"{day} {second // 60:02d}:{second % 60:02d}" for day in days for second in range(100)]
    path = csv({"t": dates, "x": np.arange(3100.0), "y": np.zeros(3100)}, tmp_path / "log.csv")
    assert check_same_as_read_logs(path) == 3100
    path = csv(
        {"t": dates[:1200], "x": np.arange(1200.0), "y": np.zeros(1200)}, tmp_path / "short.csv"
    )
    with pytest.raises(InputError, match="say which: --dates dmy or --dates mdy"):
        store_logs(path, rows=TINY)
    assert check_same_as_read_logs(path, dates="dmy") == 1200
    late = csv(
        {"t": [*dates[:2400], "01/31/2024"], "x": np.arange(2401.0), "y": np.zeros(2401)},
        tmp_path / "late.csv",
    )
    with pytest.raises(InputError, match="in different orders of day and month"):
        store_logs(late, rows=TINY)


@pytest.mark.parametrize("name", ["log.csv", "log.parquet"])
def test_a_table_without_times_holds_shapes(tmp_path, name):
    """Of each shape, some points repeat the one before, also where a batch or a block begins."""
    rng = np.random.default_rng(8)
    names = rng.choice(["a", "b", "c"], 9000, p=[0.8, 0.19, 0.01])
    steps = rng.integers(0, 3, (9000, 2)) / 1e4
    table = {
        "track_id": names,
        "lat": 48 + np.cumsum(steps[:, 0]) / 10,
        "lon": 11 + np.cumsum(steps[:, 1]) / 10,
        "note": np.arange(9000),
    }
    path = tmp_path / name
    if name == "log.csv":
        csv(table, path)
    else:
        pq.write_table(pa.table(table), path, row_group_size=700)
    with pytest.raises(InputError, match="--no-times"):
        store_logs(path, rows=TINY)
    whole = read_logs(path, times=False, keep=("note",))
    with store_logs(path, rows=TINY, times=False, keep=("note",)) as log:
        assert log.plane == whole.tracks[0].plane
        assert log.read_result.repairs == whole.repairs
        assert len(whole.repairs) == 2
        assert [(track.id, track.timed) for track in log.tracks] == [
            (track.id, False) for track in whole.tracks
        ]
        notes = np.concatenate(list(log.columns[0].chunks()))
        for track, expected in zip(log.tracks, whole.tracks, strict=True):
            found = log.read(track)
            assert (len(found), found.timed) == (len(expected), False)
            assert np.abs(found.positions - expected.positions).max() < 1e-6
            assert np.abs(found.times - expected.times).max() < 1e-3
            assert found.times[0] == 0
            own = notes[track.offset : track.offset + track.count]
            assert np.array_equal(own, expected.attributes["note"])


def test_repeated_points_are_dropped_where_blocks_are_projected_by_other_series(tmp_path):
    """Blocks of 10,000 rows end between two rows of one position."""
    steps = np.random.default_rng(9).normal(0, 1e-5, (7000, 2))
    steps[0] = 48.0, 11.0
    lat, lon = np.repeat(steps.cumsum(axis=0).round(7), 3, axis=0).T
    path = csv({"lat": lat, "lon": lon}, tmp_path / "log.csv")
    [expected] = read_logs(path, times=False).tracks
    with store_logs(path, rows=10_000, times=False) as log:
        found = log.read(log.tracks[0])
    assert (len(found), len(expected)) == (7000, 7000)
    assert np.abs(found.positions - expected.positions).max() < 1e-7


def test_a_block_of_outliers_alone_is_left_out(tmp_path, monkeypatch):
    monkeypatch.setattr(store, "_MIN_ROWS", 1)
    lat, lon = np.full(40, 48.0) + np.arange(40) / 1e6, np.full(40, 11.0)
    lat[20] = 49.0
    path = csv({"t": np.arange(40), "lat": lat, "lon": lon}, tmp_path / "log.csv")
    with store_logs(path, rows=1, clean=True) as log:
        assert log.sample_count == 39


def test_geojson_leaves_out_the_same_as_in_memory(tmp_path):
    geometry = '{"type":"LineString","coordinates":[[8,50],[8,51]]}'
    line = f'{{"type":"Feature","properties":{{"times":[0,1]}},"geometry":{geometry}}}'
    polygon = '{"type":"Feature","properties":{},"geometry":{"type":"Polygon","coordinates":[]}}'
    path = tmp_path / "log.json"
    path.write_text("\n".join([line, polygon, '{"a": 7}']))
    with pytest.raises(InputError, match="feature 3: is neither a feature nor a geometry"):
        store_logs(path, rows=1000)
    with store_logs(path, rows=1000, skip_bad=True) as log:
        assert log.read_result.left_out == read_logs(path, skip_bad=True).left_out
        assert [left.name for left in log.read_result.left_out] == [
            f"{path}: 1 Polygon",
            f"{path}: feature 3",
        ]
    path.write_text("t,x,y\n0,0,0\n")
    with pytest.raises(InputError, match="damaged JSON file"):
        store_logs(path, rows=1000, format="geojson")
