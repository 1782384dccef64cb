import subprocess
import sys
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from gpszip.archive import Archive, new_archive, open_archive
from gpszip.codec.waypoints import expand_waypoints
from gpszip.container.attributes import KeptColumns, encode_attributes
from gpszip.container.contents import Section
from gpszip.container.layout import SectionKind
from gpszip.errors import (
    CorruptArchiveError,
    InputError,
    OptionError,
    OutputError,
    UnknownTrackError,
)
from gpszip.graph.road_graph import build_road_graph
from gpszip.model import GridWalk, GridWalks
from gpszip.walks.error import positions_at
from oracle.decoded import pieces, position
from oracle.random_archives import PLANE, random_archive, random_walks


def assert_same(one, two):
    np.testing.assert_array_equal(one.nodes, two.nodes)
    assert one.timed == two.timed
    for a, b in zip(one.walks, two.walks, strict=True):
        np.testing.assert_array_equal(a.nodes, b.nodes)
        np.testing.assert_array_equal(a.time_steps, b.time_steps)
        np.testing.assert_array_equal(a.gaps, b.gaps)


@pytest.mark.parametrize("timed", [True, False])
@pytest.mark.parametrize("dimension", [1, 2, 3, 5])
def test_what_was_coded_is_decoded_from_the_bytes(dimension, timed):
    made = random_archive(dimension, timed=timed)
    opened = open_archive(made.to_bytes())
    assert_same(opened.grid_walks, random_walks(dimension=dimension, timed=timed))
    assert opened.grid == made.grid
    assert opened.ids == ("walk 0", "walk 1")
    assert opened.timed == timed
    assert opened.to_bytes() == made.to_bytes()


@pytest.mark.parametrize("nodes", [[5, 4, 3, 2, 1, 0], [0, 2, 1, 3, 4, 5], [0, 1, 2, 3, 4, 6]])
def test_nodes_that_are_not_numbered_by_visit_are_refused(nodes):
    made = random_archive()
    walk = GridWalk(np.array(nodes, np.int32), np.arange(6), np.zeros(5, np.bool_))
    walks = GridWalks(np.array([[30 * i, i * i] for i in range(6)]), (walk,))
    with pytest.raises(OptionError, match="not numbered in the order in which the walks"):
        new_archive(made.grid, ["a"], walks)


@pytest.mark.parametrize("nodes", [[2, 0, 3, 3, 4], [3, 4, 3, 0, 1], [1, 1, 1, 1, 1]])
def test_nodes_are_numbered_after_those_of_a_known_map(nodes):
    """Known nodes may be visited in any order, or not at all."""
    known = random_archive()
    count = len(known.grid_walks.nodes)
    nodes = np.where(np.array(nodes) >= 3, np.array(nodes) - 3 + count, nodes).astype(np.int32)
    walk = GridWalk(nodes, np.arange(0, 50, 10), np.zeros(4, np.bool_))
    far = known.grid_walks.nodes.max() + np.array([[10, 10], [30, 40]])
    walks = GridWalks(np.concatenate([known.grid_walks.nodes, far]), (walk,))
    made = new_archive(known.grid, ["a"], walks, known_map=known)
    found = open_archive(made.to_bytes(), known).grid_walks
    assert found.nodes[found.walks[0].nodes].tolist() == walks.nodes[nodes].tolist()


def test_positions_agree_with_the_oracle_in_any_shape():
    made = random_archive()
    rng = np.random.default_rng(5)
    for name, walk in zip(made.ids, made.walks, strict=True):
        when = rng.uniform(walk.times[0] - 20, walk.times[-1] + 20, (10, 30))
        found = made.position(name, when)
        assert found.shape == (10, 30, 2)
        nodes = made.road_map.nodes[walk.nodes]
        for t, p in zip(when.reshape(-1), found.reshape(-1, 2), strict=True):
            expected = position(walk.times, nodes, walk.gaps, t)
            assert np.isnan(p).all() if expected is None else np.allclose(p, expected, atol=1e-6)
        assert np.isnan(found).any()
        assert made.position(name, float(walk.times[3])).shape == (2,)
        assert made.position(name, []).shape == (0, 2)


