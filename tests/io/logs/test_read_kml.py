import io
import math
import re
import xml.etree.ElementTree as ET
from datetime import UTC, datetime

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError
from gpszip.io.logs.formats import format_for_reading
from gpszip.io.logs.kml.coordinates import cut_positions, split_coordinates
from gpszip.io.logs.kml.pairing import COORD, WHEN, pair_positions
from gpszip.io.logs.kml.read import read_kml
from gpszip.io.logs.raw import Request
from gpszip.io.logs.read import read_logs
from gpszip.io.storage.source import Source
from random_tests import examples

HEAD = (
    '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2" '
    'xmlns:gx="http://www.google.com/kml/ext/2.2"><Document>'
)
END = "</Document></kml>"
START = 1714809600  # 2024-05-04T08:00:00Z


def date(second):
    return datetime.fromtimestamp(START + second, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def when(second):
    return f"<when>{date(second)}</when>"


def coord(lon, lat, *alt):
    return f"<gx:coord>{' '.join(map(str, (lon, lat, *alt)))}</gx:coord>"


def track(*parts):
    return f"<gx:Track>{''.join(parts)}</gx:Track>"


def placemark(*parts, name=None):
    title = "" if name is None else f"<name>{name}</name>"
    return f"<Placemark>{title}{''.join(parts)}</Placemark>"


def point(coordinates, time=None, more="", name=None):
    stamp = "" if time is None else f"<TimeStamp>{when(time)}</TimeStamp>"
    place = f"<Point><coordinates>{coordinates}</coordinates></Point>"
    return placemark(stamp, more, place, name=name)


def line(coordinates, more=""):
    return f"<LineString>{more}<coordinates>{coordinates}</coordinates></LineString>"


def data(*parts, head=HEAD):
    return (head + "".join(parts) + END).encode()


def raw(*parts, head=HEAD, **request):
    return read_kml(Source("walk.kml", data=data(*parts, head=head)), Request(**request))


WALK = track(when(0), when(10), coord(11.5, 48.1, 500), coord(11.6, 48.2, 501))
PLACES = [[48.1, 11.5], [48.2, 11.6]]
SCHEMA_DATA = (
    "<ExtendedData><SchemaData schemaUrl='#s'><gx:SimpleArrayData name='hr'>{}"
    "</gx:SimpleArrayData></SchemaData></ExtendedData>"
)


def values(*texts):
    return SCHEMA_DATA.format("".join(f"<gx:value>{text}</gx:value>" for text in texts))


# Tracks


@pytest.mark.parametrize(
    "parts",
    [
        (when(0), when(10), coord(11.5, 48.1, 500), coord(11.6, 48.2, 501)),
        (coord(11.5, 48.1, 500), coord(11.6, 48.2, 501), when(0), when(10)),
        (when(0), coord(11.5, 48.1, 500), when(10), coord(11.6, 48.2, 501)),
        (coord(11.5, 48.1, 500), when(0), coord(11.6, 48.2, 501), when(10)),
        (when(0), coord(11.5, 48.1, 500), coord("11.6,48.2", ""), when(10)),
    ],
    ids=["times first", "positions first", "alternating", "alternating back", "commas"],
)
def test_times_and_positions_of_a_track_come_in_any_order(parts):
    log = raw(placemark(track(*parts), name="walk"))
    assert (log.ids, log.times.tolist()) == (("walk",), [START, START + 10])
    assert log.coordinates.tolist() == PLACES
    assert not log.repairs
    assert log.dropped_columns == ("alt",)


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("gx:", ""),
        lambda text: text.replace("gx:", "ext:"),
        lambda text: text.replace("<", "<k:").replace("<k:/", "</k:").replace(":gx:", ":"),
    ],
    ids=["2.3", "another prefix", "a prefix for all"],
)
def test_prefixes_do_not_matter(change):
    text = f"<kml><Document>{placemark(WALK, name='walk')}</Document></kml>"
    source = Source("walk.xml", data=change(text).encode())
    assert format_for_reading(source).name == "kml"
    assert read_kml(source, Request()).coordinates.tolist() == PLACES


