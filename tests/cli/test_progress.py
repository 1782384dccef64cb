"""The line of progress: what it says at any time, and how real runs draw it on terminals."""

import os
import re
import select
import subprocess
import sys
from functools import cache

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip import compress
from gpszip.cli.progress import ProgressLine
from gpszip.io.logs.write import write_tracks
from gpszip.model import Progress
from gpszip.testing import patrol

#: Events: seconds since the one before, stage, share and points.
EVENTS = st.lists(
    st.tuples(
        st.floats(0, 1000),
        st.sampled_from(["learn", "encode", "measure"]),
        st.floats(0, 1),
        st.integers(0, 10**9),
    ),
    max_size=20,
)


class Clock:
    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


def share_of(text):
    found = re.search(r"(\d+) %", text)
    return int(found.group(1)) if found else 0


def label_of(text):
    return text.split("  ")[0]


@given(EVENTS, st.integers(1, 250), st.floats(0, 5000))
def test_the_line_fits_any_width_and_never_goes_back(events, width, pause):
    clock = Clock()
    line, before = ProgressLine(clock), ("", 0)
    for seconds, stage, done, points in events:
        clock.now += seconds
        line.show(Progress(stage, done, points))
        # Also while nothing happens.
        for _ in range(2):
            assert len(line.draw(width).plain) <= width
            text = line.draw(250).plain
            label, share = label_of(text), share_of(text)
            assert share >= before[1] or label != before[0]
            assert " 0 s left" not in text
            before = label, share
            clock.now += pause


@given(EVENTS, st.floats(0.001, 1e5))
def test_an_estimate_that_has_passed_is_left_out(events, pause):
    clock = Clock()
    line = ProgressLine(clock)
    for seconds, stage, done, points in events:
        clock.now += seconds
        line.show(Progress(stage, done, points))
    left = line.seconds_left
    clock.now += pause
    later = line.seconds_left
    if left is None or left <= pause:
        assert later is None
    else:
        assert later == pytest.approx(left - pause, abs=1e-6)


def test_there_is_no_estimate_before_two_steps_and_two_seconds(clock):
    line = ProgressLine(clock)
    line.show(Progress("encode", 0.0, 1000))
    assert "left" not in line.draw(200).plain
    clock.now += 10
    line.show(Progress("encode", 0.1, 1000))
    assert "left" not in line.draw(200).plain
    clock.now += 10
    line.show(Progress("encode", 0.2, 1000))
    # 20 s for a fifth.
    assert "10 points/s  80 s left" in line.draw(200).plain
    quick = ProgressLine(clock)
    for share in (0.1, 0.2, 0.3):
        clock.now += 0.1
        quick.show(Progress("encode", share, 1000))
    assert "left" not in quick.draw(200).plain


def test_a_stage_that_begins_again_is_another_try(clock):
    line = ProgressLine(clock)
    labels = []
    for stage, done in [("learn", 0.5), ("learn", 1.0), ("measure", 0.0), ("learn", 0.5)]:
        line.show(Progress(stage, done))
        labels.append(label_of(line.draw(200).plain))
    assert labels == ["learn", "learn", "measure", "learn, try 2"]


def test_compiling_is_named_until_the_next_step(clock):
    line = ProgressLine(clock)
    line.show(Progress("learn", 0.5))
    line.note_compiling()
    line.note_compiling()
    assert line.draw(80).plain == "compile kernel 2  once for this installation"
    assert line.draw(39).plain == "compile kernel 2"
    line.show(Progress("learn", 0.6))
    assert line.draw(80).plain.startswith("learn")


def test_a_wide_line_has_a_bar_and_a_narrow_one_keeps_the_time(clock):
    line = ProgressLine(clock)
    for share in (0.25, 0.5):
        clock.now += 300
        line.show(Progress("measure", share, 10**6))
    assert "[" in line.draw(199).plain
    assert line.draw(39).plain == "measure  [#####.....]  50 %  5 min left"
    assert line.draw(30).plain == "measure  50 %  5 min left"
    assert line.draw(9).plain == "measure"


# Real runs on a terminal.

pty = pytest.importorskip("pty", reason="terminals of POSIX")


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """A folder with a log, a short one, and an archive of it."""
    folder = tmp_path_factory.mktemp("progress")
    write_tracks([patrol(3000, seed=1)], folder / "patrol.csv")
    write_tracks([patrol(100, seed=1)], folder / "short.csv")
    compress(patrol(100, seed=1), rmse=1.0, effort=1).save(folder / "short.gpsz")
    return folder


