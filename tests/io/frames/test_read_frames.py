"""Reading tables in memory: Arrow, NumPy and dicts give what the same table gives as a file."""

import io
import json
import struct
import warnings
from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gpszip
from gpszip.errors import InputError, OptionError
from gpszip.io.frames.source import frame_sources
from gpszip.io.large.store import store_logs
from gpszip.io.networks.wkb import parse_wkb_points

TIMES = 1_700_000_000.0 + 5 * np.arange(6)
LAT, LON = 48 + np.arange(6) / 1000, 11 + np.arange(6) / 500
IDS = ["bus", "bus", "bus", "tram", "tram", "tram"]


def columns(**others):
    return {"track_id": IDS, "t": TIMES, "lat": LAT, "lon": LON, **others}


def tracks_of(result):
    return [
        (track.id, track.timed, track.times.tolist(), track.positions.tolist()) for track in result
    ]


def as_csv(values):
    lines = [",".join(values)]
    lines += [",".join(map(str, row)) for row in zip(*values.values(), strict=True)]
    return io.BytesIO("\n".join(lines).encode())


def structured(values):
    return np.rec.fromarrays([np.asarray(cells) for cells in values.values()], names=list(values))


def batches(values):
    table = pa.table(values)
    return pa.RecordBatchReader.from_batches(table.schema, table.to_batches(max_chunksize=2))


FRAMES = {
    "dict": dict,
    "dict of arrays": lambda values: {name: pa.array(cells) for name, cells in values.items()},
    "structured array": structured,
    "table": pa.table,
    "stream": batches,
    "batch": lambda values: pa.RecordBatch.from_pydict(dict(values)),
}


@pytest.mark.parametrize("kind", FRAMES)
def test_a_frame_is_read_as_the_same_table_in_a_file(kind):
    expected = gpszip.read(as_csv(columns(speed=TIMES)))
    result = gpszip.read(FRAMES[kind](columns(speed=TIMES)))
    assert tracks_of(result) == tracks_of(expected)
    assert (result.points, result.lost, result.dropped_columns) == (6, 0, ("speed",))


numbers = st.one_of(
    st.none(), st.floats(-80, 80, allow_nan=False).map(lambda value: round(value, 5) + 0.0)
)


@given(st.lists(st.tuples(st.integers(0, 400), numbers, numbers), min_size=3, max_size=12))
def test_missing_and_repeated_rows_are_counted_as_in_a_file(rows):
    t, x, y = (list(cells) for cells in zip(*rows, strict=True))
    table = {"t": pa.array(t), "x": pa.array(x, pa.float64()), "y": pa.array(y, pa.float64())}
    text = [["" if cell is None else repr(cell) for cell in cells] for cells in (t, x, y)]
    outcomes = []
    for source in (as_csv(dict(zip("txy", text, strict=True))), pa.table(table)):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", gpszip.LossWarning)
                result = gpszip.read(source, sort=True)
            repairs = [(repair.what, repair.count) for repair in result.repairs]
            outcomes.append((tracks_of(result), result.points, repairs))
        except InputError as error:
            outcomes.append(error.reason.replace(" 'null'", ""))
    assert outcomes[0] == outcomes[1]


def test_nulls_are_dropped_counted_and_named_by_their_row():
    table = pa.table(columns() | {"lat": pa.array([*LAT[:2], None, *LAT[3:]])})
    with pytest.warns(gpszip.LossWarning):
        result = gpszip.read(table)
    (repair,) = result.repairs
    assert (repair.count, repair.where) == (1, "Table: row 2")
    assert result.points == result.kept + 1


SECONDS = (TIMES - TIMES[0]).astype(int)


@pytest.mark.parametrize(
    "times",
    [
        pa.array((TIMES * 1000).astype(int), pa.timestamp("ms")),
        pa.array((TIMES * 1e6).astype(int), pa.timestamp("us", "Europe/Berlin")),
        (TIMES * 1e9).astype("M8[ns]"),
        TIMES.astype("M8[s]"),
        [datetime.fromtimestamp(t, UTC) for t in TIMES],
        [datetime.fromtimestamp(t, timezone(timedelta(hours=5))) for t in TIMES],
        [datetime.fromtimestamp(t, UTC).isoformat() for t in TIMES],
        TIMES.astype(">f8"),
        np.ma.masked_array(TIMES, np.zeros(6, bool)),
        pa.array([datetime.fromtimestamp(t, UTC).isoformat() for t in TIMES]).dictionary_encode(),
    ],
    ids=lambda times: str(getattr(times, "type", getattr(times, "dtype", type(times[0])))),
)
def test_times_of_all_types(times):
    assert gpszip.read(columns(t=times))[0].times.tolist() == TIMES[:3].tolist()


