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
from gpszip.model import Network, Track
from gpszip.model.match import Scales
from gpszip.testing.city import drives

SCALES = Scales(error=4.0, sigma=8.0, beta=6.0, median_speed=9.0, max_speed=60.0)


def town(n=7, block=120.0):
    nodes = block * (np.array([(x, y) for x in range(n) for y in range(n)], float) - (n - 1) / 2)
    pairs = [(x * n + y, (x + 1) * n + y) for x in range(n - 1) for y in range(n)]
    pairs = np.array(
        pairs + [(x * n + y, x * n + y + 1) for x in range(n) for y in range(n - 1)], np.int32
    )
    both = np.ones(len(pairs), bool)
    offsets = 2 * np.arange(len(pairs) + 1)
    return Network(
        nodes,
        pairs[:, 0].copy(),
        pairs[:, 1].copy(),
        offsets,
        nodes[pairs.ravel()],
        both,
        both,
        np.full(len(pairs), np.nan),
    )


def live(matcher, track):
    told = [
        matcher.push(t, place)
        for t, place in zip(track.times.tolist(), track.positions, strict=True)
    ]
    return told, [one for here in told for one in here.finalised] + list(matcher.finish())


@pytest.mark.parametrize("period", [1.0, 15.0])
@pytest.mark.parametrize("seed", range(3))
def test_what_is_settled_is_what_the_batch_finds(period, seed):
    times, places = drives(vehicles=1, period=period, duration=600.0 * period**0.5, seed=seed)[
        "bus-0"
    ]
    kept = ~(
        (times > 200) & (times < 290)
    )  # a silence, in which the last sample before it may have no layer yet
    places = np.where(
        ((times > 100) & (times < 110 + 6 * period))[:, None], places + np.array([0, 7000]), places
    )  # faster than anybody
    index, track = index_network(town()), Track("bus", times[kept], places[kept])
    is_gap = np.diff(track.times) > 60
    whole = find_viterbi_path(
        index,
        create_workspace(index),
        Observations(
            track.positions.copy(), track.times.copy(), is_gap, np.zeros_like(track.positions)
        ),
        SCALES,
    )
    _, finalised = live(LiveMatcher(index, SCALES, gap=60.0), track)
    assert all(one.converged for one in finalised)
    assert [one.time for one in finalised] == track.times[whole.sample_indices].tolist()
    assert [one.edge for one in finalised] == np.where(
        whole.roads >= 0, whole.roads >> 1, -1
    ).tolist()
    assert [one.forward for one in finalised] == (
        (whole.roads >= 0) & (whole.roads % 2 == 0)
    ).tolist()


@pytest.mark.parametrize(
    ("lag", "period", "seed"),
    [(1, 1.0, 3), (4, 2.0, 4), (20, 1.0, 5), (6, 20.0, 6), (200, 20.0, 7)],
)
def test_what_is_final_is_what_the_batch_finds_whatever_the_lag(lag, period, seed):
    times, places = drives(
        vehicles=1, period=period, duration=500.0 * period**0.5, seed=seed, noise=12.0
    )["bus-0"]
    kept = ~((times > 200) & (times < 290)) & ~((times > 330) & (times < 395))
    index, track = index_network(town()), Track("bus", times[kept], places[kept])
    stretch = Observations(
        track.positions.copy(),
        track.times.copy(),
        np.diff(track.times) > 60,
        np.zeros_like(track.positions),
    )
    whole = find_viterbi_path(index, create_workspace(index), stretch, SCALES)
    told, finalised = live(LiveMatcher(index, SCALES, lag=lag, gap=60.0), track)
    assert [one.time for one in finalised] == track.times[whole.sample_indices].tolist()
    converged = np.array([one.converged for one in finalised])
    roads = np.array(
        [2 * one.edge + (not one.forward) if one.edge >= 0 else -1 for one in finalised]
    )
    np.testing.assert_array_equal(roads[converged], whole.roads[converged])
    assert converged.mean() > (0.0 if lag < 5 else 0.95)
    assert converged.all() or lag < 200
    layers = np.searchsorted(
        track.times[whole.sample_indices], [here.time for here in told], side="right"
    )
    waited = [
        layer - np.searchsorted(track.times[whole.sample_indices], one.time)
        for layer, here in zip(layers, told, strict=True)
        for one in here.finalised
    ]
    assert max(waited) <= lag + 1


def test_now_is_near_what_later_samples_tell():
    times, places = drives(vehicles=1, duration=900.0, seed=8)["bus-0"]
    streets, track = town(), Track("bus", times, places)
    batch = match(track, streets)
    told, _ = live(LiveMatcher(streets, batch.scales), track)
    assert np.mean([a.edge == b for a, b in zip(told, batch[0].edge.tolist(), strict=True)]) > 0.9
    assert np.mean([one.confidence for one in told]) > 0.8
    assert max(one.distance for one in told) < 30
    assert not any(one.off_map for one in told)


