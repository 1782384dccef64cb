"""Sets of archives give the same bytes in whatever order they are named, and tracks come out in a stated one."""

from itertools import permutations

import numpy as np
import pytest

from gpszip.archive import new_archive
from gpszip.merging.deviation import natural_sort_key
from gpszip.model import GridWalk, GridWalks, Options, QuantisationGrid, Track
from gpszip.model.merge_options import MergeOptions
from gpszip.pipeline.compress import compress
from gpszip.pipeline.merge import merge
from gpszip.testing import patrol


def robots(count, shift=0.0, dimension=2):
    """A robot's rounds cut in runs, each an archive of its own of some 20 bytes; in space it climbs as it goes east."""
    whole = patrol(2400, seed=4)
    places = whole.positions + shift
    places = np.column_stack((places, 0.2 * places[:, 0])) if dimension > 2 else places
    return [
        compress(
            Track(f"run {number}", whole.times[rows], places[rows]), Options(rmse=0.5, effort=1)
        )[0]
        for number, rows in enumerate(np.array_split(np.arange(len(whole)), count))
    ]


def equal_archives():
    """The same walk under two names, twice."""
    walk = GridWalk(np.array([0, 1], np.int32), np.array([0, 30]), np.zeros(1, bool))
    return [
        new_archive(
            QuantisationGrid((0, 0), 0, 128, 128),
            [name],
            GridWalks(np.array([[0, 0], [90, 0]]), (walk,)),
        )
        for name in "abc"
    ]


SETS = {
    "tiny": lambda: robots(3),
    "in space": lambda: robots(3, dimension=3),
    "far apart": lambda: [*robots(3)[:2], robots(3, shift=5000.0)[2]],
    "one large and some tiny": lambda: [*robots(6)[:2], merge(robots(6)[2:])[0]],
    "equal": equal_archives,
}


@pytest.mark.parametrize("name", SETS)
def test_any_order_gives_the_same_bytes(name):
    archives = SETS[name]()
    found = {merge(order)[0].to_bytes() for order in permutations(archives)}
    assert len(found) == 1


def test_deviations_are_told_in_the_order_in_which_archives_were_given():
    archives = robots(3)
    one, other = (merge(order)[1].deviations for order in (archives, archives[::-1]))
    assert one == other[::-1]
    assert len({deviation.rms for deviation in one}) == 3


def test_trees_of_one_shape_take_as_many_bytes():
    one, two, three = robots(3)
    sizes = [
        len(merge([merge(pair)[0], last])[0].to_bytes())
        for pair, last in (((one, two), three), ((two, one), three))
    ]
    assert sizes[0] == sizes[1]


def still(name, start):
    """A walk of a minute along one street."""
    walk = GridWalk(np.array([0, 1], np.int32), np.array([0, 60]), np.zeros(1, bool))
    return new_archive(
        QuantisationGrid((0, 0), 1000 * start, 128, 128),
        [name],
        GridWalks(np.array([[0, 0], [90, 0]]), (walk,)),
    )


def test_tracks_that_start_together_come_in_the_order_of_their_names():
    made, _ = merge([still(f"bus {number}", 0) for number in (10, 9, 11)])
    assert made.ids == ("bus 9", "bus 10", "bus 11")


def test_tracks_come_in_the_order_of_their_starts_where_names_are_worth_less():
    names = {
        name: 100_000 * number
        for number, name in enumerate(("q", "b", "x", "a", "m", "c", "z", "e"))
    }
    made, _ = merge([still(name, start) for name, start in sorted(names.items())])
    assert made.ids == tuple(names)


def test_prefixes_name_the_archives_as_given():
    archives = [still("0", 0), still("0", 500)]
    made, _ = merge(archives[::-1], MergeOptions(same_id="prefix"))
    assert {name: made.walk(name).times[0] for name in made.ids} == {"1:0": 500.0, "2:0": 0.0}


@pytest.mark.parametrize(
    ("smaller", "larger"),
    [
        ("a9", "a10"),
        ("a09", "a9"),
        ("7", "a"),
        ("a", "a0"),
        ("bus", "bus 1"),
        ("9" * 5000, "1" + "0" * 5000),
    ],
)
def test_numbers_in_names_count_by_their_value(smaller, larger):
    assert natural_sort_key(smaller) < natural_sort_key(larger)