def test_decompressing_gives_the_knots_of_every_piece():
    made = random_archive()
    decoded = {track.id: track for track in made.decompress()}
    for walk in made.walks:
        expected = pieces(walk.times, made.road_map.nodes[walk.nodes], walk.gaps)
        assert len(expected) > 1
        for i, (times, positions) in enumerate(expected):
            track = decoded.pop(f"{walk.id}/{i}")
            assert track.times.tolist() == list(times)
            np.testing.assert_array_equal(track.positions, positions)
    assert not decoded


def test_a_track_without_gaps_keeps_its_id():
    made = random_archive(gaps=0.0, ids=["", "ein/1 ü"])
    assert [track.id for track in made.decompress()] == ["", "ein/1 ü"]
    assert [name for name, _ in made.shapes()] == ["", "ein/1 ü"]


def test_an_archive_without_times_has_paths_and_says_so():
    made, timed = random_archive(timed=False), random_archive()
    for (name, positions), track in zip(made.shapes(), timed.decompress(), strict=True):
        assert name == track.id
        moved = np.append(True, (np.diff(track.positions, axis=0) != 0).any(axis=1))
        np.testing.assert_array_equal(positions, track.positions[moved])
    assert not any(piece.timed for piece in made.decompress())
    for question in (lambda: made.position("walk 0", 0.0), lambda: made.sample(1.0)):
        with pytest.raises(OptionError, match="times"):
            question()


def test_samples_lie_on_the_multiples_inside_the_pieces():
    made = random_archive()
    sampled = made.sample(7.5)
    knots = {track.id: track for track in made.decompress()}
    assert {track.id for track in sampled} <= set(knots)
    for track in sampled:
        first, last = knots[track.id].times[[0, -1]]
        k = np.arange(np.ceil(first / 7.5), np.floor(last / 7.5) + 1)
        np.testing.assert_array_equal(track.times, k * 7.5)
        np.testing.assert_array_equal(
            track.positions, made.position(track.id.rsplit("/", 1)[0], track.times)
        )
    missed = set(knots) - {track.id for track in sampled}
    assert all(
        np.ceil(knots[name].times[0] / 7.5) > np.floor(knots[name].times[-1] / 7.5)
        for name in missed
    )


def test_samples_at_given_times_come_sorted_and_from_one_track():
    made = random_archive(gaps=0.0)
    times = made.walks[1].times
    (track,) = made.sample(
        at=[times[5], times[2], times[5], times[-1] + 99, times[0] - 99], track="walk 1"
    )
    assert track.id == "walk 1"
    assert track.times.tolist() == [times[2], times[5]]
    np.testing.assert_array_equal(track.positions, made.road_map.nodes[made.walks[1].nodes[[2, 5]]])


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"every": 1.0, "at": [1.0]},
        {"every": 0.0},
        {"every": -1.0},
        {"every": np.inf},
        {"at": [np.nan]},
    ],
)
def test_samples_at_no_times_are_refused(options):
    with pytest.raises(OptionError):
        random_archive().sample(**options)


def test_times_may_be_dates_text_or_seconds():
    made = random_archive(plane=PLANE, gaps=0.0)
    start = made["walk 0"].start
    expected = made.position("walk 0", start + 60)
    moment = datetime.fromtimestamp(start + 60, UTC)
    for when in (moment, moment.isoformat(), np.datetime64(moment.replace(tzinfo=None))):
        np.testing.assert_allclose(made.position("walk 0", when), expected, atol=1e-9)
        (sampled,) = made.sample(at=[when], track="walk 0")
        np.testing.assert_allclose(sampled.coordinates[0], expected, atol=1e-9)


def test_a_time_before_the_log_is_nan_and_a_wrong_unit_is_an_error():
    made = random_archive(gaps=0.0)
    start = made["walk 0"].start
    assert np.isnan(made.position("walk 0", [start - 86_400, start - 1e6])).all()
    assert made.sample(at=[start - 86_400]) == []
    for wrong, says in (([12.0, 13.5], "from the start"), ([start * 1000], "milliseconds")):
        for ask in (
            lambda when: made.position("walk 0", when),
            lambda when: made.sample(at=when),
            lambda when: made.sample(at=when, track="walk 1"),
            lambda when: made["walk 0"][when[0] : when[-1]],
        ):
            with pytest.raises(OptionError, match=f"2014-05-13 16:53:2.*{says}"):
                ask(wrong)
    assert np.isfinite(made.position("walk 0", [start, 12.0])[0]).all()


