import os
import signal
import threading
import time

import numpy as np
import pytest

from batches import compress_in_batches, force_batches
from gpszip.errors import BoundError, OptionError, WorkerError
from gpszip.io.large.store import store_logs
from gpszip.model import Options, Track
from gpszip.pipeline import coreset as sketching
from gpszip.pipeline.compress import compress
from gpszip.pipeline.merge import merge
from gpszip.pipeline.segment_mean import segment_mean
from gpszip.run import Dask, Processes, Serial, Threads, resolve_executor
from gpszip.run.dask import connect
from gpszip.run.executor import reduce_tree, share_value
from gpszip.testing import patrol
from oracle.chores import (
    empty_record,
    halve,
    join_in_brackets,
    join_records,
    kill_process_at_three,
    process_and_address,
    raise_error,
    scale,
)

dask = pytest.importorskip("dask")
distributed = pytest.importorskip("distributed")

pytestmark = pytest.mark.filterwarnings("default")


class Cluster(distributed.LocalCluster):
    """A local cluster that ignores the removal of workers that it never saw.

    A worker may die before its start is reported. ``LocalCluster`` then keeps a ``KeyError`` and
    raises it when it is closed, instead of closing.
    """

    def _update_worker_status(self, op, msg):
        if op != "remove" or msg in self.scheduler_info["workers"]:
            super()._update_worker_status(op, msg)


