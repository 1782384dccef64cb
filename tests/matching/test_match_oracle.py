"""The lattice against a plain twin that tries everything."""

from dataclasses import replace

import numpy as np
import pytest

from gpszip.matching.index import create_workspace, index_network
from gpszip.matching.kernels.backtrace import best_path
from gpszip.matching.kernels.backtrace import road_positions as where
from gpszip.matching.kernels.candidates import empty_candidates, find_candidates
from gpszip.matching.kernels.trellis import build_trellis, select_samples
from gpszip.matching.parameters import min_spacing, model_parameters
from gpszip.model import Network
from gpszip.model.match import Scales
from oracle.matching import Plain, cheapest
from oracle.matching import candidates as plain_candidates

SCALES = Scales(error=8.0, sigma=14.0, beta=12.0, median_speed=8.0, max_speed=60.0)
HEADED = replace(SCALES, heading=25.0)


def crooked_town(seed, size=5, block=90.0, crooked=1.0, missing=0.15):
    """Crossings out of place, some streets missing, some one-way, some bent: every way has its own length."""
    rng = np.random.default_rng(seed)
    nodes = block * np.array(
        [(x, y) for x in range(size) for y in range(size)], float
    ) + crooked * rng.normal(0, 0.15 * block, (size * size, 2))
    pairs = [(x * size + y, (x + 1) * size + y) for x in range(size - 1) for y in range(size)]
    pairs += [(x * size + y, x * size + y + 1) for x in range(size) for y in range(size - 1)]
    pairs = [pairs[i] for i in np.flatnonzero(rng.random(len(pairs)) >= missing)]
    lines = []
    for a, b in pairs:
        bend = (
            [(nodes[a] + nodes[b]) / 2 + rng.normal(0, 0.1 * block, 2)]
            if rng.random() < 0.4 * crooked
            else []
        )
        lines.append(np.array([nodes[a], *bend, nodes[b]]))
    forward = rng.random(len(pairs)) < 1 - 0.1 * crooked
    backward = ~forward | (rng.random(len(pairs)) < 1 - 0.15 * crooked)
    starts, ends = np.array(pairs, np.int32).T
    offsets = np.append(0, np.cumsum([len(line) for line in lines]))
    return Network(
        nodes,
        starts.copy(),
        ends.copy(),
        offsets,
        np.concatenate(lines),
        forward,
        backward,
        np.full(len(pairs), np.nan),
    )


def wander(network, seed, steps=14, period=4.0, noise=8.0):
    """Samples of somebody who follows streets, whether or not he may."""
    rng = np.random.default_rng(seed)
    at = int(rng.integers(len(network.nodes)))
    line = [network.nodes[at]]
    for _ in range(30):
        out = np.flatnonzero((network.starts == at) | (network.ends == at))
        if not len(out):
            break
        road = int(rng.choice(out))
        back = network.ends[road] == at
        line += list(network.road(road)[:: -1 if back else 1][1:])
        at = int(network.starts[road] if back else network.ends[road])
    line = np.array(line)
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    times = period * np.arange(steps)
    places = np.stack([np.interp(9.0 * times, along, axis) for axis in line.T], axis=1)
    return times, places + rng.normal(0, noise, places.shape)


@pytest.mark.parametrize("headed", [False, True])
@pytest.mark.parametrize("seed", range(40))
def test_the_chain_is_as_cheap_as_the_plain_one(seed, headed):
    town = crooked_town(seed)
    times, places = wander(
        town, seed + 1000, period=[2.0, 4.0, 12.0][seed % 3], noise=[3.0, 10.0][seed % 2]
    )
    places[9:] += [0, 1000] if seed % 5 == 0 else 0  # faster than anybody, and out of town
    places[11:] -= [0, 1000] if seed % 10 == 0 else 0
    index, model, is_gap = (
        index_network(town),
        model_parameters(HEADED if headed else SCALES),
        np.zeros(len(times) - 1, bool),
    )
    used = select_samples(places, is_gap, min_spacing(SCALES))
    facing = facings(places, seed) if headed else np.zeros((len(times), 2))
    layers = build_trellis(
        places,
        times,
        facing,
        is_gap,
        used,
        index.roads,
        index.road_grid,
        index.graph,
        model,
        create_workspace(index),
    )
    chain = best_path(layers)
    least, plain, price = cheapest(
        town, places[used], times[used], model, [one if one.any() else None for one in facing[used]]
    )
    assert price(layers.candidates.roads[chain].tolist()) == pytest.approx(least, rel=1e-9)
    # at a crossing the end of one road and the beginning of the next are one place
    np.testing.assert_allclose(
        spots(index, layers.candidates.roads[chain], layers.candidates.metres[chain]),
        spots(
            index,
            np.array([one[0] for one in plain], np.int32),
            np.array([one[1] for one in plain]),
        ),
        atol=1e-6,
    )


