"""The trellis, and its cheapest path, against an oracle that tries everything."""

from dataclasses import replace

import numpy as np
import pytest

from calling import from_python
from gpszip.matching.index import create_workspace, index_network
from gpszip.matching.kernels.backtrace import best_path, road_positions
from gpszip.matching.kernels.candidates import empty_candidates, find_candidates
from gpszip.matching.kernels.trellis import build_trellis, select_samples
from gpszip.matching.parameters import min_spacing, model_parameters
from gpszip.model import Network
from gpszip.model.match import Scales
from matching.streets import grid, network
from oracle.matching import DirectedRoads, Trellis
from oracle.matching import find_candidates as find_candidates_plainly

# Inner kernels, as Python calls them.
empty_candidates = from_python(empty_candidates)
find_candidates = from_python(find_candidates)

SCALES = Scales(error=8.0, sigma=14.0, beta=12.0, median_speed=8.0, max_speed=60.0)
WITH_HEADING = replace(SCALES, heading=25.0)


def crooked_town(seed, block=90.0):
    """A grid with crossings displaced, streets missing, one-way, or bent: all paths differ."""
    rng = np.random.default_rng(seed)
    nodes, pairs = grid(4, block)
    nodes += rng.normal(0, 0.15 * block, nodes.shape)
    pairs = [pairs[i] for i in np.flatnonzero(rng.random(len(pairs)) >= 0.15)]
    lines = []
    for a, b in pairs:
        bend = (nodes[a] + nodes[b]) / 2 + rng.normal(0, 0.1 * block, 2)
        bends = [bend] if rng.random() < 0.4 else []
        lines.append(np.array([nodes[a], *bends, nodes[b]]))
    forward = rng.random(len(pairs)) < 0.9
    backward = ~forward | (rng.random(len(pairs)) < 0.85)
    starts, ends = np.array(pairs, np.int32).T
    return Network(
        nodes,
        starts.copy(),
        ends.copy(),
        np.append(0, np.cumsum([len(line) for line in lines])),
        np.concatenate(lines),
        forward,
        backward,
        np.full(len(pairs), np.nan),
    )


def wander(town, seed, period, noise, steps=14):
    """Samples of an agent that follows streets at random, also against one-way roads."""
    rng = np.random.default_rng(seed)
    node = int(rng.integers(len(town.nodes)))
    line = [town.nodes[node]]
    for _ in range(30):
        roads = np.flatnonzero((town.starts == node) | (town.ends == node))
        if not len(roads):
            break
        road = int(rng.choice(roads))
        is_backward = town.ends[road] == node
        line += list(town.road(road)[:: -1 if is_backward else 1][1:])
        node = int(town.starts[road] if is_backward else town.ends[road])
    line = np.array(line)
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    times = period * np.arange(steps)
    positions = np.stack([np.interp(9.0 * times, along, axis) for axis in line.T], axis=1)
    return times, positions + rng.normal(0, noise, positions.shape)


def rough_headings(positions, seed):
    """Unit vectors about the direction of travel, one in five unknown (zero)."""
    rng = np.random.default_rng(seed)
    steps = np.gradient(positions, axis=0) + rng.normal(0, 10, positions.shape)
    is_known = rng.random((len(positions), 1)) < 0.8
    return np.where(is_known, steps / np.linalg.norm(steps, axis=1, keepdims=True), 0.0)


def both_trellises(town, times, positions, headings, scales):
    """The index, the trellis of the kernels, and that of the oracle."""
    index, model = index_network(town), model_parameters(scales)
    is_gap = np.zeros(len(times) - 1, bool)
    samples = select_samples(positions, is_gap, min_spacing(scales))
    trellis = build_trellis(
        positions,
        times,
        headings,
        is_gap,
        samples,
        index.roads,
        index.road_grid,
        index.graph,
        model,
        create_workspace(index),
    )
    plain_headings = [heading if heading.any() else None for heading in headings[samples]]
    plain = Trellis(town, positions[samples], times[samples], model, plain_headings)
    return index, trellis, plain


def positions_of(index, roads, metres):
    """Coordinates of candidates, -1 off the roads."""
    on_roads = road_positions(np.maximum(roads, 0), metres, index.roads, index.graph)
    return np.where(roads[:, None] >= 0, on_roads, -1.0)