def test_durations_count_from_the_start_of_the_log():
    durations = (SECONDS * 1000).astype("m8[ms]")
    assert gpszip.read(columns(t=durations))[1].times.tolist() == [15.0, 20.0, 25.0]


def test_times_of_whole_minutes_are_read():
    minutes = np.datetime64("2024-05-01T10:00", "m") + np.arange(6)
    assert gpszip.read(columns(t=minutes))[0].times.tolist() == [
        1714557600 + 60 * i for i in (0, 1, 2)
    ]


def test_units_columns_and_attributes_are_chosen_as_for_files():
    frame = {"when": SECONDS, "north": LON, "east": LAT, "speed": pa.array(SECONDS, pa.int16())}
    named = gpszip.read(frame, columns="t=when,x=east,y=north", time_unit="ms", keep="speed")
    assert named[0].times.tolist() == (SECONDS / 1000).tolist()
    assert named[0].coordinates.tolist() == np.stack([LAT, LON], axis=1).tolist()
    assert named[0].attributes["speed"].tolist() == SECONDS.tolist()
    by_position = gpszip.read(frame, columns=("t", "y", "x", "-"))
    assert by_position[0].coordinates.tolist() == named[0].coordinates.tolist()


def test_ids_may_be_numbers_or_categories():
    categories = pa.chunked_array(
        [pa.array(IDS[:2]).dictionary_encode(), pa.array(IDS[2:]).dictionary_encode()]
    )
    assert [track.id for track in gpszip.read(columns(track_id=categories))] == ["bus", "tram"]
    numbers = columns(track_id=[7, 7, 7, 9, 9, 9])
    assert [track.id for track in gpszip.read(numbers)] == ["7", "9"]


def test_a_column_that_has_no_role_may_hold_anything():
    assert len(gpszip.read(columns(note=["a", 1, None, 2.5, (), {}]))) == 2


def test_several_frames_are_one_log():
    plain = {name: cells for name, cells in columns().items() if name != "track_id"}
    result = gpszip.read([plain, plain])
    assert [track.id for track in result] == ["dict-1", "dict-2"]


@pytest.mark.parametrize(
    ("frame", "message"),
    [
        ({}, "dict: holds no column"),
        ({"t": [], "x": [], "y": []}, "dict: columns, but no rows"),
        ({"t": [0], "x": [0, 1], "y": [0]}, "differ in length: 't' 1, 'x' 2, 'y' 1"),
        ({"t": 5, "x": [0], "y": [0]}, "column 't' is a int, not an array"),
        ({"t": [0, 1], "x": [0, "a"], "y": [0, 1]}, "dict: column 'x': can't be read"),
        ({"t": [0, 1], "x": np.zeros((2, 2)), "y": [0, 1]}, "column 'x' has 2 axes, not 1"),
        ({"t": [0, 1], "speed": [0, 1]}, "no position; columns found: t, speed"),
        ({"x": [0, 1], "y": [0, 1]}, "no time; columns found: x, y"),
        ({"t": [0, 1], "x": [[0], [1]], "y": [0, 1]}, "column 'x' holds list"),
        (pa.table([[0], [1], [2]], ["t", "x", "x"]), "2 columns are named 'x'"),
        (pa.chunked_array([[1.0]]), "is one column, not a table"),
        (np.zeros((2, 2), [("t", float), ("x", float), ("y", float)]), "has 2 axes, not 1"),
    ],
)
def test_what_is_no_log_is_refused_with_a_reason(frame, message):
    with pytest.raises(InputError) as raised:
        gpszip.read(frame)
    assert message in str(raised.value)


def test_an_error_of_a_stream_is_an_input_error():
    def failing():
        yield pa.record_batch({"t": [0.0], "x": [0.0], "y": [0.0]})
        raise RuntimeError("the query was cancelled")

    schema = pa.schema([(name, pa.float64()) for name in "txy"])
    with pytest.raises(InputError, match="the query was cancelled"):
        gpszip.read(pa.RecordBatchReader.from_batches(schema, failing()))


