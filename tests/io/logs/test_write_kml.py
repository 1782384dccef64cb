import io
import xml.etree.ElementTree as ET
import zipfile

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import OutputError
from gpszip.geo.planes import to_geographic
from gpszip.io.logs.kml.read import read_kml
from gpszip.io.logs.raw import Request
from gpszip.io.logs.read import read_logs
from gpszip.io.logs.write import write_tracks
from gpszip.io.storage.source import Source
from gpszip.model import Plane, Track
from random_tests import examples

PLANE = Plane(((480_000_000, 110_000_000),))
START = 1.7e9
KML, GX = "{http://www.opengis.net/kml/2.2}", "{http://www.google.com/kml/ext/2.2}"


def walk(name="walk", n=3, first=0.0, **options):
    times = START + first + np.arange(n) * 10.0
    positions = np.column_stack([np.arange(n) * 7.5, np.arange(n) ** 2.0])
    return Track(name, times, positions, plane=PLANE, **options)


def written(tracks, format="kml", **options):
    stream = io.BytesIO()
    write_tracks(tracks, stream, format, **options)
    return stream.getvalue()


def test_a_track_is_a_placemark_with_times_positions_and_arrays_in_the_order_of_the_schema():
    columns = {
        "ele": np.array([500.5, np.nan, 501.0]),
        "hr": np.array([60, 61, 62]),
        "speed": np.array([1.5, np.nan, 3.0]),
        "note": np.array(["a & b", "", "<c>"]),
    }
    root = ET.fromstring(written([walk(attributes=columns)]))
    (track,) = root.iter(f"{GX}Track")
    assert [child.tag for child in track] == [
        f"{KML}altitudeMode",
        *[f"{KML}when"] * 3,
        *[f"{GX}coord"] * 3,
        f"{KML}ExtendedData",
    ]
    assert track.findtext(f"{KML}when") == "2023-11-14T22:13:20.000Z"
    heights = [coord.text.split()[2:] for coord in track.iter(f"{GX}coord")]
    assert heights == [["500.5"], [], ["501"]]
    fields = {f.get("name"): f.get("type") for f in root.iter(f"{GX}SimpleArrayField")}
    assert fields == {"hr": "int", "speed": "double", "note": "string"}
    values = {
        array.get("name"): [value.text for value in array]
        for array in track.iter(f"{GX}SimpleArrayData")
    }
    assert values == {
        "hr": ["60", "61", "62"],
        "speed": ["1.5", None, "3.0"],
        "note": ["a & b", None, "<c>"],
    }


def test_columns_come_back():
    columns = {
        "alt": np.array([500.5, np.nan, 501.0]),
        "hr": np.array([60.0, np.nan, 62.0]),
        "note": np.array(["a & b", "", "<c>"]),
    }
    tracks = [walk(attributes=columns), walk("b", attributes=columns)]
    back = read_logs(io.BytesIO(written(tracks)), keep=["ele", "hr", "note"]).tracks
    assert [track.id for track in back] == ["walk", "b"]
    for track in back:
        np.testing.assert_array_equal(track.attributes["ele"], columns["alt"])
        np.testing.assert_array_equal(track.attributes["hr"], columns["hr"])
        assert track.attributes["note"].tolist() == columns["note"].tolist()


def test_pieces_of_a_track_are_a_multitrack_that_is_not_interpolated():
    pieces = [walk("bus/1"), walk("bus/2", first=5000)]
    file = written(pieces, pieces={"bus/1": "bus", "bus/2": "bus"})
    (multi,) = ET.fromstring(file).iter(f"{GX}MultiTrack")
    assert [child.tag for child in multi] == [f"{GX}interpolate", *[f"{GX}Track"] * 2]
    assert multi.findtext(f"{GX}interpolate") == "0"
    (back,) = read_logs(io.BytesIO(file)).tracks
    assert (back.id, len(back)) == ("bus", 6)


def test_shapes_are_lines():
    shape = Track("plan", [0, 1, 2], [[0, 0], [5, 5], [9, 0]], plane=PLANE, timed=False)
    other = Track("ring", [0, 1], [[0, 0], [5, 5]], plane=PLANE, timed=False)
    root = ET.fromstring(written([shape, other]))
    assert not list(root.iter(f"{GX}Track"))
    assert [len(line.text.split()) for line in root.iter(f"{KML}coordinates")] == [3, 2]
    back = read_logs(io.BytesIO(written([shape, other]))).tracks
    assert [(track.id, track.timed, len(track)) for track in back] == [
        ("plan", False, 3),
        ("ring", False, 2),
    ]


def test_kmz_is_a_zip_archive_of_the_same_file_and_always_the_same_bytes():
    tracks = [walk()]
    file = written(tracks, "kmz")
    with zipfile.ZipFile(io.BytesIO(file)) as archive:
        assert archive.namelist() == ["doc.kml"]
        assert archive.read("doc.kml") == written(tracks)
    assert written(tracks, "kmz") == file


def test_what_kml_can_not_hold_is_refused():
    with pytest.raises(OutputError, match=r"KML holds latitudes and longitudes, .*; write CSV"):
        written([Track("robot", [0, 1], [[0, 0], [1, 1]])])
    far = Track("far", [1e12, 1e12 + 1], [[0, 0], [1, 1]], plane=PLANE)
    with pytest.raises(OutputError, match="track 'far': times outside the years 1 to 9999"):
        written([far])


NAMES = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=9)
TEXTS = st.text(st.sampled_from("ab <&>\"'é\u2028"), max_size=5)


@examples(60)
@given(
    name=NAMES,
    notes=st.lists(TEXTS, min_size=2, max_size=5),
    steps=st.lists(st.integers(1, 10**6), min_size=5, max_size=5),
)
def test_any_track_is_well_formed_and_an_independent_parse_finds_its_numbers(name, notes, steps):
    n = len(notes)
    times = START + np.cumsum(steps[:n]) / 1000
    positions = np.array(steps[:n])[:, np.newaxis] * [0.001, -0.002]
    columns = {"note": np.array(notes), "ele": np.array(steps[:n]) / 8}
    track = Track(name, times, positions, plane=PLANE, attributes=columns)
    file = written([track])

    # What a parser that knows nothing of tracks finds.
    root = ET.fromstring(file)
    coords = np.array([[*map(float, c.text.split())] for c in root.iter(f"{GX}coord")])
    lat, lon = to_geographic(positions, PLANE)
    assert np.abs(coords[:, :2] - np.column_stack([lat, lon])[:, ::-1]).max() <= 0.51e-8
    assert coords[:, 2].tolist() == np.round(columns["ele"], 3).tolist()
    assert [value.text or "" for value in root.iter(f"{GX}value")] == notes

    # What the reader finds. A column in which all texts are blank is unknown.
    log = read_kml(Source("walk.kml", data=file), Request(keep=("note",)))
    assert log.times.tolist() == np.round(times, 3).tolist()
    assert log.coordinates[:, ::-1].tolist() == coords[:, :2].tolist()
    expected = ["" if not note.strip() else note for note in notes]
    if any(expected):
        assert log.attributes["note"].tolist() == expected
    else:
        assert np.isnan(log.attributes["note"]).all()
