"""gpszip compress --stream."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import gpszip as package

#: A process that a shell started in the background ignores SIGINT, and so do its children.
SCRIPT = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
from gpszip.cli.main import run
run()
"""

#: One time step a second around a circle of 50 m, 40 points a round.
OPTIONS = "compress --stream --rmse 50cm --effort 1"


def position(second):
    return 50 * np.cos(2 * np.pi * second / 40), 50 * np.sin(2 * np.pi * second / 40)


def row(second):
    x, y = position(second)
    return f"{second},{x:.3f},{y:.3f}\n"


def log(first, last):
    return "t,x,y\n" + "".join(map(row, range(first, last)))


def rmse(path, seconds):
    archive = package.open(path.read_bytes())
    found = archive.position("0", seconds, metres=True)
    return np.sqrt(np.mean(np.sum((found - np.transpose(position(seconds))) ** 2, axis=1)))


class Robot:
    """A robot whose rows go into a process of gpszip."""

    def __init__(self, folder, *options):
        command = [sys.executable, "-c", SCRIPT, *OPTIONS.split(), "-o", "a.gpsz", *options]
        self.process = subprocess.Popen(
            command, cwd=folder, stdin=subprocess.PIPE, stderr=subprocess.PIPE
        )
        self.archive = folder / "a.gpsz"
        self.send("t,x,y\n")

    def send(self, text):
        self.process.stdin.write(text.encode())
        self.process.stdin.flush()

    def wait_for(self, second):
        """Wait until the archive on disk has the position at a time; it opens at each moment."""
        deadline = time.monotonic() + 120
        while time.monotonic() < deadline:
            if self.archive.exists():
                walk = package.open(self.archive.read_bytes()).walk("0")
                if walk.time_ranges[-1, 1] >= second:
                    return
            assert self.process.poll() is None, self.process.stderr.read()
            time.sleep(0.02)
        raise AssertionError("the archive was not written in time")

    def end(self, number):
        """Send a signal; return the exit code and what was told."""
        self.process.send_signal(number)
        code = self.process.wait(120)
        told = self.process.stderr.read().decode()
        self.process.stdin.close()
        self.process.stderr.close()
        return code, told


@pytest.mark.skipif(os.name != "posix", reason="Windows has no such signals")
def test_a_killed_stream_leaves_a_whole_archive_that_is_continued(tmp_path):
    # Killed between two batches.
    robot = Robot(tmp_path, "--every", "10ms")
    for second in range(60):
        robot.send(row(second))
    robot.wait_for(59)
    robot.send(row(60))
    code, _ = robot.end(signal.SIGKILL)
    assert code == -signal.SIGKILL
    assert rmse(robot.archive, np.arange(60)) <= 0.5

    # Started again, with some rows again; ended by Ctrl-C, which finishes the rest.
    robot = Robot(tmp_path, "--append", "--batch", "20", "--every", "1h")
    for second in range(30, 112):
        robot.send(row(second))
    robot.wait_for(95)
    code, told = robot.end(signal.SIGINT)
    assert code == 0, told
    [name] = package.open(robot.archive).ids
    assert name == "0"
    assert not package.open(robot.archive).walk("0").gaps.any()
    assert rmse(robot.archive, np.arange(112)) <= 0.5
    assert "rows that the archive holds already" in told


def test_a_pipe_that_ends_is_an_archive(gpszip, tmp_path):
    (tmp_path / "robot.csv").write_text(log(0, 90) + "oops,1,1\n" + row(45) + row(90))
    run = gpszip(OPTIONS, "robot.csv", "--batch", 30, "--json")
    assert run.code == 3
    assert run.json["output"] == "robot.gpsz"
    assert (run.json["lines"], run.json["points"], run.json["lost"]) == (94, 91, 2)
    assert run.json["counts"] == {
        "rows without a time dropped": 1,
        "rows from before the last one of their track left out; --sort puts them in order": 1,
    }
    assert run.json["rmse"] <= 0.5
    assert rmse(tmp_path / "robot.gpsz", np.arange(91)) <= 0.5


