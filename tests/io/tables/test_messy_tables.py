"""Messy tables are read correctly, cleaned with a report, or refused; in memory and in batches."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError, UnknownFormatError
from gpszip.geo.planes import to_geographic
from gpszip.io.large.store import store_logs
from gpszip.io.logs.read import read_logs
from random_tests import examples


class Log:
    """A log read in memory or in batches."""

    def __init__(self, result, tracks):
        self.tracks = {track.id: track for track in tracks}
        self.repairs = {repair.what: repair for repair in result.repairs}
        self.lost = result.lost
        self.points = result.points

    @property
    def positions(self):
        (track,) = self.tracks.values()
        if track.plane is None:
            return track.positions
        return np.stack(to_geographic(track.positions, track.plane), axis=1)


def in_memory(path, **options):
    result = read_logs(path, **options)
    return Log(result, result.tracks)


def in_batches(path, **options):
    with store_logs(path, rows=1000, **options) as log:
        return Log(log.read_result, [log.read(track) for track in log.tracks])


@pytest.fixture(params=[in_memory, in_batches], ids=["in memory", "in batches"])
def read(request, tmp_path):
    def read_content(content, **options):
        path = tmp_path / "log"
        if isinstance(content, dict):
            pq.write_table(pa.table(content), path)
        else:
            path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return request.param(path, **options)

    return read_content


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("time,LATITUDE,N/S,LONGITUDE,E/W\n0,33.8561,S,70.2152,W\n", (-33.8561, -70.2152)),
        ("t,lat,lat_dir,lon,lon_dir\n0,33.8561,s,-70.2152,west\n", (-33.8561, -70.2152)),
        (
            "t,GPSLatitude,GPSLatitudeRef,GPSLongitude,GPSLongitudeRef\n"
            "0,33.8561,South,70.2152,East\n",
            (-33.8561, 70.2152),
        ),
        ("t,lat,a,lon,b\n0,33.8561,S,70.2152,W\n", (-33.8561, -70.2152)),
        ("t,lat,lon,a,b\n0,33.8561,70.2152,S,W\n", (-33.8561, -70.2152)),
        ("t,lat,ns,lon,ew\n0,4808.225,N,00007.500,W\n", (48 + 8.225 / 60, -0.125)),
        ("t,LATITUDE N/S,LONGITUDE E/W\n0,33.8561S,70.2152W\n", (-33.8561, -70.2152)),
        ('t,lat,lon\n0,48°08\'13.5"N,"11°34\'30""E"\n', (48.13708333, 11.575)),
        ('t,lat,lon\n0,"48,1371","11,575"\n', (48.1371, 11.575)),
        ("t;lat;lon\n0;48,1371;11,575\n", (48.1371, 11.575)),
        ("sep=;\r\nt;lat;lon\r\n0;48,1371;11,575\r\n", (48.1371, 11.575)),
        ("\ufefft,lat,lon,\n0,48.1371,11.575\n", (48.1371, 11.575)),
        ("t,lat,lon\n0,48.1371,11.575,\n", (48.1371, 11.575)),
        ("Log of a device\nMunich, 2024\n\nt,lat,lon\n0,48.1371,11.575\n", (48.1371, 11.575)),
    ],
)
def test_notations_of_coordinates(read, text, expected):
    log = read(text)
    np.testing.assert_allclose(log.positions, [expected], atol=2e-7)
    assert not log.repairs


@pytest.mark.parametrize(
    "time",
    [
        "tracked_at",
        "timestamp_epoch",
        "epoch_ms",
        "gpsTime",
        "time_stamp_utc",
        "BaseDateTime",
        "fixTime",
        "tst",
    ],
)
@pytest.mark.parametrize(
    ("lat", "lon"),
    [("locationLatitude(WGS84)", "locationLongitude(WGS84)"), ("position_lat", "position_long")],
)
def test_common_column_names(read, time, lat, lon):
    assert read(f"{lon},{lat},{time}\n11,48,0\n").points == 1


@pytest.mark.parametrize(
    ("text", "row", "value"),
    [
        ("t,lat,lon\n0,48.1,11\n1,undefined,11\n2,,11\n3,48.2,11\n", 3, "lat 'undefined'"),
        ("t,lat,lon\n0,48.1,11\n1,,11\n2,48.2,x\n3,48.2,11\n", 4, "lon 'x'"),
        ("t;lat;lon\n0;48,1;11\n1;48.1;11\n2;48.2;11\n", 2, "lat '48,1'"),
        ("t,lat,N/S,lon,E/W\n0,48.1,N,11,E\n1,48.1,E,11,E\n2,48.1,N,11,E\n", 3, "N/S 'E'"),
        ("t,lat,N/S,lon,E/W\n0,48.1,N,11,E\n1,-48.1,N,11,E\n2,48.1,N,11,E\n", 3, "N/S 'N'"),
        ("t,x,y\n0,1,1\n1,0x10,1\n2,1_0,1\n3,1,2\n", 3, "x '0x10'"),
        ("t,x,y\n0,1,1\n1," + "9" * 400 + "e,1\n3,1,2\n", 3, "x '" + "9" * 40 + "...'"),
    ],
)
def test_unreadable_cells_are_dropped_counted_and_named(read, text, row, value):
    log = read(text)
    repair = log.repairs["rows without a position dropped"]
    assert repair.where.endswith(f"row {row}")
    assert repair.value == value
    assert repair.count == log.lost == log.points - len(log.positions)


def test_row_of_units_is_dropped_and_named(read):
    log = read("t,lat,lon\ns,deg,deg\n1,48,11\n2,48.1,11\n")
    assert log.repairs["rows without a time dropped"].value == "t 's'"
    assert len(log.positions) == 2


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("t,lat,lat,lon\n0,1,2,3\n", "columns 2 and 3 are both named 'lat'"),
        ("t,lat,a,lon,b\n0,33,S,70,q\n", "column 'a' holds only N or S"),
        ("t,lat,ns,lon,ew\n0,33,1,70,2\n", "ns '1'"),
        ("t,lat,lon\n0,undefined,70\n", "lat 'undefined'"),
        (
            "t,lat,lon,speed,course\n0,48,11,5\n1,48,11,5\n",
            "header has 5 cells, but its rows have 4",
        ),
        ("t;x;y\n0;1,234;2,345\n", "'1,234' may have decimals or thousands"),
        ("t,lat,lon\n0,4808.225,01134.5\n", "not degrees"),
        ('t,x,y,note\n0,1,2,"lost\n1,2,3,a\n2,3,4,b\n', "row 2: a quote is not closed"),
        (
            't,x,y,note\n0,1,2,"lost\n1,2,3,a\n2,3,4,"found" b\n3,3,4,c\n',
            "row 2: a quote is not closed",
        ),
        ("t,x,y," + "c," * (1 << 18) + "\n0,1,2\n", "first line is longer than 256 KiB"),
        ("id,t,x,y\na\0b,0,0,0\n", "neither text"),
    ],
)
def test_ambiguous_tables_are_refused_in_one_line(read, text, says):
    with pytest.raises((InputError, UnknownFormatError)) as caught:
        read(text)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_columns_by_position_override_names_and_hemispheres(read):
    assert read("t,lat,lat,lon\n0,1,2,3\n", columns="t,-,lat,lon").positions[0].round(
        6
    ).tolist() == [
        2,
        3,
    ]
    assert read("t,lat,a,lon,b\n0,33,S,70,q\n", columns="t,lat,-,lon").positions[0].round(
        6
    ).tolist() == [33, 70]


def test_names_of_rows_are_no_track_ids(read):
    rows = "".join(f"u{i},{i},{48 + i * 1e-5:.5f},11\n" for i in range(40))
    log = read("uuid,t,lat,lon\n" + rows)
    assert len(log.positions) == 40
    (repair,) = log.repairs.values()
    assert repair.what == (
        "rows named one by one in column 'uuid', which is no track id; "
        "--columns id=uuid makes it one"
    )
    assert not repair.drops
    assert len(read("uuid,t,lat,lon\n" + rows, columns="id=uuid").tracks) == 40
    assert len(read("uuid,t,lat,lon\n" + rows, columns="id,t,lat,lon").tracks) == 40


@pytest.mark.parametrize(
    ("row", "tracks"),
    [
        ("{i},5,{i},11", 40),  # all at one time
        ("{i},{i},{i},11", 40),  # faster than any aircraft
        ("{i},-{i},0,11", 40),  # times decrease
        ("{half},{i},0,11", 20),  # two rows of each
    ],
)
def test_a_list_of_many_vehicles_keeps_their_names(read, row, tracks):
    rows = [row.format(i=i, half=i % 20) for i in range(40)]
    assert len(read("\n".join(["mmsi,t,lat,lon", *rows])).tracks) == tracks


def test_batches_agree_on_names_of_tracks(read):
    """All names differ in the last batch, as if they named rows."""
    rows = [f"bus {i % 7},{i},{i},0,{'x' * 90}\n" for i in range(42_000)]
    rows += [f"late {i},{50_000 + i},{i},0,\n" for i in range(5)]
    log = read("name,t,x,y,note\n" + "".join(rows))
    assert len(log.tracks) == 12
    assert not log.repairs


@pytest.mark.parametrize(
    ("bad", "count", "value"),
    [("-9999,-9999", 1, "lat -9999"), ("100,11", 3, "lat 100"), ("48,999", 5, "lon 999")],
)
def test_few_positions_off_the_globe_are_dropped_counted_and_named(read, bad, count, value):
    good = 3 if count <= 3 else 95
    text = "t,lat,lon\n" + "".join(
        f"{i},{bad if 0 < i <= count else '48.1,11'}\n" for i in range(good + count)
    )
    repair = read(text).repairs["rows off the globe dropped"]
    assert (repair.count, repair.value, repair.where[-6:]) == (count, value, " row 3")


def test_many_positions_off_the_globe_are_refused_without_skip_bad(read):
    text = "t,lat,lon\n" + "".join(f"{i},{'-9999' if i % 3 else '48'},11\n" for i in range(30))
    with pytest.raises(
        InputError, match=r"row 3: latitude -9999, longitude 11: not degrees \(20 of 30 such\)"
    ):
        read(text)
    assert len(read(text, skip_bad=True).positions) == 10
    with pytest.raises(InputError, match="not degrees"):
        read("t,lat,lon\n0,5000,12\n", skip_bad=True)


def test_swapped_coordinates_are_found_by_few_positions_off_the_globe(read):
    rows = "".join(f"{i},{89.5 + i * 0.005},22\n" for i in range(103))
    with pytest.raises(InputError, match="look swapped"):
        read("t,lat,lon\n" + rows)


def test_positions_at_zero_are_reported_and_dropped_by_clean(read):
    text = "t,lat,lon\n0,0,0\n" + "".join(f"{i},{48 + i * 1e-5:.5f},11\n" for i in range(1, 30))
    kept, cleaned = read(text), read(text, clean=True)
    ((what, repair),) = kept.repairs.items()
    assert "0,0 kept" in what
    assert "--clean" in what
    assert (repair.count, repair.drops, kept.lost) == (1, False, 0)
    assert (cleaned.repairs["rows at 0,0 dropped"].count, cleaned.lost) == (1, 1)
    assert not read("t,lat,lon\n0,0,0\n1,0.0001,0\n").repairs


@pytest.mark.parametrize("size", [200_000, 3_000_000])
def test_cells_of_any_length(read, size):
    log = read(f't,x,y,note\n0,1,2,"{"a" * size}"\n1,2,3,"{"b," * 70_000}"\n')
    assert log.positions.tolist() == [[1, 2], [2, 3]]
    log = read(f"t,x,y\n0,1,0.{'3' * size}\n1,{'7' * size},1\n")
    assert log.positions.tolist() == [[1, 1 / 3]]
    assert log.lost == 1


def test_line_ends_may_be_mixed_and_lines_empty(read):
    assert len(read(b"t,x,y\r\n0,0,0\n1,1,1\r2,2,2\r\n\r\n\n3,3,3").positions) == 4


def test_late_letters_that_are_not_utf_8(read):
    log = read(
        b"id,t,x,y\n" + b"".join(b"a,%d,0,0\n" % i for i in range(40_000)) + b"\xe9\0\x01,1,0,0\n"
    )
    assert list(log.tracks) == ["a", "\xe9\0\x01"]


@examples(25)
@given(
    names=st.lists(
        st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=12),
        min_size=1,
        max_size=4,
        unique=True,
    )
)
def test_names_are_kept_verbatim(names, tmp_path_factory):
    path = tmp_path_factory.mktemp("names") / "log"
    names = [*names, "../../etc/passwd", "<script>", "a\nb\r\n", "\x1b[31m", "x" * 200]
    cells = ['"' + name.replace('"', '""') + '"' for name in names]
    path.write_bytes(
        (
            "t,track_id,x,y\n" + "".join(f"{t},{cell},0,0\n" for t in range(3) for cell in cells)
        ).encode()
    )
    assert (
        list(in_memory(path).tracks) == list(in_batches(path).tracks) == list(dict.fromkeys(names))
    )


@pytest.mark.parametrize(
    "lat",
    [
        pa.array(["48.5", "49"]),
        pa.array(["48,5", "49"]),
        pa.array([b"48.5", b"49"]),
        pa.array(["48.5N", "49"]).dictionary_encode(),
        pa.array([48.5, 49.0]).dictionary_encode(),
        pa.array(["48.5", "49"]).cast(pa.decimal128(9, 4)),
        pa.array(["48.5", "49"]).cast(pa.decimal256(40, 4)),
        pa.array(np.array([48.5, 49], np.float16)),
    ],
)
def test_parquet_columns_of_numeric_types(read, lat):
    assert read({"t": [0, 1], "lat": lat, "lon": [11, 11]}).positions[:, 0].round(6).tolist() == [
        48.5,
        49,
    ]


@pytest.mark.parametrize(
    ("columns", "says"),
    [
        ({"lat": [[48.5], [49]]}, "column 'lat' holds list"),
        ({"lat": [{"a": 1}, {"a": 2}]}, "column 'lat' holds struct"),
        ({"lat": [b"\xff", b"1"]}, "column 'lat' holds bytes that are no text"),
        ({"lat": [True, False]}, "column 'lat' holds bool"),
        ({"lat": pa.array([0, 1], pa.date32())}, "column 'lat' holds date32"),
        ({"lat": pa.nulls(2)}, "log: "),
        ({"t": pa.nulls(2)}, "that can be read"),
        ({"track_id": [[1], [2]]}, "column 'track_id' holds list"),
        ({"track_id": [b"\xff", b"\xfe"]}, "column 'track_id' holds binary"),
    ],
)
def test_parquet_columns_of_other_types_are_refused(read, columns, says):
    with pytest.raises(InputError) as caught:
        read({"t": [0, 1], "lat": [48, 49], "lon": [11, 11]} | columns)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_parquet_columns_of_one_name_are_refused(tmp_path):
    path = tmp_path / "log"
    arrays = [pa.array([0, 1]), pa.array([1.0, 2.0]), pa.array([1.0, 2.0]), pa.array([1.0, 2.0])]
    pq.write_table(pa.table(arrays, names=["t", "lat", "lat", "lon"]), path)
    for read_file in (in_memory, in_batches):
        with pytest.raises(InputError, match="2 columns are named 'lat'"):
            read_file(path)


@examples(40)
@given(data=st.data())
def test_damaged_parquet_is_read_or_refused(data, tmp_path_factory):
    path = tmp_path_factory.mktemp("damaged") / "log"
    pq.write_table(
        pa.table({"t": np.arange(50), "lat": np.arange(50) / 2, "lon": ["11"] * 50}), path
    )
    raw = bytearray(path.read_bytes())
    damage = data.draw(st.integers(4, len(raw) - 1))
    raw[damage : damage + 4] = data.draw(st.binary(min_size=4, max_size=4))
    path.write_bytes(bytes(raw[: data.draw(st.sampled_from([len(raw), damage + 5]))]))
    for read_file in (in_memory, in_batches):
        try:
            read_file(path)
        except InputError as error:
            assert "\n" not in str(error)


def test_placeholders_for_missing_values_are_named(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(
        "t,lat,lon\n" + "".join(f"{i},{'n/a' if i == 7 else 48 + i / 1e4},11\n" for i in range(40))
    )
    (repair,) = read_logs(path).repairs
    assert (repair.what, repair.count, repair.value) == (
        "rows without a position dropped",
        1,
        "lat 'n/a'",
    )


def test_table_without_times_is_a_shape_on_request(tmp_path):
    path = tmp_path / "route.csv"
    path.write_text(
        "name,lat,lon\n" + "".join(f"{'ab'[i // 5]},{48 + i / 1e3},11\n" for i in range(10))
    )
    with pytest.raises(InputError, match=r"no time;.*or keep the shape alone: --no-times"):
        read_logs(path)
    tracks = read_logs(path, times=False).tracks
    assert [(track.id, track.timed, len(track)) for track in tracks] == [
        ("a", False, 5),
        ("b", False, 5),
    ]
    assert tracks[0].times[-1] == pytest.approx(4 * 111.2, rel=1e-3)
