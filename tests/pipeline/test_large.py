"""Logs larger than memory keep all bounds, on all engines and however files share them."""

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
from batches import append_in_batches, compress_in_batches, force_batches
from gpszip import BoundError, OptionError
from gpszip.cli.main import main
from gpszip.model import Options, Track
from gpszip.model.log import MemoryLog
from gpszip.pipeline import encode_batches, learn_in_batches
from gpszip.pipeline import memory as memory_limits
from gpszip.pipeline.job import prepare
from gpszip.pipeline.open_log import open_log
from gpszip.run import Processes, Serial, Threads
from gpszip.testing import city
from gpszip.testing.patrol import patrol
from gpszip.walks.shapes import shape_error

MEMORY = 420 << 20
TESTS = Path(__file__).parents[1]

#: Samples of a batch: short logs have several.
BATCH = 830

#: Samples of both robots.
N = 2000


@pytest.fixture(autouse=True)
def small_batches(monkeypatch):
    """Make batches so small that short logs have several."""
    force_batches(monkeypatch, batch=BATCH, subsample=1000)


@pytest.fixture(scope="module")
def robots():
    """Two robots in one building."""
    return [patrol(1500, seed=5, id="one"), patrol(500, seed=5, id="two")]


@pytest.fixture
def folder(robots, tmp_path):
    """A folder of two files, each with some hours of both robots."""
    path = tmp_path / "logs"
    path.mkdir()
    for name, rows in (("9", slice(0, 300)), ("8", slice(300, 1500))):
        tables = [rows_of_track(robot, rows) for robot in robots]
        pq.write_table(pa.concat_tables(tables).sort_by("t"), path / f"{name}.parquet")
    return path


def rows_of_track(track, rows):
    """Some samples of a track as a table."""
    times = track.times[rows]
    x, y = track.positions[rows].T
    return pa.table({"track_id": [track.id] * len(times), "t": times, "x": x, "y": y})


def distances(archive, tracks):
    """Distances of all samples to the archive's positions."""
    by_track = [
        np.linalg.norm(
            archive.position(track.id, track.times, metres=True) - track.positions, axis=1
        )
        for track in tracks
    ]
    return np.concatenate(by_track)


def root_mean_square(values):
    return float(np.sqrt((values**2).mean()))


@pytest.mark.parametrize("bound", [{"rmse": 0.25}, {"max_error": 0.9}, {}])
def test_the_bound_holds_at_every_sample(folder, robots, bound):
    archive, report, result = compress_in_batches(folder, Options(effort=1, **bound), memory=MEMORY)
    errors = distances(archive, robots)
    assert report.points == len(errors) == result.points == N
    assert report.rmse == pytest.approx(root_mean_square(errors), rel=1e-6)
    assert report.max_error == pytest.approx(errors.max(), rel=1e-6)
    assert report.rmse <= bound.get("rmse", np.inf)
    assert report.max_error <= bound.get("max_error", np.inf)
    assert sorted(archive.ids) == ["one", "two"]
    in_memory = gpszip.compress(robots, effort=1, **(bound or {"rmse": report.rmse}))
    assert len(archive.to_bytes()) < 1.6 * len(in_memory.to_bytes())


def test_engines_give_the_same_bytes(folder):
    options = Options(rmse=0.3, effort=1)
    with Processes(2) as processes:
        archives = [
            compress_in_batches(folder, options, memory=MEMORY, executor=executor)[0].to_bytes()
            for executor in (Serial(), Threads(3), processes)
        ]
    assert len(set(archives)) == 1


def test_batches_can_be_pickled_for_other_processes(folder):
    """An executor that pickles functions, batches and results gives the same bytes."""

    class PicklingExecutor:
        def __init__(self):
            self.batches = []

        def local(self):
            return Serial()

        def map(self, function, items):
            for item in items:
                remote_function, batch = pickle.loads(pickle.dumps((function, item)))
                self.batches.append(batch)
                yield pickle.loads(pickle.dumps(remote_function(batch)))

    pickling, options = PicklingExecutor(), Options(rmse=0.3, effort=1)
    local, remote = (
        compress_in_batches(folder, options, memory=MEMORY, executor=executor)[0]
        for executor in (Serial(), pickling)
    )
    assert local.to_bytes() == remote.to_bytes()
    encoded = sum(
        isinstance(batch, list) and isinstance(batch[0], Track) for batch in pickling.batches
    )
    assert encoded >= 3
    assert encoded % 3 == 0  # all three batches, for each share of the bound that is tried


