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


def test_threads_run_concurrently():
    meeting = threading.Barrier(3, timeout=10)
    assert sorted(Threads(3).map(lambda _: meeting.wait(), range(3))) == [0, 1, 2]


def test_a_long_stream_is_drawn_lazily():
    drawn = []

    def stream():
        for x in range(1000):
            drawn.append(x)
            yield x

    results = Threads(2).map(abs, stream())
    next(results)
    assert len(drawn) <= 5
    results.close()
    assert len(drawn) <= 5


@pytest.mark.parametrize("executor", [Serial(), Threads(2)], ids=str)
def test_an_error_is_raised_in_its_turn(executor):
    results = executor.map(lambda x: 6 // x, [3, 2, 0, 1])
    assert [next(results), next(results)] == [2, 3]
    with pytest.raises(ZeroDivisionError):
        next(results)


def test_an_interruption_reaches_the_running_threads():
    started, interrupted = [threading.Event(), threading.Event()], []

    def work(item):
        try:
            started[item].set()
            for _ in range(3000):
                time.sleep(0.01)
        except KeyboardInterrupt:
            interrupted.append(item)
            raise

    def interrupt():
        for event in started:
            event.wait(60)
        time.sleep(0.3)  # both threads sleep by now, and the main thread waits for their results
        signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)

    # a shell's background processes ignore SIGINT from the start
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        threading.Thread(target=interrupt).start()
        with pytest.raises(KeyboardInterrupt):
            list(Threads(2).map(work, range(2)))
    finally:
        signal.signal(signal.SIGINT, before)
    assert sorted(interrupted) == [0, 1]


def test_zero_threads_are_refused():
    with pytest.raises(OptionError, match="1 or more"):
        Threads(0)
