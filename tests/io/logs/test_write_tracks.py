import csv
import io
import json
from xml.etree import ElementTree

import numpy as np
import pyarrow.parquet as pq
import pytest

from gpszip.errors import OptionError, OutputError
from gpszip.geo.planes import choose_plane, to_plane
from gpszip.io.logs.formats import LOG_FORMATS
from gpszip.io.logs.read import read_logs
from gpszip.io.logs.track_rows import metre_decimals
from gpszip.io.logs.write import write_tracks
from gpszip.io.logs.xml.writing import has_unwritable_letters
from gpszip.model import Plane, Track

#: Formats of geographic information systems.
TABLES_OF_POINTS = ["geoparquet", "gpkg", "flatgeobuf"]
VECTOR = [*TABLES_OF_POINTS, "geojsonl", "mf-json"]


def on_earth(name="walk", n=50, at=(48.2, 16.4), start=1.7e9, seed=0):
    rng = np.random.default_rng(seed)
    lat, lon = at[0] + rng.normal(0, 0.01, n), at[1] + rng.normal(0, 0.01, n)
    plane = choose_plane(lat, lon)
    times = start + np.cumsum(rng.integers(1, 5000, n)) / 1000
    return Track(name, times, to_plane(lat, lon, plane), plane=plane)


def in_metres(name="robot", n=50, d=2, seed=0):
    rng = np.random.default_rng(seed)
    return Track(
        name,
        np.cumsum(rng.integers(1, 5000, n)) / 1000,
        rng.integers(-(10**9), 10**9, (n, d)) / 1000,
    )


def again(tracks, format_):
    stream = io.BytesIO()
    write_tracks(tracks, stream, format_)
    return read_logs(io.BytesIO(stream.getvalue()))


#: Formats that are written, and hold degrees: TUM holds metres only.
GEOGRAPHIC = [known.name for known in LOG_FORMATS if known.write and known.name != "tum"]


@pytest.mark.parametrize("format_", GEOGRAPHIC)
def test_tracks_on_earth_come_back_from_every_format(format_):
    track = on_earth()
    (back,) = again([track], format_).tracks
    assert back.id == "walk"
    assert back.times.tolist() == track.times.tolist()
    assert back.plane == track.plane
    assert np.abs(back.positions - track.positions).max() < 1e-3


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("format_", ["csv", "parquet", "geojson", *VECTOR])
def test_metres_come_back_exactly(format_, d):
    tracks = [
        in_metres("a b", d=d),
        in_metres("007", n=1, d=d, seed=1),
        in_metres("ü,\"'\n<&>", n=3, d=d, seed=2),
    ]
    back = again(tracks, format_).tracks
    assert [t.id for t in back] == [t.id for t in tracks]
    for one, other in zip(back, tracks, strict=True):
        assert one.times.tolist() == other.times.tolist()
        assert one.positions.tolist() == other.positions.tolist()


@pytest.mark.parametrize("format_", ["csv", "parquet", "geojson", *VECTOR])
def test_tracks_of_one_row_keep_their_names(format_):
    """Elsewhere, a column with a value of its own in each row doesn't name tracks."""
    tracks = [Track(name, [time], [[0, 0]]) for time, name in enumerate(["", "0", "a", "b"])]
    assert [track.id for track in again(tracks, format_).tracks] == ["", "0", "a", "b"]


def test_gpx_escapes_names_and_holds_heights():
    track = on_earth('<a> & "b"', n=3)
    track = Track(
        track.id,
        track.times,
        track.positions,
        attributes={"alt": np.array([1.5, np.nan, 3.0])},
        plane=track.plane,
    )
    stream = io.BytesIO()
    write_tracks([track], stream, "gpx")
    (back,) = read_logs(io.BytesIO(stream.getvalue()), keep=["ele"]).tracks
    assert back.id == '<a> & "b"'
    assert np.array_equal(back.attributes["ele"], [1.5, np.nan, 3.0], equal_nan=True)