@pytest.mark.parametrize("seed", range(12))
def test_of_chains_equally_cheap_the_first_is_taken(seed):
    """On a square grid, at its crossings, most chains have equals; all numbers are whole, so that they are equal to the last bit."""
    town = crooked_town(0, block=96.0, crooked=0.0, missing=0.0)
    rng = np.random.default_rng(seed)
    corners = np.array([0, 0]) + np.cumsum(rng.integers(0, 2, (5, 2)), axis=0).clip(0, 4)
    places = 96.0 * np.repeat(corners, 2, axis=0) + rng.choice([-48, 0, 0, 0, 48], (10, 2))
    times = 12.0 * np.arange(len(places))
    index, model, is_gap = (
        index_network(town),
        model_parameters(SCALES),
        np.zeros(len(times) - 1, bool),
    )
    used = select_samples(places, is_gap, min_spacing(SCALES))
    layers = build_trellis(
        places,
        times,
        np.zeros_like(places),
        is_gap,
        used,
        index.roads,
        index.road_grid,
        index.graph,
        model,
        create_workspace(index),
    )
    _, plain, _ = cheapest(town, places[used], times[used], model)
    assert layers.candidates.roads[best_path(layers)].tolist() == [one[0] for one in plain]


def facings(places, seed):
    """Rough headings of somebody who moves like this; some are not known."""
    rng = np.random.default_rng(seed)
    steps = np.gradient(places, axis=0) + rng.normal(0, 10, places.shape)
    return np.where(
        rng.random((len(places), 1)) < 0.8,
        steps / np.linalg.norm(steps, axis=1, keepdims=True),
        0.0,
    )


def spots(index, roads, metres):
    return np.where(
        roads[:, None] >= 0, where(np.maximum(roads, 0), metres, index.roads, index.graph), -1.0
    )


@pytest.mark.parametrize("seed", range(10))
def test_candidates_are_those_of_the_plain_twin(seed):
    town = crooked_town(seed, block=75.0)
    index, model, plain = index_network(town), model_parameters(HEADED), Plain(town)
    rng = np.random.default_rng(seed)
    layer = empty_candidates(2 * model.max_candidates + 1)
    for place in rng.uniform(-50, 350, (30, 2)):
        heading = rng.normal(0, 1, 2)
        heading /= np.linalg.norm(heading)
        n = find_candidates(place, heading, index.roads, index.road_grid, index.graph, model, layer)
        found = sorted(
            zip(
                layer.roads[:n].tolist(),
                layer.metres[:n].tolist(),
                layer.emission_costs[:n].tolist(),
                strict=True,
            )
        )
        wanted = sorted(plain_candidates(plain, place, model, heading))
        assert [one[0] for one in found] == [one[0] for one in wanted]
        np.testing.assert_allclose(
            [one[1:] for one in found], [one[1:] for one in wanted], atol=1e-9
        )


def test_a_hairpin_is_near_twice():
    line = np.array([[0.0, 0.0], [400.0, 0.0], [400.0, 20.0], [0.0, 20.0]])
    one = np.ones(1, bool)
    road = Network(
        line[[0, 3]],
        np.zeros(1, np.int32),
        np.ones(1, np.int32),
        np.array([0, 4]),
        line,
        one,
        one,
        np.full(1, np.nan),
    )
    index, model = index_network(road), model_parameters(SCALES)
    layer = empty_candidates(2 * model.max_candidates + 1)
    n = find_candidates(
        np.array([100.0, 12.0]),
        np.zeros(2),
        index.roads,
        index.road_grid,
        index.graph,
        model,
        layer,
    )
    assert layer.roads[:n].tolist() == [0, 1, 0, 1, -1]
    np.testing.assert_allclose(layer.metres[: n - 1], [720, 100, 100, 720])
    np.testing.assert_allclose(layer.distances[: n - 1], [8, 8, 12, 12])
