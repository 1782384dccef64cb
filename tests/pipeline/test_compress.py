"""Logs in memory are compressed within bounds of error and size."""

import math
import subprocess
import sys
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.archive import open_archive
from gpszip.errors import BoundError, InputError, OptionError
from gpszip.geo.planes import choose_plane, to_plane
from gpszip.kernels.jit import CACHES
from gpszip.model import Options, Plane, Progress, Track
from gpszip.model.log import MemoryLog
from gpszip.model.read_result import ReadResult
from gpszip.pipeline.append import append
from gpszip.pipeline.compress import compress
from gpszip.pipeline.merge import merge
from gpszip.pipeline.segment_mean import segment_mean
from gpszip.pipeline.warm import warm
from gpszip.run.serial import Serial
from gpszip.run.threads import Threads
from gpszip.testing import patrol
from oracle.decoded import measure
from random_tests import examples


def wander(n=250, dimension=2, seed=0, name="a", start=0.0, step=1.0, noise=0.1):
    """A track of straight legs, turns and some stops."""
    rng = np.random.default_rng(seed)
    legs = rng.integers(5, 25, n // 5 + 1)
    velocity = np.repeat(
        rng.normal(0, 1.2, (len(legs), dimension)) * (rng.random((len(legs), 1)) > 0.2),
        legs,
        axis=0,
    )[:n]
    return Track(
        name,
        start + step * np.arange(n),
        np.cumsum(velocity * step, axis=0) + rng.normal(0, noise, (n, dimension)),
    )


def with_gaps(track, every=60, length=500.0):
    """The track with a gap after every 60th sample."""
    return Track(
        track.id,
        track.times + length * (np.arange(len(track)) // every),
        track.positions,
        plane=track.plane,
    )


def antimeridian(n=200):
    """A ship that crosses 180 degrees of longitude: its track, latitudes and longitudes."""
    lat, lon = -17.0 + 0.0004 * np.arange(n), (179.96 + 0.0005 * np.arange(n) + 180) % 360 - 180
    plane = choose_plane(lat, lon)
    return Track("ship", 10.0 * np.arange(n), to_plane(lat, lon, plane), plane=plane), lat, lon


LOGS = {
    "1-D": [wander(dimension=1)],
    "2-D": [wander()],
    "3-D": [wander(dimension=3)],
    "three tracks": [wander(seed=i, name=f"walk {i}", start=1e4 * i) for i in range(3)],
    "tracks of all lengths": [wander(n, seed=n, name=str(n)) for n in (1, 2, 3, 40)],
    "gaps": [with_gaps(wander())],
    "epoch seconds and UTM metres": [
        Track("a", wander().times + 1.4e9, wander().positions + np.array([5e5, 5.8e6]))
    ],
    "standing still": [Track("a", np.arange(50.0), np.full((50, 2), 3.0))],
    "one sample": [Track("a", [1234.5678], [[1.0, 2.0]])],
    "two samples": [Track("a", [0.0, 0.1], [[1.0, 2.0], [8.0, -1.0]])],
    "odd steps of time": [
        Track(
            "a",
            np.cumsum(np.random.default_rng(1).exponential(1.0, 150) + 1e-3),
            wander(150).positions,
        )
    ],
    "one jump": [
        Track("a", np.arange(20.0), np.where(np.arange(20)[:, None] < 10, 0.0, 1e5) + np.zeros(2))
    ],
    "antimeridian": [antimeridian()[0]],
}


def compress_and_reopen(tracks, **options):
    """Compress, check that the tracks have not changed, and reopen the archive."""
    copies = [(track.times.copy(), track.positions.copy()) for track in tracks]
    archive, report = compress(tracks, Options(**options))
    for track, (times, positions) in zip(tracks, copies, strict=True):
        np.testing.assert_array_equal(track.times, times)
        np.testing.assert_array_equal(track.positions, positions)
    return open_archive(archive.to_bytes()), report


@pytest.mark.parametrize("bound", [{"rmse": 0.5}, {"rmse": 20.0}, {"max_error": 1.0}], ids=str)
@pytest.mark.parametrize("log", LOGS)
def test_every_sample_is_covered_within_the_bound(log, bound):
    tracks = LOGS[log]
    archive, report = compress_and_reopen(tracks, **bound, effort=1)
    rmse, worst, lost = measure(tracks, archive.decompress())
    assert lost == 0
    assert rmse <= bound.get("rmse", math.inf) * (1 + 1e-9)
    assert worst <= bound.get("max_error", math.inf) * (1 + 1e-9)
    assert report.rmse == pytest.approx(rmse, rel=1e-6, abs=1e-9)
    assert report.max_error == pytest.approx(worst, rel=1e-6, abs=1e-9)
    assert (report.points, report.tracks) == (sum(map(len, tracks)), len(tracks))
    assert report.bytes_out == len(archive.to_bytes())
    assert (report.segments, report.nodes) == (
        sum(len(w.gaps) for w in archive.walks),
        len(archive.road_map.nodes),
    )


@given(
    st.integers(0, 10_000),
    st.integers(1, 60),
    st.integers(1, 3),
    st.sampled_from([0.05, 0.4, 3.0]),
    st.booleans(),
)
@examples(12)
def test_any_bound_holds_for_any_track(seed, n, dimension, bound, is_rmse):
    rng = np.random.default_rng(seed)
    times = 1e5 * rng.random() + np.cumsum(rng.choice([0.01, 1.0, 1.0, 1.0, 300.0], n))
    tracks = [Track("x", times, np.cumsum(rng.normal(0, 1, (n, dimension)), axis=0))]
    archive, _ = compress_and_reopen(
        tracks, effort=1, gap=100.0, **{"rmse" if is_rmse else "max_error": bound}
    )
    rmse, worst, lost = measure(tracks, archive.decompress())
    assert lost == 0
    assert (rmse if is_rmse else worst) <= bound * (1 + 1e-9)


def test_a_bound_too_tight_for_a_map_holds_by_keeping_samples():
    track = wander(60)
    archive, _ = compress_and_reopen([track], max_error=1e-3, effort=1)
    _, worst, lost = measure([track], archive.decompress())
    assert lost == 0
    assert worst <= 1e-3


def test_a_bound_below_the_finest_grid_is_refused():
    with pytest.raises(BoundError, match="1e-09"):
        compress(wander(30), Options(max_error=1e-9, effort=1))


def test_archives_have_no_positions_in_gaps():
    track = with_gaps(wander(), length=500.0)
    archive, report = compress_and_reopen([track], rmse=0.5, effort=1)
    assert 1 < report.gap < 500
    gap_starts = track.times[:-1][np.diff(track.times) > report.gap]
    assert len(gap_starts) == 4
    assert np.isnan(archive.position("a", gap_starts + 250)).all()
    assert [piece.id for piece in archive.decompress()] == [f"a/{i}" for i in range(5)]
    without_gaps, report = compress_and_reopen([track], rmse=0.5, gap=math.inf, effort=1)
    assert report.gap == math.inf
    assert not np.isnan(without_gaps.position("a", gap_starts + 250)).any()
    assert [piece.id for piece in without_gaps.decompress()] == ["a"]


def test_degrees_are_restored_across_the_antimeridian():
    track, lat, lon = antimeridian()
    archive, _ = compress_and_reopen([track], max_error=5.0, effort=1)
    degrees = archive.position("ship", track.times)
    assert np.abs(degrees[:, 0] - lat).max() < 1e-4
    assert np.abs((degrees[:, 1] - lon + 180) % 360 - 180).max() < 1e-4


def test_a_track_on_two_planes_keeps_its_positions():
    lat, lon = (
        np.array([52.5] * 30 + [-33.9] * 20),
        np.append(13.4 + 1e-4 * np.arange(30), 151.2 + 1e-4 * np.arange(20)),
    )
    plane = choose_plane(lat, lon)
    track = Track("flight", np.arange(50.0), to_plane(lat, lon, plane), plane=plane)
    archive, _ = compress_and_reopen([track], max_error=5.0, gap=math.inf, effort=1)
    assert measure([track], archive.decompress())[2] == 0
    degrees = archive.position("flight", track.times)
    np.testing.assert_allclose(degrees, np.stack([lat, lon], axis=1), atol=2e-4)


def test_the_same_log_gives_the_same_bytes():
    tracks = LOGS["tracks of all lengths"]
    options = Options(rmse=0.5, effort=2)
    first, second = (compress(tracks, options)[0].to_bytes() for _ in range(2))
    assert first == second


@pytest.mark.parametrize(
    "options",
    [Options(rmse=0.5, effort=3), Options(max_error=1.0, effort=3), Options(k=20, m=8)],
    ids=["rmse", "max", "thesis"],
)
def test_neither_workers_nor_the_origin_of_the_log_change_the_walks(options):
    track = wander(150)
    track = Track("a", track.times, np.round(track.positions, 3))
    serial = compress(track, options, executor=Serial())[0]
    assert compress(track, options, executor=Threads(3))[0].to_bytes() == serial.to_bytes()
    moved = compress(Track("a", track.times + 1e9, track.positions + 1e7), options)[0]
    assert moved.contents.groups == serial.contents.groups
    assert (moved.grid.space, moved.grid.time) == (serial.grid.space, serial.grid.time)
    assert moved.grid.epoch - serial.grid.epoch == 10**12
    assert [a - b for a, b in zip(moved.grid.origin, serial.grid.origin, strict=True)] == [
        10**10,
        10**10,
    ]


def test_without_a_bound_one_is_estimated_and_reported():
    track = wander(400, noise=0.2)
    archive, report = compress_and_reopen([track], effort=1)
    rmse, _, lost = measure([track], archive.decompress())
    bound = float(report.bound.split()[-2])
    assert lost == 0
    assert rmse <= bound
    assert 0.2 < bound < 3.0
    assert any(f"{bound:g} m" in note and "estimated" in note for note in report.notes)
    assert compress_and_reopen([track], rmse=bound, effort=1)[1].notes == ()


def test_archives_without_times_keep_the_shape():
    track = wander()
    timed, timed_report = compress_and_reopen([track], rmse=0.5, effort=1)
    untimed, untimed_report = compress_and_reopen([track], rmse=0.5, effort=1, times=False)
    assert not untimed.timed
    assert untimed_report.bytes_out < timed_report.bytes_out
    assert untimed_report.rmse == timed_report.rmse
    assert any("times" in note for note in untimed_report.notes)
    for (_, shape), (_, timed_shape) in zip(untimed.shapes(), timed.shapes(), strict=True):
        has_moved = np.append(True, (np.diff(timed_shape, axis=0) != 0).any(axis=1))
        assert shape[1:-1].tolist() == timed_shape[has_moved][1:-1].tolist()
        assert np.linalg.norm(shape[[0, -1]] - timed_shape[[0, -1]], axis=1).max() <= 2


def test_the_layer_packs_the_archive_once_more():
    track = wander()
    plain, _ = compress_and_reopen([track], rmse=0.5, effort=1)
    packed, _ = compress_and_reopen([track], rmse=0.5, effort=1, layer="bz2")
    assert packed.contents.layer == "bz2"
    assert [t.positions.tolist() for t in packed.decompress()] == [
        t.positions.tolist() for t in plain.decompress()
    ]


@cache
def fit_size(size, times):
    return compress_and_reopen([wander(80)], size=size, effort=1, times=times)


@pytest.mark.parametrize(("size", "times"), [(50, True), (120, True), (50, False)])
def test_archives_fit_a_size_and_use_it(size, times):
    archive, report = fit_size(size, times)
    assert 0.8 * size <= len(archive.to_bytes()) == report.bytes_out <= size
    assert report.bound == f"size <= {size} bytes"
    if times:
        assert report.rmse == pytest.approx(measure([wander(80)], archive.decompress())[0])


def test_more_bytes_give_a_smaller_error():
    assert fit_size(50, True)[1].rmse > fit_size(120, True)[1].rmse


@pytest.mark.parametrize("log", ["one sample", "standing still", "tracks of all lengths"])
def test_any_log_fits_a_size(log):
    tracks = LOGS[log]
    archive, report = compress_and_reopen(tracks, size=150, effort=1)
    rmse, _, lost = measure(tracks, archive.decompress())
    assert lost == 0
    assert report.bytes_out <= 150
    assert report.rmse == pytest.approx(rmse, abs=1e-9)


def test_a_ratio_refers_to_the_bytes_of_the_log_or_else_of_its_arrays():
    (track,) = LOGS["standing still"]
    assert (
        compress_and_reopen([track], ratio=20.0, effort=1)[1].bound
        == f"size <= {50 * 3 * 8 // 20} bytes"
    )
    log = MemoryLog((track,), ReadResult((track,), points=50, bytes=2000, geographic=False))
    archive, report = compress(log, Options(ratio=20.0, effort=1))
    assert report.bound == "size <= 100 bytes"
    assert len(archive.to_bytes()) <= 100


def test_the_message_on_too_small_a_size_names_the_smallest():
    with pytest.raises(BoundError, match="5 bytes are too few") as caught:
        compress(wander(60), Options(size=5, effort=1))
    smallest = int(str(caught.value).split("takes ")[1].split(";")[0])
    assert compress_and_reopen([wander(60)], size=smallest, effort=1)[1].bytes_out == smallest


def back_and_forth(n=240):
    """A track back and forth along one lane, which four segments approximate."""
    t = np.arange(float(n)) % 40
    x = np.where(t < 20, t, 39 - t)
    return Track("lane", np.arange(float(n)), np.stack([x, 0.3 * np.sin(x)], axis=1))


@pytest.mark.parametrize(
    "options",
    [{"k": 12, "m": 2}, {"k": 12}, {"m": 4, "rmse": 2.0}, {"m": 4, "max_error": 6.0}],
    ids=str,
)
def test_a_segment_mean_becomes_an_archive(options):
    track = back_and_forth()
    archive, report = compress_and_reopen([track], **options)
    rmse, worst, lost = measure([track], archive.decompress())
    assert lost == 0
    assert rmse <= options.get("rmse", math.inf)
    assert worst <= options.get("max_error", math.inf)
    assert report.rmse == pytest.approx(rmse)
    assert report.nodes <= 2 * options.get("m", 12)


def test_rounding_adds_little_error_to_a_segment_mean():
    track = wander(300, noise=0.3)
    _, report = compress_and_reopen([track], k=20, m=20)
    mean = segment_mean(track, 20, 20)
    assert report.rmse <= 1.05 * math.sqrt(mean.cost / len(track)) + 1e-9


def test_a_segment_mean_has_no_positions_in_gaps():
    track = Track(
        "a",
        np.append(np.arange(20.0), 1000 + np.arange(20.0)),
        np.append(np.arange(20.0), 90 - np.arange(20.0))[:, None],
    )
    archive, _ = compress_and_reopen([track], k=2, m=2)
    assert np.isnan(archive.position("a", 500.0)).all()
    assert measure([track], archive.decompress())[2] == 0


def test_a_bound_too_tight_for_k_segments_is_refused():
    with pytest.raises(BoundError, match="more segments"):
        compress(wander(300), Options(k=3, m=1, rmse=0.01))


def test_tracks_of_a_log_share_the_segments_of_a_segment_mean():
    forth = Track("forth", np.arange(20.0), np.arange(20.0)[:, None])
    again = Track("again", 5 + np.arange(20.0), np.arange(20.0)[:, None] + 1e-3)
    archive, report = compress_and_reopen([forth, again], k=2, m=1)
    assert (report.nodes, report.edges, report.tracks) == (2, 1, 2)
    assert archive.position("again", [5.0, 24.0]).ravel() == pytest.approx([0, 19], abs=0.1)
    with pytest.raises(OptionError, match="k >= 2"):
        compress([forth, again], Options(k=1))


def test_k_with_a_bound_finds_the_segments_that_hold_it():
    log = patrol(1500)
    _, report = compress([log], Options(k=14, rmse=1.0))
    assert report.rmse <= 1.0
    assert report.nodes < 28


def test_tracks_that_contradict_each_other_are_refused():
    track = wander(10)
    one_dimensional = Track("b", track.times, track.positions[:, :1])
    same_name = Track("a", track.times, track.positions)
    on_a_plane = Track("b", track.times, track.positions, plane=Plane(((0, 0),)))
    with pytest.raises(InputError, match="no tracks"):
        compress([])
    for other, word in (
        (one_dimensional, "coordinates"),
        (same_name, "two tracks"),
        (on_a_plane, "planes"),
    ):
        with pytest.raises(OptionError, match=word):
            compress([track, other])


@pytest.mark.parametrize(
    "options",
    [
        {"max_error": 1.0, "ratio": 9.0},
        {"rmse": 0.0},
        {"rmse": math.nan},
        {"max_error": math.inf},
        {"rmse": 1.0, "size": 100},
        {"size": 100, "ratio": 10.0},
        {"size": 0},
        {"ratio": 0.0},
        {"ratio": math.inf},
        {"size": 100, "k": 3},
        {"gap": 0.0},
        {"k": 0},
        {"k": 3, "m": 4},
        {"m": 3},
        {"m": 0, "rmse": 1.0},
        {"layer": "zip"},
        {"effort": 0},
        {"effort": 10},
    ],
    ids=str,
)
def test_options_out_of_range_are_refused(options):
    with pytest.raises(OptionError):
        Options(**options)


def test_progress_is_reported_up_to_the_end():
    events: list[Progress] = []
    compress(wander(100), Options(rmse=0.5, effort=3), progress=events.append)
    assert {"learn", "measure"} <= {event.stage for event in events}
    assert all(0 <= event.done <= 1 for event in events)
    assert events[-1].done == 1


@pytest.fixture(scope="module")
def warmed():
    """The shares done that are reported while all kernels are compiled."""
    events: list[Progress] = []
    warm(events.append)
    return [event.done for event in events]


def run_script(script):
    """What a Python script prints in a process of its own."""
    return subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=120
    ).stdout


def test_nothing_is_compiled_after_warming(warmed):
    assert warmed == sorted(warmed)
    assert warmed[-1] == 1.0
    assert run_script(COUNT_COMPILATIONS) == "0\n"


@pytest.mark.skipif(not CACHES, reason="this numba caches in its own way")
def test_each_kernel_is_loaded_without_the_compiler_after_warming(warmed):
    # Machine code that lacks a function of numba ends the process.
    missing, compilations, has_registries = run_script(LOAD_KERNELS).splitlines()
    assert missing == "[]"
    assert (compilations, has_registries) == ("0", "False")


LOAD_KERNELS = """
import sys
from importlib import import_module
from pathlib import Path

import gpszip
from gpszip.kernels import precompiled
from gpszip.kernels.compiling import on_compile
from numba.core.registry import cpu_target

package = Path(gpszip.__file__).parent
for path in sorted(package.rglob("kernels/*.py")):
    name = path.relative_to(package.parent).with_suffix("").as_posix().replace("/", ".")
    import_module(name.removesuffix(".__init__"))

# Each kernel for all types of arguments for which it is compiled, which a kernel without any lacks.
missing, compilations = [], []
context = cpu_target.target_context
processor = context.codegen().magic_tuple()
with on_compile(lambda: compilations.append(1)):
    for cache in precompiled._CACHES:
        index = cache.numba._cache_file._load_index()
        signatures = [key[0] for key in index if key[1] == processor]
        loaded = [cache.load_overload(signature, context) for signature in signatures]
        if not loaded or None in loaded:
            missing.append(cache._function.__qualname__)
print(missing, len(compilations), "numba.np.linalg" in sys.modules, sep="\\n")
"""


COUNT_COMPILATIONS = """
from gpszip import Matcher, compress, decompress, match, patch
from gpszip.kernels.compiling import on_compile
from gpszip.model import Options, Track
from gpszip.pipeline.compress import compress as compress_tracks
from gpszip.testing import patrol

compilations = []
with on_compile(lambda: compilations.append(1)):
    track = patrol(3000)
    for options in (Options(rmse=0.3), Options(max_error=1.0), Options(k=9, m=5)):
        archive, _ = compress_tracks([track], options)

    # On a map: all samples with little effort, and every sixth with the default. Together they
    # call the kernels that all samples with the default effort call, in a quarter of the time.
    sparse = Track("0", track.times[::6], track.positions[::6])
    for tracks, effort in (([track], 1), ([sparse], 5)):
        decompress(compress(tracks, rmse=0.3, map=archive, effort=effort))

    kept = [*range(1000), *range(2000, 3000)]
    patch([Track("0", track.times[kept], track.positions[kept])], archive, gap=30.0)
    Matcher(archive, match(track, archive).scales).push(0.0, [0.0, 0.0])
print(len(compilations))
"""


def test_larger_archives_store_the_sampling_interval():
    small, _ = compress(wander(40), Options(rmse=2.0, effort=1))
    large, _ = compress(wander(1200, step=4.0, noise=0.0), Options(rmse=0.02, effort=1))
    assert (len(small.to_bytes()) < 256, small.sampling) == (True, None)
    assert len(large.to_bytes()) >= 256
    assert open_archive(large.to_bytes()).sampling == pytest.approx(4.0, rel=0.1)


def test_merged_archives_store_the_longest_sampling_interval(monkeypatch):
    monkeypatch.setattr("gpszip.archive.create._MIN_BYTES_WITH_SAMPLING", 50)
    frequent = wander(200, seed=7, name="frequent", noise=0.0)
    rare = wander(200, seed=8, name="rare", start=9e4, step=16.0, noise=0.0)
    options = Options(rmse=0.5, effort=1)
    archives = [compress(track, options)[0] for track in (frequent, rare)]
    assert [archive.sampling for archive in archives] == [1.0, 16.0]
    assert merge(archives)[0].sampling == 16.0
    assert append(archives[0], rare, options)[0].sampling == 16.0
    unknown = compress(wander(10, seed=9, name="short", start=5e5), options)[0]
    assert unknown.sampling is None
    assert merge([archives[0], unknown])[0].sampling is None
