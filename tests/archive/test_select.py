"""Parts of archives, and archives joined from parts."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gpszip
from gpszip.archive.join import join
from gpszip.archive.select import decompress_selection, iterate_selection, select
from gpszip.errors import OptionError, UnknownTrackError
from gpszip.model.selection import BoundingBox, Selection
from gpszip.testing import patrol
from oracle.random_archives import random_archive
from random_tests import examples

#: Seconds to which an archive keeps the ends of pieces, outwards.
TICK = 2e-3


@pytest.fixture(scope="module")
def archive():
    return random_archive(gaps=0.2)


@pytest.fixture(scope="module")
def kept():
    track = patrol(4000, seed=2)
    other = gpszip.Track("other", track.times[:900] + 50, track.positions[:900])
    return gpszip.compress([track, other], max_error=0.5, keep_times=True, effort=1)


def _probe(archive, count=4000):
    begin, end = archive.time_range
    return np.linspace(begin - 5, end + 5, count)


def _same_positions(part, whole, track, times, wanted):
    """Positions are those of the whole archive where they are wanted, and none elsewhere."""
    expected = whole.position(track, times, metres=True)
    expected[~wanted] = np.nan
    found = part.position(track, times, metres=True)
    np.testing.assert_allclose(found, expected, atol=1e-6)


@examples(15)
@given(st.floats(0, 1), st.floats(0, 1))
def test_a_time_range_keeps_positions_and_claims_no_more(archive, first, last):
    begin, end = archive.time_range
    since, until = sorted(begin + np.array([first, last]) * (end - begin))
    try:
        part = archive.select(since=since, until=until)
    except OptionError:
        times = np.linspace(since, until, 500)
        assert all(np.isnan(archive.position(name, times)).all() for name in archive.ids)
        return
    times = _probe(archive)
    times = times[(np.abs(times - since) > TICK) & (np.abs(times - until) > TICK)]
    tolerance = part.error_bound.metres - archive.error_bound.metres if part.error_bound else 0
    for name in part.ids:
        expected = archive.position(name, times, metres=True)
        found = part.position(name, times, metres=True)
        outside = (times < since) | (times > until)
        assert np.isnan(found[outside]).all()
        inside = ~outside & ~np.isnan(expected[:, 0])
        assert not np.isnan(found[inside]).any()
        assert np.abs(found - expected)[inside].max(initial=0) <= tolerance + 2.0


def test_tracks_are_selected_by_name(archive):
    part = archive.select(tracks=["walk 1"])
    assert part.ids == ("walk 1",)
    times = _probe(archive)
    _same_positions(part, archive, "walk 1", times, np.ones(len(times), bool))
    assert archive.select(tracks="walk 1").to_bytes() == part.to_bytes()
    with pytest.raises(UnknownTrackError, match="no track 'nobody'"):
        archive.select(tracks="nobody")


def test_an_area_is_where_the_tracks_are_found_afterwards(kept):
    low, high = kept.road_map.nodes.min(axis=0), kept.road_map.nodes.max(axis=0)
    middle = (low + high) / 2
    part = kept.select(bbox=[*low, *middle])
    step = kept.info()["node_step_m"]
    times = _probe(kept)
    for name in part.ids:
        whole = kept.position(name, times)
        found = part.position(name, times)
        inside = ((whole >= low + step) & (whole <= middle - step)).all(axis=1)
        assert not np.isnan(found[inside]).any()
        claimed = found[~np.isnan(found[:, 0])]
        assert (claimed <= middle + step).all()
        assert np.abs(found - whole)[inside].max() <= step
    assert part.error_bound.maximum
    assert part.error_bound.metres <= kept.error_bound.metres + step


def test_pieces_of_a_selection_are_those_of_the_part(archive):
    begin, end = archive.time_range
    selection = Selection(since=begin + 100.5, until=end - 99.5)
    pieces, owners = decompress_selection(archive, selection)
    streamed = [piece for group, _ in iterate_selection(archive, selection) for piece in group]
    assert [piece.id for piece in streamed] == [piece.id for piece in pieces]
    assert set(owners.values()) == set(select(archive, selection).ids)
    for piece in pieces:
        assert begin + 100.5 <= piece.times[0] <= piece.times[-1] <= end - 99.5
        track = owners[piece.id]
        np.testing.assert_allclose(
            piece.positions, archive.position(track, piece.times, metres=True), atol=1e-6
        )


def test_groups_are_decoded_one_at_a_time():
    archive = random_archive(tracks=6)
    for _ in iterate_selection(archive, Selection()):
        assert not archive._decoded_groups

    # A group that is decoded already stays.
    assert archive.walks
    decoded = dict(archive._decoded_groups)
    assert list(iterate_selection(archive, Selection()))
    assert decoded
    assert archive._decoded_groups == decoded


def test_kept_times_are_those_of_the_part(kept):
    begin = kept.sample_times("other")[0]
    part = kept.select(since=begin + 10, until=begin + 20)
    for name in part.ids:
        times = kept.sample_times(name)
        expected = times[(times >= begin + 10) & (times <= begin + 20)]
        np.testing.assert_array_equal(part.sample_times(name), expected)
        (track,) = part.samples(name)
        assert len(track) == len(expected)


@examples(10)
@given(st.lists(st.floats(0.01, 0.99), min_size=1, max_size=5, unique=True))
def test_joining_the_parts_gives_the_archive_back(kept, cuts):
    begin, end = kept.time_range
    bounds = [None, *sorted(begin + np.array(cuts) * (end - begin)), None]
    parts = []
    for since, until in zip(bounds[:-1], bounds[1:], strict=True):
        try:
            parts.append(kept.select(since=since, until=until))
        except OptionError:
            continue
    whole = join(parts)
    times = _probe(kept)
    tolerance = max(whole.error_bound.metres - kept.error_bound.metres, 0) + 1e-6
    for name in kept.ids:
        expected, found = kept.position(name, times), whole.position(name, times)
        np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
        assert np.nanmax(np.abs(found - expected)) <= tolerance
        np.testing.assert_array_equal(whole.sample_times(name), kept.sample_times(name))


def test_tracks_joined_are_the_archive_byte_for_byte(kept):
    parts = [kept.select(tracks=name) for name in kept.ids]
    assert join(parts).to_bytes() == kept.to_bytes()


def test_archives_that_do_not_go_together_are_not_joined(kept, archive):
    with pytest.raises(OptionError, match=r"archive 2: .*merge"):
        join([kept, archive])
    with pytest.raises(OptionError, match="overlaps in time"):
        join([kept, kept])
    with pytest.raises(OptionError, match="no archive"):
        join([])


def test_a_part_on_a_known_map_stays_on_it():
    city = gpszip.compress(patrol(3000, seed=1), max_error=0.5, effort=1)
    track = patrol(6000, seed=1)
    later = gpszip.Track("later", track.times[3000:], track.positions[3000:])
    on_map = gpszip.compress(later, max_error=0.5, effort=1, map=city)
    middle = float(later.times[1500])
    part = on_map.select(until=middle)
    assert part.contents.map == on_map.contents.map
    again = gpszip.open(part.to_bytes(), map=city)
    times = later.times[:1400]
    np.testing.assert_allclose(
        again.position("later", times), on_map.position("later", times), atol=1.0
    )
    whole = join([part, on_map.select(since=middle)])
    np.testing.assert_allclose(
        whole.position("later", later.times), on_map.position("later", later.times), atol=1.0
    )


def test_nothing_selected_says_what_there_is(archive):
    with pytest.raises(OptionError, match=r"nothing is selected; the archive has 2014-05-13"):
        archive.select(since="2020-01-01")
    with pytest.raises(OptionError, match="south of where it begins"):
        archive.select(bbox=(0, 5, 1, 4))
    with pytest.raises(OptionError, match="4 sides"):
        archive.select(bbox=(0, 5, 1))
    with pytest.raises(OptionError, match="ends before it begins"):
        archive.select(since=5.0, until=4.0)
    with pytest.raises(OptionError, match="off the globe"):
        BoundingBox(0, 0, 0, 91).check(geographic=True)


def test_waypoints_of_a_walk_that_goes_on_beyond_its_travel():
    """A segment before the start of its piece is no travel, but part of the walk."""
    from gpszip.archive import new_archive
    from gpszip.model import GridWalk, GridWalks, QuantisationGrid

    walk = GridWalk(np.arange(3, dtype=np.int32), np.array([0, 5, 10]), np.zeros(2, bool))
    nodes = np.array([[0, 0], [50, 0], [50, 90]])
    archive = new_archive(
        QuantisationGrid((0, 0), 0, 128, 128),
        ["a"],
        GridWalks(nodes, (walk,)),
        time_ranges=[np.array([[6.0, 9.0]])],
    )
    assert len(archive.road_map.edges) == 1
    assert archive.info(decode=True)["waypoints"] >= 2
