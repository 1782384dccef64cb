"""Logs larger than memory: the same promises, whoever works and however the log is spread over files."""

import io
import os
import pickle
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import gpszip
from batches import compress_in_batches, force_batches
from gpszip import BoundError, OptionError
from gpszip.cli.main import main
from gpszip.model import Options, Track
from gpszip.model.error_bound import WRITING_SHARE_IN_METRES
from gpszip.model.log import MemoryLog
from gpszip.pipeline import encode_batches, learn
from gpszip.pipeline import memory as budget
from gpszip.pipeline.job import prepare
from gpszip.pipeline.open_log import open_log
from gpszip.run import Processes, Serial, Threads
from gpszip.testing import city
from gpszip.testing.patrol import patrol

MEMORY = 420 << 20
TESTS = Path(__file__).parents[1]


@pytest.fixture(autouse=True)
def small_batches(monkeypatch):
    """Batches so small that little logs have several."""
    force_batches(monkeypatch, batch=4000, subsample=6000)


@pytest.fixture
def folder(tmp_path):
    """Two robots in one building, whose hours are spread over files."""
    room = tmp_path / "logs"
    room.mkdir()
    robots = [patrol(9000, seed=5, id="one"), patrol(3000, seed=5, id="two")]
    for number, cut in enumerate((slice(0, 2000), slice(2000, 9000))):
        parts = [pa.table({"track_id": [r.id] * len(r.times[cut]), "t": r.times[cut], "x": r.positions[cut, 0], "y": r.positions[cut, 1]})
                 for r in robots if len(r.times[cut])]  # fmt: skip
        pq.write_table(pa.concat_tables(parts).sort_by("t"), room / f"{9 - number}.parquet")
    return room, robots


def off(archive, tracks):
    return np.concatenate(
        [
            np.linalg.norm(archive.position(one.id, one.times, metres=True) - one.positions, axis=1)
            for one in tracks
        ]
    )


@pytest.mark.parametrize("bound", [{"rmse": 0.25}, {"max_error": 0.9}, {}])
def test_the_bound_holds_at_every_sample(folder, bound):
    archive, report, reading = compress_in_batches(
        folder[0], Options(effort=1, **bound), memory=MEMORY
    )
    errors = off(archive, folder[1])
    assert report.points == len(errors) == reading.points == 12_000
    assert report.rmse == pytest.approx(np.sqrt((errors**2).mean()), rel=1e-6)
    assert report.max_error == pytest.approx(errors.max(), rel=1e-6)
    assert report.rmse <= bound.get("rmse", np.inf)
    assert report.max_error <= bound.get("max_error", np.inf)
    assert sorted(archive.ids) == ["one", "two"]
    whole = gpszip.compress(folder[1], effort=1, **(bound or {"rmse": report.rmse}))
    assert len(archive.to_bytes()) < 1.6 * len(whole.to_bytes())


def test_the_same_bytes_whoever_works(folder):
    made = []
    with Processes(2) as processes:
        for executor in (Serial(), Threads(1), Threads(3), processes):
            made.append(
                compress_in_batches(
                    folder[0], Options(rmse=0.3, effort=1), memory=MEMORY, executor=executor
                )[0].to_bytes()
            )
    assert len(set(made)) == 1


def test_batches_are_worked_on_by_other_processes(folder):
    """Nothing but bytes comes and goes: an executor in whose map both are pickled does the same."""

    class Elsewhere:
        def __init__(self):
            self.batches = []

        def local(self):
            return Serial()

        def map(self, function, items):
            for item in items:
                there, work = pickle.loads(pickle.dumps((function, item)))
                self.batches.append(work)
                yield pickle.loads(pickle.dumps(there(work)))

    elsewhere = Elsewhere()
    here, there = (
        compress_in_batches(folder[0], Options(rmse=0.3, effort=1), memory=MEMORY, executor=x)[0]
        for x in (Serial(), elsewhere)
    )
    assert here.to_bytes() == there.to_bytes()
    laid = sum(isinstance(work, list) and isinstance(work[0], Track) for work in elsewhere.batches)
    assert laid >= 3
    assert laid % 3 == 0  # all batches, for each share of the bound that is tried


