import io

import numpy as np
import pytest

from gpszip.errors import InputError
from gpszip.io.large.store import store_logs
from gpszip.io.logs.read import read_logs
from gpszip.model.read_result import Loss


def text_of(rows, header="t,x,y"):
    return "\n".join([header, *rows, ""])


def read_in_both_forms(text, path, **options):
    """Read a log in memory and on disk, and check that both report the same."""
    path.write_text(text)
    reading = read_logs(path, **options)
    with store_logs(path, rows=1000, **options) as log:
        assert set(log.read_result.losses) == set(reading.losses)
        assert {track.id: track.count for track in log.tracks} == {
            track.id: len(track) for track in reading.tracks
        }
        assert sorted(
            (one.what, one.count, one.drops) for one in log.read_result.repairs
        ) == sorted((one.what, one.count, one.drops) for one in reading.repairs)
        assert (log.read_result.points, log.read_result.lost) == (reading.points, reading.lost)
        assert len(log.read_result.left_out) == len(reading.left_out)
    assert reading.points == reading.kept + reading.lost
    return reading


@pytest.fixture
def path(tmp_path):
    return tmp_path / "log.csv"


def test_a_few_lost_points_are_no_loss(path):
    rows = [f"{number},{number},0" for number in range(100)]
    reading = read_in_both_forms(
        text_of([*rows, "50.5,,1", "99,7,7", "99,8,8", *rows[-1:]]).replace("\n99,8,8", ""), path
    )
    assert (reading.lost, reading.losses, reading.complete) == (3, (), True)


def test_repeated_rows_are_no_loss(path):
    reading = read_in_both_forms(
        text_of([f"{number // 3},{number // 3},0" for number in range(90)]), path
    )
    assert (reading.lost, reading.losses) == (60, ())


def test_five_points_a_second_with_whole_seconds(path):
    reading = read_in_both_forms(
        text_of([f"{number // 5},{number},0" for number in range(5000)]), path
    )
    assert reading.losses == (Loss("0", str(path), 4000, 5000, 5),)
    assert not reading.complete


def test_three_points_at_one_time_are_a_loss_in_any_log(path):
    rows = [f"{number},{number},0" for number in range(100)]
    assert read_in_both_forms(text_of([*rows[:50], "49,7,7", *rows[50:]]), path).complete
    reading = read_in_both_forms(text_of([*rows[:50], "49,7,7", "49,8,8", *rows[50:]]), path)
    assert [(loss.lost, loss.points, loss.shared) for loss in reading.losses] == [(2, 102, 3)]


def test_tracks_that_lose_many_points_and_tracks_that_vanish(path):
    rows = [f"{name},{number},{number},0" for name in "abc" for number in range(10)]
    rows = [
        row.replace(",5,5,", ",5,,").replace(",7,7,", ",,7,") if row[0] == "b" else row
        for row in rows
    ]
    reading = read_in_both_forms(
        text_of([row[:4] + ",0" if row[0] == "c" else row for row in rows], "id,t,x,y"), path
    )
    assert set(reading.losses) == {Loss("b", str(path), 2, 10), Loss("c", str(path), 10, 10)}
    assert [track.id for track in reading.tracks] == ["a", "b"]


def test_rows_that_belong_to_no_track_are_a_loss_of_the_log(path):
    reading = read_in_both_forms(
        text_of([f"{number},{number},0" + ",9" * (number % 5 == 1) for number in range(20)]), path
    )
    assert reading.losses == (Loss("", str(path), 4, 20),)


@pytest.mark.parametrize("read", [read_logs, lambda path: store_logs(path, rows=1000)])
def test_a_clock_that_stands_still_is_refused(path, read):
    path.write_text(text_of([f"1367654400,{number},0" for number in range(184)]))
    with pytest.raises(
        InputError,
        match=r"log.csv: all 184 points.* have the same time, 2013-05-04T08:00:00Z; .*t=COLUMN",
    ):
        read(path)


