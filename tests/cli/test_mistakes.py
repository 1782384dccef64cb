"""Mistakes of a new user: each ends with one line that says what, where and how to fix it."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from gpszip.errors import InputError
from gpszip.io.logs.read import read_logs


def mistake(run, code, *words):
    """Check that a run failed with this code and one line that has these words."""
    assert run.code == code, run.err
    assert run.out == ""
    lines = run.err.strip().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("gpszip: ")
    for word in words:
        assert word in lines[0], lines[0]


LOGS = {
    "no time": ("x,y\n0,0\n1,1\n", "no time", "--columns"),
    "no position": ("t,height\n0,0\n1,1\n", "no position", "x,y or lat,lon"),
    "other columns": (
        "first,second,third\n0,0,0\n1,1,1\n",
        "columns found: first, second, third",
        "--columns",
    ),
    "empty file": ("", "empty"),
    "header only": ("t,x,y\n", "no rows"),
    "text in a column": ("t,x,y\n0,zero,0\n1,one,1\n", "x"),
    "time goes back": ("t,x,y\n5,0,0\n1,1,1\n", "row 3: time goes back 4 s", "--sort", "--split"),
    "latitude of 480": ("t,lat,lon\n0,480,11\n1,481,12\n", "lat"),
    "numbers too large for positions": (
        "t,x,y\n0,1e300,0\n1,1,1\n",
        "track '0': sample 0",
        "1e+300",
        "too far",
    ),
    "numbers too large for times": (
        "t,x,y\n0,1,0\n1e200,1,1\n",
        "track '0': sample 1",
        "a time of",
    ),
    "prose": ("Dear diary, today I went for a walk.\n", "needed: t"),
}


@pytest.mark.parametrize("name", LOGS)
def test_files_that_are_no_logs(gpszip, tmp_path, name):
    text, *words = LOGS[name]
    (tmp_path / "log.csv").write_text(text)
    done = gpszip("compress", "log.csv", "-o", "log.gpsz", "--rmse", "5m")
    mistake(done, 1, *words)
    assert "log.csv" in done.err or "track '0'" in done.err
    assert [path.name for path in tmp_path.iterdir()] == ["log.csv"]


@pytest.mark.parametrize("name", [name for name in LOGS if "too large" not in name])
def test_errors_of_logs_have_the_file_as_a_field(tmp_path, name):
    path, (text, *words) = tmp_path / "log.csv", LOGS[name]
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_logs(path)
    error = caught.value
    assert error.path == str(path)
    assert str(error) == f"{path}: {error.detail}"
    assert all(word in error.detail for word in words)
    assert str(path) not in error.detail


def test_wrong_column_named(gpszip, log):
    mistake(
        gpszip("compress", log, "-o", "out.gpsz", "--columns", "t=when,x=x,y=y"),
        1,
        "when",
        "t, x, y",
    )


def test_no_column_to_keep(gpszip, log):
    mistake(
        gpszip("compress", log, "-o", "out.gpsz", "--keep", "speed"),
        1,
        "no column 'speed'",
        "t, x, y",
    )


def test_no_such_file(gpszip):
    mistake(gpszip("compress", "nowhere.csv", "-o", "out.gpsz"), 1, "nowhere.csv: no such file")


def test_pattern_without_files(gpszip):
    mistake(gpszip("compress", "*.csv", "-o", "out.gpsz"), 1, "no file matches")


def test_folder_as_log(gpszip, tmp_path):
    (tmp_path / "logs").mkdir()
    mistake(gpszip("compress", "logs", "-o", "out.gpsz"), 1, "logs: no file in this folder")


def test_archive_as_log(gpszip, archive):
    mistake(gpszip("compress", archive, "-o", "out.gpsz"), 1, "gpszip decompress")


def test_log_as_archive(gpszip, log):
    mistake(
        gpszip("decompress", log, "-o", "out.csv"),
        4,
        "name a file that gpszip compress has written",
    )


def test_one_point_is_no_mistake(gpszip, tmp_path):
    (tmp_path / "one.csv").write_text("t,x,y\n7,3,4\n")
    done = gpszip("compress", "one.csv", "-o", "one.gpsz", "--rmse", "1m")
    assert done.code == 0, done.err
    assert gpszip("decompress", "one.gpsz", "-o", "-").out.splitlines()[1].startswith("0,7")


def test_output_exists(gpszip, log):
    Path("out.gpsz").write_text("precious")
    mistake(
        gpszip("compress", log, "-o", "out.gpsz", "--rmse", "5m"),
        1,
        "out.gpsz: exists already",
        "--force",
    )
    assert Path("out.gpsz").read_text() == "precious"
    assert gpszip("compress", log, "-o", "out.gpsz", "--rmse", "5m", "--force").code == 0
    assert Path("out.gpsz").read_bytes() != b"precious"


def test_output_is_refused_before_any_work(gpszip):
    Path("out.gpsz").write_text("precious")
    mistake(gpszip("compress", "nowhere.csv", "-o", "out.gpsz"), 1, "exists already")


def test_output_in_no_folder(gpszip, log):
    mistake(
        gpszip("compress", log, "-o", "nowhere/out.gpsz"),
        1,
        "nowhere: no such folder",
        "make it first",
    )


def test_output_below_a_file(gpszip, log):
    mistake(gpszip("compress", log, "-o", f"{log}/out.gpsz"), 1, "is a file, not a folder")


def test_output_is_a_folder(gpszip, log, tmp_path):
    mistake(gpszip("compress", log, "-o", tmp_path), 1, "is a folder; name a file in it")


@pytest.mark.skipif(
    not Path("/proc/self").is_dir(), reason="needs a folder that nobody may write to"
)
def test_output_that_is_no_file(gpszip, log, archive):
    mistake(
        gpszip("compress", log, "-o", "/dev/null", "--force"),
        1,
        "/dev/null: is no regular file",
        "standard output",
    )
    mistake(
        gpszip("decompress", archive, "-o", "/dev/null", "--force", "--format", "csv"),
        1,
        "/dev/null: is no regular file",
    )
    assert Path("/dev/null").is_char_device()


def test_a_link_stays_a_link(gpszip, archive):
    Path("to.csv").symlink_to("real.csv")
    assert gpszip("decompress", archive, "-o", "to.csv").code == 0
    assert Path("to.csv").is_symlink()
    assert Path("real.csv").read_text().startswith("track_id,t,x,y")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a disk that is always full")
@pytest.mark.parametrize(
    "command",
    [["decompress", "-o", "-"], ["map", "-o", "-"], ["info"], ["verify"]],
    ids=lambda command: command[0],
)
def test_full_disk(archive, command):
    script = "from gpszip.cli.main import run; run()"
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run(
            [sys.executable, "-c", script, command[0], str(archive), *command[1:]],
            stdout=full,
            stderr=subprocess.PIPE,
            check=False,
        )
    told = done.stderr.decode()
    assert told.startswith("gpszip: standard output: can't be written: No space left on device; ")
    assert len(told.splitlines()) == 1
    assert done.returncode == 1


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pipes that break")
def test_a_reader_that_closes_the_pipe(archive):
    script = "from gpszip.cli.main import run; run()"
    command = [
        sys.executable,
        "-c",
        script,
        "decompress",
        str(archive),
        "-o",
        "-",
        "--every",
        "1ms",
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        first = process.stdout.readline()
        process.stdout.close()
        told = process.stderr.read().decode()
    assert (first, told) == (b"track_id,t,x,y\n", "")
    assert process.returncode == 1


def test_output_where_nobody_may_write(gpszip, log):
    mistake(gpszip("compress", log, "-o", "/proc/out.gpsz"), 1, "can't write to this folder", "-o")


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write everywhere")
def test_output_without_permission(gpszip, log, tmp_path):
    (tmp_path / "locked").mkdir(mode=0o500)
    mistake(gpszip("compress", log, "-o", "locked/out.gpsz"), 1, "can't write to this folder")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--append"], ["no output was named", "-o walks.gpsz"]),
        (["-o", "a.gpsz", "--rmse", "5yd"], ["'yd' is no unit of length", "m, mm, cm"]),
        (["-o", "a.gpsz", "--gap", "5m"], ["write min for minutes"]),
        (["-o", "a.gpsz", "--rmse", "-5"], ["greater than 0"]),
        (["-o", "a.gpsz", "--rmse", "5m", "--bytes", "900"], ["give one"]),
        (
            ["-o", "a.gpsz", "--rmse", "5m", "--bytes", "900"],
            ["--rmse and --bytes were both given"],
        ),
        (["-o", "a.gpsz", "--bytes", "4 parsecs"], ["'parsecs' is no unit of size"]),
        (["-o", "a.gpsz", "--bytes", "900", "--k", "3"], ["can't be given with k or m"]),
        (["-o", "a.gpsz", "--ratio", "0"], ["x>0"]),
        (["-o", "a.gpsz", "--effort", "11"], ["1<=x<=9"]),
        (["-o", "a.gpsz", "--m", "3"], ["m was given alone"]),
        (["-o", "a.gpsz", "--k", "3", "--m", "5"], ["more segments than parts"]),
        (["-o", "a.gpsz", "--keep", "x"], ["'x' can't be kept: positions have", "rename"]),
        (["-o", "a.gpsz", "--keep-times", "--no-times"], ["can't be kept without times"]),
        (["-o", "a.gpsz", "--max-eror", "9m"], ["--max-eror", "--max-error"]),
    ],
    ids=lambda value: " ".join(value[2:]) if isinstance(value, list) else None,
)
def test_usage(gpszip, log, arguments, words):
    mistake(gpszip("compress", log, *arguments), 2, *words)
    assert list(log.parent.iterdir()) == [log]


def test_no_such_command(gpszip):
    mistake(gpszip("squeeze"), 2, "No such command 'squeeze'", "gpszip --help")


def test_errors_as_json(gpszip):
    done = gpszip("compress", "nowhere.csv", "-o", "out.gpsz", "--json")
    assert json.loads(done.err) == {
        "error": {"kind": "InputError", "message": "nowhere.csv: no such file", "exit_code": 1}
    }
    done = gpszip("compress", "--json", "--squeeze")
    assert json.loads(done.err)["error"]["exit_code"] == 2


def test_traceback_only_when_asked_for(gpszip):
    assert "Traceback" not in gpszip("info", "nowhere.gpsz").err
    told = gpszip("info", "nowhere.gpsz", "--debug").err
    assert "Traceback" in told
    assert told.splitlines()[-1] == "gpszip: nowhere.gpsz: no such file"


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs a terminal")
def test_an_archive_is_not_written_to_a_terminal(log):
    master, slave = os.openpty()
    script = "from gpszip.cli.main import run; run()"
    done = subprocess.run(
        [sys.executable, "-c", script, "compress", str(log), "-o", "-"],
        stdout=slave,
        stderr=subprocess.PIPE,
        check=False,
        timeout=60,
    )
    os.close(slave)
    os.close(master)
    assert done.returncode == 1
    assert b"redirect with > FILE" in done.stderr


@pytest.mark.parametrize("moment", ["before the command", "while the outcome is reported"])
def test_an_interrupt_outside_of_the_command_is_reported(log, tmp_path, moment):
    script = f"""
