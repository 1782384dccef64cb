"""Coresets of logs larger than memory: as good as those in memory, and the same on all engines."""

import numpy as np
import pytest

from gpszip import OptionError
from gpszip.io.large.store import store_logs
from gpszip.pipeline import coreset as pipeline_coreset
from gpszip.run import Processes, Serial, Threads
from gpszip.sketches.partition import build_coreset
from gpszip.sketches.pieces import polyline
from gpszip.testing import patrol


@pytest.fixture(autouse=True)
def small_batches(monkeypatch):
    monkeypatch.setattr(pipeline_coreset, "_BATCH", 700)


@pytest.fixture(scope="module")
def tracks():
    """A track of many batches, and short ones, several to a batch."""
    counts = {"long": 6100, "a": 150, "b": 1, "c": 340, "d": 699}
    return [patrol(count, seed=5, id=name) for name, count in counts.items()]


@pytest.fixture
def log(tracks, tmp_path):
    rows = [
        (t, track.id, *position)
        for track in tracks
        for t, position in zip(track.times.tolist(), track.positions.tolist(), strict=True)
    ]
    path = tmp_path / "log.csv"
    path.write_text(
        "t,id,x,y\n" + "".join(f"{t!r},{name},{x!r},{y!r}\n" for t, name, x, y in sorted(rows))
    )
    with store_logs(str(path), rows=1000) as log:
        yield log


def are_equal(first, second):
    return (
        first.tracks == second.tracks
        and first.rows.tobytes() == second.rows.tobytes()
        and first.owners.tolist() == second.owners.tolist()
    )


@pytest.mark.parametrize("size", [5, 60, 400, 20_000])
def test_a_coreset_is_as_good_as_one_in_memory(log, tracks, size):
    coreset = pipeline_coreset.sketch_log(log, size=size)
    in_memory = build_coreset(tracks, size=size)
    assert len(coreset) <= size
    assert coreset.samples == in_memory.samples == 7290
    assert set(coreset.tracks) == set(in_memory.tracks)
    assert coreset.error <= 1.1 * in_memory.error + 1e-9


def test_costs_of_functions_that_break_at_edges_are_exact(log, tracks):
    coreset = pipeline_coreset.sketch_log(log, size=50)
    for track in tracks:
        starts = np.unique(coreset.track(track.id).edges[:, 0])[::3]
        knots = np.append(starts, track.times[-1] + 1)
        corners = np.random.default_rng(3).normal(0, 50, (len(knots), 2))
        values = np.stack([np.interp(track.times, knots, axis) for axis in corners.T], axis=1)
        cost = coreset.cost(polyline(knots, corners), track=track.id)
        assert cost.estimate == pytest.approx(((values - track.positions) ** 2).sum(), rel=1e-9)


@pytest.mark.parametrize(("k", "eps"), [(1, 0.5), (4, 0.5), (12, 0.9), (80, 0.9)])
def test_the_requested_relative_error_holds(log, tracks, k, eps):
    coreset = pipeline_coreset.sketch_log(log, k=k, eps=eps)
    assert coreset.samples == 7290
    for track in tracks:
        assert coreset.track(track.id).eps(k) <= eps
    assert coreset.eps(k) <= eps
    assert len(coreset) <= 1.2 * len(build_coreset(tracks, k=k, eps=eps)) + 7290 / 700


def test_engines_give_the_same_coreset(log):
    with Processes(2) as processes:
        for options in ({"size": 40}, {"k": 5, "eps": 0.6}):
            first, *others = (
                pipeline_coreset.sketch_log(log, executor=executor, **options)
                for executor in (Serial(), Threads(1), Threads(3), processes)
            )
            assert all(are_equal(first, other) for other in others)


@pytest.mark.parametrize("size", [5, 60])
def test_weighted_points_have_the_moments_of_the_blocks(log, tracks, size):
    coreset = pipeline_coreset.sketch_log(log, size=size)
    thinned = list(pipeline_coreset.thin_log(log, coreset, executor=Threads(2)))
    assert sum(map(len, thinned)) <= 8 * size
    tracks_by_id = {track.id: track for track in tracks}
    for points, entry in zip(thinned, log.tracks, strict=True):
        track = tracks_by_id[entry.id]
        assert np.isin(points.times, track.times).all()
        for first, last in coreset.track(track.id).edges:
            chosen = (points.times >= first) & (points.times <= last)
            block = (track.times >= first) & (track.times <= last)
            weights = points.weights[chosen]
            assert weights.sum() == pytest.approx(block.sum(), rel=1e-9)
            assert weights @ points.positions[chosen] == pytest.approx(
                track.positions[block].sum(axis=0), rel=1e-9, abs=1e-6
            )
            assert weights @ points.times[chosen] ** 2 == pytest.approx(
                (track.times[block] ** 2).sum(), rel=1e-9
            )


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"size": 4},
        {"size": 9, "max_bytes": 99_999},
        {"k": 0, "eps": 0.5},
        {"k": 3},
        {"max_bytes": 90},
    ],
)
def test_impossible_sizes_are_refused(log, options):
    with pytest.raises(OptionError):
        pipeline_coreset.sketch_log(log, **options)
