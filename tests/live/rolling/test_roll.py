"""Journals that are appended to archives."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Geod

import gpszip
from gpszip.errors import BoundError, GPSZipError, OptionError, OutputError
from gpszip.live import Fix, Journal, Notices
from gpszip.live.follow import Follower
from gpszip.live.journal import Tail, segments
from gpszip.live.outbox import Outbox
from gpszip.live.rolling import roll as module
from gpszip.live.rolling.archives import open_archives
from gpszip.live.rolling.fixes import read_fixes
from gpszip.live.rolling.roll import roll
from gpszip.model import Options
from live.receiving import run
from random_tests import examples

#: 1 m of noise, so that walks are far shorter than their tracks.
OPTIONS = Options(rmse=4.0, max_error=15.0, effort=1)
START = 1.795e9

GEOD = Geod(ellps="WGS84")


def drive(agent, first, count, step=5.0, seed=0, at=(52.51, 13.4)):
    """Fixes of a bus on its round of 600 m."""
    rng = np.random.default_rng([seed, first])
    for number in range(first, first + count):
        along = 7.0 * step * number % 600
        east, north = (
            np.interp(along, [0, 200, 300, 500, 600], axis) + rng.normal()
            for axis in ([0, 200, 200, 0, 0], [0, 0, 100, 100, 0])
        )
        position = at[0] + north / 111_200, at[1] + east / 67_700
        yield Fix(agent, "test", START + step * number, START + step * number + 1, position)


def write(folder, fixes):
    journal = Journal(folder)
    journal.append(fixes)
    journal.close()


def roll_in(folder, fixes, options=OPTIONS):
    write(folder / "journal", fixes)
    return roll(folder / "journal", folder / "a.gpsz", options)


def worst_error(folder, fixes):
    """Largest distance in metres of any fix from the nearest track of its agent."""
    archives = [gpszip.open(path) for path in sorted(folder.glob("a*.gpsz"))]
    worst = 0.0
    for agent in {fix.agent for fix in fixes}:
        own = [fix for fix in fixes if fix.agent == agent]
        lat, lon = np.transpose([fix.position for fix in own])
        nearest = np.full(len(own), np.inf)
        for archive in archives:
            for name in archive.ids:
                if name == agent or name.startswith(f"{agent} ("):
                    found = archive.position(name, [fix.time for fix in own])
                    apart = GEOD.inv(lon, lat, found[:, 1], found[:, 0])[2]
                    nearest = np.fmin(nearest, apart)
        worst = max(worst, nearest.max())
    return worst


@pytest.fixture(scope="module")
def rolled(tmp_path_factory):
    """An archive of two buses, appended to once, its fixes and both reports."""
    folder = tmp_path_factory.mktemp("rolled")
    parts = [
        [*drive("a", 0, 60), *drive("b", 20, 40)],
        [*drive("a", 60, 40), *drive("b", 60, 40)],
    ]
    reports = [roll_in(folder, part) for part in parts]
    return folder, [*parts[0], *parts[1]], reports


@pytest.fixture
def copy(rolled, tmp_path):
    """A folder with a copy of that archive."""
    (tmp_path / "a.gpsz").write_bytes((rolled[0] / "a.gpsz").read_bytes())
    return tmp_path


def test_an_archive_holds_all_fixes_and_the_journal_none(rolled):
    folder, fixes, reports = rolled
    assert [(each.fixes, each.known, each.late, each.segments) for each in reports] == [
        (100, 0, 0, 1),
        (80, 0, 0, 1),
    ]
    assert segments(folder / "journal") == []
    archive = gpszip.open(folder / "a.gpsz")
    assert archive.ids == ("a", "b")
    assert str(archive.error_bound) == "RMSE <= 4 m, maximum <= 15 m"
    assert worst_error(folder, fixes) <= 15.05


def test_what_is_archived_already_is_not_appended_again(rolled, copy):
    _, fixes, _ = rolled
    before = (copy / "a.gpsz").read_bytes()
    report = roll_in(copy, fixes[::-1])
    assert (report.fixes, report.known, report.archives) == (len(fixes), len(fixes), [])
    assert (copy / "a.gpsz").read_bytes() == before
    assert segments(copy / "journal") == []


def test_late_fixes_get_tracks_of_their_own(rolled, copy):
    _, fixes, _ = rolled
    # Before the first fix of b, elsewhere between fixes of a, and in the order of time after it.
    late = [
        *drive("b", 0, 20),
        *(Fix("a", "test", START + t + 2.5, 0.0, (52.52, 13.41)) for t in (100, 105, 110)),
    ]
    new = [*drive("a", 100, 20), *late[::-1]]
    report = roll_in(copy, new)
    assert (report.fixes, report.late) == (43, 23)
    assert gpszip.open(copy / "a.gpsz").ids == ("a", "b", "a (2)", "b (2)")
    assert worst_error(copy, [*fixes, *new]) <= 15.05

    # Later ones still go on where those end, and earlier ones don't.
    even_later = [
        Fix("a", "test", START + 2.5, 0.0, (52.53, 13.41)),
        Fix("a", "test", START + 300.5, 0.0, (52.53, 13.41)),
    ]
    assert roll_in(copy, even_later).late == 2
    archive = gpszip.open(copy / "a.gpsz")
    assert set(archive.ids) == {"a", "b", "a (2)", "b (2)", "a (3)"}
    assert worst_error(copy, [*fixes, *new, *even_later]) <= 15.05


def test_a_kill_before_the_journal_is_deleted_costs_nothing(rolled, copy, monkeypatch):
    _, fixes, _ = rolled
    new = list(drive("a", 100, 20))
    with monkeypatch.context() as patch:
        patch.setattr(module, "mark_archived", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            roll_in(copy, new)
    assert len(segments(copy / "journal")) == 1
    report = roll(copy / "journal", copy / "a.gpsz", OPTIONS)
    assert (report.fixes, report.known, report.segments) == (20, 20, 1)
    assert worst_error(copy, [*fixes, *new]) <= 15.05


def test_the_journal_stays_unless_the_archive_is_proved_to_hold_it(copy, monkeypatch):
    from gpszip.pipeline import append

    def forgetful(archive, tracks, options, progress):
        return archive, None

    monkeypatch.setattr(append, "append", forgetful)
    with pytest.raises(BoundError, match="does not hold all fixes of 'a'"):
        roll_in(copy, drive("a", 100, 20))
    assert len(segments(copy / "journal")) == 1


def test_places_too_far_for_the_map_get_an_archive_of_their_own(rolled, copy):
    _, fixes, _ = rolled
    sydney = (-33.86, 151.2)
    new = [*drive("a", 100, 10), *drive("a", 200, 20, at=sydney), *drive("a", 300, 10)]
    report = roll_in(copy, new)
    assert [name.rsplit("/", 1)[1] for name in report.archives] == ["a.gpsz", "a-2.gpsz"]
    assert worst_error(copy, [*fixes, *new]) <= 15.05
    # Both are appended to.
    more = [*drive("a", 400, 10), *drive("a", 500, 20, at=sydney)]
    assert len(roll_in(copy, more).archives) == 2
    assert len(open_archives(copy / "a.gpsz")) == 2
    assert worst_error(copy, [*fixes, *new, *more]) <= 15.05


def test_what_an_archive_cannot_take_goes_to_another_one(copy, monkeypatch):
    from gpszip.pipeline import append

    def refuse(archive, tracks, options, progress):
        raise BoundError("too coarse")

    monkeypatch.setattr(append, "append", refuse)
    new = list(drive("a", 100, 20))
    report = roll_in(copy, new, Options(effort=1))
    assert report.archives == [str(copy / "a-2.gpsz")]
    # It has the bound of the first one.
    bounds = [archive.error_bound for _, archive in open_archives(copy / "a.gpsz")]
    assert bounds[0] == bounds[1]
    assert worst_error(copy, new) <= 15.05


def test_archives_that_nothing_can_be_appended_to_are_refused(copy):
    metres = Fix("a", "test", 7.0, 8.0, (1.0, 2.0), geographic=False)
    with pytest.raises(OptionError, match="journal is in metres, the archive in degrees"):
        roll_in(copy, [metres])
    assert len(segments(copy / "journal")) == 1
    line = gpszip.Track("a", range(9), [[float(t), 0.0] for t in range(9)])
    for options, reason in [
        ({"rmse": 1.0}, "no maximum error"),
        ({"max_error": 1.0, "times": False}, "without times"),
        ({"max_error": 1.0, "keep_times": True}, "keeps columns"),
    ]:
        gpszip.compress(line, effort=1, **options).save(copy / "other.gpsz", force=True)
        with pytest.raises(OptionError, match=reason):
            roll(copy / "journal", copy / "other.gpsz", OPTIONS)


def test_robots_have_planes(tmp_path):
    fixes = [
        Fix("r", "test", float(t), 9.0, (min(t, 10.0), max(t - 10.0, 0.0), 1.0), geographic=False)
        for t in range(20)
    ]
    roll_in(tmp_path, fixes[:12], Options(max_error=0.1, effort=1))
    roll_in(tmp_path, fixes[12:], Options(effort=1))
    archive = gpszip.open(tmp_path / "a.gpsz")
    found = archive.position("r", [fix.time for fix in fixes])
    assert np.linalg.norm(found - [fix.position for fix in fixes], axis=1).max() <= 0.1001


def test_heights_are_neither_made_up_nor_asked_for(tmp_path):
    def move(agent, first, last, *height):
        times = range(first, last)
        positions = [(float(t), 1.0, *height) for t in times]
        return [
            Fix(agent, "test", float(t), 9.0, position, geographic=False)
            for t, position in zip(times, positions, strict=True)
        ]

    bound = Options(max_error=0.1, effort=1)
    roll_in(tmp_path, move("r", 0, 10, 5.0), bound)
    report = roll_in(tmp_path, move("r", 10, 20) + move("s", 0, 10), bound)
    assert report.archives == [str(tmp_path / "a-2.gpsz")]
    first, second = (gpszip.open(tmp_path / name) for name in ("a.gpsz", "a-2.gpsz"))
    assert (first.grid.dimension, second.grid.dimension) == (3, 2)
    assert second.ids == ("r", "s")

    # Both take more of their kind; what is known is known.
    report = roll_in(tmp_path, move("s", 5, 20), bound)
    assert (report.known, report.archives) == (5, [str(tmp_path / "a-2.gpsz")])
    write(tmp_path / "mixed", move("r", 0, 3, 5.0) + move("r", 3, 6))
    fixes, _ = read_fixes(segments(tmp_path / "mixed"), Tail())
    assert fixes["r"].coordinates.tolist() == [[t, 1.0] for t in range(6)]


def test_an_archive_that_is_none_is_named(tmp_path):
    (tmp_path / "a.gpsz").write_text("none")
    with pytest.raises(GPSZipError, match=r"a\.gpsz: not a"):
        roll_in(tmp_path, drive("a", 0, 5))


def test_a_new_archive_needs_a_bound(tmp_path):
    with pytest.raises(OptionError, match="needs a bound"):
        roll_in(tmp_path, drive("a", 0, 5), Options(effort=1))
    assert len(segments(tmp_path / "journal")) == 1


def test_an_rmse_alone_gets_a_maximum(tmp_path):
    roll_in(tmp_path, drive("a", 0, 20), Options(rmse=5.0, effort=1))
    assert gpszip.open(tmp_path / "a.gpsz").error_bound.max_error == 20.0


def test_the_last_segment_belongs_to_its_writer(tmp_path):
    journal = Journal(tmp_path / "journal")
    journal.append(drive("a", 0, 10))
    assert roll(tmp_path / "journal", tmp_path / "a.gpsz", OPTIONS).segments == 0
    journal.rotate()
    journal.append(drive("a", 10, 10))
    assert roll(tmp_path / "journal", tmp_path / "a.gpsz", OPTIONS).fixes == 10
    journal.close()
    assert len(segments(tmp_path / "journal")) == 1


def test_segments_without_fixes_are_deleted(tmp_path):
    for number, data in enumerate(
        [b"", b"gpszip jour", b"gpszip journal 1\n", b"gpszip journal 1\nx"]
    ):
        (tmp_path / f"{number + 1:08}.log").write_bytes(data)
    report = roll(tmp_path, tmp_path / "a.gpsz", Options())
    assert (report.segments, report.fixes, report.archives) == (4, 0, [])
    assert segments(tmp_path) == []


def test_one_process_archives_a_journal(tmp_path):
    lock = module.Lock(tmp_path, "rolling")
    assert lock.acquire()
    with pytest.raises(OutputError, match="another process archives"):
        roll(tmp_path, tmp_path / "a.gpsz", OPTIONS)
    lock.release()


rows = st.tuples(
    st.sampled_from(["a", "b"]),
    st.integers(0, 5),
    st.integers(0, 3),
    st.none() | st.sampled_from([3.0, 7.0]),
)


@examples(20)
@given(st.lists(st.lists(rows, min_size=1, max_size=6), min_size=1, max_size=3))
def test_fixes_are_sorted_and_the_most_accurate_of_a_time_is_taken(tmp_path_factory, batches):
    folder = tmp_path_factory.mktemp("sorted")
    journal = Journal(folder)
    twin = {}
    for batch in batches:
        fixes = [
            Fix(agent, "test", float(time), 0.0, (float(east), 1.0), accuracy=accuracy)
            for agent, time, east, accuracy in batch
        ]
        journal.append(fixes)
        journal.rotate()
        for fix in fixes:
            known = twin.setdefault(fix.agent, {}).get(fix.time)
            mine = np.inf if fix.accuracy is None else fix.accuracy
            if known is None or mine < known[0]:
                twin[fix.agent][fix.time] = mine, fix.position
    journal.close()
    found, geographic = read_fixes(segments(folder), Tail())
    assert geographic
    assert list(found) == sorted(twin)
    for agent, known in twin.items():
        assert found[agent].times.tolist() == sorted(known)
        assert found[agent].coordinates.tolist() == [list(known[t][1]) for t in sorted(known)]


def robot(first, count, x, mark=""):
    """Fixes of a robot that drives east at 1 m/s, as its map has them."""
    for number in range(first, first + count):
        quality = mark if number == first else ""
        at = x + number - first, 0.0
        yield Fix("r", "test", float(number), number + 1.0, at, geographic=False, quality=quality)


def test_no_way_is_made_of_a_break(tmp_path):
    # A break within a segment, one at the start of a segment, and what goes on then.
    options = Options(max_error=0.5, effort=1)
    first = [*robot(0, 20, 0.0), *robot(20, 20, 500.0, "break")]
    roll_in(tmp_path, first, options)
    more = [*robot(40, 20, 900.0, "break"), *robot(60, 5, 0.0, "arrival break"), *robot(65, 5, 5.0)]
    roll_in(tmp_path, more, options)
    roll_in(tmp_path, list(robot(70, 10, 10.0)), options)

    archive = gpszip.open(tmp_path / "a.gpsz")
    assert archive.ids == ("r", "r (2)", "r (3)", "r (4)")
    for name, begin, end, x in [
        ("r", 0, 19, 0.0),
        ("r (2)", 20, 39, 500.0),
        ("r (3)", 40, 59, 900.0),
        ("r (4)", 60, 79, 0.0),
    ]:
        times = np.arange(begin, end + 1.0)
        found = archive.position(name, times)
        assert np.abs(found[:, 0] - (x + times - begin)).max() <= 0.501
        assert np.isnan(archive.position(name, [begin - 0.5, end + 0.5])).all()

    # A late fix from after the first break is no way from before it.
    late = Fix("r", "test", 25.5, 90.0, (503.0, 0.0), geographic=False)
    report = roll_in(tmp_path, [late, *robot(80, 1, 20.0)], options)
    assert (report.fixes, report.late) == (2, 2)
    archive = gpszip.open(tmp_path / "a.gpsz")
    assert archive.position("r (5)", [25.5])[0, 0] == pytest.approx(503.0, abs=0.501)
    assert np.isnan(archive.position("r", [19.5])).all()
    assert archive.position("r (4)", [80.0])[0, 0] == pytest.approx(20.0, abs=0.501)


def test_too_many_breaks_begin_no_tracks(tmp_path, monkeypatch):
    from gpszip.live.rolling import archives

    monkeypatch.setattr(archives, "_MAX_BROKEN_PARTS", 2)
    options = Options(max_error=0.5, effort=1)
    for number in range(4):
        roll_in(tmp_path, list(robot(10 * number, 10, 10.0 * number, "break")), options)
    assert gpszip.open(tmp_path / "a.gpsz").ids == ("r", "r (2)")


def test_segments_stay_until_their_events_are_found(rolled, copy):
    _, fixes, _ = rolled
    journal = Journal(copy / "journal")
    notices = Notices(lambda _line: None)
    outbox = Outbox(journal.folder, {}, notices)

    # A listener that is killed before it has read anything.
    Follower(journal, gpszip.Monitor(), outbox, notices)
    journal.append(fixes)
    journal.advance()
    report = roll(journal.folder, copy / "a.gpsz", OPTIONS)
    assert (report.segments, report.waiting) == (0, 1)
    journal.close()
    with pytest.raises(OptionError, match="ended before it found the events") as error:
        roll(journal.folder, copy / "a.gpsz", OPTIONS)
    assert str(journal.folder / "monitor") in error.value.remedy
    assert len(segments(journal.folder)) == 2

    # The next one reads them.
    run(Follower(journal, gpszip.Monitor(), outbox, notices).finish(is_over=False))
    run(outbox.close())
    report = roll(journal.folder, copy / "a.gpsz", OPTIONS)
    assert (report.segments, report.waiting, report.known) == (2, 0, len(fixes))
    assert segments(journal.folder) == []
