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
from oracle.chores import (
    halve,
    kill_process_at_three,
    process_and_address,
    process_id,
    raise_error,
    scale,
)


@pytest.fixture(scope="module")
def two_processes():
    with Processes(2) as executor:
        yield executor


def test_results_come_in_order_from_other_processes(two_processes, tmp_path):
    assert list(two_processes.map(halve, iter(range(40)))) == [x / 2 for x in range(40)]
    others = set(two_processes.map(process_id, [tmp_path] * 2))
    assert len(others) == 2
    assert os.getpid() not in others


def test_a_shared_value_is_read_once_by_each_process(two_processes):
    value = list(range(1000))
    with two_processes.share(value) as shared:
        assert list(shared.map(scale, range(50))) == [x * x for x in range(50)]
        loads = set(shared.map(process_and_address, range(30)))
    assert len({process for process, _ in loads}) == len(loads) <= 2


def test_the_file_of_a_shared_value_is_removed(two_processes, tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    with two_processes.share("x") as shared:
        assert len(list(tmp_path.iterdir())) == 1
        assert list(shared.map(process_and_address, [1])) != []
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("number", "error_class"), [(0, BoundError), (1, CorruptArchiveError), (2, MissingExtraError)]
)
def test_errors_keep_their_class_message_and_fields(two_processes, number, error_class):
    with pytest.raises(error_class) as from_process:
        list(two_processes.map(raise_error, [number]))
    with pytest.raises(error_class) as original:
        raise_error(number)
    assert str(from_process.value) == str(original.value)
    assert vars(from_process.value) == vars(original.value)


def test_a_killed_process_raises_a_worker_error_and_the_next_call_starts_a_new_one():
    with Processes(2) as executor:
        with pytest.raises(WorkerError, match="fewer workers"):
            list(executor.map(kill_process_at_three, range(8)))
        assert list(executor.map(halve, [4])) == [2.0]


def test_zero_processes_are_refused():
    with pytest.raises(OptionError, match="1 or more"):
        Processes(0)


def test_ctrl_c_ends_the_processes_at_once(tmp_path):
    script, asleep = tmp_path / "main.py", tmp_path / "asleep"
    asleep.mkdir()
    script.write_text(
        textwrap.dedent("""
            import multiprocessing, signal, sys
            from gpszip.run import Processes
            from oracle.chores import sleep_30_seconds
            if __name__ == "__main__":
                # a shell's background processes ignore SIGINT from the start
                signal.signal(signal.SIGINT, signal.default_int_handler)
                with Processes(2) as executor:
                    try:
                        list(executor.map(sleep_30_seconds, [sys.argv[1]] * 4))
                    except KeyboardInterrupt:
                        print(len(multiprocessing.active_children()), flush=True)
        """)
    )
    path = os.pathsep.join(p for p in sys.path if p)
    running = subprocess.Popen(
        [sys.executable, script, asleep],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": path},
    )
    # Both processes sleep before the signal comes.
    deadline = time.monotonic() + 60
    while len(children := [int(path.name) for path in asleep.iterdir()]) < 2:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    running.send_signal(signal.SIGINT)
    rest, _ = running.communicate(timeout=20)
    assert rest.strip() == "0"
    for child in children:
        with pytest.raises(ProcessLookupError):
            os.kill(child, 0)