def test_csv_is_plain_text_with_the_documented_columns():
    stream = io.BytesIO()
    write_tracks(
        [
            Track("000", [0, 0.5, 1e6], [[0, -0.0001], [1234567.8914, 2], [1e-9, 3]]),
            Track("a b", [1], [[5, 6]]),
        ],
        stream,
    )
    text = "track_id,t,x,y\n000,0,0,0\n000,0.5,1234567.891,2\n000,1000000,0,3\na b,1,5,6\n"
    assert stream.getvalue().decode() == text


def test_csv_of_an_epoch_keeps_milliseconds_without_an_exponent():
    stream = io.BytesIO()
    write_tracks([Track("0", [1211033530.077], [[0, 0]])], stream)
    assert stream.getvalue().decode().splitlines()[1] == "0,1211033530.077,0,0"


def test_decimals_can_be_chosen():
    stream = io.BytesIO()
    write_tracks([Track("0", [0], [[0.123456789, 0]])], stream, decimals=6)
    assert b"0.123457" in stream.getvalue()


def test_attributes_become_columns():
    track = Track(
        "0",
        [0, 1],
        [[0, 0], [1, 1]],
        attributes={"speed": np.array([1.5, 2.5]), "gear": np.array(["a,b", "c"])},
    )
    stream = io.BytesIO()
    write_tracks([track], stream)
    back = read_logs(io.BytesIO(stream.getvalue()), keep=["speed", "gear"]).tracks[0]
    assert back.attributes["speed"].tolist() == [1.5, 2.5]
    assert back.attributes["gear"].tolist() == ["a,b", "c"]


def test_geojson_holds_heights_and_other_columns():
    plane = choose_plane(np.array([48.0]), np.array([11.0]))
    columns = {
        "ele": np.array([500.5, 501.0]),
        "speed": np.array([1.5, np.nan]),
        "mode": np.array(["walk", "bus"]),
    }
    out = io.BytesIO()
    write_tracks(
        [Track("a", [0, 1], [[0, 0], [5, 5]], attributes=columns, plane=plane)], out, "geojson"
    )
    feature = json.loads(out.getvalue())["features"][0]
    assert [position[2] for position in feature["geometry"]["coordinates"]] == [500.5, 501.0]
    assert feature["properties"]["speed"] == [1.5, None]
    assert feature["properties"]["mode"] == ["walk", "bus"]
    assert read_logs(io.BytesIO(out.getvalue()), keep=["ele"]).tracks[0].attributes[
        "ele"
    ].tolist() == [500.5, 501.0]


def test_many_rows_are_written_in_batches(monkeypatch):
    monkeypatch.setattr("gpszip.io.logs.track_table._BATCH_ROWS", 1000)
    tracks = [Track(str(i), np.arange(300.0), np.zeros((300, 2))) for i in range(11)]
    stream = io.BytesIO()
    write_tracks(tracks, stream, "parquet")
    back = read_logs(io.BytesIO(stream.getvalue()))
    assert [(t.id, len(t)) for t in back.tracks] == [(t.id, len(t)) for t in tracks]
    assert pq.ParquetFile(io.BytesIO(stream.getvalue())).num_row_groups == 3


@pytest.mark.parametrize("format_", ["csv", "geojson", "parquet", "gpx", *TABLES_OF_POINTS])
def test_no_tracks_make_a_valid_empty_file(format_):
    stream = io.BytesIO()
    write_tracks([], stream, format_)
    assert stream.getvalue()


def test_files_appear_complete_or_not_at_all(tmp_path):
    path = tmp_path / "out.csv"
    write_tracks([in_metres()], path)
    whole = path.read_bytes()

    def broken():
        yield in_metres()
        yield on_earth()

    with pytest.raises(OutputError, match="has columns"):
        write_tracks(broken(), path)
    assert path.read_bytes() == whole
    assert [file.name for file in tmp_path.iterdir()] == ["out.csv"]


def test_standard_output(capfdbinary):
    write_tracks([Track("0", [0], [[1, 2]])], "-")
    assert capfdbinary.readouterr().out == b"track_id,t,x,y\n0,0,1,2\n"