def test_a_track_whose_clock_stands_still_is_refused_or_left_out(path):
    rows = (
        [f"a,{number},{number},0" for number in range(10)]
        + [f"b,5,{number},0" for number in range(30)]
        + ["c,5,1,1"] * 4
    )
    path.write_text(text_of(rows, "id,t,x,y"))
    with pytest.raises(InputError, match="all 30 points of track 'b' have the same time, 5 s"):
        read_logs(path)
    with pytest.raises(InputError, match="all 30 points of track 'b' have the same time, 5 s"):
        store_logs(path, rows=1000)
    reading = read_in_both_forms(text_of(rows, "id,t,x,y"), path, skip_bad=True)
    assert {track.id: len(track) for track in reading.tracks} == {"a": 10, "c": 1}
    assert (reading.losses, len(reading.left_out), reading.complete) == ((), 1, False)


@pytest.mark.parametrize("order", ["ab", "ba"])
def test_rows_of_tracks_left_out_count_alike_in_any_order(path, order):
    rows = {
        "a": [f"a,{number},{number},0" for number in range(2)],
        "b": [f"b,5,{number},0" for number in range(3)],
    }
    text = text_of([row for name in order for row in rows[name]], "id,t,x,y")
    reading = read_in_both_forms(text, path, skip_bad=True)
    assert (reading.points, reading.lost, reading.kept) == (5, 3, 2)
    assert [(repair.what, repair.count) for repair in reading.repairs] == [
        ("points of track 'b' left out", 3)
    ]


@pytest.mark.parametrize("positions", ["122", "121", "112", "222", "1222221"])
def test_points_at_two_positions_are_no_stopped_clock_in_any_order(path, positions):
    rows = ["a,0,0,0", "a,1,1,0", *(f"b,5,{x},0" for x in positions)]
    reading = read_in_both_forms(text_of(rows, "id,t,x,y"), path)
    assert {track.id: len(track) for track in reading.tracks} == {"a": 2, "b": 1}


def test_positions_at_one_time_are_counted_across_batches(path, monkeypatch):
    monkeypatch.setattr("gpszip.io.logs.csv.BLOCK", 32)
    rows = ["a,0,0,0", "a,1,1,0", *(f"b,5,{x},0" for x in "1222211112222")]
    assert len(read_in_both_forms(text_of(rows, "id,t,x,y"), path).tracks) == 2
    path.write_text(text_of([*rows, "b,5,3,0"], "id,t,x,y"))
    with pytest.raises(InputError, match="all 14 points of track 'b' have the same time"):
        store_logs(path, rows=1000)


@pytest.mark.parametrize("read", [read_logs, lambda path: store_logs(path, rows=1000)])
def test_one_point_of_many_is_refused_with_the_causes(path, read):
    path.write_text(text_of(["0,0,0", "1,,0", "2,,0", ",5,5"]))
    with pytest.raises(
        InputError, match=r"only 1 of 4 rows can be used: .*2 rows without a position dropped"
    ):
        read(path)
    path.write_text(text_of(["0,0,0", "1,,0"]))
    assert len(read_logs(path).tracks[0]) == 1


def test_points_at_one_time_in_different_batches(path, monkeypatch):
    monkeypatch.setattr("gpszip.io.logs.csv.BLOCK", 512)
    rng = np.random.default_rng(5)
    rows = [f"v{rng.integers(3)},{number // 7},{rng.integers(2)},0" for number in range(4000)]
    assert len(read_in_both_forms(text_of(rows, "id,t,x,y"), path).losses) == 3


@pytest.mark.parametrize(
    "read", [read_logs, lambda path, **options: store_logs(path, rows=1000, **options)]
)
@pytest.mark.parametrize("sort", [False, True])
def test_times_of_day_that_go_back_are_refused_however_they_are_to_be_ordered(path, read, sort):
    path.write_text(text_of(["23:59:58,0,0", "23:59:59,1,0", "00:00:00,2,0", "00:00:01,3,0"]))
    with pytest.raises(
        InputError,
        match="the time of day goes back, perhaps at midnight, and there is no date; add a column",
    ):
        read(path, sort=sort)
    assert [len(track) for track in read_logs(path, split=True).tracks] == [2, 2]


def test_standard_input_is_named_in_losses():
    reading = read_logs(io.BytesIO(text_of(["0,0,0", "1,1,1", "2,,2"]).encode()))
    assert reading.losses == (Loss("0", "stream", 1, 3),)
