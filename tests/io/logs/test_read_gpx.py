import io
import math
import re
import xml.etree.ElementTree as ET
from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError, UnknownFormatError
from gpszip.io.logs.formats import format_for_reading
from gpszip.io.logs.gpx.read import read_gpx
from gpszip.io.logs.raw import Request, UnreadableCell
from gpszip.io.logs.read import read_logs
from gpszip.io.storage.source import Source
from random_tests import examples

HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n<gpx version="1.1" creator="test" xmlns="http://www.topografix.com/GPX/1/1">'


def point(lat, lon, time, more=""):
    return (
        f'<trkpt lat="{lat}" lon="{lon}">{more}'
        + (f"<time>{time}</time>" if time else "")
        + "</trkpt>"
    )


def track(*segments, name=None):
    title = "" if name is None else f"<name>{name}</name>"
    return (
        f"<trk>{title}"
        + "".join(f"<trkseg>{''.join(segment)}</trkseg>" for segment in segments)
        + "</trk>"
    )


def read(*parts, head=HEAD, **options):
    return read_logs(io.BytesIO((head + "".join(parts) + "</gpx>").encode()), **options)


def raw(*parts, head=HEAD, encoding="utf-8", **request):
    """What the reader hands over, before anything is mended."""
    data = (head + "".join(parts) + "</gpx>").encode(encoding)
    return read_gpx(Source("walk.gpx", data=data), Request(**request))


T = "2023-11-14T22:13:20Z"
A = point(50, 8, "2023-11-14T22:13:20.077Z", "<ele>100.5</ele>")
B = point(50.00000123, 8, "2023-11-14T23:13:21+01:00")
C = point(50.1, 8, "2023-11-14T22:15:00")


def test_segments_follow_each_other_with_milliseconds_and_zones():
    reading = read(track([A, B], [C], name="Zürich &amp; back"))
    (only,) = reading.tracks
    assert only.id == "Zürich & back"
    assert only.times.tolist() == [1700000000.077, 1700000001.0, 1700000100.0]
    assert reading.geographic
    assert np.isclose(np.diff(only.positions[:, 1])[0], 0.1368, atol=1e-3)
    assert reading.dropped_columns == ("ele",)


def test_height_can_be_kept_by_any_of_its_names():
    for name in ("ele", "alt"):
        heights = read(track([A, B]), keep=[name]).tracks[0].attributes[name]
        assert heights[0] == 100.5
        assert np.isnan(heights[1])


def test_heights_that_cant_be_read_leave_the_others():
    # The first heights of a receiver without a fix; NaN is one that is not known.
    heights = ["---", "", "NaN", "100.5", "-0.5", "x" * 99]
    points = [point(50, 8 + i / 1e4, T, f"<ele>{h}</ele>") for i, h in enumerate(heights)]
    log = raw(track(points), heights=True)
    assert log.attributes["ele"][[3, 4]].tolist() == [100.5, -0.5]
    assert np.isnan(log.attributes["ele"][[0, 1, 2, 5]]).all()
    (repair,) = log.repairs
    assert (repair.what, repair.count) == ("heights that can't be read left out", 2)
    assert (repair.where, repair.value) == ("walk.gpx: point 1", "ele '---'")

    # A column that somebody names keeps its texts; without any number there is no height.
    assert raw(track(points), keep=("ele",)).attributes["ele"][0] == "---"
    assert raw(track(points[:3]), heights=True).dropped_columns == ("ele",)


def test_what_is_not_kept_is_named_and_what_is_not_there_refused():
    more = "<hdop>1.5</hdop><extensions><speed>3.5</speed></extensions>"
    some = track([A.replace("</trkpt>", more + "</trkpt>"), C])
    assert read(some).dropped_columns == ("ele", "hdop", "speed")
    assert read(some, keep=["hdop"]).tracks[0].attributes["hdop"][0] == 1.5
    assert read(some, keep=["hdop"]).dropped_columns == ("ele", "speed")
    with pytest.raises(InputError, match="no 'vdop' to keep; its points have: ele, hdop, speed"):
        read(some, keep=["vdop"])
    with pytest.raises(InputError, match="its points have: position and time only"):
        read(track([C]), keep=["time"])