def test_mistakes(tmp_path):
    with pytest.raises(OutputError, match="end it with one of"):
        write_tracks([in_metres()], tmp_path / "out.xyz")
    with pytest.raises(OutputError, match="can't be written"):
        write_tracks([in_metres()], tmp_path / "none" / "out.csv")
    with pytest.raises(OutputError, match="in x and y; write CSV"):
        write_tracks([in_metres()], io.BytesIO(), "gpx")
    with pytest.raises(OptionError, match="no format"):
        write_tracks([in_metres()], io.BytesIO(), "xyz")
    with pytest.raises(OutputError, match="years 1 to 9999"):
        write_tracks([on_earth(start=1e12)], io.BytesIO(), "gpx")


DATE_LINE = Plane(((-170000000, 1800000000),))
GPX = {"g": "http://www.topografix.com/GPX/1/1"}


def written(tracks, format_, **options):
    stream = io.BytesIO()
    write_tracks(tracks, stream, format_, **options)
    return stream.getvalue().decode()


def gpx_tracks(text):
    """Names of the tracks, and the attributes and time of each point of each segment."""
    root = ElementTree.fromstring(text)  # our own file
    return [
        (
            track.findtext("g:name", namespaces=GPX),
            [
                [(p.get("lat"), p.get("lon"), p.findtext("g:time", namespaces=GPX)) for p in part]
                for part in track.findall("g:trkseg", GPX)
            ],
        )
        for track in root.findall("g:trk", GPX)
    ]


def ride_with_gaps(plane=DATE_LINE):
    """Three pieces of one track, the second a single sample, and another track, near 180 E."""
    lines = [
        [[100.0, 0.0], [200.0, 0.0]],
        [[300.0, 0.0]],
        [[400.0, 0.0], [500.0, 0.0], [600.0, 9.0]],
    ]
    ride = [
        Track(f"ride/{i}", 1000.0 * i + np.arange(len(line)), line, plane=plane)
        for i, line in enumerate(lines)
    ]
    other = Track("ride", [0, 1], [[0.5, 90], [1, 90]], plane=plane)
    return [*ride, other], {
        "ride/0": "my ride",
        "ride/1": "my ride",
        "ride/2": "my ride",
        "ride": "ride",
    }


def test_gpx_has_a_segment_for_each_piece_between_gaps():
    tracks, pieces = ride_with_gaps()
    found = gpx_tracks(written(tracks, "gpx", pieces=pieces))
    assert [(name, [len(part) for part in parts]) for name, parts in found] == [
        ("my ride", [2, 1, 3]),
        ("ride", [2]),
    ]
    assert found[0][1][2][0][2] == "1970-01-01T00:33:20.000Z"
    back = read_logs(io.BytesIO(written(tracks, "gpx", pieces=pieces).encode())).tracks
    assert [(track.id, len(track)) for track in back] == [("my ride", 6), ("ride", 2)]


def test_geojson_has_a_line_for_each_piece_between_gaps_with_its_times():
    tracks, pieces = ride_with_gaps()
    whole = [tracks[0], tracks[2]]
    (feature,) = json.loads(written(whole, "geojson", pieces=pieces))["features"]
    assert feature["geometry"]["type"] == "MultiLineString"
    assert [len(line) for line in feature["geometry"]["coordinates"]] == [2, 3]
    assert feature["properties"] == {"track_id": "my ride", "times": [[0, 1], [2000, 2001, 2002]]}


def test_geojson_has_single_positions_as_points_in_the_order_of_travel():
    tracks, pieces = ride_with_gaps()
    text = written(tracks, "geojson", pieces=pieces)
    kinds = [
        (feature["geometry"]["type"], feature["properties"]["track_id"])
        for feature in json.loads(text)["features"]
    ]
    assert kinds == [
        ("LineString", "my ride"),
        ("Point", "my ride"),
        ("LineString", "my ride"),
        ("LineString", "ride"),
    ]
    back = read_logs(io.BytesIO(text.encode())).tracks
    assert [(track.id, track.times.tolist()) for track in back] == [
        ("my ride", [0, 1, 1000, 2000, 2001, 2002]),
        ("ride", [0, 1]),
    ]


