"""The report on a history: its numbers, its sentences, and its page."""

import html
import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

import gpszip
from gpszip.errors import OptionError, OutputError
from gpszip.view.report.report import build_report
from gpszip.view.report.sections import _write_places, _write_speeds
from guard_log import NAME, ODD_ROUND, ROUNDS, START, guard_archive, guard_findings, guard_track

SECTIONS = ["map", "places", "activity", "edges", "changes", "unusual", "rounds"]
SECTIONS += ["prediction", "doubt"]


@pytest.fixture(scope="module")
def told():
    return build_report(guard_findings(), guard_archive(), NAME)


def without_map(page):
    return re.sub(r'srcdoc="[^"]*"', "", page)


def test_numbers_are_those_of_the_history(told):
    numbers, rows = told.numbers, guard_findings().history.traversals
    assert numbers["travel"]["metres"] == pytest.approx(rows.metres.sum(), abs=0.1)
    assert sum(numbers["hours"]) == pytest.approx(rows.metres.sum(), abs=1)
    assert sum(numbers["activity"]["metres"]) == pytest.approx(rows.metres.sum(), abs=1)
    assert sum(numbers["activity"]["trips"]) == numbers["trips"]["trips"] == ROUNDS
    assert (numbers["period"]["days"], numbers["period"]["timezone"]) == (2, "Europe/Berlin")

    # Edges by their traversals, and hours of the local clock: 21 h is the first.
    counts = [edge["forward"] + edge["backward"] for edge in numbers["edges"]]
    assert counts == sorted(counts, reverse=True)
    assert numbers["edges"][0]["edge"] == np.bincount(rows.edge).argmax()
    assert numbers["activity"]["starts"][0] == "2024-01-01 21:00"
    assert {each["hour"] for each in numbers["speeds"]} >= {21, 22, 23, 0}

    # The round with the short cut, which is a part of the one before it.
    trip = guard_findings().trips.trips[ODD_ROUND]
    assert numbers["unusual"]["rows"][0]["start"] == pytest.approx(trip.start, abs=0.01)
    assert numbers["rounds"]["rounds"] == ROUNDS - 2
    late = [each["late_s"] for each in numbers["rounds"]["rows"]]
    assert late == sorted(late, reverse=True)
    assert late[0] > 900


def test_speeds_by_hour_are_weighted_by_metres(told):
    """A plain search for the median: half of all metres are travelled at this speed or slower."""
    rows = guard_findings().history.traversals
    hours = guard_findings().calendar.part("hour", rows.enter)
    speeds = rows.metres / (rows.leave - rows.enter - rows.standing)
    for each in told.numbers["speeds"]:
        own = hours == each["hour"]
        slower = rows.metres[own][speeds[own] <= each["speed"] + 1e-3].sum()
        faster = rows.metres[own][speeds[own] >= each["speed"] - 1e-3].sum()
        assert min(slower, faster) >= 0.5 * rows.metres[own].sum() - 1e-6
        assert each["traversals"] == own.sum()


def test_the_page_has_all_sections_and_names_are_text(told):
    page = without_map(told.html)
    assert re.findall(r'<section id="(\w+)"', page) == SECTIONS
    assert NAME not in page
    assert f"<h1>{html.escape(NAME)}</h1>" in page
    assert f'<td class="left">{html.escape(NAME)}</td>' in page
    assert "16 trips" in page
    assert "<script" not in page


def test_the_map_is_the_page_of_the_archive_with_the_same_policy(told):
    page = html.unescape(re.search(r'srcdoc="([^"]*)"', told.html).group(1))
    assert '"history":{"zone":"Europe/Berlin"' in page
    policy = r'http-equiv="Content-Security-Policy" content="([^"]*)"'
    inner, outer = (re.findall(policy, each)[0] for each in (page, told.html))
    assert inner == outer
    assert "connect-src 'none'" in inner
    assert not re.search(r"""(?:src|href)\s*=\s*["']?(?:https?:)?//""", told.html)


def test_pictures_are_well_formed_and_say_what_they_show(told):
    pictures = re.findall(r"<svg.*?</svg>", without_map(told.html), re.DOTALL)
    assert len(pictures) == 4  # by hour, the week, speeds, rounds
    for picture in pictures:
        tree = ElementTree.fromstring(picture)
        assert len(tree.attrib["aria-label"]) > 20
        bars = list(tree.iter("rect"))
        assert bars
        assert all(float(each.attrib["height"]) >= 0 for each in bars)