def test_no_more_threads_work_than_there_is_memory_for(folder, monkeypatch):
    monkeypatch.setattr(budget, "_BYTES_ENCODING", 4000)
    with open_log(folder[0], memory=MEMORY) as log:
        job = prepare(log, Options(rmse=0.3), memory=MEMORY, executor=Threads(9))
    workers, available = job.executor.workers, MEMORY - budget.PROGRAM
    assert workers * 5000 * 4000 <= available < (workers + 1) * 5000 * 4000


def test_degrees_and_gaps(tmp_path):
    rows = ["id,time,lat,lon"]
    for name, (times, degrees) in city(vehicles=3, period=10.0, duration=9000.0, blocks=3).items():
        rows += [
            f"{name},{t + (40_000 if t > 5000 else 0):g},{lat:.6f},{lon:.6f}"
            for t, (lat, lon) in zip(times, degrees, strict=True)
        ]
    (tmp_path / "town.csv").write_text("\n".join(rows) + "\n")
    archive, report, _ = compress_in_batches(
        str(tmp_path / "town.csv"), Options(rmse=12.0, effort=1), memory=MEMORY
    )
    assert report.gap < 40_000
    assert all(walk.gaps.sum() == 1 for walk in archive.walks)
    assert np.sqrt((off(archive, gpszip.read(str(tmp_path / "town.csv"))) ** 2).mean()) <= 12.01


def test_a_batch_that_learning_does_not_master_keeps_the_knots_that_it_needs(folder, monkeypatch):
    monkeypatch.setattr(encode_batches, "learn_on", lambda *_, **__: None)
    archive, report, _ = compress_in_batches(
        folder[0], Options(max_error=1.0, effort=1), memory=MEMORY
    )
    assert off(archive, folder[1]).max() <= 1.0
    assert report.points == 12_000


def test_a_batch_may_take_more_error_where_others_take_less(folder, monkeypatch):
    from gpszip.mapping.on_known_map import learn_on

    def only_for_more(known, grid, tracks, gaps, *, rmse, **others):
        hard = tracks[0].id == "0/0"
        return (
            None
            if hard and rmse < 0.31
            else learn_on(known, grid, tracks, gaps, rmse=rmse if hard else 0.8 * rmse, **others)
        )

    monkeypatch.setattr(encode_batches, "learn_on", only_for_more)
    archive, report, _ = compress_in_batches(folder[0], Options(rmse=0.31, effort=1), memory=MEMORY)
    assert report.rmse <= 0.31
    assert np.sqrt((off(archive, folder[1]) ** 2).mean()) <= 0.31


def test_what_needs_the_whole_log_is_refused(folder):
    with pytest.raises(
        OptionError, match=r"larger than the memory.*give --rmse instead of k and m"
    ):
        compress_in_batches(folder[0], Options(k=3), memory=MEMORY)


def test_a_size_is_kept_and_made_use_of(folder):
    archive, report, reading = compress_in_batches(
        folder[0], Options(effort=1, ratio=500.0), memory=MEMORY
    )
    size = int(reading.bytes / 500)
    assert 0.9 * size <= len(archive.to_bytes()) == report.bytes_out <= size
    assert report.rmse == pytest.approx(np.sqrt((off(archive, folder[1]) ** 2).mean()), rel=1e-6)


def test_a_size_that_nothing_has_names_what_would_do(folder):
    with pytest.raises(
        BoundError, match="20 bytes are too few for this log: the smallest archive takes"
    ):
        compress_in_batches(folder[0], Options(size=20, effort=1), memory=MEMORY)


def test_too_little_memory_is_refused(folder):
    with pytest.raises(OptionError, match="give at least 400 MiB"):
        compress_in_batches(folder[0], Options(rmse=1.0), memory=1 << 20)