def test_a_damaged_table_is_refused():
    # The second text ends before it begins.
    offsets, text = pa.py_buffer(np.array([0, 2, 1], np.int32)), pa.py_buffer(b"ab")
    names = pa.StringArray.from_buffers(2, offsets, text)
    table = pa.table({"track_id": names, "t": [0, 1], "x": [0, 1], "y": [0, 1]})
    with pytest.raises(InputError, match="Table: can't be read"):
        gpszip.read(table)


def test_tracks_and_frames_are_not_mixed():
    track = gpszip.Track("a", [0, 1], [[0, 0], [1, 0]])
    with pytest.raises(OptionError, match="tracks and logs"):
        gpszip.compress([track, columns()], rmse=1.0)


def test_a_frame_is_compressed_as_its_tracks():
    archive = gpszip.compress(pa.table(columns()), rmse=5.0, effort=1)
    assert (
        archive.to_bytes() == gpszip.compress(gpszip.read(columns()), rmse=5.0, effort=1).to_bytes()
    )
    # Times and coordinates of eight bytes, as for tracks.
    assert gpszip.read(pa.table(columns())).bytes == 6 * 3 * 8


# Larger than memory


def test_a_stream_is_sorted_on_disk_batch_by_batch():
    shuffled = np.random.default_rng(1).permutation(6)
    mixed = {name: np.asarray(cells)[shuffled] for name, cells in columns().items()}
    (source,) = frame_sources([batches(mixed)])
    with pytest.raises(InputError, match="time goes back"):
        gpszip.read(pa.table(mixed))
    archive = gpszip.compress(batches(columns()), rmse=5.0, effort=1, memory=2**30)
    assert archive.to_bytes() == gpszip.compress(columns(), rmse=5.0, effort=1).to_bytes()
    assert source.name == "RecordBatchReader"


@pytest.mark.parametrize("kind", ["stream", "table", "dict"])
def test_rows_on_disk_are_those_in_memory(kind, tmp_path):
    # Dictionaries that differ from batch to batch, and dates whose order only the last row shows.
    dates = [f"0{day}/0{month}/2024 10:00" for day, month in ((3, 4), (4, 4), (5, 4))]
    dates += ["13/04/2024 10:00", "14/04/2024 10:00", "15/04/2024 10:00"]
    values = columns(t=dates)
    (source,) = frame_sources([FRAMES[kind](values)])
    stored = source.stored_at(tmp_path / "stream")
    with store_logs([stored], rows=1000, sort=True) as log:
        tracks = [(track.id, log.read(track).times.tolist()) for track in log.tracks]
        assert log.read_result.points == 6
    assert tracks == [(t.id, t.times.tolist()) for t in gpszip.read(values)]


# Geometries


def wkb(point, *, order="<", z=False, srid=None, iso=True):
    kind = 1 + (1000 if z and iso else 0) + (0x80000000 if z and not iso else 0)
    kind += 0x20000000 if srid is not None else 0
    head = struct.pack(f"{order}BI", order == "<", kind)
    head += b"" if srid is None else struct.pack(f"{order}I", srid)
    return head + struct.pack(f"{order}{len(point)}d", *point)


coordinate = st.floats(-1e6, 1e6, allow_nan=False)


@st.composite
def encoded_points(draw):
    point = draw(st.none() | st.tuples(coordinate, coordinate) | st.tuples(*3 * [coordinate]))
    if point is None:
        return None, None
    options = draw(
        st.fixed_dictionaries(
            {
                "order": st.sampled_from("<>"),
                "srid": st.sampled_from([None, 4326]),
                "iso": st.booleans(),
            }
        )
    )
    return point, wkb(point, z=len(point) == 3, **options)


@given(st.lists(encoded_points()))
def test_points_in_well_known_binary_are_parsed(cells):
    binary = pa.array([None, *(data for _, data in cells)], pa.binary())[1:]
    parsed = parse_wkb_points(binary)
    for (point, _), row, kind in zip(cells, parsed.points, parsed.types, strict=True):
        expected = [] if point is None else list(point)
        assert np.array_equal(row, [*expected, *[np.nan] * (3 - len(expected))], equal_nan=True)
        assert kind == (point is not None)


@given(encoded_points(), st.integers(0, 30))
def test_damaged_points_are_known(cell, length):
    point, data = cell
    cut = (data or b"")[:length]
    parsed = parse_wkb_points(pa.array([cut]))
    is_whole = point is not None and len(cut) == len(data)
    assert parsed.types[0] == (1 if is_whole else 0 if not cut else -1)


