"""A large archive is opened without being read, and a question reads the groups that it needs."""

import io
import pickle
import shutil
from dataclasses import replace

import numpy as np
import pytest

import gpszip
from gpszip.archive import Archive, new_archive, open_archive
from gpszip.container.attributes import KeptColumns, encode_attributes
from gpszip.container.catalog import WHOLE_FILE_BYTES, StoredGroups
from gpszip.container.contents import Contents, Group, Section
from gpszip.container.layout import SectionKind
from gpszip.container.recover import recover
from gpszip.container.verify import verify
from gpszip.errors import CorruptArchiveError, InputError, MapError
from gpszip.model import GridWalk, GridWalks
from oracle.random_archives import random_archive

#: Groups of the archive, of two tracks each. Three of them differ; the others repeat these.
GROUPS = 12

#: Bytes of a further section, which make the file large.
FURTHER_BYTES = 1_100_000

#: Bytes of index, names, both ends and the heads of further sections, in all.
INDEX_BYTES = 1000


class CountingFile(io.BytesIO):
    """A file that counts the bytes that are read of it."""

    bytes_read = 0

    def read(self, size=-1):
        data = super().read(size)
        self.bytes_read += len(data)
        return data


@pytest.fixture(scope="module")
def hours():
    """Archives of the same place in three different hours."""
    return [
        random_archive(knots=600, spread=1 << 20, seed=hour, first_step=50_000 * hour)
        for hour in range(3)
    ]


