"""What GPSZip is compared with: its algorithms, files and bounds."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.peers import bottom_up, cised, integers, on_knots, on_samples, td_tr
from benchmarks.peers.curves import Steps, make_curve
from benchmarks.peers.files import decode_file, encode_file
from benchmarks.peers.log import find_period, find_speed, make_log, read_log
from hypothesis import given
from hypothesis import strategies as st

from gpszip.testing import drives
from oracle.plain_peers import cised as plain_cised
from oracle.plain_peers import synchronised_distances
from oracle.plain_peers import td_tr as plain_td_tr
from random_tests import examples

SIMPLIFIERS = {
    "td-tr": td_tr.simplify,
    "cised-s": cised.simplify,
    "cised-wide": cised.simplify_with_wide_cones,
    "bottom-up": bottom_up.simplify,
}


def log_of(*tracks):
    """A log of tracks, each given as (times, positions)."""
    sizes = [len(times) for times, _ in tracks]
    times = np.concatenate([np.asarray(times, float) for times, _ in tracks])
    positions = np.concatenate([np.asarray(positions, float) for _, positions in tracks])
    names = [f"bus-{i}" for i in range(len(tracks))]
    x, y = (np.ascontiguousarray(axis) for axis in positions.T)
    return make_log(names, np.repeat(np.arange(len(tracks)), sizes), times, x, y)


@st.composite
def logs(draw, most=40, tracks=2):
    """Logs with times in tenths of a second and positions in tenths of a metre."""
    made = []
    for _ in range(draw(st.integers(1, tracks))):
        steps = draw(st.lists(st.integers(1, 50), max_size=most))
        times = np.r_[0, np.cumsum(steps)] / 10 + draw(st.integers(0, 1000))
        number = st.integers(-300, 300)
        moves = draw(st.lists(st.tuples(number, number), min_size=len(times), max_size=len(times)))
        positions = np.array(moves, float) / 10
        made.append((times, positions.cumsum(axis=0) if draw(st.booleans()) else positions))
    return log_of(*made)


@st.composite
def bounds(draw):
    return draw(st.integers(1, 400)) / 10


def segments(kept, log):
    """Pairs of successive samples kept of one track."""
    firsts = set(log.firsts.tolist())
    return [(a, b) for a, b in itertools.pairwise(kept.tolist()) if b not in firsts]


@pytest.mark.parametrize("simplify", SIMPLIFIERS.values(), ids=SIMPLIFIERS)
@given(log=logs(), bound=bounds())
def test_no_sample_is_further_than_the_tolerance(simplify, log, bound):
    kept = simplify(log, bound)
    assert set(log.firsts[:-1]) | set(log.firsts[1:] - 1) <= set(kept)
    positions = np.column_stack([log.x, log.y])
    for a, b in segments(kept, log):
        assert synchronised_distances(log.clock, positions, a, b).max(initial=0) <= bound + 1e-6


STRAIGHT = [(i, (2 * i, 0)) for i in range(6)]

# 1 m/s to the east until second 4, then to the north.
TURN = [(i, (min(i, 4), max(i - 4, 0))) for i in range(9)]

# 1 m/s to the east, with a stop of 4 seconds: a straight line on the ground, but not in time.
STOP = [(i, (min(i, 4) + max(i - 8, 0), 0)) for i in range(13)]


@pytest.mark.parametrize(
    ("samples", "bound", "kept"),
    [
        (STRAIGHT, 0.01, [0, 5]),
        # the corner is 2.83 m from the middle of the line from (0, 0) to (4, 4)
        (TURN, 2.8, [0, 4, 8]),
        (TURN, 2.9, [0, 8]),
        # at 2/3 m/s all along, the sample at second 4 is 4 - 8/3 m ahead, that at 8 as far behind
        (STOP, 1.3, [0, 4, 8, 12]),
        (STOP, 1.4, [0, 12]),
    ],
)
def test_td_tr_keeps_what_hands_compute(samples, bound, kept):
    log = log_of(tuple(zip(*samples, strict=True)))
    assert td_tr.simplify(log, bound).tolist() == kept


def test_narrow_cones_end_a_line_before_the_cone_that_misses_the_others():
    # Cones of 0.5 m about (1, 0) at second 1, (2, 0) at second 2, (3, 3) at second 3: velocities
    # within 0.5, 0.25 and 0.17 of (1, 0), (1, 0) and (1, 1). The last is out of reach.
    log = log_of(([0, 1, 2, 3], [(0, 0), (1, 0), (2, 0), (3, 3)]))
    assert cised.simplify(log, 1.0).tolist() == [0, 2, 3]

    # Cones of 1.9 m have velocities within 0.95 of (1, 0) and 0.63 of (1, 1): both hold (1, 0.7).
    assert cised.simplify(log, 3.8).tolist() == [0, 3]


def test_lines_with_wide_cones_end_at_samples_inside_all_cones():
    # Seen from the first sample, a cone of 1 m about (1, 0) at second 1 does not hold the velocity
    # (1, 1.5) of the second, but (1, 0.6), which suits both. Velocity (1, 0.5) of the third suits.
    positions = [(0, 0), (1, 0), (2, 3), (4, 2)]
    log = log_of(([0, 1, 2, 4], positions))
    assert cised.simplify_with_wide_cones(log, 1.0).tolist() == [0, 1, 2, 3]
    assert cised.simplify_with_wide_cones(log, 2.1).tolist() == [0, 3]


def without_ties(log, seed):
    """The log with positions moved at random, so that no decision is left to the last digit."""
    moves = np.random.default_rng(seed).normal(0, 0.05, (2, len(log.clock)))
    return replace(log, x=log.x + moves[0], y=log.y + moves[1])


seeds = st.integers(0, 2**32 - 1)


@given(log=logs(tracks=1), bound=bounds(), seed=seeds)
def test_td_tr_is_its_definition(log, bound, seed):
    log = without_ties(log, seed)
    positions = np.column_stack([log.x, log.y])
    expected = plain_td_tr(log.clock, positions, bound)
    assert td_tr.simplify(log, bound).tolist() == expected


@pytest.mark.parametrize("narrow", [True, False])
@given(log=logs(tracks=1), bound=bounds(), seed=seeds)
@examples(50)
def test_cised_is_its_definition(narrow, log, bound, seed):
    log = without_ties(log, seed)
    positions = np.column_stack([log.x, log.y])
    expected = plain_cised(log.clock, positions, bound, cised.SIDES, narrow=narrow)
    simplify = cised.simplify if narrow else cised.simplify_with_wide_cones
    assert simplify(log, bound).tolist() == expected


@given(log=logs())
def test_vertices_are_those_of_least_squares(log):
    kept = np.unique(np.r_[log.firsts[:-1], log.firsts[1:] - 1, np.arange(0, len(log.clock), 5)])
    clock = log.clock[kept]
    found = bottom_up.fit_vertices(log, kept, clock, np.zeros(len(kept), bool))

    # The matrix of shares, with a row for the sample of each knot.
    shares = np.array([np.interp(log.clock, clock, unit) for unit in np.eye(len(kept))]).T
    matrix = np.vstack([shares, np.sqrt(bottom_up.RIDGE) * np.eye(len(kept))])
    for vertices, axis in zip(found, (log.x, log.y), strict=True):
        right = np.r_[axis, np.sqrt(bottom_up.RIDGE) * axis[kept]]
        np.testing.assert_allclose(
            vertices, np.linalg.lstsq(matrix, right, rcond=None)[0], atol=1e-6
        )


def test_bottom_up_removes_the_cheapest_first():
    # Sample 1 adds 0.01 m² and goes first. Then 2 would leave it 1.05 m from the line, and stays.
    log = log_of(([0, 1, 2, 3, 4], [(0, 0), (1, 0.1), (2, 0), (3, 2), (4, 4)]))
    assert bottom_up.simplify(log, 0.5).tolist() == [0, 2, 4]


tables = st.lists(
    st.tuples(*[st.integers(-5, 5) | st.integers(-(2**40), 2**40)] * 3), max_size=40
).map(lambda rows: np.array(rows, np.int64).reshape(-1, 3))


@pytest.mark.parametrize("name", ["arithmetic", "bzip2", "zstd", "pco"])
@given(table=tables)
def test_tables_round_trip(name, table):
    if name == "pco":
        pytest.importorskip("pcodec")
    coder = integers.CODERS[name]
    assert np.array_equal(coder.decode(coder.encode(table), *table.shape), table)


@pytest.mark.parametrize("coder", ["arithmetic", "bzip2"])
@given(log=logs())
def test_files_hold_the_curve(coder, log):
    curve = make_curve(log, np.arange(len(log.clock)), Steps(0.5, 0.25))
    tracks = decode_file(encode_file(log, curve, coder))
    assert [track[0] for track in tracks] == log.names
    starts = log.starts.repeat(np.diff(curve.firsts))
    times, x, y = (np.concatenate([track[i] for track in tracks]) for i in (1, 2, 3))
    np.testing.assert_allclose(times, starts + 0.5 * curve.ticks)
    assert np.array_equal(x, 0.25 * curve.x)
    assert np.array_equal(y, 0.25 * curve.y)


def decoded_errors(log, tracks):
    for track, (_, times, x, y) in enumerate(tracks):
        part = slice(log.firsts[track], log.firsts[track + 1])
        at = log.clock[part] - log.clock[part.start] + log.starts[track]
        yield np.hypot(np.interp(at, times, x) - log.x[part], np.interp(at, times, y) - log.y[part])


@pytest.mark.parametrize("name", on_knots.SIMPLIFIERS)
@given(log=logs(), bound=bounds())
@examples(25)
def test_files_of_knots_hold_the_bound(name, log, bound):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(on_knots, "CODERS", ("arithmetic",))
        data, sizes = on_knots.compress(log, bound, name, "thorough")
    assert sizes == {"arithmetic": len(data)}
    assert max(map(np.max, decoded_errors(log, decode_file(data)))) <= bound * (1 + 1e-6)


@given(log=logs(), bound=bounds())
def test_files_of_samples_hold_the_bound(log, bound):
    data = on_samples.compress(log, bound, "bzip2")
    assert max(map(np.max, decoded_errors(log, decode_file(data)))) <= bound * (1 + 1e-6)


def test_files_of_sz3_hold_the_bound():
    pytest.importorskip("pysz")
    pytest.importorskip("pcodec")
    log = log_of(*drives(vehicles=3, duration=300.0).values())
    tracks = on_samples.decode_sz3(on_samples.compress(log, 2.0, "sz3"))
    assert max(map(np.max, decoded_errors(log, tracks))) <= 2.0


def test_logs_are_read(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("track_id,t,x,y\na,5,1,2\na,6.5,3,4\nb,2,5,6\n")
    log = read_log(str(path))
    assert (log.names, log.starts.tolist(), log.firsts.tolist()) == (["a", "b"], [5, 2], [0, 2, 3])
    assert np.diff(log.clock)[0] == 1.5
    assert log.clock[2] > log.clock[1] + 1000
    assert (log.x.tolist(), log.y.tolist()) == ([1, 3, 5], [2, 4, 6])


def test_periods_and_speeds():
    log = log_of(([0, 1.5, 6], [(0, 0), (3, 0), (3, 9)]), ([7, 10], [(50, 0), (50, 6)]))
    assert find_period(log) == 1.5
    assert find_speed(log, np.arange(5), quantile=0.5) == 2.0


def test_names_that_follow_take_one():
    from benchmarks.peers.files import decode_names, encode_names

    for names in (["bus-0", "bus-1", "bus-2"], ["a", "c"], ["7"], ["x", "x1"]):
        data = encode_names(names)
        assert decode_names(data, len(names)) == names
    assert encode_names(["bus-8", "bus-9", "bus-10"]) == b"\0bus-8"