@pytest.fixture(scope="module")
def terminal(logs):
    """Run the command on a terminal, and return what it wrote there and its exit code."""
    import fcntl
    import struct
    import termios

    # The same run serves several tests.
    @cache
    def call(arguments, columns=80, **environment):
        parent, child = pty.openpty()
        fcntl.ioctl(child, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
        unset = {"NO_COLOR", "FORCE_COLOR", "COLUMNS", "LINES", "TTY_COMPATIBLE"}
        settings = {name: value for name, value in os.environ.items() if name not in unset}
        process = subprocess.Popen(
            [sys.executable, "-m", "gpszip", *arguments.split()],
            stdin=subprocess.DEVNULL,
            stdout=child,
            stderr=child,
            cwd=logs,
            env={**settings, "TERM": "xterm-256color", **environment},
        )
        os.close(child)

        # Read while it runs: a full terminal would stop it.
        written = b""
        with open(parent, "rb", buffering=0) as stream:
            while select.select([stream], [], [], 120)[0]:
                try:
                    data = stream.read(65536)
                except OSError:  # the other end is closed
                    break
                if not data:
                    break
                written += data
        return written.decode(), process.wait()

    return call


STYLE = re.compile(r"\x1b\[[0-9;]*m")
MOVE = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
COLOUR = re.compile(r"\x1b\[(?:3[0-7]|9[0-7]|38;|4[0-8])[0-9;]*m")
COMMAND = "compress patrol.csv --rmse 24cm --force"

#: The same where the line of progress need not be drawn.
QUICK = "compress short.csv -o quick.gpsz --rmse 24cm --effort 1 --force"


def lines_of(written):
    """Texts between two movements of the cursor."""
    plain = MOVE.sub("\r", STYLE.sub("", written))
    return [text for text in re.split(r"[\r\n]+", plain) if text.strip()]


def test_progress_is_drawn_in_colour_and_erased(terminal):
    written, code = terminal(COMMAND, 200)
    assert code == 0
    assert COLOUR.search(written) or "%" not in written
    assert any(
        text.startswith(("read", "learn", "measure", "compile")) for text in lines_of(written)
    )
    # The last line is the summary, which is all that stays.
    assert lines_of(written)[-1].count("points in 1 track")
    assert "\x1b[?25h" in written  # the cursor is back


@pytest.mark.parametrize(("columns", "environment"), [(40, {"NO_COLOR": "1"}), (200, {})])
def test_no_line_of_progress_is_wider_than_the_terminal(terminal, columns, environment):
    written, code = terminal(COMMAND, columns, **environment)
    assert code == 0
    drawn, _, _ = written.rpartition("patrol.gpsz:")
    assert max(map(len, lines_of(drawn))) < columns


def test_no_color_leaves_out_colours_only(terminal):
    written, code = terminal(COMMAND, 40, NO_COLOR="1")
    assert code == 0
    assert not COLOUR.search(written)
    assert any(text.startswith(("read", "learn")) for text in lines_of(written))


def test_a_dumb_terminal_gets_the_summary_alone(terminal):
    written, code = terminal(QUICK, TERM="dumb")
    assert code == 0
    assert "\x1b" not in written
    assert len(lines_of(written)) == 1


@pytest.mark.parametrize("option", ["--quiet", "--json"])
def test_quiet_and_json_draw_nothing(terminal, option):
    written, code = terminal(f"{QUICK} {option}")
    assert code == 0
    assert "\x1b" not in written
    assert len(lines_of(written)) == (option == "--json")


@pytest.mark.parametrize(
    ("columns", "environment"),
    [(40, {}), (200, {}), (40, {"NO_COLOR": "1"}), (40, {"TERM": "dumb"})],
)
def test_tables_have_no_escapes_and_all_their_facts_at_any_width(terminal, columns, environment):
    tables = [
        ("info short.gpsz", ["format", "tracks", "error bound"]),
        ("formats", ["csv", "geojson", "graphml"]),
    ]
    # It takes a second to start, and draws its table as the others do.
    if not environment:
        tables.append((f"{QUICK} --dry-run", ["rows", "bound", "written"]))
    for command, facts in tables:
        written, code = terminal(command, columns, **environment)
        assert code == 0
        assert "\x1b" not in written
        assert all(fact in written for fact in facts)