@pytest.fixture(scope="module")
def client():
    # an item may kill one worker, not the usual three: each takes seconds to start again, on a busy
    # machine more than the 15 after which the cluster closes it
    settings = {
        "distributed.scheduler.allowed-failures": 1,
        "distributed.deploy.lost-worker-timeout": "120s",
    }
    with (
        dask.config.set(settings),
        Cluster(
            n_workers=2,
            threads_per_worker=1,
            processes=True,
            dashboard_address=":0",  # any free port
            memory_limit=0,
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


@pytest.fixture(scope="module")
def two_processes():
    # shared by several tests, as each process loads all kernels
    with Processes(2) as executor:
        yield executor


def test_results_come_in_order_from_the_workers(client):
    executor = Dask(client)
    assert list(executor.map(halve, iter(range(40)))) == [x / 2 for x in range(40)]
    with executor.share([1, 2, 3]) as shared:
        assert list(shared.map(scale, range(9))) == [0, 2, 6, 3, 8, 15, 6, 14, 24]
        assert {process for process, _ in shared.map(process_and_address, range(12))} <= set(
            client.run(os.getpid).values()
        )


def test_errors_of_items_keep_their_class(client):
    with pytest.raises(BoundError, match="too tight"):
        list(Dask(client).map(raise_error, [0]))


@pytest.mark.parametrize("count", [1, 2, 3, 5, 6, 7, 8, 23])
def test_reduce_tree_has_the_same_shape_on_every_executor(client, count):
    words = "abcdefghijklmnopqrstuvw"[:count]
    serial = reduce_tree(None, join_in_brackets, words, str.upper)
    assert serial.replace("(", "").replace(")", "").split() == list(words.upper())
    assert (
        reduce_tree(Dask(client), join_in_brackets, iter(words), str.upper)
        == reduce_tree(Threads(2), join_in_brackets, words, str.upper)
        == serial
    )


def test_partial_results_stay_at_the_workers(client):
    record = reduce_tree(Dask(client), join_records, range(8), empty_record)
    # only the root of the tree is sent to the client, once
    assert record.processes.count(os.getpid()) == 1


def test_a_client_is_resolved_to_its_cluster(client):
    assert isinstance(resolve_executor(client), Dask)
    assert isinstance(resolve_executor(None), Threads)
    with pytest.raises(OptionError, match="no executor"):
        resolve_executor(3)


def test_a_killed_worker_does_not_change_the_result(client):
    executor = Dask(client)
    with executor.share(np.arange(100_000)) as shared:
        victim = next(iter(client.run(os.getpid).values()))
        killer = threading.Timer(0.3, os.kill, (victim, signal.SIGKILL))
        killer.start()

        def slow(values, item):
            time.sleep(0.05)
            return int(values[item] + item)

        assert list(shared.map(slow, range(60))) == [2 * x for x in range(60)]
        killer.join()
    client.wait_for_workers(2, timeout=120)
    assert victim not in client.run(os.getpid).values()


def test_an_item_that_kills_every_worker_raises_a_worker_error(client):
    with pytest.raises(WorkerError, match="too little memory"):
        list(Dask(client).map(kill_process_at_three, [3]))
    client.wait_for_workers(2, timeout=120)


def test_archives_and_segment_means_are_the_same_on_every_executor(client, two_processes):
    track = patrol(600, seed=5)
    options = Options(rmse=0.3, effort=3)
    expected = compress(track, options, executor=Serial())[0].to_bytes()
    for executor in (Threads(3), two_processes, client):
        assert compress(track, options, executor=executor)[0].to_bytes() == expected
    means = [
        segment_mean(track, m=4, executor=executor)
        for executor in (None, Threads(3), two_processes, client)
    ]
    assert len({mean.cost for mean in means}) == 1
    assert len({mean.boundaries.tobytes() for mean in means}) == 1


def test_archives_of_large_logs_are_the_same_on_a_cluster(client, tmp_path, monkeypatch):
    force_batches(monkeypatch, batch=500, subsample=750)
    track = patrol(1500, seed=5)
    log = tmp_path / "log.csv"
    log.write_text(
        "t,x,y\n"
        + "\n".join(f"{t},{x},{y}" for t, (x, y) in zip(track.times, track.positions, strict=True))
    )
    archives = [
        compress_in_batches(
            str(log), Options(rmse=0.3, effort=1), memory=420 << 20, executor=executor
        )[0].to_bytes()
        for executor in (Serial(), Dask(client))
    ]
    assert archives[0] == archives[1]


def test_coresets_are_the_same_on_a_cluster(client, tmp_path, monkeypatch):
    monkeypatch.setattr(sketching, "_BATCH", 500)
    track = patrol(5300, seed=5)
    log = tmp_path / "log.csv"
    log.write_text(
        "t,x,y\n"
        + "\n".join(f"{t},{x},{y}" for t, (x, y) in zip(track.times, track.positions, strict=True))
    )
    with store_logs(str(log), rows=2000) as stored:
        for options in ({"size": 40}, {"k": 5, "eps": 0.6}):
            serial, on_cluster = (
                sketching.sketch_log(stored, executor=executor, **options)
                for executor in (Serial(), Dask(client))
            )
            assert serial.rows.tobytes() == on_cluster.rows.tobytes()


def test_merged_archives_are_the_same_on_every_executor(client, two_processes):
    track = patrol(600, seed=5)
    thirds = [Track(str(i), track.times[i::3], track.positions[i::3]) for i in range(3)]
    archives = [compress(third, Options(rmse=0.3, effort=1))[0] for third in thirds]
    expected = merge(archives, executor=Serial())[0].to_bytes()
    for executor in (Threads(3), two_processes, client):
        assert merge(archives, executor=executor)[0].to_bytes() == expected


def test_an_executor_with_map_alone_suffices():
    class Backwards:
        def map(self, function, items):
            items = list(items)
            return iter([function(item) for item in items[::-1]][::-1])

    with share_value(Backwards(), 5) as shared:
        assert list(shared.map(pow, [1, 2])) == [5, 25]
    track = patrol(600, seed=5)
    archives = [
        compress(track, Options(rmse=0.3, effort=2), executor=executor)[0]
        for executor in (Backwards(), Serial())
    ]
    assert archives[0].to_bytes() == archives[1].to_bytes()


def test_an_unreachable_scheduler_raises_a_worker_error(monkeypatch):
    monkeypatch.setattr("gpszip.run.dask._CONNECT_TIMEOUT", 1)
    with pytest.raises(WorkerError, match="no scheduler answers"):
        connect("tcp://127.0.0.1:9")
