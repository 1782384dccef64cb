"""Reading in memory, reading on disk in tiny batches, and a plain twin give the same."""

import tempfile
from collections import Counter
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError
from gpszip.io.large import store
from gpszip.io.large.store import store_logs
from gpszip.io.logs.read import read_logs
from gpszip.io.logs.repeats import RepeatedRows, drop_repeated_rows
from gpszip.io.logs.rows import LogRows

#: Rows of small numbers, so that names, times and positions often repeat; some can't be used.
ROW = st.tuples(
    st.sampled_from("abc"),
    st.sampled_from(["", *map(str, range(8))]),
    st.sampled_from(["", "0", "1", "2"]),
    st.integers(0, 5),
)
FILES = st.lists(st.lists(ROW, min_size=1, max_size=25), min_size=1, max_size=3)
ORDER = st.sampled_from([{}, {"sort": True}, {"split": True}])


def write_files(folder, files):
    """Write each list of rows to a CSV file of its own."""
    paths = []
    for number, rows in enumerate(files):
        path = Path(folder, f"{number}.csv")
        lines = [f"{name},{time},{x},0,{note}" for name, time, x, note in rows]
        path.write_text("\n".join(["track_id,t,x,y,note", *lines, ""]))
        paths.append(path)
    return paths


def read_in_memory(paths, **options):
    """Tracks and record of a log, or the error."""
    try:
        result = read_logs(paths, keep=("note",), **options)
    except InputError as error:
        return str(error)
    tracks = [
        (track.id, track.times.tolist(), track.positions[:, 0].tolist(), note(track))
        for track in result.tracks
    ]
    return tracks, record(result)


def note(track):
    return track.attributes["note"].tolist()


def record(result):
    return (
        result.points,
        result.bytes,
        result.lost,
        sorted(result.repairs, key=lambda repair: (repair.where, repair.what)),
        set(result.losses),
        # A batch may show an error before the one that all rows show.
        [item.name for item in result.left_out],
        result.dropped_columns,
    )


def read_on_disk(paths, **options):
    """The same, of a log that is read in batches of two or three rows and sorted on disk."""
    with (
        mock.patch("gpszip.io.logs.csv.BLOCK", 32),
        mock.patch.object(store, "_MIN_ROWS", 4),
        mock.patch("gpszip.io.large.disk_rows._MIN_BLOCK_ROWS", 3),
    ):
        try:
            log = store_logs(paths, rows=4, keep=("note",), **options)
        except InputError as error:
            return str(error)
    with log:
        notes = np.concatenate(list(log.columns[0].chunks()))
        tracks = []
        for track in log.tracks:
            samples = log.read(track)
            own = notes[track.offset : track.offset + track.count]
            tracks.append(
                (track.id, samples.times.tolist(), samples.positions[:, 0].tolist(), own.tolist())
            )
        return tracks, record(log.read_result)


@given(FILES, ORDER, st.booleans())
def test_batches_on_disk_give_the_same_as_memory(files, order, skip_bad):
    with tempfile.TemporaryDirectory() as folder:
        paths = write_files(folder, files)
        expected = read_in_memory(paths, **order, skip_bad=skip_bad)
        found = read_on_disk(paths, **order, skip_bad=skip_bad)
    if isinstance(expected, str) or isinstance(found, str):
        # Errors of one file come in another order if batches show one before the other.
        assert isinstance(expected, str) == isinstance(found, str), (expected, found)
        return
    assert found == expected


SHAPE_FILES = st.lists(
    st.lists(st.tuples(st.sampled_from("ab"), st.sampled_from(["", "0", "1", "2"])), min_size=2),
    min_size=1,
    max_size=2,
)


@given(SHAPE_FILES, st.booleans())
def test_shapes_in_batches_on_disk_are_those_in_memory(files, clean):
    with tempfile.TemporaryDirectory() as folder:
        paths = []
        for number, rows in enumerate(files):
            paths.append(Path(folder, f"{number}.csv"))
            lines = [f"{name},{x},0,{note}" for note, (name, x) in enumerate(rows)]
            paths[-1].write_text("\n".join(["track_id,x,y,note", *lines, ""]))
        options = {"times": False, "clean": clean}
        expected = read_in_memory(paths, **options)
        found = read_on_disk(paths, **options)
    if isinstance(expected, str):
        assert isinstance(found, str)
        return
    assert found == expected

    # The plain twin keeps each point that differs from the one before.
    plain = []
    for rows in files:
        for name in dict.fromkeys(name for name, _ in rows):
            own = [float(x) for other, x in rows if other == name and x]
            plain += [[x for i, x in enumerate(own) if i == 0 or own[i - 1] != x]] if own else []
    assert sorted(positions for _, _, positions, _ in expected[0]) == sorted(plain)