def test_tracks_of_a_multitrack_follow_each_other_and_placemarks_are_tracks():
    later = track(when(20), coord(11.7, 48.3))
    log = raw(
        placemark(
            f"<gx:MultiTrack><gx:interpolate>0</gx:interpolate>{WALK}{later}</gx:MultiTrack>",
            name="a",
        ),
        placemark(WALK, name="b"),
        f"<Folder><name>f</name>{placemark(WALK)}</Folder>",
    )
    assert (log.ids, log.codes.tolist()) == (("a", "b", "f"), [0, 0, 0, 1, 1, 2, 2])
    assert log.times[:3].tolist() == [START, START + 10, START + 20]


def test_names_come_from_the_placemark_its_folder_the_document_or_the_file():
    assert raw(placemark(WALK)).ids == ()
    assert raw("<name>\n<![CDATA[a <b>]]>\n</name>", placemark(WALK)).ids == ("a <b>",)
    assert raw(f"<Folder><Style id='s'/><name>f</name>{placemark(WALK)}</Folder>").ids == ("f",)
    late = placemark(WALK).replace("</Pl", "<Style><name>no</name></Style><name>late</name></Pl")
    assert raw(late, placemark(WALK, name="late")).ids == ("late", "late-2")


def test_a_track_without_times_is_a_shape():
    log = raw(placemark(track(coord(11.5, 48.1), coord(11.6, 48.2)), name="plan"))
    assert (log.ids, log.untimed, log.coordinates.tolist()) == (("plan",), {0}, PLACES)


def test_times_and_positions_without_a_partner_are_dropped_and_counted():
    alternating = track(when(0), coord(11.5, 48.1), when(5), when(10), coord(11.6, 48.2))
    log = raw(placemark(alternating))
    assert log.times.tolist() == [START, START + 5]
    assert log.coordinates.tolist() == PLACES
    (repair,) = log.repairs
    assert repair.what == "times of tracks (when) without a position (coord) dropped"
    assert (repair.count, repair.drops, repair.where) == (1, True, "walk.kml: placemark 1")

    in_blocks = track(when(0), when(10), coord(11.5, 48.1), coord(11.6, 48.2), coord(1, 2))
    reading = read_logs(io.BytesIO(data(placemark(in_blocks))))
    assert (reading.points, reading.kept, reading.lost) == (3, 2, 1)
    assert reading.repairs[0].what == "positions of tracks (coord) without a time (when) dropped"


def test_blank_times_and_positions_keep_their_places():
    blank = track(
        when(0),
        when(5),
        "<when/>",
        when(10),
        coord(11.5, 48.1),
        "<gx:coord/>",
        coord(1, 2),
        coord(11.6, 48.2),
    )
    reading = read_logs(io.BytesIO(data(placemark(blank))))
    assert reading.tracks[0].times.tolist() == [START, START + 10]
    assert [repair.what for repair in reading.repairs] == [
        "points without a time dropped",
        "points without a position dropped",
    ]


def test_years_and_months_are_their_first_days():
    times = ["2024", " 2024-03 ", "2024-05-04"]
    parts = [f"<when>{time}</when>{coord(i, i)}" for i, time in enumerate(times)]
    log = raw(placemark(track(*parts)))
    expected = [datetime(2024, month, day, tzinfo=UTC) for month, day in ((1, 1), (3, 1), (5, 4))]
    assert log.times.tolist() == [time.timestamp() for time in expected]


def test_the_model_of_a_track_is_no_item_of_its_own():
    model = "<Model><Location><longitude>1</longitude></Location><name>car</name></Model>"
    log = raw(placemark(WALK.replace("</gx:Track>", model + "</gx:Track>"), name="walk"))
    assert (log.ids, log.left_out, len(log.times)) == (("walk",), (), 2)


def test_a_track_outside_a_placemark_is_named():
    log = raw(WALK, placemark(WALK), "<LineString><coordinates>1,2</coordinates></LineString>")
    assert [left.name for left in log.left_out] == ["walk.kml: 2 tracks without a placemark"]
    assert len(log.times) == 2


# Points