def test_tables_name_the_pieces_between_gaps():
    tracks, pieces = ride_with_gaps()
    rows = list(csv.DictReader(written(tracks, "csv", pieces=pieces).splitlines()))
    assert [row["track_id"] for row in rows] == ["ride/0"] * 2 + ["ride/1"] + ["ride/2"] * 3 + [
        "ride"
    ] * 2


def test_tracks_of_one_name_stay_separate_tracks():
    twins = [on_earth("walk", 3), on_earth("walk", 4, start=1.8e9)]
    assert [len(parts) for _, parts in gpx_tracks(written(twins, "gpx"))] == [1, 1]
    assert len(json.loads(written(twins, "geojson"))["features"]) == 2


def across_the_date_line():
    return Track("ferry", [1.7e9, 1.7e9 + 90], [[-500.0, 0.0], [1000.0, 0.0]], plane=DATE_LINE)


def test_knots_are_brought_to_the_antimeridian_on_both_sides():
    rows = list(
        csv.DictReader(written([across_the_date_line()], "csv", max_deviation=0.02).splitlines())
    )
    assert [round(float(row["lon"]), 3) for row in rows] == [179.995, 180, -180, -179.991]
    times = [float(row["t"]) for row in rows]
    assert times[1] == pytest.approx(1.7e9 + 30, abs=0.01)
    assert times[2] - times[1] == pytest.approx(1e-6, abs=3e-7)


def test_lines_are_cut_at_the_antimeridian():
    ((_, parts),) = gpx_tracks(written([across_the_date_line()], "gpx", max_deviation=0.02))
    assert [[round(float(lon), 3) for _, lon, _ in part] for part in parts] == [
        [179.995, 180],
        [-180, -179.991],
    ]
    (feature,) = json.loads(written([across_the_date_line()], "geojson", max_deviation=0.02))[
        "features"
    ]
    assert feature["geometry"]["type"] == "MultiLineString"
    assert [[round(lon, 3) for lon, _ in line] for line in feature["geometry"]["coordinates"]] == [
        [179.995, 180],
        [-180, -179.991],
    ]


@pytest.mark.parametrize("format_", ["csv", "geojson", "gpx", "parquet", *VECTOR])
def test_a_track_across_the_antimeridian_is_read_again_as_one(format_):
    stream = io.BytesIO()
    write_tracks([across_the_date_line()], stream, format_, max_deviation=0.02)
    (back,) = read_logs(io.BytesIO(stream.getvalue())).tracks
    assert len(back) == 4
    assert np.hypot(*(back.positions[-1] - back.positions[0])) == pytest.approx(1500, abs=0.1)


def test_samples_get_no_row_that_was_not_asked_for():
    track = across_the_date_line()
    assert len(written([track], "csv").splitlines()) == 3
    assert [len(part) for part in gpx_tracks(written([track], "gpx"))[0][1]] == [1, 1]
    heights = Track(
        track.id,
        track.times,
        track.positions,
        attributes={"ele": np.array([1.0, 2.0])},
        plane=track.plane,
    )
    assert len(written([heights], "csv").splitlines()) == 3

    # Numbers are linear between samples, so that rows may be added where they are asked for.
    assert len(written([heights], "csv", max_deviation=0.02).splitlines()) == 5


def shape(name="hike"):
    return Track(
        name,
        [0.0, 5.0, 9.0],
        [[0, 0], [3, 4], [3, 8]],
        plane=Plane(((480000000, 110000000),)),
        timed=False,
    )