def test_tracks_of_one_name_are_numbered_and_nameless_ones_named_after_the_file(tmp_path):
    reading = read(track([A], name="Run"), track([B], name="Run"), track([C]))
    assert [t.id for t in reading.tracks] == ["Run", "Run-2", "stream-3"]
    assert read(track([A])).tracks[0].id == "0"
    for name in ("mon", "tue"):
        (tmp_path / f"{name}.gpx").write_text(HEAD + track([A]) + "</gpx>")
    assert [t.id for t in read_logs(str(tmp_path / "*.gpx")).tracks] == ["mon", "tue"]


def test_titles_of_several_files_are_not_one_track(tmp_path):
    (tmp_path / "a.gpx").write_text(HEAD + track([A, B], name="Run") + "</gpx>")
    (tmp_path / "b.gpx").write_text(HEAD + track([C], name="Run") + "</gpx>")
    assert [t.id for t in read_logs(str(tmp_path / "*.gpx")).tracks] == ["Run", "Run-2"]


def test_empty_tracks_do_not_shift_the_names():
    reading = read(track(name="planned"), track([A, B], name="driven"))
    assert [t.id for t in reading.tracks] == ["driven"]


def test_waypoints_are_named_as_left_out():
    extra = (
        '<wpt lat="1" lon="2"><name>w</name><time>2020-01-01T00:00:00Z</time></wpt>'
        '<wpt lat="1" lon="2"/>'
    )
    reading = read(extra, track([A]))
    assert [left.name for left in reading.left_out] == ["stream: 2 waypoints"]
    with pytest.raises(InputError, match="no track points, only 2 waypoints; GPSZip reads tracks"):
        read(extra)


def test_points_without_a_time_among_others_are_counted():
    reading = read(track([A, point(50, 8, None), B]))
    assert (reading.points, reading.kept, reading.lost) == (3, 2, 1)
    assert reading.repairs[0].where == "stream: point 2"


def test_times_that_go_back_name_the_point():
    with pytest.raises(InputError, match="point 2: time goes back"):
        read(track([C, B]))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (HEAD + track([A, B])[:-60], "damaged GPX"),
        ('<!DOCTYPE x [<!ENTITY a "b">]>' + HEAD, "XML, but of no format that is read"),
        (HEAD.replace("<gpx", "<!DOCTYPE gpx><gpx") + "</gpx>", "line 2: has a document type"),
        (HEAD + "</gpx>", "no track points"),
    ],
)
def test_damaged_or_dangerous_files_are_refused_in_one_line(text, says):
    with pytest.raises(InputError) as caught:
        read_logs(io.BytesIO(text.encode()))
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_content_counts_not_the_name(tmp_path):
    path = tmp_path / "walk.csv"
    path.write_text(HEAD + track([A]) + "</gpx>")
    assert len(read_logs(path).tracks) == 1


@pytest.mark.parametrize(
    "more",
    [
        "<course>271.5</course>",
        "<extensions><gpxtpx:TrackPointExtension><gpxtpx:course> 271.5 </gpxtpx:course>"
        "</gpxtpx:TrackPointExtension></extensions>",
    ],
    ids=["1.0", "extension"],
)
def test_the_course_is_a_heading_where_it_is_asked_for(more):
    head = HEAD.replace(
        "<gpx ", '<gpx xmlns:gpxtpx="http://www.garmin.com/xmlschemas/TrackPointExtension/v2" '
    )
    points = [
        "<!-- <trkpt> -->",
        point(50, 8, "2023-11-14T22:13:20Z", more),
        point(50.1, 8, "2023-11-14T22:14:20Z"),
    ]
    (only,) = read(track(points), head=head, heading=True).tracks
    np.testing.assert_array_equal(only.attributes["heading"], [271.5, np.nan])
    assert not read(track(points), head=head).tracks[0].attributes


def test_points_without_a_course_have_no_headings():
    assert not read(track([A, B]), heading=True).tracks[0].attributes


# Positions


