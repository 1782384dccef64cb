import numpy as np
import pytest

from gpszip.mapping.initial_map import allocate_working_map
from gpszip.mapping.kernels.assign import assign_slice
from gpszip.mapping.kernels.assign_max_error import build_directions
from gpszip.mapping.kernels.grid_moments import prefix_sums
from gpszip.mapping.kernels.initial_map import count_walks, find_near_nodes, index_nodes, step_count
from gpszip.mapping.kernels.time_grid import TimeGridArrays
from oracle.settle import FRESH, Window

UNIT = 64.0
NAMES = ("error", "time", "stay time", "new", "place", "link", "stay", "jump", "escape")


class Log:
    """A track that drifts among a few nodes, a slot at every cell, and its present walk."""

    def __init__(self, seed, slots, samples):
        rng = np.random.default_rng(seed)
        self.nodes = rng.uniform(0, 12, (7, 2))
        cell = np.sort(rng.uniform(0, slots - 1, samples))
        bends = np.cumsum(rng.normal(0, 3, (4, 2)), axis=0) + self.nodes[0]
        way = np.column_stack(
            [np.interp(cell, np.linspace(0, slots - 1, 4), bends[:, axis]) for axis in (0, 1)]
        )
        ticks = np.rint(UNIT * (way + rng.normal(0, 0.4, way.shape))).astype(np.int64)
        self.times, self.samples, self.weights = (
            np.rint(256 * cell).astype(np.int64),
            ticks / UNIT,
            np.ones(samples, np.int64),
        )
        self.ticks = 256 * np.arange(slots)
        self.ends = np.searchsorted(self.times, self.ticks)
        self.ends[-1] = samples
        self.positions = self.samples[np.minimum(self.ends, samples - 1)]
        self.centers = np.rint(self.positions * UNIT).astype(np.int64)
        self.sums = prefix_sums(self.times, ticks, self.weights, self.ends)
        self.own = np.where(rng.random(slots) < 0.5, rng.integers(0, 7, slots), -1)
        # every node is used, and nodes 5 and 6 are this walk's alone
        self.own[[0, -1]] = 5, 6
        self.others = [
            [0, 1, 2, 3, 4],
            *(rng.integers(0, 5, rng.integers(2, 8)).tolist() for _ in range(3)),
        ]
        self.prices = dict(
            zip(
                NAMES,
                rng.uniform([0.1, 1, 1, 0.5, 3, 3, 1, 2, 0], [3, 6, 6, 3, 12, 10, 5, 8, 1]),
                strict=True,
            )
        )


class Settling:
    """The log's walk on a draft behind the others' walks."""

    def __init__(self, log, reach):
        others = [node for walk in log.others for node in walk]
        self.before = len(others)
        self.last_slots = np.append(
            np.cumsum([len(walk) for walk in log.others]) - 1, self.before + len(log.ticks) - 1
        )
        self.slot_nodes = np.concatenate([others, log.own]).astype(np.int64)
        self.working_map = allocate_working_map(2, 200, 400, reach)
        self.working_map.positions[: len(log.nodes)] = log.nodes
        self.working_map.scalars[0] = len(log.nodes)
        index_nodes(self.working_map, len(log.nodes))
        count_walks(self.working_map, self.slot_nodes, self.last_slots)

    def settle(self, log, start, phase, window, most, max_slots):
        def behind(values):
            return np.concatenate(
                [np.zeros((self.before, *values.shape[1:]), values.dtype), values]
            )

        grid_arrays = TimeGridArrays(
            behind(log.sums), behind(log.ticks), behind(log.centers), behind(log.positions), np.array([UNIT]), behind(log.ends),
            log.times / 256, log.samples, behind(log.ticks) / 256, build_directions(2)[0], np.zeros(1),
        )  # fmt: skip
        prices = np.array([*(log.prices[name] for name in NAMES), np.inf])
        marks = np.zeros(200, np.int64)
        first, last = self.before, len(self.slot_nodes) - 1
        end = assign_slice(
            self.working_map, grid_arrays, self.slot_nodes, first + start, np.array([first, last, 1, 1]), phase, window, most, max_slots, prices, marks
        )  # fmt: skip
        assert end == last
        assert not marks.any()
        return self.slot_nodes[first:]


def assert_counts_are_those_of_the_walks(settling):
    working_map, nodes = settling.working_map, int(settling.working_map.scalars[0])
    again = allocate_working_map(2, 200, 400, float(working_map.bucket_size[0]))
    count_walks(again, settling.slot_nodes, settling.last_slots)
    used = again.uses[:nodes] > 0
    np.testing.assert_array_equal(np.maximum(working_map.uses[:nodes], 0), again.uses[:nodes])
    np.testing.assert_array_equal(working_map.outgoing_weight[:nodes], again.outgoing_weight[:nodes])
    for u in range(nodes):
        for v in range(nodes):
            assert step_count(working_map, u, v) == step_count(again, u, v)
    # every used node is found at its place, and the others are not
    found, distances = np.empty(200, np.int64), np.empty(200)
    for node in np.flatnonzero(used).tolist():
        assert (
            node
            in found[
                : find_near_nodes(working_map, working_map.positions[node], 200, found, distances)
            ]
        )
    free = set(working_map.free[: working_map.scalars[1]].tolist())
    assert free == set(np.flatnonzero(~used).tolist())


@pytest.mark.parametrize("seed", range(120))
@pytest.mark.parametrize("closed", [False, True])
def test_a_window_is_settled_as_cheaply_as_any_choice(seed, closed):
    log = Log(seed, slots=5, samples=18)
    start = int(np.flatnonzero(log.own >= 0)[1]) if closed and (log.own[1:-1] >= 0).any() else 0
    settling, max_slots = Settling(log, reach=4.0), 2 + seed % 5
    kept = [node for node in log.own[: start + 1].tolist() if node >= 0] if start else []
    window = Window(
        log, log.nodes, log.others, kept, log.own.tolist(), start, log.prices, 2, 4.0, max_slots
    )
    slot_nodes = settling.settle(log, start, 1000, 1000, 2, max_slots)
    path = [
        (slot, int(slot_nodes[slot]) if slot_nodes[slot] < len(log.nodes) else FRESH)
        for slot in range(start, 5)
        if slot_nodes[slot] >= 0
    ]
    assert (path[0][0], path[-1][0]) == (start, 4)
    assert window.cost(path) == pytest.approx(window.cheapest(), rel=1e-7)
    np.testing.assert_array_equal(slot_nodes[:start], log.own[:start])
    assert_counts_are_those_of_the_walks(settling)


@pytest.mark.parametrize("seed", range(20))
def test_counts_stay_those_of_the_walks_through_many_windows(seed):
    log = Log(seed, slots=60, samples=200)
    settling = Settling(log, reach=3.0)
    rng = np.random.default_rng(seed)
    for _ in range(4):
        slot_nodes = settling.settle(
            log, 0, int(rng.integers(1, 9)), int(rng.integers(2, 9)), 4, 20
        )
        assert slot_nodes[0] >= 0
        assert slot_nodes[-1] >= 0
        assert_counts_are_those_of_the_walks(settling)


def test_a_draft_without_room_is_left_at_the_window_that_lacks_it():
    log = Log(1, slots=60, samples=200)
    settling = Settling(log, reach=3.0)
    settling.working_map.scalars[0] = 195
    with pytest.raises(AssertionError):
        settling.settle(log, 0, 8, 8, 4, 20)
    np.testing.assert_array_equal(settling.slot_nodes[settling.before :], log.own)