def test_small_logs_are_read_into_memory(folder, monkeypatch):
    monkeypatch.setattr(budget, "_BYTES_IN_MEMORY", 700)
    with open_log(folder[0], memory=1 << 30) as log:
        assert isinstance(log, MemoryLog)
    with open_log(folder[0], memory=400 << 20) as log:
        assert isinstance(log, MemoryLog)
    monkeypatch.setattr(budget, "_BYTES_IN_MEMORY", 70_000)
    with open_log(folder[0], memory=1 << 30) as log:
        assert not isinstance(log, MemoryLog)


def test_the_command_line_compresses_in_batches(folder, capfd, monkeypatch):
    (folder[0] / "bad.parquet").write_bytes(b"PAR1 none")
    target = folder[0].parent / "out.gpsz"
    command = [
        "compress",
        str(folder[0]),
        "-o",
        str(target),
        "--rmse",
        "30cm",
        "--effort",
        "1",
        "--memory",
        "420MiB",
    ]
    assert main(command) == 1
    assert "bad.parquet: can't be read" in capfd.readouterr().err
    assert main([*command, "--skip-bad"]) == 3
    assert "bad.parquet" in capfd.readouterr().err
    assert np.sqrt((off(gpszip.open(target), folder[1]) ** 2).mean()) <= 0.3
    assert main([*command, "--skip-bad", "--force", "--k", "9"]) == 2


@pytest.mark.skipif(
    not Path("/proc/self/status").exists(), reason="the peak of a process is read from Linux"
)
def test_memory_is_kept(tmp_path):
    """As a process of its own, once what it needs is compiled, which takes memory by itself."""
    script = textwrap.dedent(
        """
        import sys
        import numpy as np, pyarrow as pa, pyarrow.parquet as pq
        from gpszip.model import Options, Track
        from batches import compress_in_batches
        n = 200_000; noise = np.random.default_rng(1).normal(0, 0.5, (2, n))
        with pq.ParquetWriter(sys.argv[1], pa.schema([("t", pa.float64()), ("x", pa.float64()), ("y", pa.float64())])) as file:
            for a in range(0, n, 50_000):
                t = np.arange(a, a + 50_000) / 10
                x, y = np.stack([50 * np.cos(t / 50), 30 * np.sin(t / 50)]) + noise[:, a : a + 50_000]
                file.write_table(pa.table({"t": t, "x": x, "y": y}))
        archive, report, _ = compress_in_batches(sys.argv[1], Options(rmse=1.0, effort=1), memory=410 << 20)
        assert report.points == n
        # what getrusage tells begins with the size of the process that started this one
        status = dict(line.split(":", 1) for line in open("/proc/self/status"))
        print(int(status["VmHWM"].split()[0]) / 1024)
        """
    )
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", script, str(tmp_path / "log.parquet")],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join([str(TESTS), *sys.path])},
        )
    assert float(done.stdout) < 1.2 * 410


def test_a_dense_subsample_is_thinned_and_a_sparse_one_is_not():
    dense = MemoryLog((patrol(4000, seed=5),))

    def thin_out(**bound):
        options = Options(**bound)
        return learn._thin_out(prepare(dense, options), options)[0]

    (few,) = thin_out(rmse=0.3)
    assert len(few) <= 8 * 100 + 2
    assert few.weights.sum() == pytest.approx(4000)
    assert thin_out(rmse=0.01)[0] is dense.tracks[0]
    assert thin_out(max_error=0.02)[0] is dense.tracks[0]


def test_standard_input_larger_than_memory_is_split_where_time_goes_back(
    tmp_path, monkeypatch, capfd
):
    times = np.tile(np.arange(6000.0), 2)
    rows = "".join(f"{t:g},{50 * np.cos(t / 50):.3f},{30 * np.sin(t / 50):.3f}\n" for t in times)
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(("t,x,y\n" + rows).encode())))
    target = tmp_path / "out.gpsz"
    command = [
        "compress",
        "-",
        "-o",
        str(target),
        "--rmse",
        "1m",
        "--effort",
        "1",
        "--memory",
        "420MiB",
    ]
    assert main(command) == 1
    assert "--split starts a new track" in capfd.readouterr().err
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(("t,x,y\n" + rows).encode())))
    assert main([*command, "--split"]) == 0, capfd.readouterr().err
    assert gpszip.open(target).ids == ("0", "0-2")


