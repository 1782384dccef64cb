import json
import math

import numpy as np
import pytest

from gpszip import Matcher, compress
from gpszip.errors import OptionError, TrackError
from gpszip.matching.averaging import moving_average
from gpszip.matching.index import create_workspace, index_network
from gpszip.matching.live import LiveMatcher
from gpszip.matching.match import match
from gpszip.matching.viterbi import Observations, find_viterbi_path
from gpszip.model import Track
from gpszip.model.match import Scales
from gpszip.testing.city import drives
from matching.streets import town

SCALES = Scales(error=4.0, sigma=8.0, beta=6.0, median_speed=9.0, max_speed=60.0)


def match_live(matcher, track):
    """Live positions of all samples, and all finalised positions."""
    positions = [
        matcher.push(time, position)
        for time, position in zip(track.times.tolist(), track.positions, strict=True)
    ]
    finalised = [one for here in positions for one in here.finalised]
    return positions, finalised + list(matcher.finish())


def match_batch(index, track, gap, scales=SCALES):
    """Times and directed roads of the Viterbi path of a track."""
    is_gap = np.diff(track.times) > gap
    positions = moving_average(track.positions.copy(), is_gap, scales.averaging_window)
    observations = Observations(positions, track.times.copy(), is_gap, np.zeros_like(positions))
    path = find_viterbi_path(index, create_workspace(index), observations, scales)
    return track.times[path.sample_indices], path.roads


def directed_roads(finalised):
    return np.array(
        [2 * one.edge + (not one.forward) if one.edge >= 0 else -1 for one in finalised]
    )


@pytest.mark.parametrize("period", [1.0, 15.0])
@pytest.mark.parametrize("seed", range(3))
def test_finalised_positions_are_those_of_the_batch(period, seed):
    buses = drives(vehicles=1, period=period, duration=600.0 * period**0.5, seed=seed)
    times, positions = buses["bus-0"]
    # away from all roads for a while, and a gap; the last sample before it may make no time step
    is_away = (times > 100) & (times < 110 + 6 * period)
    positions = np.where(is_away[:, None], positions + np.array([0, 7000]), positions)
    kept = ~((times > 200) & (times < 290))
    index, track = index_network(town()), Track("bus", times[kept], positions[kept])

    step_times, roads = match_batch(index, track, gap=60.0)
    _, finalised = match_live(LiveMatcher(index, SCALES, gap=60.0), track)
    assert all(one.converged for one in finalised)
    assert [one.time for one in finalised] == step_times.tolist()
    np.testing.assert_array_equal(directed_roads(finalised), roads)


@pytest.mark.parametrize(
    ("lag", "period", "seed"),
    [(1, 1.0, 3), (4, 2.0, 4), (20, 1.0, 5), (6, 20.0, 6), (200, 20.0, 7)],
)
def test_converged_positions_are_those_of_the_batch_at_any_lag(lag, period, seed):
    buses = drives(vehicles=1, period=period, duration=500.0 * period**0.5, seed=seed, noise=12.0)
    times, positions = buses["bus-0"]
    kept = ~((times > 200) & (times < 290)) & ~((times > 330) & (times < 395))
    index, track = index_network(town()), Track("bus", times[kept], positions[kept])

    step_times, roads = match_batch(index, track, gap=60.0)
    live, finalised = match_live(LiveMatcher(index, SCALES, lag=lag, gap=60.0), track)
    assert [one.time for one in finalised] == step_times.tolist()
    converged = np.array([one.converged for one in finalised])
    np.testing.assert_array_equal(directed_roads(finalised)[converged], roads[converged])
    assert converged.mean() > (0.0 if lag < 5 else 0.95)
    assert converged.all() or lag < 200

    # no position waits longer than the lag
    steps = np.searchsorted(step_times, [here.time for here in live], side="right")
    waited = [
        step - np.searchsorted(step_times, one.time)
        for step, here in zip(steps, live, strict=True)
        for one in here.finalised
    ]
    assert max(waited) <= lag + 1


def test_live_positions_are_near_those_of_the_batch():
    track = Track("bus", *drives(vehicles=1, duration=900.0, seed=8)["bus-0"])
    batch = match(track, town())
    live, _ = match_live(LiveMatcher(town(), batch.scales), track)
    assert np.mean([here.edge for here in live] == batch[0].edge) > 0.9
    assert np.mean([here.confidence for here in live]) > 0.8
    assert max(here.distance for here in live) < 30
    assert not any(here.off_map for here in live)


def test_the_next_roads_are_those_that_leave_the_crossing():
    matcher = LiveMatcher(town(), SCALES)
    here = [matcher.push(t, [9.0 * t - 300, 1.0]) for t in range(10)][-1]
    assert len(here.next) == 4
    assert sum(road.probability for road in here.next) == pytest.approx(1.0)
    by_probability = sorted(here.next, key=lambda road: road.probability)
    assert by_probability[-1][:2] == (here.edge + 7, here.forward)  # straight on
    assert by_probability[0][:2] == (here.edge, not here.forward)  # back


