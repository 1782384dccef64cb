import numpy as np
import pytest

from gpszip.codec.walks import decode, encode
from gpszip.mapping.plan import Plan
from gpszip.mapping.rounds import fit
from gpszip.mapping.time_grid import build_time_grid
from gpszip.model import QuantisationGrid, Track, Walk
from gpszip.model.grid import step_size
from gpszip.run import Serial, Threads
from gpszip.testing import patrol
from gpszip.walks.error import synchronised_errors

FRAME = QuantisationGrid((-1000, -1000), 0, 111, 136)
UNIT = step_size(FRAME.space)


@pytest.fixture(scope="module")
def track():
    """A patrol with a pause of a minute."""
    whole = patrol(2500, seed=3)
    return Track("0", whole.times + 60.0 * (np.arange(2500) > 900), whole.positions)


def laid(track, sparse=False):
    gap = np.zeros(len(track) - 1, bool)
    gap[900] = True
    return build_time_grid([track], [gap], FRAME, sparse=sparse)


def errors(track, walks):
    """Distance of every sample from the decoded walk in quanta."""
    (one,) = walks.walks
    walk = Walk("0", one.nodes, one.time_steps * step_size(FRAME.time), one.gaps)
    return synchronised_errors(track, walk, walks.nodes * UNIT - 1.0) / UNIT


def test_the_error_told_is_that_of_the_bytes_and_within_the_target(track):
    outcome = fit(laid(track), 1, Plan(target=0.9))
    assert outcome.walks.walks[0].gaps.sum() == 1
    data = encode(outcome.walks)
    assert len(data) == outcome.size
    found = errors(track, decode(data, 2, 1))
    assert not np.isnan(found).any()
    assert float(np.sqrt((found**2).mean())) == pytest.approx(outcome.error, rel=1e-6)
    assert outcome.error <= 0.9
    # the bound is used, not kept with room to spare
    assert outcome.error > 0.6


def test_more_error_takes_fewer_bytes(track):
    slots = laid(track)
    sizes = [fit(slots, 1, Plan(target=target)).size for target in (0.7, 1.2, 2.4)]
    assert sizes[0] > sizes[1] > sizes[2]


def test_walks_share_nodes_where_they_come_again(track):
    slots = laid(track)
    shared = fit(slots, 1, Plan(target=0.9))
    assert shared.size < len(slots.times) / 10
    assert len(shared.walks.nodes) < len(shared.walks.walks[0].nodes)


def test_the_same_input_gives_the_same_bytes(track):
    one, other = (encode(fit(laid(track), 1, Plan(target=0.9)).walks) for _ in range(2))
    assert one == other


def test_thin_slots_keep_the_target_too(track):
    outcome = fit(laid(track), 1, Plan(target=0.9), sparse_grid=laid(track, sparse=True))
    assert outcome.error <= 0.9
    assert float(np.sqrt((errors(track, outcome.walks) ** 2).mean())) == pytest.approx(
        outcome.error, rel=1e-6
    )


def test_a_target_below_what_whole_quanta_allow_is_not_met(track):
    assert fit(laid(track), 1, Plan(target=0.01, rounds=3)) is None


@pytest.mark.parametrize("executor", [Serial(), Threads(1), Threads(2)], ids=str)
def test_walks_coded_beside_the_next_round_are_the_same_whoever_codes_them(track, executor):
    slots, plan = (
        laid(track),
        Plan(target=0.9, rounds=9, extra_rounds=3, encode_alternate_rounds=True),
    )
    expected, found = fit(slots, 1, plan), fit(slots, 1, plan, executor=executor)
    assert encode(found.walks) == encode(expected.walks)
    assert len(encode(found.walks)) == found.size


def test_rounds_follow_until_the_error_allowed_is_made_use_of(track):
    slots = laid(track)
    short, long = (
        fit(slots, 1, Plan(target=0.9, rounds=12, extra_rounds=extra_rounds))
        for extra_rounds in (0, 6)
    )
    assert long.size <= short.size
    assert long.error <= 0.9
