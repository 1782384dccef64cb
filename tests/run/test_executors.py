from __future__ import annotations

import signal
import threading
import time

import pytest

from gpszip.errors import OptionError
from gpszip.run import Serial, Threads


@pytest.mark.parametrize("executor", [Serial(), Threads(1), Threads(4), Threads()], ids=str)
def test_results_come_in_the_order_of_the_items(executor):
    def slow_first(x):
        time.sleep(0.01 if x % 5 == 0 else 0)
        return x * x

    assert list(executor.map(slow_first, iter(range(40)))) == [x * x for x in range(40)]
    assert list(executor.map(abs, [])) == []


def test_threads_work_side_by_side():
    meeting = threading.Barrier(3, timeout=10)
    assert sorted(Threads(3).map(lambda _: meeting.wait(), range(3))) == [0, 1, 2]


def test_a_long_stream_is_not_held_at_once():
    taken = []

    def stream():
        for x in range(1000):
            taken.append(x)
            yield x

    results = Threads(2).map(abs, stream())
    next(results)
    assert len(taken) <= 5
    results.close()
    assert len(taken) <= 5


@pytest.mark.parametrize("executor", [Serial(), Threads(2)], ids=str)
def test_an_error_is_raised_in_its_turn(executor):
    results = executor.map(lambda x: 6 // x, [3, 2, 0, 1])
    assert [next(results), next(results)] == [2, 3]
    with pytest.raises(ZeroDivisionError):
        next(results)


def test_an_interruption_ends_the_work_under_way():
    begun, ended = [threading.Event(), threading.Event()], []

    def work(item):
        try:
            begun[item].set()
            for _ in range(3000):
                time.sleep(0.01)
        except KeyboardInterrupt:
            ended.append(item)
            raise

    def interrupt():
        for one in begun:
            one.wait(60)
        time.sleep(0.3)  # until both threads and the one that waits for them are where they stay
        signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)

    # what runs in the background of a shell is born deaf to interruptions
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        threading.Thread(target=interrupt).start()
        with pytest.raises(KeyboardInterrupt):
            list(Threads(2).map(work, range(2)))
    finally:
        signal.signal(signal.SIGINT, before)
    assert sorted(ended) == [0, 1]


def test_no_threads_at_all_is_refused():
    with pytest.raises(OptionError, match="1 or more"):
        Threads(0)