def test_memory_limits_the_number_of_threads(folder, monkeypatch):
    monkeypatch.setattr(memory_limits, "_BYTES_ENCODING", 24_000)
    with open_log(folder, memory=MEMORY) as log:
        job = prepare(log, Options(rmse=0.3), memory=MEMORY, executor=Threads(9))
    workers, available = job.executor.workers, MEMORY - memory_limits.PROGRAM
    assert workers * BATCH * 24_000 <= available < (workers + 1) * BATCH * 24_000


@pytest.fixture
def messy_logs(tmp_path):
    """Two halves of a log, each with a row of every kind that reading repairs."""
    names = []
    for name, first in (("morning", 0), ("evening", 1000)):
        times = np.arange(first, first + 1000)
        noise = np.random.default_rng(first).normal(0, 0.3, (2, len(times)))
        x, y = np.stack([50 * np.cos(times / 50), 30 * np.sin(times / 50)]) + noise
        x[300] += 50_000  # an outlier
        rows = [
            f"robot,{row[0]},{row[1]:.3f},{row[2]:.3f}" for row in zip(times, x, y, strict=True)
        ]
        rows[100] = f"robot,{times[100]},,"  # no position
        rows[200] = rows[199]  # a duplicate
        rows[400], rows[401] = rows[401], rows[400]  # a time that goes back
        names.append(str(tmp_path / f"{name}.csv"))
        Path(names[-1]).write_text("\n".join(["id,t,x,y", *rows]) + "\n")
    return names


def test_disk_and_memory_report_the_same_points_and_repairs(messy_logs):
    def count_points_and_repairs(report, result):
        repairs = sorted((repair.what, repair.count, repair.drops) for repair in result.repairs)
        return report.points, result.points, repairs

    counts = []
    for memory in (None, MEMORY):
        reading = {"memory": memory, "clean": True, "sort": True}
        archive, *compressed = compress_in_batches(
            messy_logs[0], Options(rmse=1.0, effort=1), **reading
        )
        _, *appended = append_in_batches(archive, messy_logs[1], Options(effort=1), **reading)
        counts.append([count_points_and_repairs(*pair) for pair in (compressed, appended)])
    in_memory, on_disk = counts
    assert on_disk == in_memory
    for kept, points, repairs in in_memory:
        assert (kept, points, len(repairs)) == (997, 1000, 4)


def test_logs_in_degrees_with_gaps_are_compressed(tmp_path):
    rows = ["id,time,lat,lon"]
    for name, (times, degrees) in city(vehicles=3, period=10.0, duration=9000.0, blocks=3).items():
        rows += [
            f"{name},{t + (40_000 if t > 5000 else 0):g},{lat:.6f},{lon:.6f}"
            for t, (lat, lon) in zip(times, degrees, strict=True)
        ]
    log = str(tmp_path / "town.csv")
    Path(log).write_text("\n".join(rows) + "\n")
    archive, report, _ = compress_in_batches(log, Options(rmse=12.0, effort=1), memory=MEMORY)
    assert report.gap < 40_000
    assert all(walk.gaps.sum() == 1 for walk in archive.walks)
    assert root_mean_square(distances(archive, gpszip.read(log))) <= 12.01


def write_shapes(path):
    """Planned routes in a table without times; the first one is longer than a batch."""
    rows = ["track_id,x,y"]
    for number, count in enumerate((1300, 300, 1)):
        angle = np.arange(count) / 10 + number
        x, y = 50 * np.cos(angle), 30 * np.sin(angle) + 40 * np.floor(angle / 60)
        rows += [f"r{number},{a:.3f},{b:.3f}" for a, b in zip(x, y, strict=True)]
    path.write_text("\n".join(rows) + "\n")
    return str(path)