def test_points_with_times_of_a_folder_are_a_track():
    speed = "<ExtendedData><Data name='speed'><value>{}</value></Data></ExtendedData>"
    log = raw(
        "<Folder><name>bus</name>",
        point("11.5,48.1,500", 0, speed.format(3), name="first"),
        point("11.6,48.2", 10),
        "</Folder><Folder>",
        point("11.7,48.3", 5),
        "</Folder>",
        keep=("speed", "name", "ele"),
    )
    assert (log.ids, log.codes.tolist()) == (("bus", "walk-2"), [0, 0, 1])
    assert log.times.tolist() == [START, START + 10, START + 5]
    assert log.coordinates.tolist() == [*PLACES, [48.3, 11.7]]
    np.testing.assert_array_equal(log.attributes["speed"], [3, np.nan, np.nan])
    np.testing.assert_array_equal(log.attributes["ele"], [500, np.nan, np.nan])
    assert log.attributes["name"].tolist() == ["first", "", ""]


def test_the_beginning_of_a_time_span_is_the_time_of_a_point():
    span = f"<TimeSpan><begin>{date(3)}</begin><end>{date(8)}</end></TimeSpan>"
    log = raw(point("11.5,48.1", more=span), point("11.6,48.2", 10))
    assert log.times.tolist() == [START + 3, START + 10]
    (repair,) = log.repairs
    assert repair.what == "time spans of points read as their beginnings"
    assert (repair.count, repair.drops) == (1, False)


def test_points_with_a_time_beside_tracks_are_markers_and_named():
    log = raw(point("1,2", 0, name="Start"), placemark(WALK, name="walk"), point("1,2", 9))
    assert log.ids == ("walk",)
    assert [(left.name, left.reason) for left in log.left_out] == [
        ("walk.kml: 2 points with a time", "beside tracks, such as a start or an end")
    ]


def test_times_of_views_are_not_those_of_a_point():
    view = f"<LookAt><gx:TimeStamp>{when(99)}</gx:TimeStamp><longitude>1</longitude></LookAt>"
    log = raw(point("11.5,48.1", 0, view), point("11.6,48.2", 10, view))
    assert log.times.tolist() == [START, START + 10]


# Lines


def test_lines_are_shapes_each_for_itself():
    log = raw(
        placemark(
            f"<MultiGeometry>{line(' 11.5,48.1,0  11.6, 48.2 ')}<MultiGeometry>"
            f"{line('1,2 3,4')}</MultiGeometry></MultiGeometry>",
            name="plan",
        ),
        placemark("<LinearRing><coordinates>5,6\n7,8\t5,6</coordinates></LinearRing>", name="ring"),
    )
    assert (log.ids, log.untimed) == (("plan", "plan-2", "ring"), {0, 1, 2})
    assert log.codes.tolist() == [0, 0, 1, 1, 2, 2, 2]
    assert log.coordinates[:2].tolist() == PLACES
    assert np.isnan(log.times).all()


def test_the_time_of_a_line_is_reported_as_not_read():
    span = f"<TimeSpan><begin>{date(3)}</begin></TimeSpan>"
    (repair,) = raw(placemark(span, line("1,2 3,4"))).repairs
    assert repair.what.startswith("times of lines not read")
    assert not repair.drops


def test_a_line_may_be_longer_than_any_other_text():
    count = 200_000
    text = " ".join(f"{i % 180},{i % 90},{i}" for i in range(count))
    log = raw(placemark(line(text)), keep=("ele",))
    assert log.attributes["ele"].tolist() == list(range(count))
    assert log.coordinates[:, 1].tolist() == [i % 180 for i in range(count)]


