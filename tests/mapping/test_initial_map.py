import numpy as np
import pytest

from gpszip.mapping.initial_map import (
    build_working_map,
    list_segments,
    normal_equations,
    round_positions,
    sample_errors,
    solve_positions,
    squared_error,
    walks_of,
)
from gpszip.mapping.time_grid import build_time_grid
from gpszip.model import QuantisationGrid, Track


def drafted(seed, nodes=9, dimension=2):
    """Slots of two tracks with gaps, and a random draft on them that keeps the pieces' ends."""
    rng = np.random.default_rng(seed)
    tracks, gaps = [], []
    for name in "ab":
        gap = rng.random(119) < 0.03
        times = np.cumsum(rng.integers(1, 900, 120) + 6000 * np.append(False, gap)) / 1000
        tracks.append(Track(name, times, np.cumsum(rng.normal(0, 1, (120, dimension)), axis=0)))
        gaps.append(gap)
    slots = build_time_grid(tracks, gaps, QuantisationGrid((0,) * dimension, 0, 112, 132))
    at = np.where(rng.random(len(slots.time_steps)) < 0.3, 0, -1)
    at[slots.first_slots] = at[slots.last_slots] = 0
    at[at >= 0] = rng.permutation(np.arange((at >= 0).sum()) % nodes)
    return slots, at, rng.normal(0, 20, (nodes, dimension))


def plain_errors(slots, at, positions):
    """Distance of each sample, found sample by sample."""
    out = []
    for i, t in enumerate(slots.times):
        piece = int((slots.ends[slots.last_slots] <= i).sum())
        knots = [
            s for s in range(slots.first_slots[piece], slots.last_slots[piece] + 1) if at[s] >= 0
        ]
        after = next((k for k in range(1, len(knots)) if slots.ends[knots[k]] > i), len(knots) - 1)
        a, b = knots[after - 1], knots[after]
        share = (t - slots.time_steps[a]) / (slots.time_steps[b] - slots.time_steps[a])
        out.append(
            float(
                np.linalg.norm(
                    (1 - share) * positions[at[a]]
                    + share * positions[at[b]]
                    - slots.sample_positions[i]
                )
            )
        )
    return out


@pytest.mark.parametrize("seed", range(4))
def test_errors_of_samples_and_their_sum_are_the_plain_twins(seed):
    slots, at, positions = drafted(seed, dimension=1 + seed % 3)
    segments = list_segments(slots, at, len(positions))
    errors, part = sample_errors(slots, segments, positions)
    np.testing.assert_allclose(errors, plain_errors(slots, at, positions), atol=1e-9)
    # sums are of positions and times in whole ticks
    assert squared_error(segments, positions) == pytest.approx(float((errors**2).sum()), rel=1e-3)
    assert (np.diff(part) >= 0).all()


@pytest.mark.parametrize("seed", range(4))
def test_nodes_are_placed_where_the_error_is_least(seed):
    slots, at, positions = drafted(seed)
    segments = list_segments(slots, at, len(positions))
    solved = solve_positions(*normal_equations(segments, positions))
    best = squared_error(segments, solved)
    # least squares over all samples, set up row by row
    design = np.zeros((slots.samples, len(positions)))
    _, part = sample_errors(slots, segments, positions)
    start, end = (
        slots.time_steps[segments.first_slots][part],
        slots.time_steps[segments.last_slots][part],
    )
    share = (slots.times - start) / (end - start)
    np.add.at(design, (np.arange(slots.samples), segments.starts[part]), 1 - share)
    np.add.at(design, (np.arange(slots.samples), segments.ends[part]), share)
    expected = np.linalg.lstsq(design, slots.sample_positions, rcond=None)[0]
    np.testing.assert_allclose(solved, expected, atol=0.05)
    rng = np.random.default_rng(seed)
    for _ in range(20):
        assert squared_error(segments, solved + rng.normal(0, 0.3, solved.shape)) > best


@pytest.mark.parametrize("seed", range(4))
def test_rounded_places_are_whole_and_near_as_good(seed):
    slots, at, positions = drafted(seed)
    segments = list_segments(slots, at, len(positions))
    system = normal_equations(segments, positions)
    solved = solve_positions(*system)
    rounded = round_positions(*system, solved)
    np.testing.assert_array_equal(rounded, np.rint(rounded))
    assert squared_error(segments, rounded) <= squared_error(segments, np.rint(solved)) + 1e-6


def test_a_node_that_nothing_binds_stays_where_it_is():
    slots, at, positions = drafted(1)
    positions = np.vstack([positions, [[77.0, -5.0]]])
    solved = solve_positions(*normal_equations(list_segments(slots, at, len(positions)), positions))
    np.testing.assert_allclose(solved[-1], [77.0, -5.0])


def test_walks_are_the_knots_of_each_track_and_gaps_part_its_pieces():
    slots, at, positions = drafted(3)
    walks = walks_of(slots, at, np.rint(positions), 2)
    for track, walk in enumerate(walks.walks):
        expected, gaps = [], []
        for piece in np.flatnonzero(slots.piece_tracks == track):
            mine = [
                s
                for s in range(slots.first_slots[piece], slots.last_slots[piece] + 1)
                if at[s] >= 0
            ]
            gaps += [bool(expected)] * (len(expected) > 0) + [False] * (len(mine) - 1)
            expected += mine
        np.testing.assert_array_equal(walk.time_steps, slots.time_steps[expected])
        np.testing.assert_array_equal(walks.nodes[walk.nodes], np.rint(positions)[at[expected]])
        assert walk.gaps.tolist() == gaps
    assert any(walk.gaps.any() for walk in walks.walks)


def test_a_draft_counts_the_knots_of_its_walks():
    slots, at, positions = drafted(2)
    working_map = build_working_map(slots, at, positions, 3.0, 50)
    np.testing.assert_array_equal(working_map.uses[:9], np.bincount(at[at >= 0], minlength=9))
    segments = list_segments(slots, at, len(positions))
    moving = segments.starts != segments.ends
    leaving = np.bincount(segments.starts[moving], minlength=9) + 0.5 * np.bincount(
        segments.ends[moving], minlength=9
    )
    np.testing.assert_array_equal(working_map.outgoing_weight[:9], leaving)


def test_parts_between_other_nodes_are_those_listed_anew():
    slots, at, positions = drafted(5)
    joined = np.where(at > 4, 4, at)
    renamed, listed = (
        list_segments(slots, at, len(positions)).relabelled(joined, 5),
        list_segments(slots, joined, 5),
    )
    for field in ("first_slots", "last_slots", "starts", "ends", "moments", "centers"):
        np.testing.assert_array_equal(getattr(renamed, field), getattr(listed, field))
    np.testing.assert_array_equal(renamed.stiffness.toarray(), listed.stiffness.toarray())
