import numpy as np
import pytest

from calling import from_python
from gpszip.mapping.kernels.grid_moments import prefix_sums
from gpszip.mapping.kernels.private_chain import find_private_chain
from oracle.private_chain import chain_cost, cheapest_chain

# Inner kernels, as Python calls them.
find_private_chain = from_python(find_private_chain)

UNIT = 64.0


class Log:
    """A path with bends in grid steps, sampled unevenly, with a slot at every time step."""

    def __init__(self, seed, slots=10, noise=0.3):
        rng = np.random.default_rng(seed)
        dimension = 1 + seed % 3
        bends = np.cumsum(rng.normal(0, 4, (5, dimension)), axis=0)
        sample_steps = np.sort(rng.uniform(0, slots - 1, 40))
        path = np.column_stack(
            [
                np.interp(sample_steps, np.linspace(0, slots - 1, 5), bends[:, axis])
                for axis in range(dimension)
            ]
        )
        ticks = np.rint(64 * (path + rng.normal(0, noise, path.shape))).astype(np.int64)
        self.times, self.samples, self.weights = (
            np.rint(256 * sample_steps).astype(np.int64),
            ticks / UNIT,
            np.ones(40, np.int64),
        )
        self.ticks = 256 * np.arange(slots)
        self.ends = np.searchsorted(self.times, self.ticks)
        self.ends[-1] = 40
        self.positions = self.samples[np.minimum(self.ends, 39)] + rng.normal(
            0, 0.2, (slots, dimension)
        )
        self.centers = np.rint(self.positions * UNIT).astype(np.int64)
        self.sums = prefix_sums(self.times, ticks, self.weights, self.ends)

    def chain(self, first, last, price, knot_bits, max_slots):
        slot_nodes = np.full(len(self.ticks), 7)
        find_private_chain(
            self.sums,
            self.ticks,
            self.centers,
            self.positions,
            UNIT,
            first,
            last,
            price,
            knot_bits,
            max_slots,
            slot_nodes,
        )
        return slot_nodes


@pytest.mark.parametrize("seed", range(9))
@pytest.mark.parametrize(
    ("price", "knot_bits", "max_slots"),
    [
        (0.5, 7.0, 300),
        (3.0, 2.0, 4),
        (40.0, 7.0, 300),
        (0.001, 7.0, 3),
        (0.2, 0.3, 300),
        (0.05, 0.1, 300),
    ],
)
def test_no_chain_is_cheaper(seed, price, knot_bits, max_slots):
    log = Log(seed)
    knots = np.flatnonzero(log.chain(0, 9, price, knot_bits, max_slots) == 0).tolist()
    assert (knots[0], knots[-1]) == (0, 9)
    assert chain_cost(log, knots, price, knot_bits, max_slots) == pytest.approx(
        cheapest_chain(log, 0, 9, price, knot_bits, max_slots), rel=1e-7
    )


def test_other_slots_are_not_changed():
    slot_nodes = Log(3).chain(2, 6, 1.0, 7.0, 300)
    assert slot_nodes[[0, 1, 7, 8, 9]].tolist() == [7] * 5
    assert set(slot_nodes[2:7].tolist()) <= {0, -1}
    assert slot_nodes[2] == slot_nodes[6] == 0


def test_more_knots_pay_at_a_higher_price_of_errors():
    log = Log(4)
    counts = [(log.chain(0, 9, price, 7.0, 300) == 0).sum() for price in (1e-4, 0.3, 30.0)]
    assert counts[0] < counts[1] < counts[2]


def test_a_piece_of_two_slots_keeps_both():
    assert Log(1).chain(3, 4, 1.0, 7.0, 300)[3:5].tolist() == [0, 0]
