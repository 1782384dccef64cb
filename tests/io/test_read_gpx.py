import io

import numpy as np
import pytest

from gpszip.errors import InputError
from gpszip.io.reading import read_logs

HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n<gpx version="1.1" creator="test" xmlns="http://www.topografix.com/GPX/1/1">'


def point(lat, lon, time, more=""):
    return f'<trkpt lat="{lat}" lon="{lon}">{more}' + (f"<time>{time}</time>" if time else "") + "</trkpt>"


def track(*segments, name=None):
    title = "" if name is None else f"<name>{name}</name>"
    return f"<trk>{title}" + "".join(f"<trkseg>{''.join(segment)}</trkseg>" for segment in segments) + "</trk>"


def read(*parts, head=HEAD, **options):
    return read_logs(io.BytesIO((head + "".join(parts) + "</gpx>").encode()), **options)


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
    assert reading.dropped == ("ele",)


def test_height_can_be_kept_by_any_of_its_names():
    for name in ("ele", "alt"):
        heights = read(track([A, B]), keep=[name]).tracks[0].attributes[name]
        assert heights[0] == 100.5
        assert np.isnan(heights[1])


def test_what_is_not_kept_is_named_and_what_is_not_there_refused():
    more = "<hdop>1.5</hdop><extensions><speed>3.5</speed></extensions>"
    some = track([A.replace("</trkpt>", more + "</trkpt>"), C])
    assert read(some).dropped == ("ele", "extensions")
    assert read(some, keep=["hdop"]).tracks[0].attributes["hdop"][0] == 1.5
    with pytest.raises(InputError, match="no 'speed' to keep; its points have: ele, hdop"):
        read(some, keep=["speed"])


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


def test_routes_and_waypoints_are_named_as_left_out():
    extra = '<wpt lat="1" lon="2"><name>w</name></wpt><wpt lat="1" lon="2"/><rte><rtept lat="1" lon="2"/></rte>'
    reading = read(extra, track([A]))
    assert [left.name for left in reading.left_out] == ["stream: 2 waypoints", "stream: 1 routes"]
    with pytest.raises(InputError, match="no track points, only 2 waypoints and 1 routes"):
        read(extra)


def test_points_without_a_time_are_counted_and_a_file_without_times_refused():
    reading = read(track([A, point(50, 8, None), B]))
    assert (reading.points, reading.kept, reading.lost) == (3, 2, 1)
    assert reading.repairs[0].where == "stream: point 2"
    with pytest.raises(InputError, match="no point has a time"):
        read(track([point(50, 8, None)]))


def test_times_that_go_back_name_the_point():
    with pytest.raises(InputError, match="point 2: time goes back"):
        read(track([C, B]))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (HEAD + track([A, B])[:-60], "damaged GPX"),
        ('<!DOCTYPE x [<!ENTITY a "b">]>' + HEAD, "XML, but not GPX"),
        (HEAD.replace("<gpx", '<!-- --><gpx a="<!DOCTYPE"'), "which no GPX file needs"),
        (HEAD + "<!--<OGRVRTDataSource>--></gpx>", "which no GPX file needs"),
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
        "<extensions><gpxtpx:TrackPointExtension><gpxtpx:course> 271.5 </gpxtpx:course></gpxtpx:TrackPointExtension></extensions>",
    ],
    ids=["1.0", "extension"],
)
def test_the_course_is_a_heading_where_it_is_asked_for(more):
    head = HEAD.replace("<gpx ", '<gpx xmlns:gpxtpx="http://www.garmin.com/xmlschemas/TrackPointExtension/v2" ')
    points = ["<!-- <trkpt> -->", point(50, 8, "2023-11-14T22:13:20Z", more), point(50.1, 8, "2023-11-14T22:14:20Z")]
    (only,) = read(track(points), head=head, heading=True).tracks
    np.testing.assert_array_equal(only.attributes["heading"], [271.5, np.nan])
    assert not read(track(points), head=head).tracks[0].attributes


def test_points_without_a_course_have_no_headings():
    assert not read(track([A, B]), heading=True).tracks[0].attributes
