import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from gpszip.archive import Archive, new_archive, open_archive
from gpszip.codec.waypoints import expand_waypoints
from gpszip.container.attributes import KeptColumns, encode_attributes
from gpszip.container.contents import Section
from gpszip.container.layout import SectionKind
from gpszip.errors import CorruptArchiveError, InputError, OptionError, OutputError
from gpszip.graph.road_graph import build_road_graph
from gpszip.model import GridWalk, GridWalks, Plane, QuantisationGrid
from oracle.decoded import pieces, position

PLANE = Plane(((525_000_000, 134_000_000),))


def grid_walks(tracks=2, knots=30, dimension=2, seed=0, timed=True, gaps=0.2, spread=400):
    """Walks that visit and visit again the nodes of a random map, numbered in first-visit order."""
    rng = np.random.default_rng(seed)
    sequence = rng.integers(0, max(2, tracks * knots // 6), tracks * knots)
    _, first, place = np.unique(sequence, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first)).astype(np.int32)
    walks = tuple(
        GridWalk(
            nodes,
            np.cumsum(rng.integers(1, 50, knots)) * timed,
            rng.random(knots - 1) < gaps,
        )
        for nodes in np.split(rank[place], tracks)
    )
    return GridWalks(rng.integers(-spread, spread, (len(first), dimension)), walks, timed)


def archive(dimension=2, plane=None, ids=None, **options):
    walks = grid_walks(dimension=dimension, **options)
    ids = ids or [f"walk {i}" for i in range(len(walks.walks))]
    return new_archive(
        QuantisationGrid((1000,) * dimension, 1_400_000_000_500, 130, 125, plane), ids, walks
    )


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
    made = archive(dimension, timed=timed)
    opened = open_archive(made.to_bytes())
    assert_same(opened.grid_walks, grid_walks(dimension=dimension, timed=timed))
    assert opened.grid == made.grid
    assert opened.ids == ("walk 0", "walk 1")
    assert opened.timed == timed
    assert opened.to_bytes() == made.to_bytes()


def test_positions_are_those_of_the_plain_twin_in_any_shape():
    made = archive()
    rng = np.random.default_rng(5)
    for name, walk in zip(made.ids, made.walks, strict=True):
        when = rng.uniform(walk.times[0] - 20, walk.times[-1] + 20, (10, 30))
        found = made.position(name, when)
        assert found.shape == (10, 30, 2)
        places = made.road_map.nodes[walk.nodes]
        for t, p in zip(when.reshape(-1), found.reshape(-1, 2), strict=True):
            expected = position(walk.times, places, walk.gaps, t)
            assert np.isnan(p).all() if expected is None else np.allclose(p, expected, atol=1e-6)
        assert np.isnan(found).any()
        assert made.position(name, float(walk.times[3])).shape == (2,)
        assert made.position(name, []).shape == (0, 2)


def test_decompressing_gives_the_knots_of_every_piece():
    made = archive()
    decoded = {track.id: track for track in made.decompress()}
    for walk in made.walks:
        expected = pieces(walk.times, made.road_map.nodes[walk.nodes], walk.gaps)
        assert len(expected) > 1
        for i, (times, places) in enumerate(expected):
            track = decoded.pop(f"{walk.id}/{i}")
            assert track.times.tolist() == list(times)
            np.testing.assert_array_equal(track.positions, places)
    assert not decoded


def test_a_track_without_gaps_keeps_its_id():
    made = archive(gaps=0.0, ids=["", "ein/1 ü"])
    assert [track.id for track in made.decompress()] == ["", "ein/1 ü"]
    assert [name for name, _ in made.shapes()] == ["", "ein/1 ü"]


def test_an_archive_without_times_has_paths_and_says_so():
    made, timed = archive(timed=False), archive()
    for (name, places), track in zip(made.shapes(), timed.decompress(), strict=True):
        assert name == track.id
        moved = np.append(True, (np.diff(track.positions, axis=0) != 0).any(axis=1))
        np.testing.assert_array_equal(places, track.positions[moved])
    assert not any(piece.timed for piece in made.decompress())
    for question in (lambda: made.position("walk 0", 0.0), lambda: made.sample(1.0)):
        with pytest.raises(OptionError, match="times"):
            question()


def test_samples_lie_on_the_multiples_inside_of_the_pieces():
    made = archive()
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


def test_samples_at_instants_come_sorted_and_from_one_track():
    made = archive(gaps=0.0)
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
        archive().sample(**options)


def test_degrees_are_where_the_plane_lies():
    made = archive(plane=PLANE, gaps=0.3)
    walk = made.walks[0]
    degrees = made.position("walk 0", np.append(walk.times, 0.0))
    assert np.isnan(degrees[-1]).all()
    metres = made.position("walk 0", walk.times, metres=True)
    # close to the plane's middle, 1 degree of latitude is 111,272 m at 52.5 degrees
    np.testing.assert_allclose(
        (degrees[:-1, 0] - 52.5) * 111_272, metres[:, 1], atol=0.01 * np.abs(metres).max()
    )
    assert np.abs(degrees[:-1, 1] - 13.4).max() < 0.1


def test_an_unknown_track_is_named_with_those_that_there_are():
    with pytest.raises(OptionError, match=r"'walk'.*'walk 0', 'walk 1'"):
        archive().position("walk", 0.0)


def test_a_large_archive_is_cut_in_groups_that_answer_alone():
    made = archive(tracks=12, knots=4000, gaps=0.01, spread=1 << 20, seed=2)
    whole = grid_walks(tracks=12, knots=4000, gaps=0.01, spread=1 << 20, seed=2)
    opened = open_archive(made.to_bytes())
    groups = opened.contents.groups
    assert len(groups) > 1
    assert min(len(group.payload) for group in groups) >= 1 << 15
    last = opened.position("walk 11", whole.walks[11].time_steps * 1.0)
    assert list(opened._decoded_groups) == [len(groups) - 1]
    assert last.shape == (4000, 2)
    for one, other in zip(opened.grid_walks.walks, whole.walks, strict=True):
        np.testing.assert_array_equal(one.time_steps, other.time_steps)
        np.testing.assert_array_equal(one.gaps, other.gaps)
        np.testing.assert_array_equal(opened.grid_walks.nodes[one.nodes], whole.nodes[other.nodes])
    at = opened.walks[7].times[100:200] + 0.3
    np.testing.assert_array_equal(opened.position("walk 7", at), position_by_walk(opened, 7, at))


def position_by_walk(opened: Archive, number, at):
    from gpszip.walks.error import positions_at

    return positions_at(opened.walks[number], opened.road_map.nodes, at)


def test_the_layer_packs_the_same_walks():
    plain = archive()
    packed = new_archive(plain.grid, plain.ids, plain.grid_walks, layer="bz2")
    assert packed.to_bytes() != plain.to_bytes()
    assert_same(open_archive(packed.to_bytes()).grid_walks, plain.grid_walks)
    assert packed.info()["layer"] == "bz2"


def test_saving_opens_again_and_never_overwrites_unasked(tmp_path):
    made, path = archive(), tmp_path / "a.gpsz"
    assert made.save(path) == path.stat().st_size == len(made.to_bytes())
    assert open_archive(str(path)).to_bytes() == made.to_bytes()
    with pytest.raises(OutputError, match="exists"):
        made.save(path)
    made.save(path, force=True)
    with pytest.raises(InputError):
        open_archive(tmp_path / "none.gpsz")


def test_torn_bytes_are_refused():
    data = archive().to_bytes()
    with pytest.raises(CorruptArchiveError):
        open_archive(data[:-1])


def test_the_facts_are_those_of_the_walks():
    made = archive(plane=PLANE)
    facts = made.info()
    assert (facts["tracks"], facts["bytes"], facts["geographic"], facts["dimension"]) == (
        2,
        len(made.to_bytes()),
        True,
        2,
    )
    assert not made._decoded_groups
    facts = made.info(decode=True)
    assert (facts["nodes"], facts["parts"], facts["timed"]) == (
        len(made.grid_walks.nodes),
        58,
        True,
    )
    assert facts["gaps"] == sum(int(walk.gaps.sum()) for walk in grid_walks().walks)
    assert facts["edges"] == len(made.road_map.edges) > 0
    assert facts["t_start"] == min(walk.times[0] for walk in made.walks)
    assert facts["t_end"] == max(walk.times[-1] for walk in made.walks)


def test_opening_and_telling_facts_needs_no_compiler(tmp_path):
    path = tmp_path / "a.gpsz"
    archive().save(path)
    program = f"import sys, gpszip.archive as a; print(a.open_archive({str(path)!r}).info()['tracks'], 'numba' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["2", "False"]


def keeping(counts=(3, 3), first=0.0, copies=1):
    """An archive that says to keep the times of samples."""
    plain = archive()
    begins = [walk.times[0] for walk in plain.walks]
    times = np.concatenate(
        [begin + first + np.arange(count) for begin, count in zip(begins, counts, strict=True)]
    )
    body = encode_attributes(KeptColumns(counts, times, {"n": np.arange(sum(counts))}))
    return Archive(
        replace(plain.contents, extras=copies * (Section(SectionKind.ATTRIBUTES, body),))
    )


def test_samples_are_where_the_walk_is_at_their_times():
    plain = archive(gaps=0)
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
    assert archive().kept_columns is None
    with pytest.raises(OptionError, match="keep_times"):
        archive().samples()


def test_sampling_as_finely_as_the_slack_stays_within_the_walk():
    made = archive()
    for piece in made.sample(0.001, track="walk 1"):
        assert np.isfinite(piece.positions).all()
        assert (np.diff(piece.times) > 0).all()


def test_waypoints_and_shortest_paths_give_the_walks_back():
    made = archive(knots=60)
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