def test_degrees_are_where_the_plane_lies():
    made = random_archive(plane=PLANE, gaps=0.3)
    walk = made.walks[0]
    degrees = made.position("walk 0", np.append(walk.times, 0.0))
    assert np.isnan(degrees[-1]).all()
    metres = made.position("walk 0", walk.times, metres=True)
    # close to the plane's middle, 1 degree of latitude is 111,272 m at 52.5 degrees
    np.testing.assert_allclose(
        (degrees[:-1, 0] - 52.5) * 111_272, metres[:, 1], atol=0.01 * np.abs(metres).max()
    )
    assert np.abs(degrees[:-1, 1] - 13.4).max() < 0.1


def test_an_unknown_track_is_named_with_those_that_exist():
    made = random_archive()
    for ask in (made.walk, made.decompress, made.__getitem__, lambda id: made.position(id, 0.0)):
        with pytest.raises(KeyError, match=r"'walk'.*'walk 0', 'walk 1'"):
            ask("walk")
    with pytest.raises(UnknownTrackError, match="no track 0"):
        made[0]


@pytest.fixture(scope="module")
def large():
    """An archive of two groups of at least 8 KiB, and the walks in it."""
    options = {"tracks": 12, "knots": 500, "gaps": 0.01, "spread": 1 << 20, "seed": 2}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gpszip.archive.create._GROUP_BYTES", 1 << 13)
        made = random_archive(**options)
    return open_archive(made.to_bytes()), random_walks(**options)


def test_a_large_archive_is_cut_in_groups_that_answer_alone(large):
    opened, walks = large
    groups = opened.contents.groups
    assert len(groups) == 2
    assert min(len(group.payload) for group in groups) >= 1 << 12
    opened = Archive(opened.contents)
    first, last = opened["walk 11"].start, opened["walk 11"].end
    assert opened.position("walk 11", [first, last]).shape == (2, 2)
    assert opened.decompress("walk 11")
    assert list(opened._decoded_groups) == [len(groups) - 1]
    for decoded, coded in zip(opened.grid_walks.walks, walks.walks, strict=True):
        np.testing.assert_array_equal(decoded.time_steps, coded.time_steps)
        np.testing.assert_array_equal(decoded.gaps, coded.gaps)
        nodes = opened.grid_walks.nodes[decoded.nodes]
        np.testing.assert_array_equal(nodes, walks.nodes[coded.nodes])


def test_groups_answer_as_the_whole_archive_does(large):
    opened, _ = large
    times = opened.walks[7].times[100:200] + 0.3
    expected = positions_at(opened.walks[7], opened.road_map.nodes, times)
    np.testing.assert_array_equal(opened.position("walk 7", times), expected)
    together = [piece for piece in opened.decompress() if opened.pieces[piece.id] == "walk 7"]
    for alone, piece in zip(opened.decompress("walk 7"), together, strict=True):
        assert alone.id == piece.id
        np.testing.assert_array_equal(alone.times, piece.times)
        np.testing.assert_array_equal(alone.positions, piece.positions)


def test_the_layer_packs_the_same_walks():
    plain = random_archive()
    packed = new_archive(plain.grid, plain.ids, plain.grid_walks, layer="bz2")
    assert packed.to_bytes() != plain.to_bytes()
    assert_same(open_archive(packed.to_bytes()).grid_walks, plain.grid_walks)
    assert packed.info()["layer"] == "bz2"


def test_saving_opens_again_and_never_overwrites_unasked(tmp_path):
    made, path = random_archive(), tmp_path / "a.gpsz"
    assert made.save(path) == path.stat().st_size == len(made.to_bytes())
    assert open_archive(str(path)).to_bytes() == made.to_bytes()
    with pytest.raises(OutputError, match="exists"):
        made.save(path)
    made.save(path, force=True)
    with pytest.raises(InputError):
        open_archive(tmp_path / "none.gpsz")


def test_torn_bytes_are_refused():
    data = random_archive().to_bytes()
    with pytest.raises(CorruptArchiveError):
        open_archive(data[:-1])


