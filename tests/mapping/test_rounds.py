from dataclasses import replace

import numpy as np
import pytest

from gpszip.codec.walks import decode, encode
from gpszip.mapping import rounds
from gpszip.mapping.initial_map import walks_of
from gpszip.mapping.plan import Plan, is_dense
from gpszip.mapping.rounds import Outcome, estimate_prices, fit, start_from
from gpszip.mapping.time_grid import build_time_grid
from gpszip.model import QuantisationGrid, Track, Walk
from gpszip.model.grid import step_index, step_size
from gpszip.run import Serial, Threads
from gpszip.testing import patrol
from gpszip.testing.city import drives
from gpszip.walks.error import synchronised_errors

GRID = QuantisationGrid((-1000, -1000), 0, 111, 136)
UNIT = step_size(GRID.space)


@pytest.fixture(scope="module")
def track():
    """A patrol with a pause of a minute."""
    log = patrol(2500, seed=3)
    return Track("0", log.times + 60.0 * (np.arange(2500) > 900), log.positions)


def build_slots(track, sparse=False):
    gap = np.zeros(len(track) - 1, bool)
    gap[900] = True
    return build_time_grid([track], [gap], GRID, sparse=sparse)


def errors(track, walks):
    """Distance of every sample from the decoded walk in grid steps."""
    (grid_walk,) = walks.walks
    walk = Walk("0", grid_walk.nodes, grid_walk.time_steps * step_size(GRID.time), grid_walk.gaps)
    return synchronised_errors(track, walk, walks.nodes * UNIT - 1.0) / UNIT


def test_the_reported_error_is_that_of_the_bytes_and_within_the_target(track):
    outcome = fit(build_slots(track), 1, Plan(target=0.9))
    assert outcome.walks.walks[0].gaps.sum() == 1
    data = encode(outcome.walks)
    assert len(data) == outcome.size
    distances = errors(track, decode(data, 2, 1))
    assert not np.isnan(distances).any()
    assert float(np.sqrt((distances**2).mean())) == pytest.approx(outcome.error, rel=1e-6)
    assert outcome.error <= 0.9
    # The walks use most of the error allowed.
    assert outcome.error > 0.6


def test_more_error_takes_fewer_bytes(track):
    time_grid = build_slots(track)
    sizes = [fit(time_grid, 1, Plan(target=target)).size for target in (0.7, 1.2, 2.4)]
    assert sizes[0] > sizes[1] > sizes[2]


def test_walks_share_nodes_where_they_repeat(track):
    time_grid = build_slots(track)
    shared = fit(time_grid, 1, Plan(target=0.9))
    assert shared.size < len(time_grid.times) / 10
    assert len(shared.walks.nodes) < len(shared.walks.walks[0].nodes)


def test_the_same_input_gives_the_same_bytes(track):
    first, second = (encode(fit(build_slots(track), 1, Plan(target=0.9)).walks) for _ in range(2))
    assert first == second


def test_a_sparse_grid_keeps_the_target_too(track):
    outcome = fit(
        build_slots(track), 1, Plan(target=0.9), sparse_grid=build_slots(track, sparse=True)
    )
    assert outcome.error <= 0.9
    assert float(np.sqrt((errors(track, outcome.walks) ** 2).mean())) == pytest.approx(
        outcome.error, rel=1e-6
    )


def test_a_target_below_the_grid_step_is_not_met(track):
    assert fit(build_slots(track), 1, Plan(target=0.01, rounds=3)) is None


@pytest.mark.parametrize("executor", [Serial(), Threads(1), Threads(2)], ids=str)
def test_concurrent_encoding_does_not_change_the_outcome(track, executor):
    time_grid, plan = (
        build_slots(track),
        Plan(target=0.9, rounds=9, extra_rounds=3, encode_alternate_rounds=True),
    )
    expected, outcome = fit(time_grid, 1, plan), fit(time_grid, 1, plan, executor=executor)
    assert encode(outcome.walks) == encode(expected.walks)
    assert len(encode(outcome.walks)) == outcome.size


def test_extra_rounds_use_up_the_error_allowed(track):
    time_grid = build_slots(track)
    short, long = (
        fit(time_grid, 1, Plan(target=0.9, rounds=12, extra_rounds=extra_rounds))
        for extra_rounds in (0, 6)
    )
    assert long.size <= short.size
    assert long.error <= 0.9


@pytest.fixture(scope="module")
def sparse_log():
    """Slots of vehicles in a town with a sample every 30 s, and their number."""
    tracks = [Track(name, *drive) for name, drive in drives(vehicles=6, period=30.0).items()]
    no_gaps = [np.zeros(len(track) - 1, bool) for track in tracks]
    grid = QuantisationGrid((0, 0), 0, step_index(20.0), step_index(4.0))
    return build_time_grid(tracks, no_gaps, grid, sparse=True), len(tracks)


def test_many_knots_end_the_rounds_once_they_use_up_the_error(sparse_log, monkeypatch):
    # Smaller walks of a later round are not found.
    monkeypatch.setattr(rounds, "_USED_UP", 0.95)
    plan = Plan(target=1.0, rounds=16)
    early, late = (fit(*sparse_log, replace(plan, many_knots=least)) for least in (1, 100_000))
    assert early.error > 0.95
    assert early.size > late.size
    assert encode(late.walks) == encode(fit(*sparse_log, plan).walks)