def with_geometry(cells, encoding="geoarrow.wkb", crs="EPSG:4326", kind=None):
    metadata = {
        "ARROW:extension:name": encoding,
        "ARROW:extension:metadata": json.dumps({"crs": crs}),
    }
    array = pa.array(cells, kind or pa.binary())
    field = pa.field("where", array.type, metadata=metadata)
    table = pa.table({"track_id": IDS[: len(cells)], "t": TIMES[: len(cells)]})
    return table.append_column(field, array)


POINTS = [wkb(point) for point in zip(LON, LAT, strict=True)]
NATIVE = [
    pa.struct([("x", pa.float64()), ("y", pa.float64())]),
    pa.list_(pa.float64(), 2),
]


@pytest.mark.parametrize(
    "frame",
    [
        with_geometry(POINTS),
        with_geometry(POINTS, kind=pa.large_binary()),
        with_geometry(
            [{"x": x, "y": y} for x, y in zip(LON, LAT, strict=True)],
            "geoarrow.point",
            kind=NATIVE[0],
        ),
        with_geometry(
            [[x, y] for x, y in zip(LON, LAT, strict=True)], "geoarrow.point", kind=NATIVE[1]
        ),
    ],
    ids=["wkb", "large wkb", "structures", "lists"],
)
def test_points_of_geoarrow_are_positions(frame):
    result = gpszip.read(frame)
    assert tracks_of(result) == tracks_of(gpszip.read(columns()))
    assert result.dropped_columns == ()


def test_points_of_a_projected_system_are_converted_to_degrees():
    utm = [wkb((500_000.0, 5_000_000.0 + 10 * i)) for i in range(6)]
    track = gpszip.read(with_geometry(utm, crs="EPSG:32632"))[0]
    assert track.coordinates[:, 1].round(9).tolist() == [9.0] * 3
    assert track.coordinates[0, 0] == pytest.approx(45.1534, abs=1e-4)


def test_points_of_a_local_system_are_metres_with_their_heights():
    cells = [wkb((i, 2.0, 3.0), z=True) for i in range(6)]
    crs = 'LOCAL_CS["hall",UNIT["metre",1]]'
    assert gpszip.read(with_geometry(cells, crs=crs))[0].coordinates.tolist() == [
        [0, 2, 3],
        [1, 2, 3],
        [2, 2, 3],
    ]


def test_points_without_a_system_are_refused_unless_they_can_only_be_metres():
    with pytest.raises(InputError, match="column 'where': names no coordinate system"):
        gpszip.read(with_geometry(POINTS, crs=None))
    far = [wkb((4e6 + i, 5e6)) for i in range(6)]
    assert gpszip.read(with_geometry(far, crs=None))[0].coordinates[1].tolist() == [4e6 + 1, 5e6]


def test_named_columns_come_before_a_geometry():
    frame = (
        with_geometry(POINTS)
        .append_column("e", pa.array(SECONDS))
        .append_column("n", pa.array(SECONDS))
    )
    track = gpszip.read(frame, columns="x=e,y=n")[0]
    assert track.plane is None
    assert track.coordinates[1].tolist() == [5.0, 5.0]


def test_a_plain_column_of_binary_is_a_geometry_where_no_other_has_positions():
    utm = [wkb((500_000.0 + 1e3 * i, 5e6)) for i in range(6)]
    frame = {"t": TIMES, "geom": utm}
    with pytest.raises(InputError, match="no position"):
        gpszip.read({"t": TIMES, "shape": utm})
    assert gpszip.read(pa.table(frame))[0].coordinates[1].tolist() == [501_000.0, 5e6]
    assert gpszip.read(pa.table({**columns(), "geom": utm})).geographic


def test_geoparquet_without_a_system_is_in_degrees():
    table = with_geometry(POINTS).replace_schema_metadata(
        {"geo": json.dumps({"primary_column": "where", "columns": {"where": {"encoding": "WKB"}}})}
    )
    plain = table.cast(
        pa.schema([field.remove_metadata() for field in table.schema], table.schema.metadata)
    )
    assert tracks_of(gpszip.read(plain)) == tracks_of(gpszip.read(columns()))


def test_metadata_that_names_no_column_as_primary_is_left():
    geo = {"primary_column": ["where"], "columns": {"where": {"encoding": "WKB"}}}
    table = with_geometry(POINTS).replace_schema_metadata({"geo": json.dumps(geo)})
    assert tracks_of(gpszip.read(table)) == tracks_of(gpszip.read(columns()))


def line(*points, kind=2):
    flat = np.array(points, "<f8")
    return struct.pack("<BII", 1, kind, len(points)) + flat.tobytes()


