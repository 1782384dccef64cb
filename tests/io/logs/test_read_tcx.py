import io
import math
import re
import xml.etree.ElementTree as ET
from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError
from gpszip.io.logs.formats import format_for_reading
from gpszip.io.logs.raw import Request
from gpszip.io.logs.read import read_logs
from gpszip.io.logs.tcx.read import read_tcx
from gpszip.io.storage.source import Source
from random_tests import examples

HEAD = (
    '<?xml version="1.0" encoding="UTF-8"?>\n<TrainingCenterDatabase '
    'xmlns="http://www.garmin.com/xmlschemas/TrainingCenterDatabase/v2" '
    'xmlns:ns3="http://www.garmin.com/xmlschemas/ActivityExtension/v2">'
)
START = 1714809600  # 2024-05-04T08:00:00Z


def position(lat, lon):
    return (
        f"<Position><LatitudeDegrees>{lat}</LatitudeDegrees>"
        f"<LongitudeDegrees>{lon}</LongitudeDegrees></Position>"
    )


def point(second, *positions, more=""):
    time = datetime.fromtimestamp(START + second, UTC).strftime("%Y-%m-%dT%H:%M:%S.000Z")
    return f"<Trackpoint><Time>{time}</Time>{''.join(positions)}{more}</Trackpoint>"


def lap(*points):
    return f'<Lap StartTime="2024"><TotalTimeSeconds>9</TotalTimeSeconds>{track(*points)}</Lap>'


def track(*points):
    return f"<Track>{''.join(points)}</Track>"


def activity(*laps, name="2024-05-04T08:00:00Z"):
    return f'<Activity Sport="Biking"><Id>{name}</Id>{"".join(laps)}</Activity>'


def activities(*found):
    return f"<Activities>{''.join(found)}</Activities>"


def data(*parts, head=HEAD):
    return (head + "".join(parts) + "</TrainingCenterDatabase>").encode()


def raw(*parts, head=HEAD, **request):
    return read_tcx(Source("run.tcx", data=data(*parts, head=head)), Request(**request))


A, B = point(0, position(48.1, 11.5)), point(10, position(48.2, 11.6))
C = point(20, position(48.3, 11.7))
GARMIN = (
    "<AltitudeMeters>512.5</AltitudeMeters><DistanceMeters>7.5</DistanceMeters>"
    "<HeartRateBpm><Value>121</Value></HeartRateBpm><Cadence>63</Cadence>"
    "<Extensions><ns3:TPX><ns3:Speed>4.5</ns3:Speed><ns3:Watts>160</ns3:Watts></ns3:TPX>"
    "</Extensions>"
)


def test_laps_and_tracks_of_an_activity_are_one_track():
    log = raw(activities(activity(lap(A), lap(B) + track(C), name="run &amp; ride")))
    assert (log.ids, log.codes.tolist()) == (("run & ride",), [0, 0, 0])
    assert log.times.tolist() == [START, START + 10, START + 20]
    assert log.coordinates.tolist() == [[48.1, 11.5], [48.2, 11.6], [48.3, 11.7]]
    assert not log.untimed


def test_each_activity_and_transition_of_a_multisport_session_is_a_track():
    session = (
        f"<MultiSportSession><Id>session</Id><FirstSport>{activity(lap(A), name='swim')}"
        f"</FirstSport><NextSport><Transition StartTime='2024'>{track(B)}</Transition>"
        f"{activity(lap(C), name='bike')}</NextSport></MultiSportSession>"
    )
    log = raw(activities(session))
    assert (log.ids, log.codes.tolist()) == (("swim", "run-2", "bike"), [0, 1, 2])


def test_courses_are_shapes_and_their_times_and_points_are_reported():
    course_point = f"<CoursePoint><Name>left</Name>{position(1, 2)}</CoursePoint>"
    course = f"<Course><Name>plan</Name><Lap/>{track(A, B)}{course_point}</Course>"
    log = raw(f"<Courses>{course}</Courses>")
    assert (log.ids, log.untimed, len(log.times)) == (("plan",), {0}, 2)
    assert np.isnan(log.times).all()
    (repair,) = log.repairs
    assert repair.what == "times of course points not read, as courses are shapes"
    assert (repair.count, repair.drops) == (2, False)
    assert [(left.name, left.reason) for left in log.left_out] == [
        ("run.tcx: 1 course point", "not a track")
    ]


def test_trackpoints_without_a_position_are_dropped_and_counted():
    file = data(activities(activity(lap(A, point(5, more=GARMIN), B))))
    reading = read_logs(io.BytesIO(file))
    assert (reading.points, reading.kept, reading.lost) == (3, 2, 1)
    (repair,) = reading.repairs
    assert (repair.what, repair.where) == ("points without a position dropped", "stream: point 2")
    assert reading.tracks[0].times.tolist() == [START, START + 10]


def test_a_workout_without_any_position_is_refused():
    with pytest.raises(InputError, match="none of 2 trackpoints has a position, as of a workout"):
        raw(activities(activity(lap(point(0), point(1, more=GARMIN)))))
    with pytest.raises(InputError, match="no trackpoint; GPSZip reads activities and courses"):
        raw("<Workouts/>")