def test_the_next_roads_are_those_that_leave():
    matcher = LiveMatcher(town(), SCALES)
    here = [matcher.push(t, [9.0 * t - 300, 1.0]) for t in range(10)][-1]
    assert len(here.next) == 4
    assert sum(one.probability for one in here.next) == pytest.approx(1.0)
    straight, back = (max, min)
    likely = straight(here.next, key=lambda one: one.probability)
    assert (likely.edge, likely.forward) == (here.edge + 7, here.forward)
    assert back(here.next, key=lambda one: one.probability)[:2] == (here.edge, not here.forward)


def test_leaving_the_roads_is_noticed():
    matcher = LiveMatcher(town(), SCALES)
    told = [matcher.push(float(t), [0.0, 9.0 * t]) for t in range(120)]
    assert not told[30].off_map
    assert told[-1].off_map
    assert (told[-1].edge, told[-1].next) == (-1, ())
    assert math.isnan(told[-1].offset)


def test_a_standing_agent_stays():
    rng = np.random.default_rng(0)
    matcher = LiveMatcher(town(), SCALES)
    told = [matcher.push(float(t), [60.0 + rng.normal(0, 2), rng.normal(0, 2)]) for t in range(200)]
    assert {one.edge for one in told} == {told[0].edge}
    offsets = np.array([one.offset for one in told])
    assert (np.diff(offsets if told[0].forward else -offsets) >= 0).all() or np.ptp(offsets) < 20


def test_bad_samples_are_refused_and_forgotten():
    matcher = LiveMatcher(town(), SCALES)
    matcher.push(0.0, [0.0, 0.0])
    with pytest.raises(TrackError, match="does not follow"):
        matcher.push(0.0, [1.0, 0.0])
    with pytest.raises(TrackError, match="not finite"):
        matcher.push(1.0, [math.nan, 0.0])
    assert matcher.push(1.0, [9.0, 0.0]).offset >= 0


def test_a_matcher_begins_anew_after_its_end():
    matcher = LiveMatcher(town(), SCALES, lag=3)
    track = Track("bus", *drives(vehicles=1, duration=60.0)["bus-0"])
    assert live(matcher, track) == live(matcher, track)


def test_choices_are_checked():
    with pytest.raises(OptionError, match="no default scales"):
        LiveMatcher(town())
    for wrong in ({"lag": 0}, {"gap": 0.0}):
        with pytest.raises(OptionError, match="positive"):
            LiveMatcher(town(), SCALES, **wrong)


def test_an_archive_is_a_map_to_follow(tmp_path):
    tracks = [
        Track(name, *one)
        for name, one in drives(blocks=3, vehicles=3, duration=600.0, noise=1.0).items()
    ]
    archive = compress(tracks, rmse=2.0)
    archive.save(tmp_path / "town.gpsz")
    times, places = drives(blocks=3, vehicles=1, duration=200.0, noise=1.0, seed=9)["bus-0"]
    for source in (archive, tmp_path / "town.gpsz"):
        matcher = Matcher(source)
        told = [matcher.push(t, place) for t, place in zip(times.tolist(), places, strict=True)]
        assert np.mean([one.off_map for one in told]) < 0.2
        assert np.nanmedian([one.distance for one in told]) < 4


@pytest.mark.parametrize("seed", range(3))
def test_means_are_matched_as_in_the_batch(seed):
    times, places = drives(vehicles=1, duration=700.0, seed=seed, noise=25.0, block=150.0)["bus-0"]
    kept = ~((times > 200) & (times < 390)) & ~(
        (times > 392) & (times < 550)
    )  # silences, and two samples between them
    streets, track = town(block=150.0), Track("bus", times[kept], places[kept])
    scales = match(track, streets).scales
    assert scales.averaging_window >= 3
    index, is_gap = index_network(streets), np.diff(track.times) > 120
    means = moving_average(track.positions, is_gap, scales.averaging_window)
    whole = find_viterbi_path(
        index,
        create_workspace(index),
        Observations(means, track.times.copy(), is_gap, np.zeros_like(means)),
        scales,
    )
    told, finalised = live(LiveMatcher(index, scales, gap=120.0), track)
    assert [here.time for here in told] == track.times.tolist()
    assert [one.time for one in finalised] == track.times[whole.sample_indices].tolist()
    assert [one.edge for one in finalised] == np.where(
        whole.roads >= 0, whole.roads >> 1, -1
    ).tolist()
    assert all(one.converged for one in finalised)