def test_lines_are_shapes_named_by_their_rows():
    first, second = ((11, 48), (11.1, 48)), ((11, 48.5), (11.1, 48.5), (11.2, 48.5))
    both = struct.pack("<BII", 1, 5, 2) + line(*first) + line(*second)
    frame = with_geometry([line(*first), both, line(*second), None, line(*first), line(*first)])
    result = gpszip.read(frame)
    assert [track.id for track in result] == ["bus", "bus-2", "bus-3", "bus-4", "tram", "tram-2"]
    assert not any(track.timed for track in result)
    assert result[3].coordinates.round(9).tolist() == [[48.5, 11.0], [48.5, 11.1], [48.5, 11.2]]
    assert [(repair.what, repair.count) for repair in result.repairs] == [
        ("rows without a line dropped", 1)
    ]
    assert "t" in result.dropped_columns


@pytest.mark.parametrize("kind", ["points", "lines"])
def test_geometries_of_a_stream_stay_of_one_kind(tmp_path, kind):
    far = [line((1, 2), (3, 4)) for _ in range(6)]
    table = with_geometry(POINTS if kind == "points" else far)
    both = [*table.to_batches(), *with_geometry(far if kind == "points" else POINTS).to_batches()]
    (source,) = frame_sources([pa.RecordBatchReader.from_batches(table.schema, both)])
    with (
        pytest.raises(InputError, match="column 'where'"),
        store_logs([source.stored_at(tmp_path / "stream")], rows=1000),
    ):
        pass


def test_columns_of_lines_are_kept_at_their_vertices():
    frame = with_geometry([line((11, 48), (11.1, 48)), line((11, 49), (11.1, 49), (11.2, 49))])
    frame = frame.append_column("lanes", pa.array([2, 4]))
    result = gpszip.read(frame, keep="lanes")
    assert [track.attributes["lanes"].tolist() for track in result] == [[2, 2], [4, 4, 4]]
    assert result.dropped_columns == ("t",)


def test_empty_lines_are_dropped():
    with pytest.warns(gpszip.LossWarning):
        result = gpszip.read(
            with_geometry([line((11, 48), (11.1, 48)), struct.pack("<BII", 1, 2, 0)])
        )
    assert [(track.id, len(track)) for track in result] == [("bus", 2)]
    assert [(repair.what, repair.count) for repair in result.repairs] == [
        ("rows without a line dropped", 1)
    ]
    with pytest.raises(InputError, match="column 'where' holds no line"):
        gpszip.read(with_geometry([struct.pack("<BII", 1, 2, 0)]))


def test_a_column_of_empty_points_is_named():
    with pytest.raises(InputError, match="column 'where' holds no point"):
        gpszip.read(with_geometry([None, wkb((np.nan, np.nan))]))


def test_native_lines_are_shapes():
    cells = [
        [{"x": 11.0, "y": 48.0}, {"x": 11.1, "y": 48.0}],
        [{"x": 11.0, "y": 49.0}, {"x": 11.1, "y": 49.0}],
    ]
    frame = with_geometry(cells, "geoarrow.linestring", kind=pa.list_(NATIVE[0]))
    result = gpszip.read(frame.drop_columns(["track_id"]))
    assert [(track.id, len(track)) for track in result] == [("0", 2), ("1", 2)]


@pytest.mark.parametrize(
    ("cells", "encoding", "message"),
    [
        (
            [POINTS[0], line((1, 2), (3, 4))],
            "geoarrow.wkb",
            "row 1: holds a LineString beside points",
        ),
        ([struct.pack("<BII", 1, 3, 0)], "geoarrow.wkb", "row 0: holds a Polygon"),
        ([POINTS[0], POINTS[1][:11]], "geoarrow.wkb", "row 1: holds a damaged geometry"),
        ([line((1, 2), (3, 4))[:-5]], "geoarrow.wkb", "can't be read"),
        ([b"x"], "geoarrow.polygon", "holds geometries as geoarrow.polygon"),
        ([b"x"], "geoarrow.point", "can't be read"),
        ([POINTS[0]], "geoarrow.wkb", None),
    ],
)
def test_other_geometries_are_refused(cells, encoding, message):
    crs = "EPSG:4326" if message else "EPSG:1"
    with pytest.raises(InputError) as raised:
        gpszip.read(with_geometry(cells, encoding, crs=crs))
    assert (message or "unknown coordinate system 'EPSG:1'") in str(raised.value)