def test_the_first_of_several_positions_counts_and_the_others_are_reported():
    odd = point(5, position(48.15, 11.55), position(1, 2), position(3, 4))
    log = raw(activities(activity(lap(A, odd, B))))
    assert log.coordinates[1].tolist() == [48.15, 11.55]
    (repair,) = log.repairs
    assert (repair.what, repair.count, repair.drops) == (
        "positions after the first one of a trackpoint not read",
        2,
        False,
    )


def test_positions_that_cannot_be_read_are_no_positions():
    log = raw(activities(activity(lap(A, point(5, position("no", "undefined")), B))))
    assert np.isnan(log.coordinates[1]).all()
    assert [(cell.column, cell.row, cell.value) for cell in log.unreadable] == [
        ("lat", 1, "no"),
        ("lon", 1, "undefined"),
    ]


def test_sensors_and_extensions_are_kept_by_the_names_of_other_formats():
    keep = ("ele", "altitude", "hr", "HeartRateBpm", "cad", "distance", "speed", "power")
    measured = point(0, position(48.1, 11.5), more=GARMIN)
    log = raw(activities(activity(lap(measured, B))), keep=keep)
    expected = (512.5, 512.5, 121, 121, 63, 7.5, 4.5, 160)
    for name, value in zip(keep, expected, strict=True):
        np.testing.assert_array_equal(log.attributes[name], [value, np.nan], name)
    assert log.dropped_columns == ()
    assert raw(activities(activity(lap(measured, B)))).dropped_columns == (
        "ele",
        "distance",
        "hr",
        "Cadence",
        "Speed",
        "Watts",
    )
    with pytest.raises(InputError, match="no 'mood' to keep; its points have: ele, distance, hr"):
        raw(activities(activity(lap(measured, B))), keep=("mood",))


def test_blanks_before_the_declaration_and_prefixes_do_not_matter():
    head = "\n   " + HEAD.replace("<Training", "<t:Training").replace("xmlns=", "xmlns:t=")
    text = head + activities(activity(lap(A, B)))
    text = re.sub(r"<(/?)(?=[A-Z])", r"<\1t:", text) + "</t:TrainingCenterDatabase>"
    source = Source("run.xml", data=text.encode())
    assert format_for_reading(source).name == "tcx"
    assert read_tcx(source, Request()).times.tolist() == [START, START + 10]


@pytest.mark.parametrize(
    ("file", "says"),
    [
        (data(activities(activity(lap(A, B))))[:-60], "damaged TCX: the file ends within"),
        (
            data(head=HEAD.replace("<Tr", "<!DOCTYPE a [<!ENTITY b 'c'>]><Tr")),
            "line 2: has a document type (<!DOCTYPE), which no TCX file needs; remove it",
        ),
        (
            data(activities(activity(lap(A.replace("</Trackpoint>", B + "</Trackpoint>"))))),
            "a <Trackpoint> within a point",
        ),
    ],
)
def test_damaged_or_dangerous_files_are_refused_in_one_line(file, says):
    with pytest.raises(InputError) as caught:
        read_logs(io.BytesIO(file), format="tcx")
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


# Against an independent parse


DEGREES = st.one_of(
    st.floats(-89, 89).map(lambda value: f"{value:.7f}"),
    st.sampled_from(["", " 7 ", "undefined", "1.2.3", "--5"]),
)
POINTS = st.builds(
    lambda second, side, more: point(second, *side, more=more),
    st.integers(0, 10**8),
    st.lists(st.builds(position, DEGREES, DEGREES), max_size=1),
    st.sampled_from(["", GARMIN]),
)
LAPS = st.lists(st.lists(POINTS, max_size=4).map(lambda points: lap(*points)), max_size=3)
FILES = st.lists(
    st.tuples(LAPS, st.sampled_from(["run", "Z&#xfc;rich", ""])).map(
        lambda parts: activity(*parts[0], name=parts[1])
    ),
    max_size=3,
).map(lambda found: data(activities(*found)))


@examples(60)
@given(file=FILES)
def test_all_points_come_out_as_an_independent_parse_has_them(file):
    expected = [
        _expected(number, point)
        for number, parent in enumerate(ET.fromstring(file).iterfind(".//{*}Activity"))
        for point in parent.iterfind(".//{*}Trackpoint")
    ]
    source = Source("run.tcx", data=file)
    if not any(math.isfinite(lat + lon) for _, _, lat, lon in expected):
        with pytest.raises(InputError):
            read_tcx(source, Request())
        return
    log = read_tcx(source, Request())
    np.testing.assert_array_equal(log.times, [time for _, time, _, _ in expected])
    np.testing.assert_array_equal(log.coordinates, [[lat, lon] for *_, lat, lon in expected])
    codes = np.zeros(len(expected), int) if log.codes is None else log.codes
    parents = [parent for parent, *_ in expected]
    assert codes.tolist() == [sorted(set(parents)).index(parent) for parent in parents]


def _expected(parent, point):
    """Number of its activity, time, latitude and longitude of a trackpoint."""
    time = datetime.fromisoformat(point.findtext("{*}Time")).timestamp()
    sides = (point.findtext(f"{{*}}Position/{{*}}{name}Degrees") for name in SIDES)
    return parent, time, *(_number(side or "") for side in sides)


SIDES = ("Latitude", "Longitude")


def _number(text):
    return float(text) if re.fullmatch(r"\s*-?[0-9]+(\.[0-9]+)?\s*", text) else math.nan
