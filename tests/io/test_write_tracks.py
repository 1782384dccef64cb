import io
import json

import numpy as np
import pytest

from gpszip.errors import OptionError, OutputError
from gpszip.geo.planes import choose_plane, to_plane
from gpszip.io.formats import FORMATS
from gpszip.io.reading import read_logs
from gpszip.io.writing import write_tracks
from gpszip.model import Track


def on_earth(name="walk", n=50, at=(48.2, 16.4), start=1.7e9, seed=0):
    rng = np.random.default_rng(seed)
    lat, lon = at[0] + rng.normal(0, 0.01, n), at[1] + rng.normal(0, 0.01, n)
    plane = choose_plane(lat, lon)
    times = start + np.cumsum(rng.integers(1, 5000, n)) / 1000
    return Track(name, times, to_plane(lat, lon, plane), plane=plane)


def in_metres(name="robot", n=50, d=2, seed=0):
    rng = np.random.default_rng(seed)
    return Track(name, np.cumsum(rng.integers(1, 5000, n)) / 1000, rng.integers(-(10**9), 10**9, (n, d)) / 1000)


def again(tracks, format_):
    stream = io.BytesIO()
    write_tracks(tracks, stream, format_)
    return read_logs(io.BytesIO(stream.getvalue()))


@pytest.mark.parametrize("format_", [known.name for known in FORMATS])
def test_tracks_on_earth_come_back_from_every_format(format_):
    track = on_earth()
    (back,) = again([track], format_).tracks
    assert back.id == "walk"
    assert back.times.tolist() == track.times.tolist()
    assert back.plane == track.plane
    assert np.abs(back.positions - track.positions).max() < 1e-3


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("format_", ["csv", "parquet", "geojson"])
def test_metres_come_back_exactly(format_, d):
    tracks = [in_metres("a b", d=d), in_metres("007", n=1, d=d, seed=1), in_metres("ü,\"'\n<&>", n=3, d=d, seed=2)]
    back = again(tracks, format_).tracks
    assert [t.id for t in back] == [t.id for t in tracks]
    for one, other in zip(back, tracks, strict=True):
        assert one.times.tolist() == other.times.tolist()
        assert one.positions.tolist() == other.positions.tolist()


def test_gpx_escapes_names_and_holds_heights():
    track = on_earth('<a> & "b"', n=3)
    track = Track(track.id, track.times, track.positions, attributes={"alt": np.array([1.5, np.nan, 3.0])}, plane=track.plane)
    stream = io.BytesIO()
    write_tracks([track], stream, "gpx")
    (back,) = read_logs(io.BytesIO(stream.getvalue()), keep=["ele"]).tracks
    assert back.id == '<a> & "b"'
    assert np.array_equal(back.attributes["ele"], [1.5, np.nan, 3.0], equal_nan=True)


def test_csv_is_plain_text_with_the_columns_that_were_promised():
    stream = io.BytesIO()
    write_tracks([Track("000", [0, 0.5, 1e6], [[0, -0.0001], [1234567.8914, 2], [1e-9, 3]]), Track("a b", [1], [[5, 6]])], stream)
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
    track = Track("0", [0, 1], [[0, 0], [1, 1]], attributes={"speed": np.array([1.5, 2.5]), "gear": np.array(["a,b", "c"])})
    stream = io.BytesIO()
    write_tracks([track], stream)
    back = read_logs(io.BytesIO(stream.getvalue()), keep=["speed", "gear"]).tracks[0]
    assert back.attributes["speed"].tolist() == [1.5, 2.5]
    assert back.attributes["gear"].tolist() == ["a,b", "c"]


def test_geojson_holds_heights_and_other_columns():
    plane = choose_plane(np.array([48.0]), np.array([11.0]))
    columns = {"ele": np.array([500.5, 501.0]), "speed": np.array([1.5, np.nan]), "mode": np.array(["walk", "bus"])}
    out = io.BytesIO()
    write_tracks([Track("a", [0, 1], [[0, 0], [5, 5]], attributes=columns, plane=plane)], out, "geojson")
    feature = json.loads(out.getvalue())["features"][0]
    assert [position[2] for position in feature["geometry"]["coordinates"]] == [500.5, 501.0]
    assert feature["properties"]["speed"] == [1.5, None]
    assert feature["properties"]["mode"] == ["walk", "bus"]
    assert read_logs(io.BytesIO(out.getvalue()), keep=["ele"]).tracks[0].attributes["ele"].tolist() == [500.5, 501.0]


def test_millions_of_rows_are_written_in_pieces():
    tracks = [Track(str(i), np.arange(300_000.0), np.zeros((300_000, 2))) for i in range(5)]
    stream = io.BytesIO()
    write_tracks(tracks, stream, "parquet")
    back = read_logs(io.BytesIO(stream.getvalue()))
    assert [(t.id, len(t)) for t in back.tracks] == [(t.id, len(t)) for t in tracks]


@pytest.mark.parametrize("format_", ["csv", "geojson", "parquet", "gpx"])
def test_no_tracks_make_a_valid_empty_file(format_):
    stream = io.BytesIO()
    write_tracks([], stream, format_)
    assert stream.getvalue()


def test_files_appear_whole_or_not_at_all(tmp_path):
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
        write_tracks([in_metres()], io.BytesIO(), "kml")
    with pytest.raises(OutputError, match="years 1 to 9999"):
        write_tracks([on_earth(start=1e12)], io.BytesIO(), "gpx")