@pytest.fixture
def rounds(tmp_path, monkeypatch):
    """A robot that goes round and round at a pace of its own, in twelve batches."""
    force_batches(monkeypatch, batch=2500, subsample=6000)
    monkeypatch.setattr(budget, "_MIN_BATCH", 2500)
    times, rng = np.arange(30_000.0), np.random.default_rng(2)
    phase = np.cumsum(np.repeat(rng.uniform(0.01, 0.03, 600), 50))
    x, y = np.stack([50 * np.cos(phase), 30 * np.sin(phase)]) + rng.normal(0, 0.5, (2, len(times)))
    pq.write_table(pa.table({"t": times, "x": x, "y": y}), tmp_path / "log.parquet")
    return str(tmp_path / "log.parquet")


def test_times_get_as_coarse_as_the_error_left_allows(rounds, monkeypatch):
    options = Options(rmse=1.0 / (1 - WRITING_SHARE_IN_METRES), effort=1)
    archive, report, _ = compress_in_batches(rounds, options, memory=MEMORY)
    monkeypatch.setattr(learn, "with_best_time_step", lambda log, base, batches, executor: base)
    fine, before, _ = compress_in_batches(rounds, options, memory=MEMORY)
    assert 0.98 < report.rmse <= 1.0
    assert archive.grid.time > fine.grid.time
    assert report.bytes_out < before.bytes_out


def test_twelve_batches_give_the_same_bytes_whoever_works(rounds):
    made = [
        compress_in_batches(rounds, Options(rmse=1.0, effort=1), memory=MEMORY, executor=one)[0]
        for one in (Serial(), Threads(3))
    ]
    assert made[0].to_bytes() == made[1].to_bytes()


def test_what_a_batch_adds_to_the_map_is_known_to_later_ones(rounds, monkeypatch):
    """The excerpt ends before the robot leaves its round for another one."""
    monkeypatch.setattr(learn, "with_best_time_step", lambda log, base, batches, executor: base)
    rows = pq.read_table(rounds).slice(0, 22_000)
    x = rows["x"].to_numpy() + np.where(np.arange(22_000) >= 5000, 300.0, 0.0)
    pq.write_table(rows.set_column(1, "x", pa.array(x)), rounds)
    monkeypatch.setattr(
        "gpszip.pipeline.job._subsample", lambda log, _: (log.read(log.tracks[0], 0, 4000),)
    )
    nodes = []
    for wave in (2, 100):
        monkeypatch.setattr(encode_batches, "_WAVE", wave)
        nodes.append(
            compress_in_batches(rounds, Options(rmse=1.0, effort=1), memory=MEMORY)[1].nodes
        )
    assert nodes[0] < nodes[1]
    monkeypatch.setattr(encode_batches, "_MAX_PRIOR_KNOTS", 0)
    monkeypatch.setattr(encode_batches, "_WAVE", 2)
    assert (
        compress_in_batches(rounds, Options(rmse=1.0, effort=1), memory=MEMORY)[1].nodes == nodes[1]
    )


def test_times_too_coarse_for_some_batch_are_taken_back(rounds, monkeypatch):
    """Where the bound can't be held on coarser times, it is on those that were learnt."""
    time_steps, encode = [], learn.encode_batches

    def on_fine_times_only(log, base, batches, executor, report):
        time_steps.append(base.grid.time)
        if len(time_steps) == 1:
            raise BoundError("too coarse")
        return encode(log, base, batches, executor, report)

    monkeypatch.setattr(learn, "encode_batches", on_fine_times_only)
    _, report, _ = compress_in_batches(rounds, Options(rmse=1.0, effort=1), memory=MEMORY)
    assert time_steps[1] < time_steps[0]
    assert report.rmse <= 1.0
