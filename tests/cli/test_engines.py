"""compress on other engines: the same bytes."""

from pathlib import Path

import pytest

distributed = pytest.importorskip("distributed")


@pytest.fixture
def scheduler():
    with distributed.LocalCluster(
        n_workers=1,
        threads_per_worker=2,
        processes=False,
        dashboard_address=":0",  # any free port
        protocol="tcp",
        host="127.0.0.1",
    ) as cluster:
        yield cluster.scheduler_address


@pytest.mark.filterwarnings("default")
def test_every_engine_writes_the_same_bytes(gpszip, log, scheduler, monkeypatch):
    warmed, written = [], []
    monkeypatch.setattr("gpszip.pipeline.warm.warm", lambda: warmed.append(True))
    for engine in (
        ["--workers", "1"],
        ["--workers", "3"],
        ["--engine", "processes", "--workers", "2"],
        ["--scheduler", scheduler],
    ):
        done = gpszip(f"compress {log} -o walk.gpsz --rmse 50cm --effort 1 --force", *engine)
        assert done.code == 0, done.err
        written.append(Path("walk.gpsz").read_bytes())
    assert len(set(written)) == 1
    assert warmed == [True]  # for the processes


def test_a_cluster_has_its_own_workers(gpszip, log):
    done = gpszip(
        "compress", log, "-o", "walk.gpsz", "--scheduler", "tcp://127.0.0.1:9", "--workers", "2"
    )
    assert done.code == 2
    assert "--workers" in done.err


@pytest.mark.filterwarnings("default")
def test_a_scheduler_that_does_not_answer_is_named(gpszip, log, monkeypatch):
    monkeypatch.setattr("gpszip.run.dask._CONNECT_TIMEOUT", 1)
    done = gpszip("compress", log, "-o", "walk.gpsz", "--scheduler", "tcp://127.0.0.1:9")
    assert done.code == 1
    assert "tcp://127.0.0.1:9" in done.err
    assert not Path("walk.gpsz").exists()
