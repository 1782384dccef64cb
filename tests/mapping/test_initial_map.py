import numpy as np
import pytest

from gpszip.mapping.initial_map import (
    draft_of,
    list_parts,
    normal_equations,
    place_nodes,
    round_nodes,
    sample_errors,
    squared_error,
    walks_of,
)
from gpszip.mapping.time_grid import lay_slots
from gpszip.model import Frame, Track


def drafted(seed, nodes=9, dimension=2):
    """Slots of two tracks with gaps, and a random draft on them that keeps the pieces' ends."""
    rng = np.random.default_rng(seed)
    tracks, gaps = [], []
    for name in "ab":
        gap = rng.random(119) < 0.03
        times = np.cumsum(rng.integers(1, 900, 120) + 6000 * np.append(False, gap)) / 1000
        tracks.append(Track(name, times, np.cumsum(rng.normal(0, 1, (120, dimension)), axis=0)))
        gaps.append(gap)
    slots = lay_slots(tracks, gaps, Frame((0,) * dimension, 0, 112, 132))
    at = np.where(rng.random(len(slots.cells)) < 0.3, 0, -1)
    at[slots.firsts] = at[slots.lasts] = 0
    at[at >= 0] = rng.permutation(np.arange((at >= 0).sum()) % nodes)
    return slots, at, rng.normal(0, 20, (nodes, dimension))


def plain_errors(slots, at, places):
    """Distance of each sample, found sample by sample."""
    out = []
    for i, t in enumerate(slots.times):
        piece = int((slots.ends[slots.lasts] <= i).sum())
        knots = [s for s in range(slots.firsts[piece], slots.lasts[piece] + 1) if at[s] >= 0]
        after = next((k for k in range(1, len(knots)) if slots.ends[knots[k]] > i), len(knots) - 1)
        a, b = knots[after - 1], knots[after]
        share = (t - slots.cells[a]) / (slots.cells[b] - slots.cells[a])
        out.append(float(np.linalg.norm((1 - share) * places[at[a]] + share * places[at[b]] - slots.spots[i])))
    return out


@pytest.mark.parametrize("seed", range(4))
def test_errors_of_samples_and_their_sum_are_the_plain_twins(seed):
    slots, at, places = drafted(seed, dimension=1 + seed % 3)
    parts = list_parts(slots, at, len(places))
    errors, part = sample_errors(slots, parts, places)
    np.testing.assert_allclose(errors, plain_errors(slots, at, places), atol=1e-9)
    # sums are of positions and times in whole ticks
    assert squared_error(parts, places) == pytest.approx(float((errors**2).sum()), rel=1e-3)
    assert (np.diff(part) >= 0).all()


@pytest.mark.parametrize("seed", range(4))
def test_nodes_are_placed_where_the_error_is_least(seed):
    slots, at, places = drafted(seed)
    parts = list_parts(slots, at, len(places))
    solved = place_nodes(*normal_equations(parts, places))
    best = squared_error(parts, solved)
    # least squares over all samples, set up row by row
    design = np.zeros((slots.samples, len(places)))
    _, part = sample_errors(slots, parts, places)
    start, end = slots.cells[parts.froms][part], slots.cells[parts.tos][part]
    share = (slots.times - start) / (end - start)
    np.add.at(design, (np.arange(slots.samples), parts.starts[part]), 1 - share)
    np.add.at(design, (np.arange(slots.samples), parts.ends[part]), share)
    expected = np.linalg.lstsq(design, slots.spots, rcond=None)[0]
    np.testing.assert_allclose(solved, expected, atol=0.05)
    rng = np.random.default_rng(seed)
    for _ in range(20):
        assert squared_error(parts, solved + rng.normal(0, 0.3, solved.shape)) > best


@pytest.mark.parametrize("seed", range(4))
def test_rounded_places_are_whole_and_near_as_good(seed):
    slots, at, places = drafted(seed)
    parts = list_parts(slots, at, len(places))
    system = normal_equations(parts, places)
    solved = place_nodes(*system)
    rounded = round_nodes(*system, solved)
    np.testing.assert_array_equal(rounded, np.rint(rounded))
    assert squared_error(parts, rounded) <= squared_error(parts, np.rint(solved)) + 1e-6


def test_a_node_that_nothing_binds_stays_where_it_is():
    slots, at, places = drafted(1)
    places = np.vstack([places, [[77.0, -5.0]]])
    solved = place_nodes(*normal_equations(list_parts(slots, at, len(places)), places))
    np.testing.assert_allclose(solved[-1], [77.0, -5.0])


def test_walks_are_the_knots_of_each_track_and_gaps_part_its_pieces():
    slots, at, places = drafted(3)
    walks = walks_of(slots, at, np.rint(places), 2)
    for track, walk in enumerate(walks.walks):
        expected, gaps = [], []
        for piece in np.flatnonzero(slots.owners == track):
            mine = [s for s in range(slots.firsts[piece], slots.lasts[piece] + 1) if at[s] >= 0]
            gaps += [bool(expected)] * (len(expected) > 0) + [False] * (len(mine) - 1)
            expected += mine
        np.testing.assert_array_equal(walk.cells, slots.cells[expected])
        np.testing.assert_array_equal(walks.nodes[walk.nodes], np.rint(places)[at[expected]])
        assert walk.gaps.tolist() == gaps
    assert any(walk.gaps.any() for walk in walks.walks)


def test_a_draft_counts_the_knots_of_its_walks():
    slots, at, places = drafted(2)
    draft = draft_of(slots, at, places, 3.0, 50)
    np.testing.assert_array_equal(draft.uses[:9], np.bincount(at[at >= 0], minlength=9))
    parts = list_parts(slots, at, len(places))
    moving = parts.starts != parts.ends
    leaving = np.bincount(parts.starts[moving], minlength=9) + 0.5 * np.bincount(parts.ends[moving], minlength=9)
    np.testing.assert_array_equal(draft.leaving[:9], leaving)


def test_parts_between_other_nodes_are_those_listed_anew():
    slots, at, places = drafted(5)
    joined = np.where(at > 4, 4, at)
    renamed, listed = list_parts(slots, at, len(places)).renamed(joined, 5), list_parts(slots, joined, 5)
    for field in ("froms", "tos", "starts", "ends", "moments", "centers"):
        np.testing.assert_array_equal(getattr(renamed, field), getattr(listed, field))
    np.testing.assert_array_equal(renamed.stiffness.toarray(), listed.stiffness.toarray())
