import math
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpszip.archive import open_archive
from gpszip.errors import BoundError, InputError, OptionError
from gpszip.geo.planes import choose_plane, to_plane
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
from oracle.decoded import measure


def wander(n=250, dimension=2, seed=0, name="a", start=0.0, step=1.0, noise=0.1):
    """Someone who walks straight for a while, turns, and stops now and then."""
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
    return Track(
        track.id,
        track.times + length * (np.arange(len(track)) // every),
        track.positions,
        plane=track.plane,
    )


def antimeridian(n=200):
    """A ship that crosses 180 degrees, in degrees and on its plane."""
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


def compressed(tracks, **options):
    before = [(track.times.copy(), track.positions.copy()) for track in tracks]
    archive, report = compress(tracks, Options(**options))
    for track, (times, positions) in zip(tracks, before, strict=True):
        np.testing.assert_array_equal(track.times, times)
        np.testing.assert_array_equal(track.positions, positions)
    return open_archive(archive.to_bytes()), report


@pytest.mark.parametrize("bound", [{"rmse": 0.5}, {"rmse": 20.0}, {"max_error": 1.0}], ids=str)
@pytest.mark.parametrize("log", LOGS)
def test_every_sample_is_covered_within_the_bound(log, bound):
    tracks = LOGS[log]
    archive, report = compressed(tracks, **bound, effort=1)
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
@settings(max_examples=12, deadline=None)
def test_any_track_is_kept_within_any_bound(seed, n, dimension, bound, rms):
    rng = np.random.default_rng(seed)
    times = 1e5 * rng.random() + np.cumsum(rng.choice([0.01, 1.0, 1.0, 1.0, 300.0], n))
    tracks = [Track("x", times, np.cumsum(rng.normal(0, 1, (n, dimension)), axis=0))]
    archive, _ = compressed(tracks, effort=1, gap=100.0, **{"rmse" if rms else "max_error": bound})
    rmse, worst, lost = measure(tracks, archive.decompress())
    assert lost == 0
    assert (rmse if rms else worst) <= bound * (1 + 1e-9)


def test_a_bound_too_tight_for_any_map_is_met_by_keeping_the_samples():
    track = wander(60)
    archive, _ = compressed([track], max_error=1e-3, effort=1)
    _, worst, lost = measure([track], archive.decompress())
    assert lost == 0
    assert worst <= 1e-3


def test_a_bound_below_the_finest_lattice_is_refused():
    with pytest.raises(BoundError, match="1e-09"):
        compress(wander(30), Options(max_error=1e-9, effort=1))


def test_no_travel_is_claimed_in_gaps():
    track = with_gaps(wander(), length=500.0)
    archive, report = compressed([track], rmse=0.5, effort=1)
    assert 1 < report.gap < 500
    silent = track.times[:-1][np.diff(track.times) > report.gap]
    assert len(silent) == 4
    assert np.isnan(archive.position("a", silent + 250)).all()
    assert [piece.id for piece in archive.decompress()] == [f"a/{i}" for i in range(5)]
    whole, report = compressed([track], rmse=0.5, gap=math.inf, effort=1)
    assert report.gap == math.inf
    assert not np.isnan(whole.position("a", silent + 250)).any()
    assert [piece.id for piece in whole.decompress()] == ["a"]


def test_degrees_come_back_across_the_antimeridian():
    track, lat, lon = antimeridian()
    archive, _ = compressed([track], max_error=5.0, effort=1)
    found = archive.position("ship", track.times)
    assert np.abs(found[:, 0] - lat).max() < 1e-4
    assert np.abs((found[:, 1] - lon + 180) % 360 - 180).max() < 1e-4


def test_a_track_over_two_planes_claims_nothing_between_them():
    lat, lon = (
        np.array([52.5] * 30 + [-33.9] * 20),
        np.append(13.4 + 1e-4 * np.arange(30), 151.2 + 1e-4 * np.arange(20)),
    )
    plane = choose_plane(lat, lon)
    track = Track("flight", np.arange(50.0), to_plane(lat, lon, plane), plane=plane)
    archive, _ = compressed([track], max_error=5.0, gap=math.inf, effort=1)
    assert measure([track], archive.decompress())[2] == 0
    found = archive.position("flight", track.times)
    np.testing.assert_allclose(found, np.stack([lat, lon], axis=1), atol=2e-4)


def test_the_same_log_gives_the_same_bytes():
    tracks = LOGS["three tracks"]
    one, other = (compress(tracks, Options(rmse=0.5, effort=2))[0].to_bytes() for _ in range(2))
    assert one == other


@pytest.mark.parametrize(
    "options",
    [Options(rmse=0.5), Options(max_error=1.0), Options(k=20, m=8)],
    ids=["rmse", "max", "thesis"],
)
def test_neither_workers_nor_the_log_s_zero_change_the_walks(options):
    track = wander(300)
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


def test_without_a_bound_a_sensible_one_is_chosen_and_told():
    track = wander(400, noise=0.2)
    archive, report = compressed([track])
    rmse, _, lost = measure([track], archive.decompress())
    bound = float(report.bound.split()[-2])
    assert lost == 0
    assert rmse <= bound
    assert 0.2 < bound < 3.0
    assert any(f"{bound:g} m" in note and "estimated" in note for note in report.notes)
    assert compressed([track], rmse=bound)[1].notes == ()


def test_times_can_be_left_out_after_the_bound_was_measured():
    track = wander()
    timed, untimed = compressed([track], rmse=0.5), compressed([track], rmse=0.5, times=False)
    assert not untimed[0].timed
    assert untimed[1].bytes_out < timed[1].bytes_out
    assert untimed[1].rmse == timed[1].rmse
    assert any("times" in note for note in untimed[1].notes)
    for (_, shape), (_, places) in zip(untimed[0].shapes(), timed[0].shapes(), strict=True):
        moved = np.append(True, (np.diff(places, axis=0) != 0).any(axis=1))
        assert shape[1:-1].tolist() == places[moved][1:-1].tolist()
        assert np.linalg.norm(shape[[0, -1]] - places[[0, -1]], axis=1).max() <= 2


def test_the_layer_packs_the_archive_once_more():
    track = wander()
    plain, packed = (
        compressed([track], rmse=0.5, effort=1)[0],
        compressed([track], rmse=0.5, effort=1, layer="bz2")[0],
    )
    assert packed.contents.layer == "bz2"
    assert [t.positions.tolist() for t in packed.decompress()] == [
        t.positions.tolist() for t in plain.decompress()
    ]


@pytest.mark.parametrize("times", [True, False])
@pytest.mark.parametrize("size", [50, 120])
def test_a_size_is_held_and_used(size, times):
    track = wander(80)
    archive, report = compressed([track], size=size, effort=1, times=times)
    assert 0.8 * size <= len(archive.to_bytes()) == report.bytes_out <= size
    assert report.bound == f"size <= {size} bytes"
    if times:
        assert report.rmse == pytest.approx(measure([track], archive.decompress())[0])


def test_more_bytes_never_cost_precision():
    errors = [compressed([wander(60)], size=size, effort=1)[1].rmse for size in (40, 90)]
    assert errors[0] > errors[1]


@pytest.mark.parametrize("log", ["one sample", "standing still", "tracks of all lengths"])
def test_any_log_fits_a_size(log):
    tracks = LOGS[log]
    archive, report = compressed(tracks, size=150, effort=1)
    rmse, _, lost = measure(tracks, archive.decompress())
    assert lost == 0
    assert report.bytes_out <= 150
    assert report.rmse == pytest.approx(rmse, abs=1e-9)


def test_a_ratio_counts_from_the_log_or_else_from_its_numbers():
    track = wander(60)
    assert compressed([track], ratio=20.0, effort=1)[1].bound == f"size <= {60 * 3 * 8 // 20} bytes"
    log = MemoryLog((track,), ReadResult((track,), points=60, bytes=2000, geographic=False))
    archive, report = compress(log, Options(ratio=20.0, effort=1))
    assert report.bound == "size <= 100 bytes"
    assert len(archive.to_bytes()) <= 100


def test_a_size_below_the_smallest_is_refused_and_the_smallest_named():
    with pytest.raises(BoundError, match="5 bytes are too few") as caught:
        compress(wander(60), Options(size=5, effort=1))
    smallest = int(str(caught.value).split("takes ")[1].split(";")[0])
    assert compressed([wander(60)], size=smallest, effort=1)[1].bytes_out == smallest


def lanes(n=240):
    """The same lane there and back: four segments hold it."""
    t = np.arange(float(n)) % 40
    x = np.where(t < 20, t, 39 - t)
    return Track("lane", np.arange(float(n)), np.stack([x, 0.3 * np.sin(x)], axis=1))


@pytest.mark.parametrize(
    "options",
    [{"k": 12, "m": 2}, {"k": 12}, {"m": 4, "rmse": 2.0}, {"m": 4, "max_error": 6.0}],
    ids=str,
)
def test_the_thesis_s_model_becomes_an_archive(options):
    track = lanes()
    archive, report = compressed([track], **options)
    rmse, worst, lost = measure([track], archive.decompress())
    assert lost == 0
    assert rmse <= options.get("rmse", math.inf)
    assert worst <= options.get("max_error", math.inf)
    assert report.rmse == pytest.approx(rmse)
    assert report.nodes <= 2 * options.get("m", 12)


def test_rounding_adds_little_to_the_thesis_s_model():
    track = wander(300, noise=0.3)
    _, report = compressed([track], k=20, m=20)
    mean = segment_mean(track, 20, 20)
    assert report.rmse <= 1.05 * math.sqrt(mean.cost / len(track)) + 1e-9


def test_gaps_between_the_thesis_s_parts_claim_no_travel():
    track = Track(
        "a",
        np.append(np.arange(20.0), 1000 + np.arange(20.0)),
        np.append(np.arange(20.0), 90 - np.arange(20.0))[:, None],
    )
    archive, _ = compressed([track], k=2, m=2)
    assert np.isnan(archive.position("a", 500.0)).all()
    assert measure([track], archive.decompress())[2] == 0


def test_a_bound_that_k_segments_can_t_hold_is_refused():
    with pytest.raises(BoundError, match="more segments"):
        compress(wander(300), Options(k=3, m=1, rmse=0.01))


def test_the_thesis_s_model_has_one_track():
    with pytest.raises(OptionError, match="one track"):
        compress(LOGS["three tracks"], Options(k=5))


def test_tracks_that_don_t_go_together_are_refused():
    track = wander(10)
    flat, named = (
        Track("b", track.times, track.positions[:, :1]),
        Track("a", track.times, track.positions),
    )
    placed = Track("b", track.times, track.positions, plane=Plane(((0, 0),)))
    with pytest.raises(InputError, match="no tracks"):
        compress([])
    for other, word in ((flat, "coordinates"), (named, "two tracks"), (placed, "planes")):
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


def test_progress_goes_on_and_ends_whole():
    events: list[Progress] = []
    compress(wander(100), Options(rmse=0.5, effort=3), progress=events.append)
    assert {"learn", "measure"} <= {event.stage for event in events}
    assert all(0 <= event.done <= 1 for event in events)
    assert events[-1].done == 1


def test_nothing_is_compiled_after_warming():
    events: list[Progress] = []
    warm(events.append)
    assert [event.done for event in events] == [0.2, 0.4, 0.6, 0.8, 1.0]
    compiled = subprocess.run(
        [sys.executable, "-c", COUNT_COMPILATIONS],
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    assert compiled.stdout == "0\n"


COUNT_COMPILATIONS = """
from gpszip import Matcher, compress, decompress, match, patch
from gpszip.kernels.compiling import noticing
from gpszip.model import Options, Track
from gpszip.pipeline.compress import compress as compress_tracks
from gpszip.testing import patrol

seen = []
with noticing(lambda: seen.append(1)):
    track = patrol(3000)
    for options in (Options(rmse=0.3), Options(max_error=1.0), Options(k=9, m=5)):
        archive, _ = compress_tracks([track], options)
    later = compress([track], rmse=0.3, map=archive)
    decompress(later)
    torn = Track("torn", *(part[[*range(1000), *range(2000, 3000)]] for part in (track.times, track.positions)))
    patch([torn], archive, gap=30.0)
    Matcher(archive, match(track, archive).scales).push(0.0, [0.0, 0.0])
print(len(seen))
"""


def test_larger_archives_tell_how_their_log_was_sampled():
    small, _ = compress(wander(40), Options(rmse=2.0, effort=1))
    large, _ = compress(wander(1200, step=4.0, noise=0.0), Options(rmse=0.02, effort=1))
    assert (len(small.to_bytes()) < 256, small.sampling) == (True, None)
    assert len(large.to_bytes()) >= 256
    assert open_archive(large.to_bytes()).sampling == pytest.approx(4.0, rel=0.1)


def test_archives_united_tell_of_the_rarest_samples():
    often = wander(1200, seed=7, name="often", noise=0.0)
    seldom = wander(1200, seed=8, name="seldom", start=9e4, step=16.0, noise=0.0)
    options = Options(rmse=0.02, effort=1)
    parts = [compress(one, options)[0] for one in (often, seldom)]
    assert [part.sampling for part in parts] == [1.0, 16.0]
    assert merge(parts)[0].sampling == 16.0
    assert append(parts[0], seldom, options)[0].sampling == 16.0
    unknown = compress(wander(40, seed=9, name="short", start=5e5), Options(rmse=2.0, effort=1))[0]
    assert merge([parts[0], unknown])[0].sampling is None
