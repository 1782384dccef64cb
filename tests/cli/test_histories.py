"""Commands that ask what was: wrong and sloppy questions to archives and logs."""

import numpy as np
import pytest

import gpszip as package

#: A guard's square round, ten times, in metres.
CORNERS = np.array([[0, 0], [90, 0], [90, 60], [0, 60]] * 10 + [[0, 0]], float)
TIMES = 30.0 * np.arange(len(CORNERS))

LOG = b"t,x,y\n0,0,0\n30,90,0\n60,90,60\n"


@pytest.fixture(scope="module")
def archives():
    """Archives of the round: flat, with heights, without times; and of tracks of two points."""
    high = np.column_stack((CORNERS, np.zeros(len(CORNERS))))
    short = [
        package.Track(str(i), [600.0 * i, 600.0 * i + 30], [[50.0 * i, 0], [50.0 * i + 50, 0]])
        for i in range(20)
    ]
    logs = {
        "flat": package.Track("guard", TIMES, CORNERS),
        "high": package.Track("guard", TIMES, high),
        "untimed": package.Track("guard", TIMES, CORNERS, timed=False),
        "dated": package.Track("guard", TIMES + 1.7e9, CORNERS),
        "short": short,
    }
    return {name: package.compress(tracks, max_error=1, effort=1) for name, tracks in logs.items()}


@pytest.fixture(autouse=True)
def files(archives, tmp_path):
    """These archives, and two logs, in the folder of each test."""
    for name, archive in archives.items():
        archive.save(tmp_path / f"{name}.gpsz")
    (tmp_path / "log.csv").write_bytes(LOG)
    (tmp_path / "point.csv").write_text("t,x,y\n0,0,0\n")


@pytest.mark.parametrize(
    "command",
    [
        "usage - -",
        "usage - --likelihood -",
        "usage - --map -",
        "rounds - -",
        "trips - -",
        "changes - -",
        "predict - -",
        "unusual - --map -",
        "route - 0,0 90,0 --map -",
    ],
)
def test_standard_input_is_read_once(gpszip, command):
    done = gpszip(command, data=LOG)
    assert (done.code, done.out) == (2, "")
    assert "standard input is named twice" in done.err


@pytest.mark.parametrize(
    "command",
    [
        "usage flat.gpsz -o a.csv --transitions ./a.csv",
        "rounds flat.gpsz -o a.csv --edges a.csv",
        "trips flat.gpsz -o a.csv --places a.csv",
    ],
)
def test_two_tables_need_two_files(gpszip, tmp_path, command):
    done = gpszip(command)
    assert done.code == 2
    assert "same file" in done.err
    assert not (tmp_path / "a.csv").exists()


def test_standard_input_beside_other_logs(gpszip):
    for command in ("usage", "trips"):
        facts = gpszip(f"{command} - log.csv --json", data=LOG).json
        assert facts["read"]["points_read"] == 6


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("route flat.gpsz nan,0 90,0", "no position"),
        ("route flat.gpsz 0,0 90,0 --depart ²:00", "no departure"),
        ("route flat.gpsz 0,0 90,0 --depart 2024-05-01", "the times of the log are none"),
        ("route short.gpsz 0,0 700,0", "half of an edge"),
        ("rounds untimed.gpsz --since 100.0", "no track has times"),
        ("changes flat.gpsz high.gpsz", "has heights"),
        ("unusual log.csv --map flat.gpsz --alarm nan", "--alarm is nan"),
    ],
)
def test_questions_without_an_answer_are_refused(gpszip, command, message):
    done = gpszip(command)
    assert (done.code, done.out) == (2, "")
    assert message in done.err


def test_departures_far_from_the_log_are_refused(gpszip):
    for depart in ("0001-01-01", "9999-12-31T23:59:59Z"):
        done = gpszip(f"route dated.gpsz 0,0 90,0 --depart {depart}")
        assert done.code == 2
        assert "a hundred years" in done.err


def test_closures_need_no_travel_times(gpszip):
    # No track travels half of an edge, so that nothing tells speeds.
    done = gpszip("changes short.gpsz --since 6000.0 --json")
    assert done.code == 0, done.err
    assert done.json["changes"] == []


def test_a_log_on_a_single_edge_has_no_likelihood(gpszip):
    done = gpszip("usage flat.gpsz --likelihood point.csv")
    assert done.code == 0, done.err
    assert "from no edge to another" in done.out
    assert "nan" not in done.out


def test_archives_without_times_tell_no_absences(gpszip):
    done = gpszip("unusual log.csv --map untimed.gpsz --json")
    assert (done.code, done.err) == (0, "")
    assert done.json["absences"] == []


@pytest.mark.parametrize("command", ["usage", "rounds", "predict", "route"])
def test_tracks_that_do_not_match_their_own_map(gpszip, command):
    # Few samples and heights: the clean map rounds off the only corner.
    corner = [[0, 0, 5], [90, 0, 5], [90, 60, 6]]
    package.compress(package.Track("a", TIMES[:3], corner), rmse=0.54, max_error=2.16).save(
        "z.gpsz"
    )
    places = " 0,0 90,60" if command == "route" else ""
    done = gpszip(f"{command} z.gpsz{places}")
    assert (done.code, done.out) == (1, "")
    assert "none of its tracks matches" in done.err