def test_leaving_the_roads_is_reported():
    matcher = LiveMatcher(town(), SCALES)
    live = [matcher.push(float(t), [0.0, 9.0 * t]) for t in range(120)]
    assert not live[30].off_map
    assert live[-1].off_map
    assert (live[-1].edge, live[-1].next) == (-1, ())
    assert math.isnan(live[-1].offset)


def test_a_standing_agent_stays():
    rng = np.random.default_rng(0)
    matcher = LiveMatcher(town(), SCALES)
    live = [matcher.push(float(t), [60.0 + rng.normal(0, 2), rng.normal(0, 2)]) for t in range(200)]
    assert {here.edge for here in live} == {live[0].edge}
    assert np.ptp([here.offset for here in live]) < 20


def test_bad_samples_are_refused_and_not_taken_in():
    matcher = LiveMatcher(town(), SCALES)
    matcher.push(0.0, [0.0, 0.0])
    with pytest.raises(TrackError, match="is not later than"):
        matcher.push(0.0, [1.0, 0.0])
    with pytest.raises(TrackError, match="not finite"):
        matcher.push(1.0, [math.nan, 0.0])
    assert matcher.push(1.0, [9.0, 0.0]).offset >= 0


def test_a_sample_that_is_refused_is_named_by_its_time_in_full():
    matcher = LiveMatcher(town(), SCALES)
    matcher.push(1700000000.25, [0.0, 0.0])
    with pytest.raises(TrackError, match=r"time 1700000000 is not later than 1700000000\.25"):
        matcher.push(1700000000.0, [1.0, 0.0])
    with pytest.raises(TrackError, match=r"sample at 1700000001\.5 s"):
        matcher.push(1700000001.5, [math.inf, 0.0])


def test_a_finished_matcher_begins_a_new_track():
    matcher = LiveMatcher(town(), SCALES, lag=3)
    track = Track("bus", *drives(vehicles=1, duration=60.0)["bus-0"])
    assert match_live(matcher, track) == match_live(matcher, track)


def test_options_are_checked():
    with pytest.raises(OptionError, match="no default scales"):
        LiveMatcher(town())
    for wrong in ({"lag": 0}, {"gap": 0.0}):
        with pytest.raises(OptionError, match="positive"):
            LiveMatcher(town(), SCALES, **wrong)


def test_an_archive_is_a_map_to_follow(tmp_path):
    buses = drives(blocks=2, vehicles=2, duration=300.0, noise=1.0)
    archive = compress([Track(name, *bus) for name, bus in buses.items()], rmse=2.0, effort=1)
    archive.save(tmp_path / "town.gpsz")
    track = Track("bus", *drives(blocks=2, vehicles=1, duration=200.0, noise=1.0, seed=9)["bus-0"])
    for source in (archive, tmp_path / "town.gpsz"):
        live, _ = match_live(Matcher(source), track)
        assert np.mean([here.off_map for here in live]) < 0.2
        assert np.nanmedian([here.distance for here in live]) < 4


@pytest.mark.parametrize("seed", range(3))
def test_averaged_samples_are_matched_as_in_the_batch(seed):
    buses = drives(vehicles=1, duration=700.0, seed=seed, noise=25.0, block=150.0)
    times, positions = buses["bus-0"]
    # two gaps, with two samples between them
    kept = ~((times > 200) & (times < 390)) & ~((times > 392) & (times < 550))
    streets, track = town(block=150.0), Track("bus", times[kept], positions[kept])
    scales = match(track, streets).scales
    assert scales.averaging_window >= 3

    index = index_network(streets)
    step_times, roads = match_batch(index, track, 120.0, scales)
    live, finalised = match_live(LiveMatcher(index, scales, gap=120.0), track)
    assert [here.time for here in live] == track.times.tolist()
    assert [one.time for one in finalised] == step_times.tolist()
    np.testing.assert_array_equal(directed_roads(finalised) >> 1, roads >> 1)
    assert all(one.converged for one in finalised)


@pytest.mark.parametrize(("noise", "lag"), [(4.0, 100), (25.0, 3)])
def test_a_matcher_goes_on_where_the_state_of_another_one_was_taken(noise, lag):
    buses = drives(vehicles=1, period=2.0, duration=400.0, seed=1, noise=noise, block=150.0)
    times, positions = buses["bus-0"]
    kept = ~((times > 200) & (times < 290))
    track = Track("bus", times[kept], positions[kept])
    index = index_network(town(block=150.0))
    scales = match(track, index.network).scales if noise > 20 else SCALES
    whole, passed_on, other = (LiveMatcher(index, scales, lag=lag, gap=60.0) for _ in range(3))
    for number, (time, place) in enumerate(zip(track.times.tolist(), track.positions, strict=True)):
        if number % 3 == 0:
            # A matcher that was somewhere else before takes over.
            other.push(time + 1.0, place[::-1])
            other.restore(json.loads(json.dumps(passed_on.state())))
            passed_on, other = other, passed_on
        expected, found = (each.push(time, place) for each in (whole, passed_on))
        assert repr(found._replace(next=())) == repr(expected._replace(next=()))
        assert repr(found.finalised) == repr(expected.finalised)
    assert repr(passed_on.finish()) == repr(whole.finish())