import signal
from gpszip.cli import main as program

main = program.main


def interrupted(arguments):
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if {moment!r} != "before the command":
        assert main(arguments) == 0
    signal.raise_signal(signal.SIGINT)


program.main = interrupted
program.run()
"""
    out = tmp_path / "out.gpsz"
    done = subprocess.run(
        [sys.executable, "-c", script, "compress", str(log), "-o", str(out)],
        capture_output=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == 130
    told = done.stderr.decode().splitlines()[-1]
    if out.exists():
        assert told.startswith("gpszip: interrupted; ")
        assert told.endswith("out.gpsz is written")
    else:
        assert told == "gpszip: interrupted; nothing was written"
    assert out.exists() == (moment != "before the command")


@pytest.mark.parametrize(
    "words",
    [
        "compress log.csv -o log.csv",
        "compress log.csv -o link.csv",
        "trips log.csv -o log.csv",
        "segments log.csv --k 4 --m 2 -o ./log.csv",
        "coreset log.csv --size 5 --points -o log.csv",
        "usage log.csv -o log.csv",
    ],
)
def test_a_log_is_not_replaced_by_what_is_made_of_it(gpszip, tmp_path, words):
    log = tmp_path / "log.csv"
    log.write_text("t,x,y\n" + "".join(f"{i},{i},0\n" for i in range(20)))
    (tmp_path / "link.csv").symlink_to(log)
    before = log.read_bytes()
    run = gpszip(f"{words} --force")
    assert run.code == 1
    assert "is an input, which would be lost; name another file with -o" in run.err
    assert log.read_bytes() == before


def test_a_selection_may_replace_its_archive(gpszip, tmp_path):
    rows = "".join(f"{name},{i},{i},0\n" for name in "ab" for i in range(20))
    (tmp_path / "log.csv").write_text(f"track_id,t,x,y\n{rows}")
    assert gpszip("compress log.csv -o log.gpsz --effort 1 --rmse 1").code == 0
    assert gpszip("decompress log.gpsz -o log.gpsz --force").code == 1
    assert gpszip("select log.gpsz --track a -o log.gpsz --force").code == 0
    assert gpszip("info log.gpsz --json").json["tracks"] == 1
