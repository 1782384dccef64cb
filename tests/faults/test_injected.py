"""Commands under faults: outputs are the old or the new file, and the message says the rest.

By default, a few calls of some commands fail, and 20 runs are killed. ``GPSZIP_FAULTS=all`` tries
every call, every error, and 200 kills of each command (``make faults``).
"""

import json
import os
import shutil
import signal
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import pytest

from faults.judging import find_complaints

ALL = os.environ.get("GPSZIP_FAULTS") == "all"
BRIEF = ["recover", "csv", "parquet", "gpkg", "coreset", "map"]

linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="system calls of Linux")


def _outcomes(*words):
    """Run commands in other processes, and return their outcomes by command."""
    paths = [str(Path(__file__).parents[1]), *sys.path]
    done = subprocess.run(
        [sys.executable, "-m", "faults.injecting", *words],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        check=False,
    )
    if done.returncode and "strace can't be attached" in done.stderr:
        pytest.skip("strace may not be attached here")
    assert done.returncode == 0, done.stderr
    found = defaultdict(list)
    for line in done.stdout.splitlines():
        outcome = json.loads(line)
        found[outcome["command"]].append(outcome)
    return found


@linux
@pytest.mark.skipif(shutil.which("strace") is None, reason="needs strace")
def test_every_call_may_fail():
    names = () if ALL else BRIEF
    found = _outcomes("--all" if ALL else "--brief", *names)
    assert not [
        (outcome, complaints)
        for outcomes in found.values()
        for outcome in outcomes
        if (complaints := find_complaints(outcome))
    ]
    for name, outcomes in found.items():
        injected = {outcome["fault"].partition(":")[0] for outcome in outcomes}
        assert {"mkdir", "write", "fsync", "rename"} <= injected, name
        assert {outcome["output"] for outcome in outcomes} >= {"old"}, name
        assert any(outcome["code"] == 1 for outcome in outcomes), name


@linux
def test_a_process_may_be_killed_at_any_time():
    found = _outcomes("--times=200") if ALL else _outcomes("--times=10", "csv", "coreset")
    assert not [
        (outcome, complaints)
        for outcomes in found.values()
        for outcome in outcomes
        if (complaints := find_complaints(outcome))
    ]
    assert sum(outcome["code"] == -9 for outcomes in found.values() for outcome in outcomes) >= (
        1000 if ALL else 5
    )


@linux
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_process_that_gets_a_signal_leaves_no_temporary_file(number):
    found = _outcomes(
        f"--times={200 if ALL else 10}", f"--signal={int(number)}", *(() if ALL else ("parquet",))
    )
    assert not [
        (outcome, complaints)
        for outcomes in found.values()
        for outcome in outcomes
        if (complaints := find_complaints(outcome))
    ]
    assert any(outcome["code"] == 130 for outcomes in found.values() for outcome in outcomes)


def test_the_judge_finds_corrupt_files_and_errors_without_a_message():
    """The judge complains about every kind of wrong outcome."""
    good = {
        "fault": "write:error=EIO",
        "code": 1,
        "message": "gpszip: out: can't be written\n",
        "output": "old",
        "left": [],
        "injected": "write(6)",
    }
    assert find_complaints(good) == []
    for change in (
        {"output": "torn"},
        {"code": 0},
        {"code": 1, "message": ""},
        {"code": -6},
        {"message": "gpszip: a fault of GPSZip's own: ValueError"},
        {"left": ["tmp/gpszip-x.part"]},
        {"fault": "write:error=EINTR"},
        {"output": "mixed"},
    ):
        assert find_complaints({**good, **change}), change
    assert find_complaints(
        {**good, "fault": "signal 9", "code": -9, "message": "", "left": ["work/out.csv.tmp"]}
    )
    assert (
        find_complaints(
            {
                **good,
                "fault": "signal 9",
                "code": -9,
                "message": "",
                "left": ["work/.gpszip-x.part"],
            }
        )
        == []
    )
