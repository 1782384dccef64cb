"""Lines of pipes."""

import os
import time

from gpszip.live.stream.lines import StreamLines


def test_lines_come_in_batches_up_to_the_end():
    read, write = os.pipe()
    lines = StreamLines(read)
    os.write(write, b"a\nb\nc\nhal")
    found, goes_on = lines.take(2, 60.0)
    assert (found, goes_on) == ([b"a\n", b"b\n"], True)
    os.write(write, b"f\nend")
    os.close(write)
    found, goes_on = lines.take(99, 60.0)
    assert (found, goes_on, lines.cut) == ([b"c\n", b"half\n", b"end"], False, 0)


def test_a_batch_ends_some_time_after_its_first_line():
    read, write = os.pipe()
    lines = StreamLines(read)
    os.write(write, b"a\n")
    assert lines.take(99, 0.01) == ([b"a\n"], True)
    os.close(write)
    assert lines.take(99, 60.0) == ([], False)


def test_what_was_read_before_a_signal_comes_yet():
    read, write = os.pipe()
    lines = StreamLines(read)
    os.write(write, b"a\nb\nhal")
    deadline = time.monotonic() + 30
    while lines._chunks.empty() and time.monotonic() < deadline:
        time.sleep(0.001)
    lines.stop()
    found, goes_on = lines.take(99, 60.0)
    assert (found, goes_on, lines.cut) == ([b"a\n", b"b\n"], False, 1)
    os.close(write)