@pytest.mark.parametrize("bound", [{"rmse": 1.5}, {"max_error": 5.0}])
def test_shapes_keep_the_bound_at_equal_shares_of_their_lengths(tmp_path, bound):
    log = write_shapes(tmp_path / "routes.csv")
    archive, report, result = compress_in_batches(
        log, Options(effort=1, **bound), memory=MEMORY, times=False
    )
    archive = gpszip.open(archive.to_bytes())
    tracks = gpszip.read(log, times=False)
    assert (archive.timed, archive.ids) == (False, tuple(track.id for track in tracks))
    assert (report.points, result.points) == (sum(map(len, tracks)), 1601)

    # Compare whole shapes with whole walks, not slice by slice.
    nodes = archive.road_map.nodes
    errors = [shape_error(track.positions, nodes[archive.walk(track.id).nodes]) for track in tracks]
    squares = sum(len(track) * error for track, (error, _) in zip(tracks, errors, strict=True))
    assert report.rmse == pytest.approx(np.sqrt(squares / report.points))
    assert report.max_error == pytest.approx(max(largest for _, largest in errors))
    assert report.rmse <= bound.get("rmse", np.inf)
    assert report.max_error <= bound.get("max_error", np.inf)
    assert any("no times in the log: shapes are kept" in note for note in report.notes)


def test_shapes_of_several_batches_give_the_same_bytes_on_all_engines(tmp_path):
    log = write_shapes(tmp_path / "routes.csv")
    archives = [
        compress_in_batches(
            log, Options(rmse=3.0, effort=1), memory=MEMORY, executor=executor, times=False
        )[0].to_bytes()
        for executor in (Serial(), Threads(3))
    ]
    assert archives[0] == archives[1]


def write_plan_and_ride(path, points=1200):
    """A route, which has no times, and a track in one GPX file."""
    at = [(48 + np.sin(i / 90) / 90, 11 + np.cos(i / 70) / 90) for i in range(points)]
    plan = "".join(f'<rtept lat="{lat:.6f}" lon="{lon:.6f}"/>' for lat, lon in at[::2])
    ride = "".join(
        f'<trkpt lat="{lat:.6f}" lon="{lon:.6f}">'
        f"<time>2024-05-04T{9 + i // 3600:02d}:{i // 60 % 60:02d}:{i % 60:02d}Z</time></trkpt>"
        for i, (lat, lon) in enumerate(at)
    )
    path.write_text(
        f'<gpx version="1.1" creator="t"><rte><name>plan</name>{plan}</rte>'
        f"<trk><name>ride</name><trkseg>{ride}</trkseg></trk></gpx>"
    )
    return str(path)


def test_shapes_and_tracks_with_times_share_a_map(tmp_path):
    log = write_plan_and_ride(tmp_path / "both.gpx")
    archive, report, _ = compress_in_batches(log, Options(max_error=10.0, effort=1), memory=MEMORY)
    archive = gpszip.open(archive.to_bytes())
    assert (archive.untimed, set(archive.ids)) == (("plan",), {"plan", "ride"})
    assert any("without times, kept as shapes: 'plan'" in note for note in report.notes)
    plan, ride = sorted(gpszip.read(log), key=lambda track: track.id)
    assert distances(archive, [ride]).max() <= 10.0
    nodes = archive.road_map.nodes
    assert shape_error(plan.positions, nodes[archive.walk("plan").nodes])[1] <= 10.0
    assert report.max_error <= 10.0


def test_shapes_are_appended_in_batches(tmp_path):
    """The log lies on the map, and its shapes have no place in time."""
    both = write_plan_and_ride(tmp_path / "both.gpx")
    ride = [track for track in gpszip.read(both) if track.timed]
    first = gpszip.compress(ride, max_error=10.0, effort=1)
    (tmp_path / "later.gpx").write_text(Path(both).read_text().replace("ride", "again"))
    longer, report, _ = append_in_batches(
        first, str(tmp_path / "later.gpx"), Options(effort=1), memory=MEMORY
    )
    longer = gpszip.open(longer.to_bytes())
    assert (longer.ids[0], set(longer.ids)) == ("ride", {"ride", "plan", "again"})
    assert (longer.untimed, longer.error_bound.metres) == (("plan",), 10.0)
    assert report.max_error <= 10.0
    with pytest.raises(OptionError, match="'plan' is in the archive, and one of both has no times"):
        append_in_batches(longer, both, Options(effort=1), memory=MEMORY)


