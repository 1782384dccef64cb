"""Coresets of logs larger than memory: as good as of a log in memory, and the same whoever works."""

import numpy as np
import pytest

from gpszip import OptionError, Track
from gpszip.io.large.store import store_logs
from gpszip.pipeline import coreset as sketching
from gpszip.run import Processes, Serial, Threads
from gpszip.sketches.partition import build_coreset
from gpszip.sketches.pieces import polyline
from gpszip.testing import patrol


@pytest.fixture(autouse=True)
def small_batches(monkeypatch):
    monkeypatch.setattr(sketching, "_BATCH", 700)


@pytest.fixture(scope="module")
def tracks():
    """One that takes many batches, and some of which a batch holds several."""
    counts = {"long": 6100, "a": 150, "b": 1, "c": 340, "d": 699}
    return [
        Track(name, one.times, one.positions)
        for name, one in ((name, patrol(count, seed=5)) for name, count in counts.items())
    ]


@pytest.fixture
def log(tracks, tmp_path):
    rows = [
        (t, one.id, *place)
        for one in tracks
        for t, place in zip(one.times.tolist(), one.positions.tolist(), strict=True)
    ]
    path = tmp_path / "log.csv"
    path.write_text(
        "t,id,x,y\n" + "".join(f"{t!r},{name},{x!r},{y!r}\n" for t, name, x, y in sorted(rows))
    )
    with store_logs(str(path), rows=1000) as log:
        yield log


def same(one, other):
    return (
        one.tracks == other.tracks
        and one.rows.tobytes() == other.rows.tobytes()
        and one.owners.tolist() == other.owners.tolist()
    )


@pytest.mark.parametrize("size", [5, 60, 400, 20_000])
def test_it_is_as_good_as_of_a_log_in_memory(log, tracks, size):
    made, whole = sketching.sketch_log(log, size=size), build_coreset(tracks, size=size)
    assert len(made) <= size
    assert made.samples == whole.samples == 7290
    assert set(made.ids) == set(whole.ids)
    assert made.error <= 1.1 * whole.error + 1e-9


def test_functions_that_break_at_edges_are_priced_exactly(log, tracks):
    made = sketching.sketch_log(log, size=50)
    for track in tracks:
        own = made.track(track.id)
        knots = np.unique(own.edges[:, 0])[::3]
        at = np.append(knots, track.times[-1] + 1)
        places = np.random.default_rng(3).normal(0, 50, (len(at), 2))
        there = np.stack([np.interp(track.times, at, axis) for axis in places.T], axis=1)
        assert made.cost(polyline(at, places), track=track.id).estimate == pytest.approx(
            ((there - track.positions) ** 2).sum(), rel=1e-9
        )


@pytest.mark.parametrize(("k", "eps"), [(1, 0.5), (4, 0.5), (12, 0.9), (80, 0.9)])
def test_the_relative_error_asked_for_is_promised(log, tracks, k, eps):
    made = sketching.sketch_log(log, k=k, eps=eps)
    assert made.samples == 7290
    for track in tracks:
        assert made.track(track.id).eps(k) <= eps
    assert made.eps(k) <= eps
    assert len(made) <= 1.2 * len(build_coreset(tracks, k=k, eps=eps)) + 7290 / 700


def test_the_same_whoever_works(log):
    with Processes(2) as processes:
        for options in ({"size": 40}, {"k": 5, "eps": 0.6}):
            one, *others = (
                sketching.sketch_log(log, executor=x, **options)
                for x in (Serial(), Threads(1), Threads(3), processes)
            )
            assert all(same(one, other) for other in others)


@pytest.mark.parametrize("size", [5, 60])
def test_points_have_the_moments_of_the_blocks(log, tracks, size):
    made = sketching.sketch_log(log, size=size)
    few = list(sketching.thin_log(log, made, executor=Threads(2)))
    assert sum(map(len, few)) <= 8 * size
    for one, track in zip(
        few,
        sorted(tracks, key=lambda track: [t.id for t in log.tracks].index(track.id)),
        strict=True,
    ):
        assert np.isin(one.times, track.times).all()
        for first, last in made.track(track.id).edges:
            here, all_ = (
                (one.times >= first) & (one.times <= last),
                (track.times >= first) & (track.times <= last),
            )
            assert one.weights[here].sum() == pytest.approx(all_.sum(), rel=1e-9)
            assert one.weights[here] @ one.positions[here] == pytest.approx(
                track.positions[all_].sum(axis=0), rel=1e-9, abs=1e-6
            )
            assert one.weights[here] @ one.times[here] ** 2 == pytest.approx(
                (track.times[all_] ** 2).sum(), rel=1e-9
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
def test_sizes_that_can_not_be_are_refused(log, options):
    with pytest.raises(OptionError):
        sketching.sketch_log(log, **options)
