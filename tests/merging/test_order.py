"""The order of the archives does not change the bytes of a merge; tracks have a defined order."""

from functools import cache

import numpy as np
import pytest

from gpszip.archive import new_archive
from gpszip.merging.deviation import natural_sort_key
from gpszip.model import GridWalk, GridWalks, Options, QuantisationGrid, Track
from gpszip.model.merge_options import MergeOptions
from gpszip.pipeline.compress import compress
from gpszip.pipeline.merge import merge
from gpszip.testing import patrol


@cache
def build_runs(count, shift=0.0, dimension=2):
    """A robot's rounds in runs, each an archive of some 20 bytes; in 3-D it climbs eastwards."""
    log = patrol(1200, seed=4)
    positions = log.positions + shift
    positions = np.column_stack((positions, 0.2 * positions[:, 0])) if dimension > 2 else positions
    return [
        compress(
            Track(f"run {number}", log.times[rows], positions[rows]), Options(rmse=0.5, effort=1)
        )[0]
        for number, rows in enumerate(np.array_split(np.arange(len(log)), count))
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
    "tiny": lambda: build_runs(3),
    "3-D": lambda: build_runs(3, dimension=3),
    "far apart": lambda: [*build_runs(3)[:2], build_runs(3, shift=5000.0)[2]],
    "one large and some tiny": lambda: [*build_runs(6)[:2], merge(build_runs(6)[2:])[0]],
    "equal": equal_archives,
}


#: Each archive at each position.
ORDERS = ((0, 1, 2), (1, 2, 0), (2, 0, 1))


@cache
def build_archives(name):
    return SETS[name]()


@cache
def merge_in_order(name, order):
    archives = build_archives(name)
    return merge([archives[number] for number in order])


@pytest.mark.parametrize("name", SETS)
def test_any_order_gives_the_same_bytes(name):
    # The reverse is merged for its deviations anyway.
    orders = (*ORDERS, (2, 1, 0)) if name == "tiny" else ORDERS
    assert len({merge_in_order(name, order)[0].to_bytes() for order in orders}) == 1


def test_deviations_are_in_the_order_of_the_archives():
    given, reverse = (
        merge_in_order("tiny", order)[1].deviations for order in ((0, 1, 2), (2, 1, 0))
    )
    assert given == reverse[::-1]
    assert len({deviation.rms for deviation in given}) == 3


def test_the_order_within_a_pair_does_not_change_the_bytes():
    one, two, _ = build_archives("tiny")
    assert merge([one, two])[0].to_bytes() == merge([two, one])[0].to_bytes()


def build_street(name, start):
    """A walk of a minute along one street."""
    walk = GridWalk(np.array([0, 1], np.int32), np.array([0, 60]), np.zeros(1, bool))
    return new_archive(
        QuantisationGrid((0, 0), 1000 * start, 128, 128),
        [name],
        GridWalks(np.array([[0, 0], [90, 0]]), (walk,)),
    )


def test_tracks_with_one_start_are_in_the_order_of_their_names():
    made, _ = merge([build_street(f"bus {number}", 0) for number in (10, 9, 11)])
    assert made.ids == ("bus 9", "bus 10", "bus 11")


def test_tracks_are_in_the_order_of_their_starts_where_that_saves_bytes():
    names = {
        name: 100_000 * number
        for number, name in enumerate(("q", "b", "x", "a", "m", "c", "z", "e"))
    }
    made, _ = merge([build_street(name, start) for name, start in sorted(names.items())])
    assert made.ids == tuple(names)


def test_prefixes_number_the_archives_in_the_order_given():
    archives = [build_street("0", 0), build_street("0", 500)]
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
def test_numbers_in_names_are_sorted_by_value(smaller, larger):
    assert natural_sort_key(smaller) < natural_sort_key(larger)