def test_the_facts_are_those_of_the_walks():
    made = random_archive(plane=PLANE)
    facts = made.info()
    assert (facts["tracks"], facts["bytes"], facts["geographic"], facts["dimension"]) == (
        2,
        len(made.to_bytes()),
        True,
        2,
    )
    assert not made._decoded_groups
    facts = made.info(decode=True)
    assert (facts["nodes"], facts["segments"], facts["timed"]) == (
        len(made.grid_walks.nodes),
        58,
        True,
    )
    assert facts["gaps"] == sum(int(walk.gaps.sum()) for walk in random_walks().walks)
    assert facts["edges"] == len(made.road_map.edges) > 0
    assert facts["t_start"] == min(walk.times[0] for walk in made.walks)
    assert facts["t_end"] == max(walk.times[-1] for walk in made.walks)


def test_opening_and_info_need_no_compiler(tmp_path):
    path = tmp_path / "a.gpsz"
    random_archive().save(path)
    program = (
        "import sys, gpszip.archive as a; "
        f"print(a.open_archive({str(path)!r}).info()['tracks'], 'numba' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["2", "False"]


def keeping(counts=(3, 3), first=0.0, copies=1):
    """An archive that says to keep the times of samples."""
    plain = random_archive()
    begins = [walk.times[0] for walk in plain.walks]
    times = np.concatenate(
        [begin + first + np.arange(count) for begin, count in zip(begins, counts, strict=True)]
    )
    body = encode_attributes(KeptColumns(counts, times, {"n": np.arange(sum(counts))}))
    return Archive(
        replace(plain.contents, extras=copies * (Section(SectionKind.ATTRIBUTES, body),))
    )


def test_samples_are_where_the_walk_is_at_their_times():
    plain = random_archive(gaps=0)
    made = keeping()
    made = open_archive(replace_walks(made, plain).to_bytes())
    assert made.kept_columns == ("n",)
    for sampled in made.samples():
        np.testing.assert_array_equal(sampled.times, made.sample_times(sampled.id))
        np.testing.assert_array_equal(sampled.positions, plain.position(sampled.id, sampled.times))
    assert made.attributes("walk 1")["n"].tolist() == [3, 4, 5]
    assert [track.id for track in made.samples("walk 1")] == ["walk 1"]
    assert open_archive(made.to_bytes()).info()["kept"] == ["n"]


def replace_walks(kept, plain):
    return Archive(replace(plain.contents, extras=kept.contents.extras))


def test_forged_samples_are_refused():
    with pytest.raises(CorruptArchiveError, match="claims no travel"):
        keeping(first=-1000.0).samples()
    with pytest.raises(CorruptArchiveError, match="claims no travel"):
        keeping(counts=(6, 0)).samples()
    with pytest.raises(CorruptArchiveError, match="two sections"):
        keeping(copies=2).samples()


def test_an_archive_without_samples_says_so():
    assert random_archive().kept_columns is None
    with pytest.raises(OptionError, match="keep_times"):
        random_archive().samples()


def test_sampling_as_finely_as_the_slack_stays_within_the_walk():
    made = random_archive()
    for piece in made.sample(0.001, track="walk 1"):
        assert np.isfinite(piece.positions).all()
        assert (np.diff(piece.times) > 0).all()


def test_waypoints_and_shortest_paths_give_the_walks_back():
    made = random_archive(knots=60)
    graph = build_road_graph(made.grid_walks.nodes, made.road_map.edges)
    for walk in made.walks:
        short = made.waypoints(walk.id)
        assert len(short) < len(walk.nodes)
        route = expand_waypoints(graph, short, len(walk.gaps))
        np.testing.assert_array_equal(route.nodes, walk.nodes)
        np.testing.assert_array_equal(route.gaps, walk.gaps)
    assert made.info(decode=True)["waypoints"] == sum(
        len(made.waypoints(name)) for name in made.ids
    )


def test_an_archive_is_a_mapping_of_its_tracks():
    made = random_archive()
    assert len(made) == 2
    assert list(made) == list(made.ids) == ["walk 0", "walk 1"]
    assert "walk 1" in made
    assert "walk" not in made
    assert {id: made[id].walk.id for id in made} == {"walk 0": "walk 0", "walk 1": "walk 1"}


def test_a_repr_reads_no_group():
    made = random_archive(plane=PLANE)
    assert repr(made) == "Archive(2 tracks, lat, lon)"
    assert not made._decoded_groups