@pytest.mark.parametrize(
    ("lat", "unread"),
    [
        ('lat="undefined"', UnreadableCell("lat", 1, "undefined")),
        ('lat="NaN"', UnreadableCell("lat", 1, "NaN")),
        ('lat="48.1371abc"', UnreadableCell("lat", 1, "48.1371abc")),
        ('lat="48,1371"', UnreadableCell("lat", 1, "48,1371")),
        ('lat="48°99\'"', UnreadableCell("lat", 1, "48°99'")),
        ('lat=""', UnreadableCell("lat", 1, "")),
        ("", UnreadableCell("lat", 1, "no lat")),
    ],
)
def test_a_position_that_cannot_be_read_is_named_and_no_part_of_it_is_read(lat, unread):
    odd = A.replace('lat="50"', lat)
    log = raw(track([C.replace('lat="50.1"', 'lat="50.5"'), odd, B, odd]))
    assert log.unreadable == (unread,)
    assert log.coordinates[[0, 2]].tolist() == [[50.5, 8], [50.00000123, 8]]
    assert np.isnan(log.coordinates[[1, 3], 0]).all()
    reading = read(track([A, odd, C]))
    assert (reading.points, reading.kept, reading.lost) == (3, 2, 1)
    assert reading.repairs[0].what == "points without a position dropped"


@pytest.mark.parametrize(
    "lat", [" 50.5\n", "+50.5", "5.05e1", "50.5N", "N 50°30'", "50:30:00", "50° 30' 0&quot; N"]
)
def test_complete_forms_of_a_coordinate_are_read(lat):
    log = raw(track([A, point(lat, 8, "2024-01-01T00:00:00Z")]))
    assert log.coordinates[1].tolist() == [50.5, 8]
    assert not log.unreadable


def test_a_decimal_comma_is_read_where_all_points_have_it():
    points = [
        point("48,1371", "11,575", "2024-01-01T00:00:00Z", "<ele>512,5</ele>"),
        point("48,2", "-11", "2024-01-01T00:00:01Z"),
    ]
    log = raw(track(points), keep=("ele",))
    assert log.coordinates.tolist() == [[48.1371, 11.575], [48.2, -11]]
    np.testing.assert_array_equal(log.attributes["ele"], [512.5, np.nan])


def test_a_file_without_any_position_or_usable_point_is_refused_with_its_first_value():
    with pytest.raises(
        InputError, match=r"no point has a position that can be read; the first has lat='undefined'"
    ) as caught:
        raw(track([point("undefined", 8, "2024-01-01T00:00:00Z")]))
    assert "--columns" not in str(caught.value)
    with pytest.raises(InputError, match="no point has both a position and a time"):
        raw(track([point(50, 8, ""), point("x", 8, "2024-01-01T00:00:00Z")]))


# Times


@pytest.mark.parametrize("written", ["\n  {}\n", "<!-- when -->{}", "<![CDATA[{}]]>", "{}<?now?>"])
def test_white_space_comments_and_sections_around_a_time_do_not_matter(written):
    times = ["2024-05-04T08:00:00Z", "2024-05-04T08:00:10.25Z"]
    log = raw(
        track(
            [
                f'<trkpt lat="50" lon="8"><time>{written.format(time)}</time></trkpt>'
                for time in times
            ]
        )
    )
    assert log.times.tolist() == [1714809600, 1714809610.25]


def test_a_track_with_times_that_cannot_be_read_is_no_shape():
    log = raw(track([A, point(50, 8, "noon"), C]))
    assert log.unreadable == (UnreadableCell("time", 1, "noon"),)
    assert np.isnan(log.times).tolist() == [False, True, False]
    with pytest.raises(InputError, match="noon"):
        raw(track([point(50, 8, "noon"), point(51, 8, "noon")]))
    other = raw(track([A], name="timed"), track([point(50, 8, "noon")], name="odd"))
    assert not other.untimed


def test_times_as_numbers_are_read_in_their_unit():
    points = [point(50, 8, 1714809600000), point(50, 8, 1714809605500)]
    assert raw(track(points)).times.tolist() == [1714809600, 1714809605.5]
    assert raw(track([point(50, 8, 7), point(50, 8, 8)]), time_unit="ms").times.tolist() == [
        0.007,
        0.008,
    ]


# Tracks, routes and shapes


