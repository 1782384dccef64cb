import numpy as np
import pytest

from calling import from_python
from gpszip.mapping.initial_map import allocate_working_map
from gpszip.mapping.kernels.assign import Prices, assign_slice
from gpszip.mapping.kernels.assign_max_error import build_directions
from gpszip.mapping.kernels.grid_moments import prefix_sums
from gpszip.mapping.kernels.initial_map import (
    FREE_COUNT,
    NODE_COUNT,
    count_walks,
    find_near_nodes,
    index_nodes,
    step_count,
)
from gpszip.mapping.kernels.time_grid import TimeGridArrays
from oracle.assignment import NEW_NODE, Window

# Inner kernels, as Python calls them.
step_count = from_python(step_count)
find_near_nodes = from_python(find_near_nodes)

UNIT = 64.0


def random_prices(rng):
    low = [0.1, 1, 1, 0.5, 3, 3, 1, 2, 0]
    high = [3, 6, 6, 3, 12, 10, 5, 8, 1]
    return Prices(*rng.uniform(low, high).tolist(), beam=np.inf)


class Log:
    """A track that drifts among a few nodes, a slot at every time step, and its present walk."""

    def __init__(self, seed, slots, samples):
        rng = np.random.default_rng(seed)
        self.nodes = rng.uniform(0, 12, (7, 2))
        sample_steps = np.sort(rng.uniform(0, slots - 1, samples))
        bends = np.cumsum(rng.normal(0, 3, (4, 2)), axis=0) + self.nodes[0]
        path = np.column_stack(
            [
                np.interp(sample_steps, np.linspace(0, slots - 1, 4), bends[:, axis])
                for axis in (0, 1)
            ]
        )
        sample_ticks = np.rint(UNIT * (path + rng.normal(0, 0.4, path.shape))).astype(np.int64)
        self.times = np.rint(256 * sample_steps).astype(np.int64)
        self.samples, self.weights = sample_ticks / UNIT, np.ones(samples, np.int64)
        self.ticks = 256 * np.arange(slots)
        self.ends = np.searchsorted(self.times, self.ticks)
        self.ends[-1] = samples
        self.positions = self.samples[np.minimum(self.ends, samples - 1)]
        self.centers = np.rint(self.positions * UNIT).astype(np.int64)
        self.sums = prefix_sums(self.times, sample_ticks, self.weights, self.ends)

        # Every node is used; only this walk uses nodes 5 and 6.
        self.own = np.where(rng.random(slots) < 0.5, rng.integers(0, 7, slots), -1)
        self.own[[0, -1]] = 5, 6
        self.others = [
            [0, 1, 2, 3, 4],
            *(rng.integers(0, 5, rng.integers(2, 8)).tolist() for _ in range(3)),
        ]
        self.prices = random_prices(rng)


class Assignment:
    """The log's walk on a map, with slots behind those of the other walks."""

    def __init__(self, log, reach):
        others = [node for walk in log.others for node in walk]
        self.before = len(others)
        self.last_slots = np.append(
            np.cumsum([len(walk) for walk in log.others]) - 1, self.before + len(log.ticks) - 1
        )
        self.slot_nodes = np.concatenate([others, log.own]).astype(np.int64)
        self.working_map = allocate_working_map(2, 200, 400, reach)
        self.working_map.positions[: len(log.nodes)] = log.nodes
        self.working_map.counters[NODE_COUNT] = len(log.nodes)
        index_nodes(self.working_map, len(log.nodes))
        count_walks(self.working_map, self.slot_nodes, self.last_slots)

    def assign(self, log, start, phase, window, max_near, max_slots):
        """Assign the log's knots from a slot on, and return its walk and the slot that ends it."""

        def shift(values):
            return np.concatenate(
                [np.zeros((self.before, *values.shape[1:]), values.dtype), values]
            )

        grid_arrays = TimeGridArrays(
            sums=shift(log.sums),
            ticks=shift(log.ticks),
            centers=shift(log.centers),
            positions=shift(log.positions),
            ticks_per_step=UNIT,
            ends=shift(log.ends),
            times=log.times / 256,
            sample_positions=log.samples,
            time_steps=shift(log.ticks) / 256,
            directions=build_directions(2)[0],
            max_distance=0.0,
        )
        marks = np.zeros(200, np.int64)
        first, last = self.before, len(self.slot_nodes) - 1
        end = assign_slice(
            self.working_map,
            grid_arrays,
            self.slot_nodes,
            first + start,
            np.array([first, last, 1, 1]),
            phase,
            window,
            max_near,
            max_slots,
            log.prices,
            marks,
        )
        assert not marks.any()
        return self.slot_nodes[first:], end - first