@pytest.mark.parametrize("has_headings", [False, True])
@pytest.mark.parametrize("seed", range(30))
def test_the_path_costs_as_much_as_that_of_the_oracle(seed, has_headings):
    town = crooked_town(seed)
    times, positions = wander(
        town, seed + 1000, period=[2.0, 4.0, 12.0][seed % 3], noise=[3.0, 10.0][seed % 2]
    )
    # some tracks jump out of town, and some of these come back
    positions[9:] += [0, 1000] if seed % 5 == 0 else 0
    positions[11:] -= [0, 1000] if seed % 10 == 0 else 0
    headings = rough_headings(positions, seed) if has_headings else np.zeros((len(times), 2))

    scales = WITH_HEADING if has_headings else SCALES
    index, trellis, plain = both_trellises(town, times, positions, headings, scales)
    path = best_path(trellis)
    roads, metres = trellis.candidates.roads[path], trellis.candidates.metres[path]
    least, plain_path = plain.cheapest_path()
    assert plain.cost_of(roads.tolist()) == pytest.approx(least, rel=1e-9)

    # at a crossing, the end of one road and the beginning of the next are one position
    plain_roads = np.array([candidate.road for candidate in plain_path], np.int32)
    plain_metres = np.array([candidate.metres for candidate in plain_path])
    np.testing.assert_allclose(
        positions_of(index, roads, metres),
        positions_of(index, plain_roads, plain_metres),
        atol=1e-6,
    )


@pytest.mark.parametrize("seed", range(12))
def test_the_first_of_equally_cheap_paths_is_taken(seed):
    """At the crossings of a square grid most paths have equals.

    All numbers are integers, so that their costs are equal to the last bit.
    """
    rng = np.random.default_rng(seed)
    corners = np.array([0, 0]) + np.cumsum(rng.integers(0, 2, (5, 2)), axis=0).clip(0, 4)
    positions = 96.0 * np.repeat(corners, 2, axis=0) + rng.choice([-48, 0, 0, 0, 48], (10, 2))
    times = 12.0 * np.arange(len(positions))
    _, trellis, plain = both_trellises(
        network(*grid(4, 96.0)), times, positions, np.zeros_like(positions), SCALES
    )
    _, plain_path = plain.cheapest_path()
    roads = trellis.candidates.roads[best_path(trellis)].tolist()
    assert roads == [candidate.road for candidate in plain_path]


@pytest.mark.parametrize("seed", range(10))
def test_candidates_are_those_of_the_oracle(seed):
    town = crooked_town(seed, block=75.0)
    index, model, roads = index_network(town), model_parameters(WITH_HEADING), DirectedRoads(town)
    rng = np.random.default_rng(seed)
    out = empty_candidates(2 * model.max_candidates + 1)
    for position in rng.uniform(-50, 350, (30, 2)):
        heading = rng.normal(0, 1, 2)
        heading /= np.linalg.norm(heading)
        n = find_candidates(
            position, heading, index.roads, index.road_grid, index.graph, model, out
        )
        columns = (out.roads[:n].tolist(), out.metres[:n], out.emission_costs[:n])
        candidates = sorted(zip(*columns, strict=True))
        plain = sorted(find_candidates_plainly(roads, position, model, heading))
        assert [one[0] for one in candidates] == [one.road for one in plain]
        np.testing.assert_allclose(
            [one[1:] for one in candidates], [one[1:] for one in plain], atol=1e-9
        )


def test_a_hairpin_is_near_twice():
    line = np.array([[0.0, 0.0], [400.0, 0.0], [400.0, 20.0], [0.0, 20.0]])
    start, end, both = np.zeros(1, np.int32), np.ones(1, np.int32), np.ones(1, bool)
    road = Network(line[[0, 3]], start, end, np.array([0, 4]), line, both, both, np.full(1, np.nan))
    index, model = index_network(road), model_parameters(SCALES)
    out = empty_candidates(2 * model.max_candidates + 1)
    n = find_candidates(
        np.array([100.0, 12.0]),
        np.zeros(2),
        index.roads,
        index.road_grid,
        index.graph,
        model,
        out,
    )
    assert out.roads[:n].tolist() == [0, 1, 0, 1, -1]
    np.testing.assert_allclose(out.metres[: n - 1], [720, 100, 100, 720])
    np.testing.assert_allclose(out.distances[: n - 1], [8, 8, 12, 12])