def test_what_is_no_track_is_named():
    polygon = (
        "<Polygon><outerBoundaryIs><LinearRing><coordinates>1,2 3,4 5,6</coordinates>"
        "</LinearRing></outerBoundaryIs></Polygon>"
    )
    link = "<NetworkLink><name>n</name><Link><href>http://example.org/a.kml</href></Link></Netw"
    others = [
        placemark(polygon),
        point("1,2"),
        point("3,4"),
        placemark("<LineString><coordinates /></LineString>"),
        link + "orkLink>",
    ]
    names = [
        "1 polygon",
        "2 points without a time",
        "1 track without positions",
        "1 network link",
    ]
    log = raw(*others, placemark(WALK))
    assert [left.name for left in log.left_out] == [f"walk.kml: {name}" for name in names]
    assert log.left_out[-1].reason == "not followed"
    with pytest.raises(InputError, match="no tracks, only 1 polygon, 2 points without a time, 1 t"):
        raw(*others)
    with pytest.raises(InputError, match="no tracks; GPSZip reads tracks, points with times, and"):
        raw()


# Further data


def test_arrays_and_angles_are_columns_of_the_positions():
    angles = "<gx:angles>45.5 66 0</gx:angles><gx:angles>90</gx:angles>"
    timed = WALK.replace("</gx:Track>", angles + values(60, 61) + "</gx:Track>")
    of_all = "<ExtendedData><Data name='type'><value>walking</value></Data></ExtendedData>"
    log = raw(placemark(timed, of_all), keep=("HR", "type", "ele", "tilt"), heading=True)
    assert log.attributes["HR"].tolist() == [60, 61]
    assert log.attributes["type"].tolist() == ["walking", "walking"]
    assert log.attributes["ele"].tolist() == [500, 501]
    assert log.attributes["heading"].tolist() == [45.5, 90]
    np.testing.assert_array_equal(log.attributes["tilt"], [66, np.nan])
    assert raw(placemark(timed, of_all)).dropped_columns == (
        "hr", "heading", "tilt", "roll", "type", "alt",
    )  # fmt: skip


def test_columns_that_only_some_tracks_have_are_unknown_elsewhere():
    timed = WALK.replace("</gx:Track>", values(60, 61) + "</gx:Track>")
    log = raw(placemark(WALK), placemark(timed), placemark(WALK), keep=("hr",))
    np.testing.assert_array_equal(log.attributes["hr"], [np.nan] * 2 + [60, 61] + [np.nan] * 2)


def test_an_array_of_another_length_is_not_read():
    timed = WALK.replace("</gx:Track>", values(60) + "</gx:Track>")
    log = raw(
        placemark(timed), placemark(WALK.replace("</gx:T", values(1, 2) + "</gx:T")), keep=("hr",)
    )
    np.testing.assert_array_equal(log.attributes["hr"], [np.nan, np.nan, 1, 2])
    (repair,) = log.repairs
    assert repair.what == "values of hr not read, as they are not as many as the positions"
    assert (repair.count, repair.drops) == (1, False)


def test_columns_of_a_track_follow_the_positions_that_are_kept():
    parts = (when(0), coord(1, 1), coord(2, 2), when(10), coord(3, 3))
    log = raw(placemark(track(*parts, values("a", "b", "c"))), keep=("hr",))
    assert log.coordinates[:, 0].tolist() == [1, 3]
    assert log.attributes["hr"].tolist() == ["a", "c"]


def test_heights_above_the_ground_are_none_above_the_sea():
    low = line("1,2,3", "<altitudeMode>relativeToGround</altitudeMode>")
    log = raw(placemark(low), placemark(line("1,2,500")), keep=("ele", "height_above_ground"))
    np.testing.assert_array_equal(log.attributes["ele"], [np.nan, 500])
    np.testing.assert_array_equal(log.attributes["height_above_ground"], [3, np.nan])


# Positions


@pytest.mark.parametrize(
    ("text", "lat", "lon", "alt"),
    [
        ("11.5,48.1", "48.1", "11.5", None),
        (" 11.5 , 48.1 , 5 ", "48.1", "11.5", "5"),
        ("11.5,48.1,", "48.1", "11.5", None),
        ("11.5 48.1", "48.1", "11.5", None),
        ("\n11.5\t48.1  5\n", "48.1", "11.5", "5"),
        ("", None, None, None),
        (" \n", None, None, None),
        ("11.5", "coordinates 11.5", None, None),
        ("11,5 48,1", "coordinates 11,5 48,1", None, None),
        ("11,5 48", "coordinates 11,5 48", None, None),
        ("11,5,48,1", "coordinates 11,5,48,1", None, None),
        (",48.1", "coordinates ,48.1", None, None),
        ("1 2 3 4", "coordinates 1 2 3 4", None, None),
    ],
)
def test_positions_are_split_completely_or_not_at_all(text, lat, lon, alt):
    found = split_coordinates(pa.chunked_array([[text]]))
    assert [column[0].as_py() for column in found] == [lat, lon, alt]


