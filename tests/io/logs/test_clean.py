import io

import numpy as np
import pytest

from gpszip.errors import InputError, OptionError
from gpszip.io.logs.read import read_logs


def read(rows, header="t,x,y", **options):
    return read_logs(io.BytesIO("\n".join([header, *rows, ""]).encode()), **options)


def test_repeated_rows_are_dropped_and_counted_apart_from_contradictions():
    reading = read(["0,0,0", "1,1,1", "1,1,1", "1,1,1", "2,2,2", "2,9,9", "2,2,2", "3,3,3"])
    assert reading.tracks[0].positions[:, 0].tolist() == [0, 1, 2, 3]
    assert {repair.what: (repair.count, repair.where) for repair in reading.repairs} == {
        "repeated rows dropped": (3, "stream: row 4"),
        "rows at another position, but the same time dropped": (1, "stream: row 7"),
    }
    assert reading.points == reading.kept + reading.lost == 8


def test_interleaved_vehicles_are_separated_by_their_ids():
    reading = read(["b,5,0,0", "a,1,1,0", "b,6,2,0", "a,2,3,0"], "vehicle,t,x,y")
    assert [
        (track.id, track.times.tolist(), track.positions[:, 0].tolist()) for track in reading.tracks
    ] == [
        ("b", [5, 6], [0, 2]),
        ("a", [1, 2], [1, 3]),
    ]


def test_time_going_back_within_one_of_the_vehicles_names_the_row_in_the_file():
    with pytest.raises(InputError, match="row 5: time goes back 5 s"):
        read(["b,5,0,0", "a,1,1,0", "b,6,2,0", "b,1,3,0"], "vehicle,t,x,y")


def test_sort_orders_each_track():
    reading = read(
        ["a,3,3,0", "b,9,0,0", "a,1,1,0", "a,2,2,0", "b,8,0,0", "a,3,7,0"], "id,t,x,y", sort=True
    )
    first, second = reading.tracks
    assert (first.id, first.times.tolist(), first.positions[:, 0].tolist()) == (
        "a",
        [1, 2, 3],
        [1, 2, 3],
    )
    assert second.times.tolist() == [8, 9]
    assert reading.kept + reading.lost == reading.points == 6
    assert [(r.count, r.drops) for r in reading.repairs if "order" in r.what] == [(2, False)]


def test_split_starts_tracks_of_new_names():
    rows = ["a,1,0,0", "a,2,0,0", "a,1,0,0", "a-2,5,0,0", "a,0,0,0"]
    reading = read(rows, "id,t,x,y", split=True)
    assert [(track.id, len(track)) for track in reading.tracks] == [
        ("a", 2),
        ("a-3", 1),
        ("a-4", 1),
        ("a-2", 1),
    ]


def test_split_of_a_log_without_names():
    assert [track.id for track in read(["1,0,0", "0,0,0", "1,0,0"], split=True).tracks] == [
        "0",
        "0-2",
    ]


def test_sort_and_split_exclude_each_other():
    with pytest.raises(OptionError, match="--sort and --split"):
        read(["0,0,0"], sort=True, split=True)


def test_a_few_positions_off_the_globe_are_dropped():
    rows = [f"{i},{i / 1000},5" for i in range(200)] + ["200,999,999"]
    reading = read(rows, "t,lat,lon")
    assert (reading.kept, reading.lost) == (200, 1)


def test_longitudes_may_run_to_360():
    reading = read(["0,10,179.999", "1,10,180.001"], "t,lat,lon")
    assert np.linalg.norm(np.diff(reading.tracks[0].positions, axis=0)) < 250


def test_clean_drops_outliers_counts_them_and_needs_no_plane_for_them():
    rows = [f"{i},{50 + i * 1e-5:.5f},8" for i in range(300)]
    rows[120] = "120,1,0"
    plain, clean = read(rows, "t,lat,lon"), read(rows, "t,lat,lon", clean=True)
    assert len(plain.tracks[0].plane.centers) == 2
    assert len(clean.tracks[0].plane.centers) == 1
    assert 120.0 not in clean.tracks[0].times.tolist()
    assert [(repair.what, repair.count) for repair in clean.repairs] == [("outliers dropped", 1)]
    assert clean.points == clean.kept + clean.lost == 300


def test_attributes_stay_with_their_rows():
    rows = ["b,2,0,0,20", "a,1,0,0,11", "b,1,0,0,10", "b,1,0,0,99", "a,,0,0,5"]
    reading = read(rows, "id,t,x,y,fuel", sort=True, keep=["fuel"])
    assert [track.attributes["fuel"].tolist() for track in reading.tracks] == [[10, 20], [11]]