def test_a_grid_whose_chains_are_far_off_is_given_up(track):
    plan = Plan(target=0.1, rounds=2, tolerance=10.0)
    assert fit(build_slots(track), 1, plan) is not None
    assert fit(build_slots(track), 1, replace(plan, give_up_ratio=1.2)) is None


def test_rounds_begin_with_the_walks_of_an_outcome_on_another_grid(track):
    # Two thirds of the space step and half the time step.
    outcome = fit(build_slots(track), 1, Plan(target=0.9))
    grid = QuantisationGrid(GRID.origin, GRID.epoch, GRID.space - 5, GRID.time - 8)
    space_ratio = UNIT / step_size(grid.space)
    gap = np.zeros(len(track) - 1, bool)
    gap[900] = True
    time_grid = build_time_grid([track], [gap], grid)
    start = start_from(outcome, time_grid, 2.0, space_ratio)

    # The start is the outcome, in the steps of the other grid; only ends of pieces may move.
    (walk,) = walks_of(time_grid, start.slot_nodes, start.positions, 1).walks
    (before,) = outcome.walks.walks
    is_inner = ~(np.append(before.gaps, True) | np.append(True, before.gaps))
    assert set((2 * before.time_steps[is_inner]).tolist()) <= set(walk.time_steps.tolist())
    assert np.unique(start.positions, axis=0) == pytest.approx(
        np.unique(space_ratio * outcome.walks.nodes, axis=0)
    )
    assert start.prices.error * space_ratio**2 == pytest.approx(outcome.prices.error)

    # A few rounds from it keep the target.
    again = fit(time_grid, 1, Plan(target=0.9 * space_ratio, rounds=4), start=start)
    assert again.error <= 0.9 * space_ratio
    assert again.size < 1.3 * outcome.size


def test_rounds_under_a_maximum_begin_with_the_walks_of_others(track):
    time_grid, plan = build_slots(track), Plan(target=0.9, rounds=6, maximum=2.3)
    outcome = fit(time_grid, 1, plan)
    start = start_from(outcome, time_grid, 1.0, 1.0)
    again = fit(time_grid, 1, plan, start=start)
    assert again.misses <= outcome.misses == 0
    assert errors(track, again.walks).max() <= 2.3


def test_few_rounds_on_a_dense_log_count_all_samples_beyond_the_maximum(track):
    # About 25 samples for each slot, most of which are limited only where they miss the maximum.
    time_grid = build_slots(track)
    plan = Plan(target=0.9, rounds=6, maximum=2.3)
    outcome = fit(time_grid, 1, plan.hurried())
    too_far = track.times[errors(track, outcome.walks) > 2.3]
    knot_times = outcome.walks.walks[0].time_steps * step_size(GRID.time)
    missed = np.unique(np.searchsorted(knot_times, too_far, side="right"))
    assert outcome.misses == len(missed) <= 2
    assert outcome.cost < 1.3 * fit(time_grid, 1, plan).cost


def test_few_rounds_on_a_dense_log_keep_the_target(track):
    plan = Plan(target=0.7)
    outcome = fit(build_slots(track), 1, plan.hurried())
    assert outcome.error <= 0.7
    assert outcome.size < 1.3 * fit(build_slots(track), 1, plan).size


def test_a_log_with_a_slot_for_each_sample_is_not_dense():
    assert is_dense(100_000, 20_000)
    assert not is_dense(100_000, 40_000)  # few samples for each slot
    assert not is_dense(2_500, 100)  # a small log


def test_the_slope_of_the_cost_is_the_price(track):
    outcome = fit(build_slots(track), 1, Plan(target=0.9))
    error, samples, change = outcome.error, len(track), 1e-5
    assert outcome.cost_at(error, samples) == outcome.cost
    slope = 8 * (outcome.cost_at(error + change, samples) - outcome.cost) / (2 * error * change)
    assert slope == pytest.approx(-outcome.prices.error * samples, rel=1e-3)


def test_outcomes_that_miss_the_target_compare_by_their_cost_at_the_target(track):
    # After two rounds the error is still far from the target: only a tolerance makes it count.
    time_grid = build_slots(track)
    tight, loose = (Plan(target=0.35, rounds=2, tolerance=most) for most in (1.0, 4.0))
    assert fit(time_grid, 1, tight) is None
    assert fit(time_grid, 1, loose).error > 0.35


def test_a_dearer_error_makes_an_outcome_costlier_at_a_tighter_target():
    cheap, dear = (
        Outcome(None, 100, 1.2, prices=estimate_prices(None, price, 3)) for price in (0.1, 0.2)
    )
    assert 100 < cheap.cost_at(1.0, 500) < dear.cost_at(1.0, 500)


def test_the_cost_at_a_far_target_is_finite():
    prices = estimate_prices(None, 1e6, 3)
    far, exact = (Outcome(None, 100, error, prices=prices) for error in (40.0, 0.0))
    assert 100 < far.cost_at(1.0, 10**6) < np.inf
    assert exact.cost_at(1.0, 10**6) <= 100
