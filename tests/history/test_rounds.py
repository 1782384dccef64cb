"""Rounds of planted patrols on a grid of corridors."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from gpszip.errors import InputError
from gpszip.history.rounds import _median_counts, find_rounds
from gpszip.history.traversals import History, Traversals
from gpszip.model import Network

#: Metres of each corridor; that to node 9, a dead end, has 40.
CORRIDOR = 100.0

#: Node paths: crossings 0 to 8 in rows of three. The round passes corridor 1-4 twice.
USUAL = [0, 1, 4, 9, 4, 1, 2, 5, 8, 7, 6, 3, 0]
WITHOUT_DEAD_END = [0, 1, 4, 1, 2, 5, 8, 7, 6, 3, 0]
WITH_DETOUR = [0, 1, 4, 9, 4, 1, 2, 5, 4, 5, 8, 7, 6, 3, 0]

PAIRS = [(0, 1), (1, 2), (3, 4), (4, 5), (6, 7), (7, 8)]
PAIRS += [(0, 3), (3, 6), (1, 4), (4, 7), (2, 5), (5, 8), (4, 9)]


def corridors():
    nodes = np.array([[CORRIDOR * (i % 3), CORRIDOR * (i // 3)] for i in range(9)] + [[120, 130]])
    nodes[9] = nodes[4] + [24, 32]
    starts, ends = np.array(PAIRS, np.int32).T
    points = nodes[np.array(PAIRS).ravel()]
    both = np.full(len(PAIRS), True)
    offsets = np.arange(0, 2 * len(PAIRS) + 1, 2)
    return Network(nodes, starts, ends, offsets, points, both, both, np.full(len(PAIRS), np.nan))


def edge_of(node, other):
    return PAIRS.index((min(node, other), max(node, other)))


def patrol(paths, speeds=None, waits=None, name="guard", timed=True):
    """Traversals of node paths, each of which begins where the one before ends."""
    network = corridors()
    rows, now = [], 0.0
    for i, path in enumerate(paths):
        now += waits[i] if waits else 0.0
        for node, other in zip(path[:-1], path[1:], strict=True):
            edge = edge_of(node, other)
            seconds = network.lengths[edge] / (speeds[i] if speeds else 1.0)
            rows.append((edge, node < other, now, now + seconds))
            now += seconds
    edge, forward, enter, leave = map(np.array, zip(*rows, strict=True))
    length = network.lengths[edge]
    starts = np.zeros(len(edge), bool)
    starts[0] = True
    unknown = np.full(len(edge), np.nan)
    return Traversals(
        (name,),
        np.zeros(len(edge), np.int32),
        edge.astype(np.int64),
        forward,
        enter if timed else unknown,
        leave if timed else unknown,
        np.where(forward, 0.0, length),
        np.where(forward, length, 0.0),
        np.zeros(len(edge)) if timed else unknown,
        starts,
    )


def together(*parts):
    joined = [np.concatenate([getattr(part, name) for part in parts]) for name in FIELDS]
    track = np.concatenate([np.full(len(part), i, np.int32) for i, part in enumerate(parts)])
    return Traversals(tuple(name for part in parts for name in part.ids), track, *joined)


FIELDS = ("edge", "forward", "enter", "leave", "begin", "end", "standing", "starts")


def rounds_of(traversals, **options):
    return find_rounds(History(corridors(), traversals), **options)


def directed(path):
    return tuple((edge_of(a, b), a < b) for a, b in zip(path[:-1], path[1:], strict=True))


def is_rotation(usual, path):
    doubled = directed(path) * 2
    return any(doubled[i : i + len(usual)] == usual for i in range(len(usual)))


def test_planted_rounds_are_told():
    paths = [USUAL] * 12
    paths[4], paths[7] = WITHOUT_DEAD_END, WITH_DETOUR
    speeds = [1.0] * 12
    speeds[9] = 0.5
    waits = [600.0] * 12
    found = rounds_of(patrol(paths, speeds, waits))

    # The usual round, from any edge that it has once.
    assert is_rotation(found.usual, USUAL)
    assert found.length == pytest.approx(1080.0)
    assert found.regularity > 0.85

    # What is unusual, once each.
    short = [each for each in found.rounds if each.share < 1]
    assert [each.missed for each in short] == [(edge_of(4, 9),)]
    assert short[0].share == pytest.approx(1 - 80 / 1080)
    assert [each.extra for each in found.rounds if each.extra] == [pytest.approx(200.0)]
    assert max(each.late for each in found.rounds) == pytest.approx(1080.0, rel=0.2)

    # Visits.
    visits = {each.edge: each for each in found.edges}
    dead_end = visits[edge_of(4, 9)]
    assert (dead_end.usual, dead_end.missed) == (2, 1)
    assert dead_end.visits == 2 * 11
    assert visits[edge_of(4, 5)].usual == 0


def test_rounds_begin_where_the_guard_waits():
    traversals = patrol([USUAL] * 6, waits=[300.0] * 6)
    first = edge_of(0, 3)
    standing = np.where(traversals.edge == first, 300.0, 0.0)
    traversals = Traversals(
        *(standing if name == "standing" else getattr(traversals, name) for name in ALL_FIELDS)
    )
    found = rounds_of(traversals)
    assert found.usual == directed(USUAL)
    assert len(found.rounds) == 6


ALL_FIELDS = ("ids", "track", *FIELDS)


def test_agents_share_the_usual_round():
    found = rounds_of(together(patrol([USUAL] * 4, name="day"), patrol([USUAL] * 3, name="night")))
    assert is_rotation(found.usual, USUAL)
    names = [each.track for each in found.rounds]
    assert set(names) == {"day", "night"}
    assert next(each.number for each in found.rounds if each.track == "night") == 1


def test_only_rounds_since_a_time_are_told():
    paths = [USUAL] * 8
    paths[1] = WITHOUT_DEAD_END
    found = rounds_of(patrol(paths), since=3 * 1080.0)
    assert 4 <= len(found.rounds) <= 5
    assert all(each.share == 1 for each in found.rounds)
    assert all(each.start >= 3 * 1080.0 for each in found.rounds)
    assert {each.missed for each in found.edges} == {0}


def test_rounds_without_times_have_lengths():
    found = rounds_of(patrol([USUAL] * 4, timed=False))
    assert np.isnan(found.duration)
    assert all(np.isnan(each.start) and each.length > 0 for each in found.rounds)
    assert all(np.isnan(each.interval) for each in found.edges)


@pytest.mark.parametrize("paths", [[USUAL], [USUAL] * 2])
def test_few_rounds_are_none(paths):
    with pytest.raises(InputError, match="rounds"):
        rounds_of(patrol(paths))


@pytest.mark.parametrize("seed", range(3))
def test_errands_are_no_rounds(seed):
    rng = np.random.default_rng(seed)
    path = [0]
    for _ in range(400):
        path.append(
            int(rng.choice([a if b == path[-1] else b for a, b in PAIRS if path[-1] in (a, b)]))
        )
    with pytest.raises(InputError, match="rounds"):
        rounds_of(patrol([path]))


@given(
    arrays.arrays(
        np.int64, st.tuples(st.integers(1, 9), st.integers(1, 5)), elements=st.integers(0, 3)
    )
)
def test_medians_are_those_of_numpy(counts):
    number, edge = np.nonzero(counts)
    expected = np.sort(counts, axis=0)[(len(counts) - 1) // 2]
    found = _median_counts(edge, counts[number, edge].astype(float), *counts.shape)
    assert found.tolist() == expected.tolist()