def test_columns_of_shapes_are_not_kept_and_coresets_of_them_refused(tmp_path):
    log = write_plan_and_ride(tmp_path / "both.gpx", points=50)
    with pytest.raises(OptionError, match="'plan' has no times, by which columns are kept"):
        compress_in_batches(log, Options(rmse=9.0, keep_times=True), memory=MEMORY)
    with pytest.raises(OptionError, match="'plan' has no times, which a coreset needs"):
        gpszip.coreset(log, size=5, memory=MEMORY)


def test_a_batch_keeps_the_knots_it_needs_where_learning_fails(folder, robots, monkeypatch):
    monkeypatch.setattr(encode_batches, "learn_on", lambda *_, **__: None)
    archive, report, _ = compress_in_batches(
        folder, Options(max_error=1.0, effort=1), memory=MEMORY
    )
    assert distances(archive, robots).max() <= 1.0
    assert report.points == N


def test_one_batch_may_have_more_error_where_others_have_less(folder, robots, monkeypatch):
    from gpszip.mapping.on_known_map import learn_on

    def learn_first_batch_coarsely(known, grid, tracks, gaps, *, rmse, **others):
        is_first = tracks[0].id == "0/0"
        if is_first and rmse < 0.31:
            return None
        rmse = rmse if is_first else 0.8 * rmse
        return learn_on(known, grid, tracks, gaps, rmse=rmse, **others)

    monkeypatch.setattr(encode_batches, "learn_on", learn_first_batch_coarsely)
    archive, report, _ = compress_in_batches(folder, Options(rmse=0.31, effort=1), memory=MEMORY)
    assert report.rmse <= 0.31
    assert root_mean_square(distances(archive, robots)) <= 0.31


def test_options_that_need_all_samples_in_memory_are_refused(folder):
    with pytest.raises(
        OptionError, match=r"larger than the memory.*give --rmse instead of k and m"
    ):
        compress_in_batches(folder, Options(k=3), memory=MEMORY)


@pytest.fixture
def short_log(robots, tmp_path, monkeypatch):
    """A file of three batches of 170 samples: a size takes many tries."""
    force_batches(monkeypatch, batch=170, subsample=300)
    pq.write_table(rows_of_track(robots[1], slice(None)), tmp_path / "short.parquet")
    return str(tmp_path / "short.parquet")


def test_archives_fit_a_size_and_use_it(short_log, robots):
    archive, report, result = compress_in_batches(
        short_log, Options(effort=1, ratio=200.0), memory=MEMORY
    )
    size = int(result.bytes / 200)
    assert 0.9 * size <= len(archive.to_bytes()) == report.bytes_out <= size
    assert report.rmse == pytest.approx(root_mean_square(distances(archive, robots[1:])), rel=1e-6)


def test_the_message_on_too_small_a_size_names_the_smallest(short_log):
    with pytest.raises(
        BoundError, match="20 bytes are too few for this log: the smallest archive takes"
    ):
        compress_in_batches(short_log, Options(size=20, effort=1), memory=MEMORY)


def test_too_little_memory_is_refused(folder):
    with pytest.raises(OptionError, match="give at least 400 MiB"):
        compress_in_batches(folder, Options(rmse=1.0), memory=1 << 20)


def test_small_logs_are_read_into_memory(folder, monkeypatch):
    monkeypatch.setattr(memory_limits, "_BYTES_IN_MEMORY", 2100)
    with open_log(folder, memory=1 << 30) as log:
        assert isinstance(log, MemoryLog)
    with open_log(folder, memory=400 << 20) as log:
        assert isinstance(log, MemoryLog)
    monkeypatch.setattr(memory_limits, "_BYTES_IN_MEMORY", 420_000)
    with open_log(folder, memory=1 << 30) as log:
        assert not isinstance(log, MemoryLog)