@given(
    st.lists(st.sampled_from(["1,2", "3 ,4", "5,\n6,7", "8, 9 , 10", "x", ",", "11,12,"])),
    st.lists(st.integers(0, 60)),
)
def test_positions_of_a_line_do_not_depend_on_where_its_text_is_cut(parts, cuts):
    text = " ".join(parts)
    whole, _ = cut_positions(text, final=True)
    bounds = sorted({0, len(text), *(cut for cut in cuts if cut < len(text))})
    found, rest = [], ""
    for start, stop in zip(bounds, bounds[1:], strict=False):
        positions, rest = cut_positions(rest + text[start:stop], final=False)
        found += positions
    assert found + cut_positions(rest, final=True)[0] == whole


def _pairs_one_by_one(order):
    """Pair by index if there are as many of both, else within groups."""
    whens, coords, groups = [], [], [([], [])]
    for i, kind in enumerate(order):
        if kind == order[0] and i and order[i - 1] != kind:
            groups.append(([], []))
        rows = whens if kind == WHEN else coords
        groups[-1][kind].append(len(rows))
        rows.append(i)
    if len(whens) == len(coords):
        return list(range(len(whens))), list(range(len(coords)))
    pairs = [pair for group in groups for pair in zip(*group, strict=False)]
    return [when for when, _ in pairs], [coord for _, coord in pairs]


@given(st.lists(st.sampled_from([WHEN, COORD])))
def test_times_and_positions_are_paired_as_one_by_one(order):
    whens, coords = pair_positions(bytes(order))
    assert (whens.tolist(), coords.tolist()) == _pairs_one_by_one(order)


# Files


@pytest.mark.parametrize(
    ("file", "says"),
    [
        (data(placemark(WALK))[:-40], "damaged KML: the file ends within"),
        (
            data(placemark(WALK)).partition(b"</gx:coord>")[0],
            "the file ends within <gx:Track>, after 0 points; fetch it again, or end it with "
            "</gx:Track></Placemark>",
        ),
        (
            b"<kml><Placemark><LineString><coordinates>11,48 12,4",
            "or end it with </coordinates></LineString></Placemark></kml> after the last complete",
        ),
        (
            b"<kml><Folder><Placemark><TimeStamp><when>2024-05-04T0",
            "the file ends within <Folder>, after 0 points; fetch it again, or end it with "
            "</Folder></kml>",
        ),
        (
            data(head=HEAD.replace("<kml", "<!DOCTYPE kml [<!ENTITY a 'b'>]><kml")),
            "line 2: has a document type (<!DOCTYPE), which no KML file needs; remove it",
        ),
        (data(placemark(line("no,no"))), "no point has a position that can be read; the first has"),
        (data(placemark(track("<when>noon</when>", coord(1, 2)))), "'noon' is no date and time"),
        (data("<a>" * 201, "</a>" * 201), "elements more than 200 deep"),
        (data(placemark(f"<name>{'x' * 2_000_000}</name>")), "a text of more than 1048576 letters"),
        (data(placemark(line("1" * 2_000_000))), "a text of more than 1048576 letters"),
        (data(placemark(track(coord("1" * 1_100_000, 2)))), "a text of more than 1048576 letters"),
        (data(placemark(WALK)), "no 'mood' to keep; its points have: alt"),
    ],
)
def test_damaged_or_dangerous_files_are_refused_in_one_line(file, says):
    keep = ["mood"] if "mood" in says else []
    with pytest.raises(InputError) as caught:
        read_logs(io.BytesIO(file), format="kml", keep=keep)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "iso-8859-1"])
