"""Commands while the system fails: the old file or the new one is there, whole, and the rest is told.

Where time is short, a few calls of each command fail, and 20 runs are killed. ``GPSZIP_FAULTS=all`` tries every call, every error,
and 200 kills of each command (``make faults``).
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

from faults.judging import wrong

ALL = os.environ.get("GPSZIP_FAULTS") == "all"
BRIEF = ["recover", "csv", "parquet", "gpkg", "coreset", "map"]

linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="system calls of Linux")


def _outcomes(*words):
    """Outcomes by command, of runs in processes of their own."""
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
        for some in found.values()
        for outcome in some
        if (complaints := wrong(outcome))
    ]
    for name, some in found.items():
        struck = {outcome["fault"].partition(":")[0] for outcome in some}
        assert {"mkdir", "write", "fsync", "rename"} <= struck, name
        assert {outcome["output"] for outcome in some} >= {"old"}, name
        assert any(outcome["code"] == 1 for outcome in some), name


@linux
def test_any_moment_may_be_the_last():
    found = _outcomes("--times=200") if ALL else _outcomes("--times=10", "csv", "coreset")
    assert not [
        (outcome, complaints)
        for some in found.values()
        for outcome in some
        if (complaints := wrong(outcome))
    ]
    assert sum(outcome["code"] == -9 for some in found.values() for outcome in some) >= (
        1000 if ALL else 5
    )


@linux
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_whoever_is_told_to_end_leaves_nothing(number):
    found = _outcomes(
        f"--times={200 if ALL else 10}", f"--signal={int(number)}", *(() if ALL else ("parquet",))
    )
    assert not [
        (outcome, complaints)
        for some in found.values()
        for outcome in some
        if (complaints := wrong(outcome))
    ]
    assert any(outcome["code"] == 130 for some in found.values() for outcome in some)


def test_torn_files_and_untold_errors_are_noticed():
    """Who judges is judged, too."""
    good = {
        "fault": "write:error=EIO", "code": 1, "told": "gpszip: out: can't be written\n", "output": "old", "left": [], "struck": "write(6)",
    }  # fmt: skip
    assert wrong(good) == []
    for change in (
        {"output": "torn"},
        {"code": 0},
        {"code": 1, "told": ""},
        {"code": -6},
        {"told": "gpszip: a fault of GPSZip's own: ValueError"},
        {"left": ["tmp/gpszip-x.part"]},
        {"fault": "write:error=EINTR"},
        {"output": "mixed"},
    ):
        assert wrong({**good, **change}), change
    assert wrong(
        {**good, "fault": "signal 9", "code": -9, "told": "", "left": ["there/out.csv.tmp"]}
    )
    assert (
        wrong(
            {**good, "fault": "signal 9", "code": -9, "told": "", "left": ["there/.gpszip-x.part"]}
        )
        == []
    )