@pytest.mark.parametrize("choice", [{"k": 20}, {"m": 5}, {"k": 20, "m": 5}])
def test_segment_means_of_large_logs_are_refused_before_they_are_sorted(
    folder, monkeypatch, choice
):
    monkeypatch.setattr(memory_limits, "_BYTES_IN_MEMORY", 210_000)
    stages = []
    with pytest.raises(OptionError, match="k and m segment a track that is in memory as a whole"):
        gpszip.compress(
            folder,
            rmse=1.0,
            **choice,
            memory=400 << 20,
            progress=lambda event: stages.append(event.stage),
        )
    assert stages == []


def test_the_command_line_compresses_in_batches(folder, robots, capfd):
    (folder / "bad.parquet").write_bytes(b"PAR1 none")
    target = folder.parent / "out.gpsz"
    options = ["--rmse", "30cm", "--effort", "1", "--memory", "420MiB"]
    command = ["compress", str(folder), "-o", str(target), *options]
    assert main(command) == 1
    assert "bad.parquet: can't be read" in capfd.readouterr().err
    assert main([*command, "--skip-bad"]) == 3
    assert "bad.parquet" in capfd.readouterr().err
    assert root_mean_square(distances(gpszip.open(target), robots)) <= 0.3
    assert main([*command, "--skip-bad", "--force", "--k", "9"]) == 2


@pytest.mark.skipif(
    not Path("/proc/self/status").exists(), reason="the peak of a process is read from Linux"
)
def test_the_memory_limit_is_kept(tmp_path):
    """A process of its own keeps the limit, if need be the second one: compiling takes memory."""
    script = textwrap.dedent(
        """
        import sys
        import numpy as np, pyarrow as pa, pyarrow.parquet as pq
        from gpszip.model import Options, Track
        from batches import compress_in_batches

        n = 170_000  # more than fit in memory
        t = np.arange(n) / 10
        x, y = np.random.default_rng(1).normal(0, 0.5, (2, n))
        x += 50 * np.cos(t / 50)
        y += 30 * np.sin(t / 50)
        pq.write_table(pa.table({"t": t, "x": x, "y": y}), sys.argv[1], row_group_size=50_000)
        options = Options(rmse=1.0, effort=1)
        archive, report, _ = compress_in_batches(sys.argv[1], options, memory=410 << 20)
        assert report.points == n

        # The peak that getrusage reports begins with the size of the parent process.
        status = dict(line.split(":", 1) for line in open("/proc/self/status"))
        print(int(status["VmHWM"].split()[0]) / 1024)
        """
    )
    for _ in range(2):
        process = subprocess.run(
            [sys.executable, "-c", script, str(tmp_path / "log.parquet")],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join([str(TESTS), *sys.path])},
        )
        peak = float(process.stdout)
        if peak < 410:
            break
    assert peak < 410


def test_a_dense_subsample_is_thinned_and_a_sparse_one_is_not():
    dense = MemoryLog((patrol(4000, seed=5),))

    def thin_out(**bound):
        options = Options(**bound)
        return learn_in_batches._thin_out(prepare(dense, options), options)[0]

    (thinned,) = thin_out(rmse=0.3)
    assert len(thinned) <= 8 * 100 + 2
    assert thinned.weights.sum() == pytest.approx(4000)
    assert thin_out(rmse=0.01)[0] is dense.tracks[0]
    assert thin_out(max_error=0.02)[0] is dense.tracks[0]


def test_standard_input_larger_than_memory_is_split_where_time_goes_back(
    tmp_path, monkeypatch, capfd
):
    force_batches(monkeypatch, batch=1500, subsample=1800)
    times = np.tile(np.arange(1800.0), 2)
    rows = "".join(f"{t:g},{50 * np.cos(t / 50):.3f},{30 * np.sin(t / 50):.3f}\n" for t in times)
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(("t,x,y\n" + rows).encode())))
    target = tmp_path / "out.gpsz"
    options = ["--rmse", "1m", "--effort", "1", "--memory", "420MiB"]
    command = ["compress", "-", "-o", str(target), *options]
    assert main(command) == 1
    assert "--split starts a new track" in capfd.readouterr().err
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(("t,x,y\n" + rows).encode())))
    assert main([*command, "--split"]) == 0, capfd.readouterr().err
    assert gpszip.open(target).ids == ("0", "0-2")