@pytest.fixture(scope="module")
def contents(hours):
    groups = []
    for number in range(GROUPS):
        walks = hours[number % 3].grid_walks.walks
        first = min(int(walk.time_steps[0]) for walk in walks)
        last = max(int(walk.time_steps[-1]) for walk in walks)
        payload = hours[number % 3].contents.groups[0].payload
        groups.append(Group(2 * number, 2, payload, (first, last)))
    ids = tuple(f"walk {number}" for number in range(2 * GROUPS))
    counts = (1,) * len(ids)
    starts = [hours[number // 2 % 3].walks[number % 2].times[0] for number in range(len(ids))]
    times = np.array(starts)
    kept = encode_attributes(KeptColumns(counts, times, {"n": np.arange(len(times))}))
    extras = (
        Section(SectionKind.ATTRIBUTES, kept),
        Section(200, np.random.default_rng(0).bytes(FURTHER_BYTES)),
    )
    return Contents(hours[0].grid, ids, tuple(groups), None, extras)


@pytest.fixture(scope="module")
def data(contents):
    data = Archive(contents).to_bytes()
    assert len(data) > WHOLE_FILE_BYTES
    return data


@pytest.fixture
def path(tmp_path, data):
    path = tmp_path / "large.gpsz"
    path.write_bytes(data)
    return path


def test_opening_reads_the_index_alone(data):
    file = CountingFile(data)
    opened = open_archive(file)
    assert len(opened.ids) == 2 * GROUPS
    assert (len(opened), "walk 5" in opened, opened.size) == (2 * GROUPS, True, len(data))
    assert repr(opened) == f"Archive({2 * GROUPS} tracks, x, y)"
    assert file.bytes_read < INDEX_BYTES


def test_one_track_reads_its_group(data, contents, hours):
    file = CountingFile(data)
    opened = open_archive(file)
    times = hours[1].walks[1].times[10:20] + 0.5
    found = opened.position("walk 15", times)
    np.testing.assert_array_equal(found, hours[1].position("walk 1", times))
    assert opened["walk 15"].pieces
    assert opened["walk 15"].sample(100.0)
    assert file.bytes_read < INDEX_BYTES + len(contents.groups[7].payload) + 200


def test_one_time_reads_the_groups_of_that_time(data, contents, hours):
    file = CountingFile(data)
    opened = open_archive(file)
    when = float(np.mean(hours[2].walks[0].times[[3, 4]]))
    sampled = opened.sample(at=[when])
    whole = open_archive(data).sample(at=[when])
    assert [track.id for track in sampled] == [track.id for track in whole]
    assert len(sampled) > 0
    third = sum(len(group.payload) for group in contents.groups[2::3])
    first = len(contents.groups[0].payload)  # whether there are times at all
    assert file.bytes_read < INDEX_BYTES + third + first + 100 * GROUPS


def test_info_reads_no_more_than_the_first_group_and_the_columns(data, contents):
    file = CountingFile(data)
    facts = open_archive(file).info()
    assert facts == open_archive(data).info()
    columns = len(bytes(contents.extras[0].body))
    assert file.bytes_read < INDEX_BYTES + len(contents.groups[0].payload) + columns + 100


def test_everything_is_the_same_as_when_all_was_read(path, data):
    lazy, whole = gpszip.open(path), gpszip.open(data)
    assert isinstance(lazy.contents.groups, StoredGroups)
    assert tuple(lazy.contents.groups) == tuple(whole.contents.groups)
    assert lazy.contents.groups[1:3] == whole.contents.groups[1:3]
    assert lazy.to_bytes() == data
    assert lazy.hash == whole.hash
    assert lazy.time_range == whole.time_range
    assert [track.times.tolist() for track in lazy.samples("walk 3")] == [
        track.times.tolist() for track in whole.samples("walk 3")
    ]
    assert [bytes(extra.body) for extra in lazy.contents.extras] == [
        bytes(extra.body) for extra in whole.contents.extras
    ]
    changed = Archive(replace(lazy.contents, sampling=100))
    assert changed.size == len(changed.to_bytes()) == len(data) + 13


def test_an_archive_in_use_goes_to_another_process(path, data):
    opened = pickle.loads(pickle.dumps(gpszip.open(path).contents))
    assert Archive(opened).to_bytes() == data


def test_a_file_can_be_saved_over_itself(path, data):
    opened = gpszip.open(path)
    opened.position("walk 0", 0.0 + opened["walk 0"].start)
    opened.save(path, force=True)
    assert path.read_bytes() == data


def test_a_file_that_changed_is_refused(path, tmp_path, data):
    opened = gpszip.open(path)
    opened.position("walk 0", opened["walk 0"].start)
    other = tmp_path / "other.gpsz"
    shutil.copy(path, other)
    other.replace(path)
    assert opened["walk 0"].start  # was read before
    with pytest.raises(InputError, match=r"large.gpsz: the archive has changed.*open it again"):
        opened.position("walk 23", 0.0)
    path.unlink()
    with pytest.raises(InputError, match="no such file"):
        opened.position("walk 23", 0.0)


def test_damage_shows_where_it_is_read(path, contents, data):
    torn = bytearray(data)
    torn[data.index(contents.groups[5].payload) + 100] ^= 1
    path.write_bytes(torn)
    opened = gpszip.open(path)
    assert opened.position("walk 0", opened["walk 0"].start).shape == (2,)
    with pytest.raises(CorruptArchiveError, match="checksum"):
        opened.road_map  # noqa: B018
    assert not verify(path).ok
    saved = recover(path)
    assert len(saved.contents.groups) == GROUPS - 1


@pytest.mark.parametrize("end", [-1, -19, 1 << 20, (1 << 20) + 1])
def test_a_file_that_was_cut_is_refused_at_once(path, data, end):
    path.write_bytes(data[:end])
    with pytest.raises(CorruptArchiveError):
        gpszip.open(path)


def test_a_large_archive_serves_as_a_map(path, tmp_path):
    city = gpszip.open(path)
    walk = city.grid_walks.walks[0]
    part = GridWalk(walk.nodes[:5], walk.time_steps[:5], walk.gaps[:4])
    walks = GridWalks(city.grid_walks.nodes, (part,))
    later = new_archive(city.grid, ["later"], walks, known_map=city)
    later.save(tmp_path / "later.gpsz")
    opened = gpszip.open(tmp_path / "later.gpsz")  # finds the map beside it
    assert opened.map.hash == city.hash
    assert opened.ids == ("later",)
    assert opened.position("later", opened["later"].start).shape == (2,)
    with pytest.raises(MapError, match="another one"):
        gpszip.open(tmp_path / "later.gpsz", map=random_archive())
