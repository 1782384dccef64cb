"""GPX, KML and TCX read in batches: the same logs as read at once."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from gpszip.errors import InputError
from gpszip.io.large.store import store_logs
from gpszip.io.logs.formats import format_named
from gpszip.io.logs.raw import Request
from gpszip.io.logs.read import read_logs
from gpszip.io.storage.source import Source
from random_tests import examples


def date(second):
    return f"2024-05-04T{second // 3600:02d}:{second // 60 % 60:02d}:{second % 60:02d}Z"


class Gpx:
    """How GPX writes tracks, segments and points."""

    name, start, end = "gpx", "<gpx><wpt lat='1' lon='2'/>", "</gpx>"

    def point(self, second, lon, hr):
        time = "" if second is None else f"<time>{date(second)}</time>"
        rate = "" if hr is None else f"<hr>{hr}</hr>"
        return f"<trkpt lat='48.{lon}' lon='11.{lon}'>{time}{rate}</trkpt>"

    def track(self, name, segments):
        title = "" if name is None else f"<name>{name}</name>"
        inner = "".join(f"<trkseg>{''.join(segment)}</trkseg>" for segment in segments)
        return f"<trk>{inner}{title}</trk>"


class Tcx(Gpx):
    """How TCX writes activities, laps and trackpoints."""

    name = "tcx"
    start = "<TrainingCenterDatabase><CoursePoint/>"
    end = "</TrainingCenterDatabase>"

    def point(self, second, lon, hr):
        time = "" if second is None else f"<Time>{date(second)}</Time>"
        rate = "" if hr is None else f"<HeartRateBpm><Value>{hr}</Value></HeartRateBpm>"
        position = f"<LatitudeDegrees>48.{lon}</LatitudeDegrees>"
        position += f"<LongitudeDegrees>11.{lon}</LongitudeDegrees>"
        return f"<Trackpoint>{time}<Position>{position}</Position>{rate}</Trackpoint>"

    def track(self, name, segments):
        title = "" if name is None else f"<Id>{name}</Id>"
        tracks = "".join(f"<Lap><Track>{''.join(s)}</Track></Lap>" for s in segments)
        return f"<Activity>{title}{tracks}</Activity>"


class Kml(Gpx):
    """How KML writes placemarks and tracks."""

    name, start = "kml", "<kml><Placemark><Point><coordinates>1,2</coordinates></Point></Placemark>"
    end = "</kml>"

    def point(self, second, lon, hr):
        time = "" if second is None else f"<when>{date(second)}</when>"
        return f"{time}<coord>11.{lon} 48.{lon}</coord>|{'' if hr is None else hr}"

    def track(self, name, segments):
        title = "" if name is None else f"<name>{name}</name>"
        tracks = ""
        for segment in segments:
            points = [point.split("|") for point in segment]
            values = "".join(f"<value>{hr}</value>" for _, hr in points)
            array = f"<SimpleArrayData name='hr'>{values}</SimpleArrayData>"
            tracks += f"<Track>{''.join(coord for coord, _ in points)}{array}</Track>"
        return f"<Placemark><MultiTrack>{tracks}</MultiTrack>{title}</Placemark>"


RATES = st.sampled_from([60, 61.5, None, "high"])
SEGMENTS = st.lists(
    st.lists(st.tuples(st.booleans(), st.integers(0, 9), RATES), max_size=6), max_size=3
)
TRACKS = st.lists(
    st.tuples(st.sampled_from([None, "a", "b"]), st.sampled_from([0.0, 1.0]), SEGMENTS), max_size=4
)


def write(kind, tracks):
    """A file of tracks; the times of a track increase, and a track may have none."""
    parts = []
    for name, timed, segments in tracks:
        second, written = 0, []
        for segment in segments:
            written.append([])
            for has_time, lon, hr in segment:
                second += 1
                time = second if timed and (has_time or kind.name == "kml") else None
                written[-1].append(kind.point(time, lon, hr))
        parts.append(kind.track(name, written))
    return (kind.start + "".join(parts) + kind.end).encode()


@pytest.mark.parametrize("kind", [Gpx(), Tcx(), Kml()], ids=lambda kind: kind.name)
def test_batches_are_the_log_that_is_read_at_once(kind, monkeypatch):
    for module in ("xml.point_collector", "kml.collector"):
        monkeypatch.setattr(f"gpszip.io.logs.{module}.BATCH_POINTS", 3)
    log_format = format_named(kind.name)

    @examples(80, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(TRACKS, st.sampled_from([(), ("hr",)]))
    def check(tracks, keep):
        request = Request(keep=keep)
        source = Source("walk.xml", data=write(kind, tracks))
        try:
            whole = log_format.read(source, request)
        except InputError as error:
            refused = None
            try:
                opened = log_format.read_batches(source, request)
                refused = opened is None
            except InputError as other:
                assert str(other) == str(error)
            # What is refused for all of its points is refused when all batches were read.
            assert refused is not False or "that can be read" in str(error)
            return

        # All batches together have the rows of the whole.
        batches = list(log_format.read_batches(source, request).batches)
        first = 1
        for batch in batches:
            assert batch.ids == whole.ids
            assert batch.first == first
            first += len(batch.times)
        assert set().union(*(batch.untimed for batch in batches)) == whole.untimed
        for column in ("times", "coordinates"):
            joined = np.concatenate([getattr(batch, column) for batch in batches])
            np.testing.assert_array_equal(joined, getattr(whole, column))
        if whole.ids:
            codes = np.concatenate([batch.codes for batch in batches])
            assert codes.tolist() == whole.codes.tolist()
        for name, values in whole.attributes.items():
            joined = np.concatenate([batch.attributes[name] for batch in batches])
            np.testing.assert_array_equal(joined, values)
        assert batches[-1].left_out == whole.left_out

    check()


@pytest.mark.parametrize("kind", [Gpx(), Tcx(), Kml()], ids=lambda kind: kind.name)
def test_logs_larger_than_memory_have_the_same_tracks(kind, tmp_path, monkeypatch):
    for module in ("xml.point_collector", "kml.collector"):
        monkeypatch.setattr(f"gpszip.io.logs.{module}.BATCH_POINTS", 700)
    points = [[(True, (i * i) % 10, 60 + i % 7) for i in range(1500)]] * 2
    path = tmp_path / f"walk.{kind.name}"
    path.write_bytes(write(kind, [("a", True, points), ("b", True, points), ("a", False, points)]))
    expected = {track.id: track for track in read_logs(path, keep=["hr"]).tracks}
    with store_logs(path, rows=1000, keep=["hr"]) as log:
        assert {track.id for track in log.tracks} == expected.keys()
        for track in log.tracks:
            stored = log.read(track)
            assert stored.times.tolist() == expected[track.id].times.tolist()
            assert np.abs(stored.positions - expected[track.id].positions).max() < 1e-6


def test_points_with_times_of_kml_are_read_at_once(tmp_path):
    points = "".join(
        f"<Placemark><TimeStamp><when>{date(i)}</when></TimeStamp><Point><coordinates>11.{i % 10},"
        "48.5</coordinates></Point></Placemark>"
        for i in range(2000)
    )
    path = tmp_path / "walk.kml"
    path.write_text(f"<kml><Folder><name>bus</name>{points}</Folder></kml>")
    source = Source("walk.kml", path=path)
    assert format_named("kml").read_batches(source, Request()) is None
    with store_logs(path, rows=1000) as log:
        (track,) = log.tracks
        assert (track.id, len(log.read(track).times)) == ("bus", 2000)