def test_tracks_without_times_are_written_without():
    assert written([shape()], "csv").splitlines()[0] == "track_id,lat,lon"
    (feature,) = json.loads(written([shape()], "geojson", max_deviation=0.02))["features"]
    assert feature["properties"] == {"track_id": "hike"}
    assert "<time>" not in written([shape()], "gpx")
    stream = io.BytesIO()
    write_tracks([shape()], stream, "parquet")
    assert pq.read_table(stream).column_names == ["track_id", "lat", "lon"]


def test_beside_tracks_with_times_those_without_have_empty_cells():
    ride = Track("ride", [7.0], [[0, 0]], plane=shape().plane)
    for tracks in ([shape(), ride], [ride, shape()]):
        rows = list(csv.DictReader(written(tracks, "csv").splitlines()))
        assert {row["t"] for row in rows if row["track_id"] == "hike"} == {""}
        assert [row["t"] for row in rows if row["track_id"] == "ride"] == ["7"]
    stream = io.BytesIO()
    write_tracks([shape(), ride], stream, "parquet")
    assert pq.read_table(stream)["t"].to_pylist() == [None, None, None, 7.0]


TITLES = [
    "../../etc/passwd",
    "<script>alert('1')</script>",
    "]]> & &amp;",
    "hike \U0001f97e\U00010348",
    " two\n lines\t",
    "'\"`",
]


@pytest.mark.parametrize("title", TITLES)
def test_titles_are_written_letter_by_letter(title):
    tracks = [on_earth(title, 2)]
    assert gpx_tracks(written(tracks, "gpx"))[0][0] == title
    assert json.loads(written(tracks, "geojson"))["features"][0]["properties"]["track_id"] == title


def test_control_characters_are_kept_where_the_format_can_hold_them():
    title = "bell \a, null \0, escape \x1b, \ufffe"
    assert (
        json.loads(written([on_earth(title, 2)], "geojson"))["features"][0]["properties"][
            "track_id"
        ]
        == title
    )
    assert has_unwritable_letters(title)
    assert (
        gpx_tracks(written([on_earth(title, 2)], "gpx"))[0][0]
        == "bell \ufffd, null \ufffd, escape \ufffd, \ufffd"
    )
    assert not any(map(has_unwritable_letters, TITLES))


@pytest.mark.parametrize("format_", ["csv", "geojson", "gpx", "parquet", *VECTOR])
def test_half_a_surrogate_pair_is_refused(format_):
    with pytest.raises(OutputError, match="half a letter"):
        written([on_earth("caf\udcc3", 2)], format_)


def gpx_times(track, **options):
    return [
        time
        for _, parts in gpx_tracks(written([track], "gpx", **options))
        for part in parts
        for *_, time in part
    ]


def test_gpx_times_are_in_milliseconds_where_these_do():
    plane = Plane(((480000000, 110000000),))
    walk = Track("walk", [0.0001, 60.0004], [[0, 0], [80, 0]], plane=plane)
    assert gpx_times(walk, max_deviation=0.02) == [
        "1970-01-01T00:00:00.000Z",
        "1970-01-01T00:01:00.000Z",
    ]
    assert gpx_times(walk) == ["1970-01-01T00:00:00.000100Z", "1970-01-01T00:01:00.000400Z"]


def test_gpx_times_are_finer_for_what_is_fast_or_dense():
    plane = Plane(((480000000, 110000000),))
    plane_at_250 = Track("flight", [0.0004, 60.0004], [[0, 0], [15_000, 0]], plane=plane)
    assert gpx_times(plane_at_250, max_deviation=0.02)[0] == "1970-01-01T00:00:00.000400Z"
    dense = Track(
        "robot", [0.0, 0.0004, 0.0008, 1.0], [[0, 0], [1e-6, 0], [2e-6, 0], [1, 0]], plane=plane
    )
    times = gpx_times(dense, max_deviation=0.02)
    assert times == sorted(set(times))
    assert len(times) == 4


@pytest.mark.parametrize(
    ("within", "decimals"), [(None, 3), (1.0, 3), (0.002, 3), (2e-4, 4), (2e-6, 6)]
)
def test_decimals_suit_the_error_that_is_allowed(within, decimals):
    assert metre_decimals(within) == decimals
