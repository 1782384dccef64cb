import errno
import json
import os
import threading
import zlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError, OutputError
from gpszip.live import Fix, Journal
from gpszip.live import journal as module
from gpszip.live.journal import Tail, archived_until, mark_archived, read_segment, segments
from live.running import stored
from random_tests import examples


def fix(number, agent="bus"):
    return Fix(agent, "test", 1.7e9 + number, 1.7e9 + number + 0.5, (48.0 + number / 7, 11.5))


FIXES = [fix(number) for number in range(5)]

numbers = st.floats(allow_nan=False, allow_infinity=False)
any_fix = st.builds(
    Fix,
    agent=st.text(max_size=20),
    source=st.text(max_size=5),
    time=numbers,
    received=numbers,
    position=st.tuples(numbers, numbers) | st.tuples(numbers, numbers, numbers),
    geographic=st.booleans(),
    accuracy=st.none() | numbers,
    heading=st.none() | numbers,
    speed=st.none() | numbers,
    quality=st.text(max_size=9),
    kind=st.text(max_size=9),
)


def written(folder, batches=((FIXES[:2]), (FIXES[2:]))):
    journal = Journal(folder)
    for batch in batches:
        journal.append(batch)
    journal.close()
    (path,) = segments(folder)
    return path


@examples(20)
@given(st.lists(any_fix, max_size=5))
def test_fixes_come_back_exactly(tmp_path_factory, fixes):
    folder = tmp_path_factory.mktemp("journal")
    journal = Journal(folder)
    journal.append(fixes)
    journal.close()
    assert stored(folder) == fixes


def test_a_record_is_its_checksum_and_json(tmp_path):
    header, *lines = written(tmp_path).read_bytes().splitlines()
    assert header == b"gpszip journal 1"
    for line, known in zip(lines, FIXES, strict=True):
        checksum, text = line.split(b" ", 1)
        assert int(checksum, 16) == zlib.crc32(text)
        assert json.loads(text)[:4] == [known.agent, known.source, known.time, known.received]


def test_a_journal_cut_anywhere_keeps_all_whole_records(tmp_path):
    fixes = FIXES[:2]
    data = written(tmp_path / "whole", [fixes]).read_bytes()
    ends = [len(module._HEADER)]
    for known in fixes:
        ends.append(ends[-1] + len(module.encode_record(known)))
    assert ends[-1] == len(data)
    path = tmp_path / "00000001.log"
    for cut in range(len(data)):
        path.write_bytes(data[:cut])
        journal = Journal(tmp_path)
        whole = max((number for number, end in enumerate(ends) if end <= cut), default=0)
        assert list(journal.recent()) == fixes[:whole]
        good = ends[whole] if cut >= ends[0] else 0
        assert journal.torn == cut - good
        # What was cut off is gone for good.
        assert path.stat().st_size == good
        journal.close()


def test_what_comes_after_a_cut_follows_it(tmp_path):
    path = written(tmp_path)
    path.write_bytes(path.read_bytes()[:-3])
    journal = Journal(tmp_path)
    journal.append([fix(9)])
    journal.close()
    assert stored(tmp_path) == [*FIXES[:4], fix(9)]
    assert len(segments(tmp_path)) == 2


def test_a_damaged_record_is_counted_and_the_others_are_read(tmp_path):
    path = written(tmp_path)
    lines = path.read_bytes().splitlines(keepends=True)
    lines[2] = lines[2].replace(b"bus", b"buz")
    path.write_bytes(b"".join(lines))
    tail = Tail()
    assert list(read_segment(path, tail)) == [FIXES[0], *FIXES[2:]]
    assert (tail.damaged, tail.torn) == (1, 0)


@pytest.mark.parametrize("data", [b"GET / HTTP/1.1 200 something longer\n", bytes(40)])
def test_a_file_of_something_else_is_refused(tmp_path, data):
    (tmp_path / "00000001.log").write_bytes(data)
    with pytest.raises(InputError, match="no segment"):
        Journal(tmp_path)
    assert (tmp_path / "00000001.log").read_bytes() == data


@pytest.mark.parametrize("head", [bytes(17), b"gpszip" + bytes(11), bytes(3)])
def test_zeros_that_a_power_failure_left_hold_nothing(tmp_path, head):
    (tmp_path / "00000001.log").write_bytes(head)
    journal = Journal(tmp_path)
    assert journal.torn == len(head)
    journal.append(FIXES)
    assert list(journal.recent()) == FIXES
    journal.close()