def assert_counts_are_those_of_the_walks(assignment):
    working_map = assignment.working_map
    nodes = int(working_map.counters[NODE_COUNT])
    expected = allocate_working_map(2, 200, 400, working_map.cell_size)
    count_walks(expected, assignment.slot_nodes, assignment.last_slots)
    is_used = expected.uses[:nodes] > 0
    np.testing.assert_array_equal(np.maximum(working_map.uses[:nodes], 0), expected.uses[:nodes])
    np.testing.assert_array_equal(
        working_map.outgoing_weight[:nodes], expected.outgoing_weight[:nodes]
    )
    for u in range(nodes):
        for v in range(nodes):
            assert step_count(working_map, u, v) == step_count(expected, u, v)

    # Every used node is found at its position, and the others are free.
    near, distances = np.empty(200, np.int64), np.empty(200)
    for node in np.flatnonzero(is_used).tolist():
        count = find_near_nodes(working_map, working_map.positions[node], 200, near, distances)
        assert node in near[:count]
    free = set(working_map.free[: working_map.counters[FREE_COUNT]].tolist())
    assert free == set(np.flatnonzero(~is_used).tolist())


@pytest.mark.parametrize("seed", range(120))
@pytest.mark.parametrize("closed", [False, True])
def test_no_choice_of_knots_is_cheaper_in_a_window(seed, closed):
    log = Log(seed, slots=5, samples=18)
    start = int(np.flatnonzero(log.own >= 0)[1]) if closed and (log.own[1:-1] >= 0).any() else 0
    assignment, max_slots = Assignment(log, reach=4.0), 2 + seed % 5
    kept = [node for node in log.own[: start + 1].tolist() if node >= 0] if start else []
    window = Window(
        log, log.nodes, log.others, kept, log.own.tolist(), start, log.prices, 2, 4.0, max_slots
    )
    slot_nodes, end = assignment.assign(log, start, 1000, 1000, 2, max_slots)
    assert end == 4
    path = [
        (slot, int(slot_nodes[slot]) if slot_nodes[slot] < len(log.nodes) else NEW_NODE)
        for slot in range(start, 5)
        if slot_nodes[slot] >= 0
    ]
    assert (path[0][0], path[-1][0]) == (start, 4)
    assert window.cost(path) == pytest.approx(window.cheapest(), rel=1e-7)
    np.testing.assert_array_equal(slot_nodes[:start], log.own[:start])
    assert_counts_are_those_of_the_walks(assignment)


@pytest.mark.parametrize("seed", range(20))
def test_counts_stay_those_of_the_walks_through_many_windows(seed):
    log = Log(seed, slots=60, samples=200)
    assignment = Assignment(log, reach=3.0)
    rng = np.random.default_rng(seed)
    for _ in range(4):
        slot_nodes, end = assignment.assign(
            log, 0, int(rng.integers(1, 9)), int(rng.integers(2, 9)), 4, 20
        )
        assert end == 59
        assert slot_nodes[0] >= 0
        assert slot_nodes[-1] >= 0
        assert_counts_are_those_of_the_walks(assignment)


def test_a_full_map_ends_the_assignment_at_the_window_that_lacks_capacity():
    log = Log(1, slots=60, samples=200)
    assignment = Assignment(log, reach=3.0)
    assignment.working_map.counters[NODE_COUNT] = 195
    slot_nodes, end = assignment.assign(log, 0, 8, 8, 4, 20)
    assert end == 0
    np.testing.assert_array_equal(slot_nodes, log.own)