def test_encodings_and_marks_are_read(encoding):
    text = "\n" * (encoding == "utf-8") + HEAD + placemark(WALK, name="Zürich") + END
    declared = text.replace('"UTF-8"', f'"{encoding.removesuffix("-sig")}"')
    log = read_kml(Source("walk.kml", data=declared.encode(encoding)), Request())
    assert log.ids == ("Zürich",)


def test_a_placemark_or_folder_may_be_the_root():
    for text in (placemark(WALK), f"<Folder>{placemark(WALK)}</Folder>"):
        source = Source("walk.kml", data=text.replace("gx:", "").encode())
        assert format_for_reading(source).name == "kml"
        assert read_kml(source, Request()).coordinates.tolist() == PLACES


# Against an independent parse


NUMBERS = st.one_of(
    st.floats(-89, 89).map(lambda value: f"{value:.7f}"), st.sampled_from(["x", "1.2.3", "7"])
)
SPACE = st.sampled_from(["", " ", "\n\t"])
TIMES = st.integers(0, 10**8).map(date)


@st.composite
def tracks(draw):
    count = draw(st.integers(0, 4))
    whens = [f"<when>{draw(SPACE)}{draw(TIMES)}</when>" for _ in range(count)]
    coords = [
        f"<gx:coord>{draw(SPACE)}{draw(NUMBERS)} {draw(NUMBERS)}{draw(st.sampled_from(['', ' 5']))}"
        "</gx:coord>"
        for _ in range(count)
    ]
    if draw(st.booleans()):
        return track(*whens, *coords)
    return track(*(part for pair in zip(whens, coords, strict=True) for part in pair))


@st.composite
def lines(draw):
    comma = f"{draw(SPACE)},{draw(SPACE)}"
    positions = draw(st.lists(st.tuples(NUMBERS, NUMBERS), max_size=4))
    return line(draw(SPACE) + "\n ".join(comma.join(numbers) for numbers in positions))


@st.composite
def files(draw):
    parts = []
    for _ in range(draw(st.integers(1, 3))):
        shapes = draw(st.lists(st.one_of(tracks(), lines()), max_size=3))
        name = draw(st.sampled_from(["a", "Z&#xfc;rich", None]))
        parts.append(placemark(f"<MultiGeometry>{''.join(shapes)}</MultiGeometry>", name=name))
        if draw(st.booleans()):
            parts[-1] = f"<Folder><name>f</name>{parts[-1]}</Folder>"
    return data(*parts)


@examples(80)
@given(file=files())
def test_all_points_come_out_as_an_independent_parse_has_them(file):
    expected = [
        row for place in ET.fromstring(file).iter(f"{KML}Placemark") for row in _expected(place)
    ]
    source = Source("walk.kml", data=file)
    if not any(math.isfinite(lat + lon) for _, lat, lon in expected):
        with pytest.raises(InputError):
            read_kml(source, Request())
        return
    log = read_kml(source, Request())
    np.testing.assert_array_equal(log.coordinates, [[lat, lon] for _, lat, lon in expected])
    np.testing.assert_array_equal(log.times, [time for time, *_ in expected])
    assert len(log.ids) == len(set(log.ids))


KML, GX = "{http://www.opengis.net/kml/2.2}", "{http://www.google.com/kml/ext/2.2}"


def _expected(place):
    """Time, latitude and longitude of the points of a placemark."""
    for part in place.iter():
        if part.tag == f"{GX}Track":
            whens = [datetime.fromisoformat(w.text.strip()) for w in part.iter(f"{KML}when")]
            coords = [coord.text.split() for coord in part.iter(f"{GX}coord")]
            for time, (lon, lat, *_) in zip(whens, coords, strict=True):
                yield time.timestamp(), _number(lat), _number(lon)
        elif part.tag == f"{KML}coordinates":
            for position in re.sub(r"\s*,\s*", ",", part.text or "").split():
                lon, lat = position.split(",")
                yield math.nan, _number(lat), _number(lon)


def _number(text):
    return float(text) if re.fullmatch(r"-?[0-9]+(\.[0-9]+)?", text) else math.nan