def plain_tracks(rows, *, sort, split):
    """Tracks of one file, row by row; None if it is refused."""
    # Rows with a time and a position, by track.
    tracks = {}
    for name, time, x, note in rows:
        own = tracks.setdefault(name, [])
        if time and x:
            own.append((float(time), float(x), note))

    # Order in time.
    ordered = {}
    for name, own in tracks.items():
        if len({time for time, _, _ in own}) == 1 and len({x for _, x, _ in own}) >= 3:
            return None
        back = [i for i in range(1, len(own)) if own[i][0] < own[i - 1][0]]
        if back and not (sort or split):
            return None
        cuts = [0, *back, len(own)] if split else [0, len(own)]
        for number, (start, stop) in enumerate(zip(cuts, cuts[1:], strict=False)):
            key = name if number == 0 else f"{name}-{number + 1}"
            ordered[key] = sorted(own[start:stop], key=lambda row: row[0])

    # One row for each time.
    kept = {}
    for name, own in ordered.items():
        times = [time for time, _, _ in own]
        first = [row for i, row in enumerate(own) if i == 0 or times[i - 1] != times[i]]
        if first:
            kept[name] = first
    if sum(map(len, kept.values())) < 2:
        return None
    return kept


@given(st.lists(ROW, min_size=3, max_size=30), ORDER)
def test_tracks_are_those_of_the_plain_twin(rows, order):
    expected = plain_tracks(rows, sort="sort" in order, split="split" in order)
    with tempfile.TemporaryDirectory() as folder:
        found = read_in_memory(write_files(folder, [rows]), **order)
    if expected is None or isinstance(found, str):
        assert (expected is None, isinstance(found, str)) == (True, True), (found, expected)
        return
    tracks, counts = found
    assert {name: list(zip(*columns, strict=True)) for name, *columns in tracks} == expected
    assert counts[0] == len(rows) == counts[2] + sum(map(len, expected.values()))


@given(
    st.lists(st.tuples(st.integers(0, 2), st.integers(0, 3), st.integers(0, 2)), min_size=1),
    st.data(),
)
def test_repeated_rows_are_counted_alike_in_blocks_of_any_size(rows, data):
    """The plain twin counts rows by loops over the whole log."""
    rows = sorted(rows, key=lambda row: row[:2])
    cuts = sorted(data.draw(st.sets(st.integers(0, len(rows)))) | {0, len(rows)})
    columns = np.array(rows)
    whole = LogRows(
        columns[:, 0].astype(np.int32),
        columns[:, 1].astype(float),
        columns[:, 2:].astype(float),
        np.arange(1, len(rows) + 1),
        {},
    )
    repeated = RepeatedRows.empty(3)
    blocks = [whole.take(slice(a, b)) for a, b in zip(cuts, cuts[1:], strict=False)]
    kept = list(drop_repeated_rows(blocks, np.full(3, np.nan), repeated))

    # Compare with the first row of each track and time.
    first = {}
    same, other, sharing = Counter(), Counter(), Counter()
    for code, time, x in rows:
        if (code, time) not in first:
            first[code, time] = x
        elif first[code, time] == x:
            same[code] += 1
        else:
            other[code] += 1
            sharing[code, time] += 1
    assert [
        (int(c), int(t)) for block in kept for c, t in zip(block.codes, block.times, strict=True)
    ] == list(first)
    assert repeated.at_same.tolist() == [same[code] for code in range(3)]
    assert repeated.at_other.tolist() == [other[code] for code in range(3)]
    assert repeated.shared.tolist() == [
        max((count + 1 for (c, _), count in sharing.items() if c == code), default=0)
        for code in range(3)
    ]


def test_a_row_at_the_time_at_which_another_file_ends_is_dropped(tmp_path):
    files = [[("a", "0", "0", 1), ("a", "1", "1", 2)], [("a", "1", "2", 3), ("a", "2", "2", 4)]]
    paths = write_files(tmp_path, files)
    tracks, counts = read_in_memory(paths)
    assert tracks == [("a", [0, 1, 2], [0, 1, 2], [1, 2, 4])]
    assert [(repair.what, repair.count) for repair in counts[3]] == [
        ("points at a time that another file has, too, dropped", 1)
    ]
    assert read_on_disk(paths) == (tracks, counts)


@pytest.mark.parametrize("read", [read_in_memory, read_on_disk])
def test_the_first_row_that_goes_back_is_named_in_any_batch(tmp_path, read):
    rows = [("a", str(t), "0", 0) for t in (0, 1, 2, 3, 4, 5, 6, 2, 7, 1)]
    (path,) = write_files(tmp_path, [rows])
    assert f"{path}: row 9: time goes back 4 s; --sort" in read([path])