P, Q = point(1, 2, None), point(3, 4, None)
ROUTE = '<rte><name>plan</name><rtept lat="5" lon="6"/><rtept lat="7" lon="8"/></rte>'


def test_routes_and_tracks_without_times_are_shapes_beside_tracks_with_times():
    log = raw(
        ROUTE,
        track([A, B], [C], name="driven"),
        track([P, Q], name="drawn"),
        track([Q, P], name="plan"),
    )
    assert log.ids == ("plan", "driven", "drawn", "plan-2")
    assert log.codes.tolist() == [0, 0, 1, 1, 1, 2, 2, 3, 3]
    assert log.untimed == {0, 2, 3}
    assert np.isnan(log.times).tolist() == [True] * 2 + [False] * 3 + [True] * 4
    assert log.coordinates[:2].tolist() == [[5, 6], [7, 8]]
    assert not log.unreadable
    assert not log.left_out


def test_each_segment_of_a_shape_is_a_separate_shape():
    log = raw(track([P, Q], [], [Q], name="a"), track([P], name="a-2"))
    assert (log.ids, log.codes.tolist(), log.untimed) == (
        ("a", "a-2", "a-2-2"),
        [0, 0, 1, 2],
        {0, 1, 2},
    )
    assert raw(track([P], [Q])).ids == ("walk", "walk-2")


def test_a_single_nameless_track_has_no_name():
    for segments in ([A], [P, Q]):
        log = raw(track(segments))
        assert (log.ids, log.codes) == ((), None)
    assert log.untimed == {0}
    blank = raw(track([A], name=" "), '<rte><rtept lat="1" lon="2"/></rte>')
    assert (blank.ids, blank.untimed) == (("walk-1", "walk-2"), {1})


def test_blank_times_are_no_times():
    assert raw(
        track(
            ['<trkpt lat="1" lon="2"><time> </time></trkpt><trkpt lat="1" lon="2"><time/></trkpt>']
        )
    ).untimed == {0}


def test_times_of_a_route_are_reported_as_not_read():
    timed = ROUTE.replace("/></rte>", "><time>2024-05-04T08:00:00Z</time></rtept></rte>")
    log = raw(track([A]), timed)
    assert log.untimed == {1}
    (repair,) = log.repairs
    assert (repair.count, repair.drops, repair.where, repair.value) == (
        1,
        False,
        "walk.gpx: point 3",
        "time '2024-05-04T08:00:00Z'",
    )


def test_points_outside_tracks_and_names_after_points_are_read():
    log = raw(
        f"<trk><trkseg>{A}</trkseg><name>late</name><name>later</name></trk>",
        f"<trkseg>{C}</trkseg>{C}",
    )
    assert (log.ids, log.codes.tolist()) == (("late", "walk-2"), [0, 1, 1])


@pytest.mark.parametrize(
    "name",
    [
        "../../etc/passwd",
        "<script>alert(1)</script>",
        "tab\tline\nend",
        "\u202ert\u0085l",
        "a" * 5000,
        " a ",
    ],
)
def test_names_come_back_letter_by_letter(name):
    escaped = name.replace("&", "&amp;").replace("<", "&lt;")
    assert raw(track([A], name=escaped)).ids == (name,)


# What else points have


GARMIN = (
    "<extensions><{0}TrackPointExtension><{0}atemp>21</{0}atemp><{0}hr>{1}</{0}hr><{0}cad>90</{0}cad></{0}TrackPointExtension>"
    "<power>250</power><osmand:speed>3.5</osmand:speed><time>elsewhere</time><mood>fine</mood></extensions>"
)


@pytest.mark.parametrize("prefix", ["gpxtpx:", "ns3:", ""])
def test_elements_of_extensions_are_columns_under_any_prefix(prefix):
    first = A.replace("</trkpt>", GARMIN.format(prefix, 120) + "</trkpt>")
    keep = ("hr", "heart_rate", "cadence", "temperature", "power", "speed", "mood", "ele")
    log = raw(track([first, C]), keep=keep)
    expected = dict(zip(keep, [120, 120, 90, 21, 250, 3.5, None, 100.5], strict=True))
    for name in set(keep) - {"mood"}:
        np.testing.assert_array_equal(log.attributes[name], [expected[name], np.nan], name)
    assert log.attributes["mood"].tolist() == ["fine", ""]
    assert log.dropped_columns == ()
    assert log.times.tolist() == [1700000000.077, 1700000100.0]
    assert raw(track([first, C])).dropped_columns == (
        "ele",
        "atemp",
        "hr",
        "cad",
        "power",
        "speed",
        "mood",
    )