def test_what_is_told_of_a_stream(gpszip, tmp_path):
    (tmp_path / "robot.csv").write_text(log(0, 20) + log(0, 20))
    run = gpszip(f"{OPTIONS} robot.csv -o a.gpsz")
    assert run.code == 3
    lines = run.err.splitlines()
    assert lines[0] == "robot.csv: row 22: 1 row without a time dropped (t 't')"
    assert lines[1] == "1 track started where time goes back"
    assert lines[2].startswith("a.gpsz: 40 points in 2 tracks, ")
    assert gpszip(f"{OPTIONS} robot.csv -o a.gpsz --quiet --force").err == ""


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("robot.csv --k 5", "--k does not go with --stream"),
        ("robot.csv --keep-times", "--keep-times does not go with --stream"),
        ("robot.csv --since 1", "--track, --since, --until, --bbox does not go with --stream"),
        ("robot.csv other.csv -o a.gpsz", "--stream reads one stream"),
        ("robot.csv -o -", "standard output"),
        ("robot.csv --sort --split", "--sort and --split exclude each other"),
        ("missing.csv", "missing.csv: can't be read"),
        (". -o a.gpsz", ".: is a folder"),
    ],
)
def test_what_a_stream_cannot_have_is_refused(gpszip, tmp_path, arguments, message):
    (tmp_path / "robot.csv").write_text(log(0, 9))
    run = gpszip("compress --stream", *arguments.split())
    assert run.code in (1, 2)
    assert message in run.err
    assert not list(tmp_path.glob("*.gpsz"))


def test_a_stream_without_times_is_an_error(gpszip, tmp_path):
    (tmp_path / "shape.csv").write_text("x,y\n0,0\n1,1\n")
    run = gpszip(f"{OPTIONS} shape.csv -o a.gpsz")
    assert run.code == 1
    assert "shape.csv: no column of times; say which it is: --columns t=COLUMN" in run.err
    assert "--no-times" not in run.err


def test_memory_is_refused_only_where_it_is_asked_for(gpszip, tmp_path, monkeypatch):
    (tmp_path / "robot.csv").write_text(log(0, 40))
    run = gpszip(f"{OPTIONS} robot.csv -o a.gpsz --memory 1GiB")
    assert (run.code, "--memory does not go with --stream" in run.err) == (2, True)
    monkeypatch.setenv("GPSZIP_MEMORY", "1GiB")
    assert gpszip(f"{OPTIONS} robot.csv -o a.gpsz").code == 0


def test_a_stream_goes_on_within_the_bound_of_its_archive(gpszip, tmp_path):
    (tmp_path / "robot.csv").write_text(log(0, 40))
    assert "the one given" not in gpszip(f"{OPTIONS} robot.csv -o a.gpsz").err
    (tmp_path / "robot.csv").write_text(log(40, 60))
    run = gpszip(f"{OPTIONS} robot.csv -o a.gpsz --append")
    assert (run.code, "the one given" in run.err) == (0, False)
    run = gpszip("compress --stream robot.csv -o a.gpsz --append --rmse 5m")
    assert run.code == 0
    assert "a.gpsz: the bound that the archive states holds, not the one given" in run.err
    assert rmse(tmp_path / "a.gpsz", np.arange(60)) <= 0.5


def test_a_stream_without_a_position_is_an_error(gpszip, tmp_path):
    (tmp_path / "robot.csv").write_text("t,x,y\n")
    run = gpszip(OPTIONS, "robot.csv")
    assert (run.code, "no position came" in run.err) == (1, True)


def test_options_of_a_stream_need_one(gpszip):
    run = gpszip("compress log.csv --every 5s")
    assert (run.code, "--every needs --stream" in run.err) == (2, True)


def test_objects_on_lines_are_streamed(gpszip, tmp_path):
    objects = [{"t": t, "x": position(t)[0], "y": position(t)[1]} for t in range(50)]
    (tmp_path / "robot.jsonl").write_text("".join(json.dumps(each) + "\n" for each in objects))
    assert gpszip(OPTIONS, "robot.jsonl").code == 0
    assert rmse(tmp_path / "robot.gpsz", np.arange(50)) <= 0.5


def test_a_row_that_cannot_be_held_costs_no_others(gpszip, tmp_path):
    (tmp_path / "robot.csv").write_text(log(0, 40) + "4e12,0,0\n" + log(41, 60)[6:])
    run = gpszip(OPTIONS, "robot.csv", "--batch", 41, "--json")
    assert run.code == 3
    assert (run.json["points"], run.json["lost"], run.json["tracks"]) == (59, 1, 1)
    assert run.json["rmse"] <= 0.5
