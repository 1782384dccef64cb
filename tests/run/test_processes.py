import os
import signal
import subprocess
import sys
import textwrap
import time

import pytest

from gpszip.errors import (
    BoundError,
    CorruptArchiveError,
    MissingExtraError,
    OptionError,
    WorkerError,
)
from gpszip.run import Processes
from oracle.chores import die, fail, halved, identity_of, process_of, scaled


@pytest.fixture(scope="module")
def two():
    with Processes(2) as executor:
        yield executor


def test_results_come_in_order_from_other_processes(two):
    assert list(two.map(halved, iter(range(40)))) == [x / 2 for x in range(40)]
    others = set(two.map(process_of, range(12)))
    assert len(others) == 2
    assert os.getpid() not in others


def test_a_shared_value_is_read_once_by_each_process(two):
    value = list(range(1000))
    with two.share(value) as shared:
        assert list(shared.map(scaled, range(50))) == [x * x for x in range(50)]
        seen = set(shared.map(identity_of, range(30)))
    assert len({process for process, _ in seen}) == len(seen) <= 2


def test_nothing_stays_behind_a_shared_value(two, tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    with two.share("x") as shared:
        assert len(list(tmp_path.iterdir())) == 1
        assert list(shared.map(identity_of, [1])) != []
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("which", "kind"), [(0, BoundError), (1, CorruptArchiveError), (2, MissingExtraError)]
)
def test_errors_come_back_as_what_they_were(two, which, kind):
    with pytest.raises(kind) as caught:
        list(two.map(fail, [which]))
    with pytest.raises(kind) as here:
        fail(which)
    assert str(caught.value) == str(here.value)
    assert vars(caught.value) == vars(here.value)


def test_a_process_that_is_killed_is_told_and_the_next_call_starts_afresh():
    with Processes(2) as executor:
        with pytest.raises(WorkerError, match="fewer workers"):
            list(executor.map(die, range(8)))
        assert list(executor.map(halved, [4])) == [2.0]


def test_no_processes_at_all_are_refused():
    with pytest.raises(OptionError, match="1 or more"):
        Processes(0)


def test_ctrl_c_ends_the_processes_at_once(tmp_path):
    script = tmp_path / "main.py"
    script.write_text(
        textwrap.dedent("""
            import multiprocessing, signal, sys
            from gpszip.run import Processes
            from oracle.chores import nap, process_of
            if __name__ == "__main__":
                # what runs in the background of a shell is born deaf to interruptions
                signal.signal(signal.SIGINT, signal.default_int_handler)
                with Processes(2) as executor:
                    print(*sorted(set(executor.map(process_of, range(8)))), flush=True)
                    try:
                        list(executor.map(nap, range(4)))
                    except KeyboardInterrupt:
                        print(len(multiprocessing.active_children()), flush=True)
        """)
    )
    path = os.pathsep.join(p for p in sys.path if p)
    running = subprocess.Popen(
        [sys.executable, script],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": path},
    )
    children = [int(word) for word in running.stdout.readline().split()]
    assert len(children) == 2
    time.sleep(0.5)
    running.send_signal(signal.SIGINT)
    rest, _ = running.communicate(timeout=20)
    assert rest.strip() == "0"
    for child in children:
        with pytest.raises(ProcessLookupError):
            os.kill(child, 0)