def test_the_first_of_several_values_counts_and_links_are_none():
    more = (
        "<link><text>x</text></link><hr> </hr><hr>1</hr>"
        "<extensions><hr>2</hr><HR>3</HR><text>t</text></extensions>"
    )
    log = raw(track([A.replace("</trkpt>", more + "</trkpt>"), C]), keep=("hr", "text"))
    np.testing.assert_array_equal(log.attributes["hr"], [1, np.nan])
    assert log.attributes["text"].tolist() == ["t", ""]
    assert log.dropped_columns == ("ele",)


def test_a_kept_column_is_numbers_only_where_all_of_it_is():
    points = [
        point(50, 8, f"2024-01-01T00:00:0{i}Z", f"<ele>{ele}</ele>")
        for i, ele in enumerate(["1.5", "NaN", "low"])
    ]
    np.testing.assert_array_equal(
        raw(track(points[:2]), keep=("alt",)).attributes["alt"], [1.5, np.nan]
    )
    assert raw(track(points), keep=("alt",)).attributes["alt"].tolist() == ["1.5", "NaN", "low"]


# Which files are GPX


@pytest.mark.parametrize(
    "head",
    [
        "<gpx>",
        '\n <?xml version="1.0"?><?xml-stylesheet type="text/xsl" href="d.xsl"?>'
        "<!-- <kml> --><gpx>",
        '<gpx version="1.0" xmlns="http://www.topografix.com/GPX/1/0">',
        '<gpx xmlns="http://example.org/not-gpx" '
        'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:schemaLocation="a b">',
        "<GPX>",
    ],
)
def test_any_namespace_and_what_stands_before_the_root_are_fine(head):
    data = (
        head
        + track([A, B])
        + head[head.rindex("<") : head.rindex("<") + 4].replace("<", "</")
        + ">"
    ).encode()
    source = Source("walk.xml", data=data)
    assert format_for_reading(source).name == "gpx"
    assert read_gpx(source, Request()).times.tolist() == [1700000000.077, 1700000001.0]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('<?xml version="1.0"?>\n<osm version="0.6"></osm>', "OpenStreetMap's"),
        ("<!DOCTYPE html><html><br></html>", "a web page"),
        ("<svg><path/></svg>", "'svg'; 'gpszip formats' lists what can be read"),
        ("<!--" + "x" * 300_000 + "--><gpx/>", "--format gpx"),
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_other_xml_is_named_with_a_remedy(text, says, encoding):
    with pytest.raises(UnknownFormatError) as caught:
        format_for_reading(Source("walk.gpx", data=text.encode(encoding)))
    assert says in str(caught.value)


# Against an independent parse


DEGREES = st.one_of(
    st.floats(-89, 89).map(lambda value: f"{value:.7f}"),
    st.integers(-80, 80).map(str),
    st.sampled_from(["", "undefined", "NaN", "1.2.3", "12x", "--5", "0x10", "1ee", "inf", "١٢"]),
)
TIMES = st.one_of(
    st.integers(0, 2_000_000_000).map(
        lambda t: datetime.fromtimestamp(t, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    ),
    st.sampled_from([None, "", "never"]),
)
SPACE = st.sampled_from(["", "", " ", "\n\t"])
BETWEEN = st.sampled_from(["", "", "\n", "<!-- <trkpt lat='1' lon='2'/> -->", "<?pi <trkpt?>"])
ENCODINGS = st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "iso-8859-1", "windows-1252"])