def test_what_cant_be_told_is_said():
    line = np.column_stack([np.arange(20.0) * 10, np.zeros(20)])
    shape = gpszip.Track("shape", np.arange(20.0) * 10, line, timed=False)
    told = gpszip.report(shape)
    page = without_map(told.html)
    assert re.findall(r'<section id="(\w+)"', page) == SECTIONS
    assert told.numbers["places"] is told.numbers["hours"] is told.numbers["rounds"] is None
    for sentence in (
        "1 track</strong> without times",
        "no track has times, so there are no stays and trips",
        "tracks without times have no hours",
        "travel doesn&#x27;t repeat in rounds",
    ):
        assert sentence in page
    assert "None" not in page
    assert "nan" not in page


def test_a_log_that_stands_still_says_so():
    times = START + np.arange(60.0) * 30
    told = gpszip.report(gpszip.Track("still", times, np.zeros((60, 2))))
    assert "Nothing moves in it." in told.html
    assert told.numbers["travel"] is None
    assert told.numbers["places"][0]["visits"] == 1


def test_what_is_new_since_a_time():
    trips = guard_findings().trips.trips
    since = trips[ODD_ROUND - 1].start - 60
    told = gpszip.report(guard_archive(), since=since, title="Since")
    assert told.numbers["period"]["since"] >= since
    assert told.numbers["unusual"]["trips"] == ROUNDS - ODD_ROUND + 1
    assert told.numbers["unusual"]["left_out"] == ODD_ROUND - 1
    assert f"Not scored: {ODD_ROUND - 1} earlier trip" in told.html
    with pytest.raises(OptionError, match="since lies outside"):
        gpszip.report(guard_archive(), since=START - 1)


def test_the_log_is_shown_beside_its_archive(tmp_path):
    path = tmp_path / "archive.gpsz"
    guard_archive().save(path)
    told = gpszip.report(path, raw=guard_track())
    assert told.name == "archive"
    assert f"&quot;total&quot;:{len(guard_track())}" in told.html
    with pytest.raises(OptionError, match="no archive has a track 'b'"):
        gpszip.report(guard_archive(), raw=_renamed("b"))


def _renamed(name):
    track = guard_track()
    return gpszip.Track(name, track.times, track.positions, plane=track.plane)


def test_a_report_is_written_once_and_shown_in_notebooks(told, tmp_path):
    path = tmp_path / "report.html"
    assert told.write(path) == path.stat().st_size
    with pytest.raises(OutputError):
        told.write(path)
    shown = told._repr_html_()
    assert shown.startswith('<iframe srcdoc="&lt;!DOCTYPE html&gt;')
    assert 'sandbox="allow-scripts"' in shown
    assert repr(told).startswith("HistoryReport(")


def test_jumps_and_equal_speeds_are_said():
    """A passage at 1,000 m/s has no speed, and is told; all hours have the same median."""
    history, found = guard_findings().history, guard_findings()
    rows = history.traversals
    leave, standing = rows.leave.copy(), rows.standing.copy()
    row = int(rows.metres.argmax())
    leave[row], standing[row] = rows.enter[row] + rows.metres[row] / 1000, 0.0
    jumps = replace(rows, leave=leave, standing=standing, max_speed=10.0)
    told = build_report(
        replace(found, history=replace(history, traversals=jumps)), guard_archive(), "n"
    )
    assert told.numbers["travel"]["jumps"] == 1
    assert told.numbers["travel"]["max_speed"] == 10.0
    assert max(each["speed_q3"] for each in told.numbers["speeds"]) < 10
    assert "1 traversal faster than 10.0 m/s" in without_map(told.html)

    hours = [{"hour": hour, "speed_q1": 0.9, "speed": 1.0, "speed_q3": 1.1} for hour in (3, 4)]
    said = _write_speeds(hours, fast=False)
    assert "All hours have a median of 1.0 m/s." in said
    assert "Fastest" not in said


def test_places_without_stays_are_no_stays():
    trips = {"places": 2, "stays": 0, "trips": 0}
    place = {"place": 1, "x": 0.0, "y": 0.0, "visits": 0, "dwell_s": 0.0, "usual": "", "role": ""}
    numbers = {"trips": trips, "places": [{**place, "arrivals": 0}] * 2}
    said = _write_places(numbers)
    assert "nobody stayed" in said
    assert "were spent" not in said