@pytest.fixture
def rounds(tmp_path, monkeypatch):
    """A log of twelve batches: a robot drives round and round at changing speeds."""
    force_batches(monkeypatch, batch=1000, subsample=2400)
    times, rng = np.arange(12_000.0), np.random.default_rng(2)
    phase = np.cumsum(np.repeat(rng.uniform(0.01, 0.03, 240), 50))
    x, y = np.stack([50 * np.cos(phase), 30 * np.sin(phase)]) + rng.normal(0, 0.5, (2, len(times)))
    pq.write_table(pa.table({"t": times, "x": x, "y": y}), tmp_path / "log.parquet")
    return str(tmp_path / "log.parquet")


def test_times_are_as_coarse_as_the_remaining_error_allows(rounds, monkeypatch):
    force_batches(monkeypatch, batch=1500, subsample=3000)
    options = Options(rmse=2.0, effort=3)
    coarse, coarse_report, _ = compress_in_batches(rounds, options, memory=MEMORY)
    monkeypatch.setattr(
        learn_in_batches, "with_best_time_step", lambda log, base, batches, executor: base
    )
    fine, fine_report, _ = compress_in_batches(rounds, options, memory=MEMORY)
    assert fine_report.rmse < coarse_report.rmse <= 2.0
    assert coarse.grid.time > fine.grid.time
    assert coarse_report.bytes_out < fine_report.bytes_out


def test_engines_give_the_same_bytes_of_twelve_batches(rounds):
    options = Options(rmse=1.0, effort=1)
    serial, threaded = (
        compress_in_batches(rounds, options, memory=MEMORY, executor=executor)[0].to_bytes()
        for executor in (Serial(), Threads(3))
    )
    assert serial == threaded


def test_later_batches_know_what_earlier_ones_add_to_the_map(rounds, monkeypatch):
    """The subsample ends before the robot leaves its circle and drives to another one."""
    monkeypatch.setattr(
        learn_in_batches, "with_best_time_step", lambda log, base, batches, executor: base
    )
    rows = pq.read_table(rounds).slice(0, 5000)
    x = rows["x"].to_numpy() + 300.0 * np.clip((np.arange(5000) - 1000) / 60, 0, 1)
    pq.write_table(rows.set_column(1, "x", pa.array(x)), rounds)
    monkeypatch.setattr(
        "gpszip.pipeline.job._subsample", lambda log, _: (log.read(log.tracks[0], 0, 800),)
    )
    nodes = []
    for wave in (1, 100):
        monkeypatch.setattr(encode_batches, "_WAVE", wave)
        nodes.append(
            compress_in_batches(rounds, Options(rmse=1.0, effort=1), memory=MEMORY)[1].nodes
        )
    assert nodes[0] < nodes[1]
    monkeypatch.setattr(encode_batches, "_MAX_PRIOR_KNOTS", 0)
    monkeypatch.setattr(encode_batches, "_WAVE", 1)
    assert (
        compress_in_batches(rounds, Options(rmse=1.0, effort=1), memory=MEMORY)[1].nodes == nodes[1]
    )


def test_times_too_coarse_for_a_batch_become_fine_again(rounds, monkeypatch):
    """Where coarser times break the bound, the learned ones are used for the same target."""
    force_batches(monkeypatch, batch=1500, subsample=3000)
    time_steps, targets, encode = [], [], learn_in_batches.encode_batches

    def encode_on_fine_times_only(log, base, batches, executor, report):
        time_steps.append(base.grid.time)
        targets.append(base.options.rmse)
        if len(time_steps) == 1:
            raise BoundError("too coarse")
        return encode(log, base, batches, executor, report)

    monkeypatch.setattr(learn_in_batches, "encode_batches", encode_on_fine_times_only)
    _, report, _ = compress_in_batches(rounds, Options(rmse=2.0, effort=3), memory=MEMORY)
    assert time_steps[1] < time_steps[0]
    assert targets[1] == targets[0]
    assert report.rmse <= 2.0