@st.composite
def points(draw, tag):
    sides = [
        f'{name}="{draw(SPACE)}{text}{draw(SPACE)}"'
        for name in ("lat", "lon")
        if (text := draw(st.none() | DEGREES)) is not None
    ]
    attributes = draw(st.permutations([*sides, *draw(st.sampled_from([[], ["id='7'"]]))]))
    time = draw(TIMES)
    parts = draw(
        st.permutations(
            [
                "<p:ele>1</p:ele>",
                *([] if time is None else [f"<p:time>{draw(SPACE)}{time}{draw(SPACE)}</p:time>"]),
            ]
        )
    )
    return f"<p:{' '.join([tag, *attributes])}>{draw(BETWEEN).join(parts)}</p:{tag}>"


@st.composite
def files(draw):
    prefix, encoding = draw(st.sampled_from(["", "g:", "x1:"])), draw(ENCODINGS)
    parts = ["<p:wpt lat='1' lon='1'/>"] * draw(st.integers(0, 2))
    for _ in range(draw(st.integers(1, 4))):
        name = draw(
            st.sampled_from(["", "<p:name>Zürich &amp; Öst</p:name>", "<p:name>b</p:name>"])
        )
        if draw(st.booleans()):
            segments = draw(st.lists(st.lists(points("trkpt"), max_size=4), max_size=3))
            inner = "".join(
                f"<p:trkseg>{draw(BETWEEN).join(segment)}</p:trkseg>" for segment in segments
            )
            parts.append(f"<p:trk>{name}{inner}</p:trk>")
        else:
            parts.append(
                f"<p:rte>{name}{''.join(draw(st.lists(points('rtept'), max_size=4)))}</p:rte>"
            )
    body = draw(BETWEEN).join(draw(st.permutations(parts)))
    declared = (
        encoding.removesuffix("-sig") if "utf" not in encoding or draw(st.booleans()) else None
    )
    head = f'<?xml version="1.0" encoding="{declared}"?>' if declared else ""
    space = f' xmlns{":" if prefix else ""}{prefix.rstrip(":")}="http://www.topografix.com/GPX/1/1"'
    text = head + f"<p:gpx{space}>{body}</p:gpx>"
    return (
        text.replace("<p:", f"<{prefix}")
        .replace("</p:", f"</{prefix}")
        .encode(encoding, "xmlcharrefreplace")
    )


@examples(60)
@given(data=files())
def test_all_points_come_out_as_an_independent_parse_has_them(data):
    root = ET.fromstring(data)
    of = "{*}"
    found = root.findall(f".//{of}trkpt") + root.findall(f".//{of}rtept")
    source = Source("walk.gpx", data=data)
    assert format_for_reading(source).name == "gpx"
    timed = [
        t
        for t in root.findall(f"{of}trk")
        if any((e.text or "").strip() for e in t.iter() if e.tag.endswith("}time"))
    ]
    expected = [
        _expected(point, parent in timed)
        for parent in root
        for point in parent.iter()
        if point.tag[-5:] in ("trkpt", "rtept")
    ]
    assert len(expected) == len(found)
    usable = [
        e for e in expected if math.isfinite(e[0] + e[1]) and (math.isfinite(e[2]) or not e[3])
    ]
    readable = not timed or any(math.isfinite(e[2]) for e in expected)
    if not usable or not readable:
        with pytest.raises(InputError):
            read_gpx(source, Request())
        return
    log = read_gpx(source, Request())
    np.testing.assert_array_equal(log.coordinates, [[lat, lon] for lat, lon, _, _ in expected])
    np.testing.assert_array_equal(log.times, [time for _, _, time, _ in expected])
    codes = np.zeros(len(expected), int) if log.codes is None else log.codes
    assert [code not in log.untimed for code in codes.tolist()] == [
        is_timed for *_, is_timed in expected
    ]
    assert len(log.ids) == len(set(log.ids))


def _expected(point, timed):
    """Latitude, longitude and time of a point, and whether it is of a track with times."""
    lat, lon = (_number(point.get(name) or "") for name in ("lat", "lon"))
    time = (point.findtext("{*}time") or "").strip()
    readable = timed and time.startswith(("1", "2"))
    return lat, lon, datetime.fromisoformat(time).timestamp() if readable else math.nan, timed


def _number(text):
    return float(text) if re.fullmatch(r"\s*[-+]?[0-9]+(\.[0-9]+)?\s*", text) else math.nan