def test_one_process_writes_to_a_journal(tmp_path):
    journal = Journal(tmp_path)
    with pytest.raises(OutputError, match="another process"):
        Journal(tmp_path)
    journal.close()
    Journal(tmp_path).close()


def test_full_disks_lose_nothing_and_leave_nothing_behind(tmp_path, monkeypatch):
    journal = Journal(tmp_path)
    journal.append(FIXES[:2])
    real = os.fsync

    def full(descriptor):
        monkeypatch.setattr(os, "fsync", real)
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match="No space left"):
        journal.append([fix(3)])
    journal.append([fix(4)])
    journal.close()
    assert stored(tmp_path) == [*FIXES[:2], fix(4)]


def test_a_full_disk_at_the_start_of_a_segment_leaves_no_segment(tmp_path, monkeypatch):
    journal = Journal(tmp_path)
    monkeypatch.setattr(module, "_write_all", lambda *_: (_ for _ in ()).throw(OSError(28, "full")))
    with pytest.raises(OutputError, match="full"):
        journal.append(FIXES)
    monkeypatch.undo()
    assert segments(tmp_path) == []
    journal.append(FIXES)
    journal.close()
    assert stored(tmp_path) == FIXES


def test_parts_that_the_system_takes_are_joined(tmp_path):
    taken = []

    class Slow:
        def write(self, data):
            taken.append(bytes(data[:3]))
            return len(taken[-1])

    module._write_all(Slow(), b"0123456789")
    assert b"".join(taken) == b"0123456789"


def test_archived_segments_are_deleted_even_after_a_kill(tmp_path):
    journal = Journal(tmp_path)
    for known in FIXES[:3]:
        journal.append([known])
        journal.rotate()
    paths = segments(tmp_path)
    mark_archived(tmp_path, paths[0])
    assert segments(tmp_path) == paths[1:]

    # Killed between the note and the deletion: the next one to open deletes them.
    (tmp_path / "archived").write_text("2\n")
    journal.close()
    journal = Journal(tmp_path)
    assert segments(tmp_path) == paths[2:]

    # Their numbers are not used again, even when none is left.
    mark_archived(tmp_path, paths[2])
    journal.append([fix(9)])
    journal.close()
    assert [path.name for path in segments(tmp_path)] == ["00000004.log"]
    assert archived_until(tmp_path) == 3


def test_a_segment_that_others_may_archive_is_not_the_last(tmp_path):
    journal = Journal(tmp_path)
    assert not journal.advance()
    journal.append(FIXES[:2])
    for _ in range(3):
        assert journal.advance()
        assert len(segments(tmp_path)) == 2
    journal.append(FIXES[2:])
    journal.close()
    assert [list(read_segment(path)) for path in segments(tmp_path)] == [FIXES[:2], FIXES[2:]]


def test_segments_may_end_while_fixes_are_written(tmp_path):
    journal = Journal(tmp_path)

    def write():
        for number in range(200):
            journal.append([fix(number)])

    writer = threading.Thread(target=write)
    writer.start()
    while writer.is_alive():
        journal.advance()
    journal.close()
    assert stored(tmp_path) == [fix(number) for number in range(200)]
    assert len(segments(tmp_path)) > 2


def test_segments_may_be_archived_while_they_are_read(tmp_path):
    journal = Journal(tmp_path)
    for known in FIXES[:3]:
        journal.append([known])
        journal.rotate()
    reading = journal.recent()
    assert next(reading) == FIXES[0]
    mark_archived(tmp_path, segments(tmp_path)[1])
    assert list(reading) == [FIXES[2]]
    journal.close()


def test_segments_have_a_size(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_MAX_SEGMENT_BYTES", 300)
    journal = Journal(tmp_path)
    for number in range(20):
        journal.append([fix(number)])
    assert list(journal.recent()) == [fix(number) for number in range(20)]
    assert len(segments(tmp_path)) > 3
    # The last ones are read, up to a size.
    recent = list(journal.recent(max_bytes=500))
    assert 1 <= len(recent) < 10
    assert recent[-1] == fix(19)
    journal.close()
