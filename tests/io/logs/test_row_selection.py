"""Selections while logs are read, in memory and on disk."""

import io
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gpszip
from gpszip.errors import InputError, OptionError, UnknownTrackError
from gpszip.io.large.store import store_logs
from gpszip.io.logs.collect import collect_log
from gpszip.io.logs.file_collector import CleaningOptions
from gpszip.io.logs.log_file import open_log_files
from gpszip.io.logs.log_format import LogBatches
from gpszip.io.logs.memory_rows import MemoryRows
from gpszip.io.logs.raw import Request
from gpszip.io.logs.read import read_logs
from gpszip.io.logs.row_selection import rows_in_box
from gpszip.model.selection import BoundingBox, Selection


def _csv(rows, header="track_id,t,x,y"):
    return "\n".join([header, *(",".join(map(str, row)) for row in rows)]).encode()


def _read(data, selection, **options):
    """Tracks in memory; those on disk must be the same."""
    result = read_logs(io.BytesIO(data), selection=selection, **options)
    with store_logs(io.BytesIO(data), rows=1000, selection=selection, **options) as stored:
        on_disk = [stored.read(track) for track in stored.tracks]
        assert stored.read_result.points == result.points
    assert [track.id for track in on_disk] == [track.id for track in result.tracks]
    for stored_track, track in zip(on_disk, result.tracks, strict=True):
        np.testing.assert_array_equal(stored_track.times, track.times)
        np.testing.assert_array_equal(stored_track.positions, track.positions)
    assert result.points == result.kept + result.lost
    return result


BACK_AND_FORTH = _csv([("bus", t, abs(t % 8 - 4), 0) for t in range(17)])


def test_a_time_range_includes_both_ends():
    (track,) = _read(BACK_AND_FORTH, Selection(since=3, until=6)).tracks
    assert track.times.tolist() == [3, 4, 5, 6]


def test_a_track_that_leaves_the_area_and_returns_starts_a_new_one():
    result = _read(BACK_AND_FORTH, Selection(bbox=BoundingBox(2, -1, 9, 1)))
    assert {track.id: track.times.tolist() for track in result.tracks} == {
        "bus": [0, 1, 2],
        "bus-2": [6, 7, 8, 9, 10],
        "bus-3": [14, 15, 16],
    }


def test_where_a_track_left_is_known_in_the_next_batch():
    """Batches of one row each."""
    (file,) = open_log_files(io.BytesIO(BACK_AND_FORTH), None, Request(), in_batches=False)
    (raw,) = file.batches()
    singles = [
        replace(
            raw,
            codes=raw.codes[row : row + 1],
            times=raw.times[row : row + 1],
            coordinates=raw.coordinates[row : row + 1],
            first=raw.first + row,
        )
        for row in range(len(raw.times))
    ]
    file = replace(file, opened=LogBatches(iter(singles)))
    options = CleaningOptions(selection=Selection(bbox=BoundingBox(2, -1, 9, 1)))
    log = collect_log([file], MemoryRows(), options)
    assert [track.name for track in log.tracks] == ["bus", "bus-2", "bus-3"]


def test_a_name_stands_for_all_its_tracks():
    rows = [("a", 5, 0, 0), ("a", 6, 1, 0), ("b", 0, 0, 0), ("a", 1, 5, 5), ("a", 2, 5, 6)]
    result = _read(_csv(rows), Selection(tracks=("a",)), split=True)
    assert [(track.id, len(track)) for track in result.tracks] == [("a", 2), ("a-2", 2)]
    assert result.points == 4
    result = _read(_csv(rows), Selection(tracks=("a-2",)), split=True)
    assert [track.id for track in result.tracks] == ["a-2"]


def test_the_track_of_a_log_without_names_has_the_name_of_the_archive():
    data = _csv([(0, 0, 0), (1, 1, 0)], "t,x,y")
    assert [track.id for track in _read(data, Selection(tracks=("0",))).tracks] == ["0"]


def test_rows_that_cannot_be_used_are_counted_still():
    rows = [("a", 0, 0, 0), ("a", 1, "", 0), ("a", 2, 2, 0), ("a", 3, 3, 0), ("a", 9, 9, 0)]
    result = _read(_csv(rows), Selection(since=2, until=4))
    assert (result.points, result.kept, result.lost) == (3, 2, 1)


def test_losses_of_tracks_that_nobody_asked_for_are_not_told():
    rows = [("a", t, t, 0) for t in range(30)] + [
        ("b", t, t if t % 2 else "", 0) for t in range(30)
    ]
    assert len(_read(_csv(rows), Selection()).losses) == 1
    assert not _read(_csv(rows), Selection(tracks=("a",))).losses


def test_what_is_not_there_is_an_error():
    with pytest.raises(UnknownTrackError, match="no track 'tram' in the log; it has 'bus'"):
        _read(BACK_AND_FORTH, Selection(tracks=("tram",)))
    with pytest.raises(InputError, match="no point is selected; the log has 0 s to 16 s"):
        _read(BACK_AND_FORTH, Selection(since=17))
    with pytest.raises(InputError, match="in the box 50,0,60,1"):
        _read(BACK_AND_FORTH, Selection(bbox=BoundingBox(50, 0, 60, 1)))
    with pytest.raises(OptionError, match="--sort and --bbox"):
        _read(BACK_AND_FORTH, Selection(bbox=BoundingBox(0, 0, 9, 1)), sort=True)


def test_a_shape_has_no_time_that_could_be_in_a_range(tmp_path):
    gpx = """<gpx version="1.1" creator="x"><trk><name>walk</name><trkseg>
    <trkpt lat="1" lon="2"><time>2024-05-01T00:00:00Z</time></trkpt>
    <trkpt lat="1.001" lon="2"><time>2024-05-01T00:01:00Z</time></trkpt></trkseg></trk>
    <rte><name>plan</name><rtept lat="1" lon="2"/><rtept lat="1.1" lon="2"/></rte></gpx>"""
    path = tmp_path / "walk.gpx"
    path.write_text(gpx)
    assert [track.id for track in gpszip.read(path)] == ["walk", "plan"]
    assert [track.id for track in gpszip.read(path, since="2024-01-01")] == ["walk"]
    assert [track.id for track in gpszip.read(path, bbox=(1.9, 0.9, 2.1, 1.0))] == ["walk", "plan"]


@given(
    st.integers(-180, 180),
    st.integers(0, 360),
    st.lists(st.floats(-720, 720), min_size=1, max_size=5),
)
def test_longitudes_are_inside_whatever_their_turn(west, width, longitudes):
    lon = np.array(longitudes)
    rows = np.stack([np.zeros(len(lon)), lon], axis=1)
    east = (west + width + 180) % 360 - 180 if width < 360 else west + 360
    inside = rows_in_box(rows, BoundingBox(west, -1, east, 1), geographic=True)
    for value, found in zip(lon, inside, strict=True):
        east_of_west = (value - west) % 360
        near_a_side = min(east_of_west, 360 - east_of_west, abs(east_of_west - width)) < 1e-6
        assert near_a_side or found == (east_of_west < width)
