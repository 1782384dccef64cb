"""The synthetic months of a person with a phone, similar to the thesis's (section 8.2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OptionError
from gpszip.model import Walk
from gpszip.testing.log_with_truth import LogWithTruth, join_truth
from gpszip.testing.roads import Roads, build_roads, drive, record

__all__ = ["person", "person_places"]

#: Blocks along each side of the town, and the fewest, at which it has a crossing for each place.
_BLOCKS, _FEWEST_BLOCKS = 14, 3

#: Mean metres between two crossings.
_BLOCK = 260.0

#: Metres per second on foot, and by car.
_SPEEDS = (1.4, 9.0)

#: Longest way in metres that is walked.
_WALKED = 900.0

#: What a day may hold: the kind of place, the hour of departure, and the chance on a weekday and on
#: a weekend.
_DAY = (
    ("work", 8.3, 0.95, 0.05),
    ("errand", 12.2, 0.35, 0.5),
    ("work", 13.3, 0.9, 0.0),
    ("gym", 17.5, 0.45, 0.3),
    ("friends", 19.2, 0.2, 0.45),
    ("errand", 20.4, 0.1, 0.1),
    ("home", 22.0, 1.0, 1.0),
)

#: Standard deviation of the hour of a departure.
_HOURS = 0.25

#: Number of places for errands, chosen ever less often.
_ERRANDS = 12

#: Mean seconds between the samples of a phone that stays in place.
_STILL_PERIOD = 3600.0

#: Share of trips on which the phone records nothing.
_UNRECORDED = 0.15

#: Share of moving samples with which the phone begins to lose some.
_DROPS = 0.01

#: Most samples in a row that it loses then.
_LONGEST_DROP = 15

#: Share of samples that jump.
_JUMPS = 0.003

#: Standard deviation of a jump along each axis, in metres.
_JUMP = 1500.0

#: Seconds of a day.
_SECONDS = 86_400.0

Floats = NDArray[np.float64]


def person(
    days: int = 243,
    *,
    seed: int = 1,
    period: float = 12.0,
    noise: float = 8.0,
    blocks: int = _BLOCKS,
    id: str = "phone",
) -> LogWithTruth:
    """Generate the log of a phone that a person carries for months.

    The person lives at home, works on weekdays, and goes to the gym, to friends and on errands: on
    foot where that is near, else by car. The phone records every few seconds while it moves, and
    now and then while it stays. It loses samples on the way, at times a whole trip, and some
    positions jump by kilometres.

    Parameters
    ----------
    days : int
        Number of days, the first a Monday; at least 1. The default is 8 months.
    seed : int
        Seed of the random generator; selects the town, the places, the days and the errors.
    period : float
        Seconds between two samples while the phone moves.
    noise : float
        Standard deviation of the position error in metres, except for jumps.
    blocks : int
        Number of blocks of 260 m along each side of the town, at least 3.
    id : str
        Name of the track.

    Returns
    -------
    LogWithTruth
        One track. Node 0 of its walk is home. ``errors`` tell jumps; what was lost is on the walk.

    Raises
    ------
    OptionError
        If there is no day, or the town is too small for all places.

    Examples
    --------
    >>> person(7)
    LogWithTruth(1 track, 693 samples, 225 nodes, 390 edges)
    """
    if days < 1:
        raise OptionError(f"a log of {days} days has no samples", remedy="give 1 day or more")

    # The town, and where the person is when.
    rng = np.random.default_rng(seed)
    roads = _build_town(blocks, rng)
    places = _choose_places(roads, rng)
    walk = _live(id, roads, places, days, rng)

    # What the phone records of that.
    times = _recorded_times(walk, days * _SECONDS, period, rng)
    errors = rng.normal(0, noise, (len(times), 2))
    jumps = rng.random(len(times)) < _JUMPS
    errors[jumps] += rng.normal(0, _JUMP, (int(jumps.sum()), 2))
    track, truth, walk = record(walk, roads.nodes, times, errors)
    return join_truth([track], [truth], roads.nodes, roads.edges, [walk])


def person_places(*, seed: int = 1, blocks: int = _BLOCKS) -> dict[str, Floats]:
    """Return where the person of :func:`person` lives, works and goes.

    Parameters
    ----------
    seed, blocks : int
        Those of the person.

    Returns
    -------
    dict of str to float64 array, shape (n, 2)
        Metres, for ``home``, ``work``, ``friends``, ``gym`` and the 12 of ``errand``.

    Examples
    --------
    >>> home = person_places(seed=3)["home"][0]
    >>> bool((home == person(1, seed=3).road_map.nodes[person(1, seed=3).walks[0].nodes[0]]).all())
    True
    """
    rng = np.random.default_rng(seed)
    roads = _build_town(blocks, rng)
    return {name: roads.nodes[nodes] for name, nodes in _choose_places(roads, rng).items()}


def _build_town(blocks: int, rng: np.random.Generator) -> Roads:
    """Return the roads of a town that has a crossing for each place."""
    if blocks < _FEWEST_BLOCKS:
        raise OptionError(
            f"a town of {blocks} blocks has too few crossings",
            remedy=f"give {_FEWEST_BLOCKS} or more",
        )
    return build_roads(blocks, _BLOCK, rng)


def _choose_places(roads: Roads, rng: np.random.Generator) -> dict[str, NDArray[np.int32]]:
    """Return the nodes of each kind of place; all kinds but errands have one."""
    # Home and friends live anywhere, the gym is near work, errands are near home.
    home, work, friends = rng.choice(len(roads.nodes), 3, replace=False)
    taken = [home, work, friends]
    gym = _choose_near(roads, work, 1, taken, rng)
    errands = _choose_near(roads, home, _ERRANDS, [*taken, *gym], rng)
    one = {"home": home, "work": work, "friends": friends, "gym": gym[0]}
    return {name: np.array([node], np.int32) for name, node in one.items()} | {"errand": errands}


def _choose_near(
    roads: Roads, center: int, count: int, taken: list[int], rng: np.random.Generator
) -> NDArray[np.int32]:
    """Return nodes that are not taken, near ones more likely than others."""
    distances = np.linalg.norm(roads.nodes - roads.nodes[center], axis=1)
    weights = np.exp(-distances / _WALKED)
    weights[taken] = 0.0
    chosen = rng.choice(len(roads.nodes), count, replace=False, p=weights / weights.sum())
    return chosen.astype(np.int32)


def _live(
    name: str,
    roads: Roads,
    places: dict[str, NDArray[np.int32]],
    days: int,
    rng: np.random.Generator,
) -> Walk:
    """Return the walk of a number of days, which begins at home at midnight."""
    # What each day holds, a row for each day: weekends are days 5 and 6 of a week.
    is_weekend = np.arange(days) % 7 >= 5
    chances = np.array([entry[2:] for entry in _DAY]).T[is_weekend.astype(int)]
    chosen = rng.random(chances.shape) < chances

    # Where it leads, some errands more often than others, and when.
    nodes = [
        places[place][np.minimum(rng.geometric(0.3, days), len(places[place])) - 1]
        for place, *_ in _DAY
    ]
    hours = np.array([entry[1] for entry in _DAY])
    hours = hours + _HOURS * np.clip(rng.standard_normal(chosen.shape), -3, 3)
    departures = np.arange(days)[:, None] * _SECONDS + hours * 3600.0

    # Drives, without those that lead to where the person is.
    stops = np.append(places["home"], np.stack(nodes, axis=1)[chosen])
    moves = np.diff(stops) != 0
    stops = np.append(stops[:1], stops[1:][moves]).astype(np.int32)
    ways = np.linalg.norm(np.diff(roads.nodes[stops], axis=0), axis=1)
    speeds = np.where(ways < _WALKED, *_SPEEDS) * rng.uniform(0.85, 1.15, len(ways))
    begins = np.maximum.accumulate(departures[chosen][moves])
    walk = drive(name, roads, stops, begins, speeds, until=days * _SECONDS)

    # The first night at home.
    assert walk.times is not None
    return Walk(
        name,
        np.append(walk.nodes[:1], walk.nodes),
        np.append(0.0, walk.times),
        np.append(False, walk.gaps),
    )


def _recorded_times(walk: Walk, duration: float, period: float, rng: np.random.Generator) -> Floats:
    """Return the times at which the phone records: often on trips, and seldom between them."""
    # Trips are what lies between two waits.
    assert walk.times is not None
    waits = np.flatnonzero(walk.nodes[1:] == walk.nodes[:-1])
    begins, ends = walk.times[waits[:-1] + 1], walk.times[waits[1:]]

    # Samples on trips, and those that are left of them.
    recorded = rng.random(len(begins)) >= _UNRECORDED
    counts = np.where(recorded, (ends - begins) // period, 0).astype(int)
    number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    moving = np.repeat(begins, counts) + number * period
    moving = moving[~_drops(len(moving), rng)]

    # Samples between trips.
    still = np.cumsum(rng.exponential(_STILL_PERIOD, int(2 * duration / _STILL_PERIOD) + 2))
    trip = np.searchsorted(begins, still, side="right") - 1
    on_trip = (trip >= 0) & (still <= np.append(ends, 0.0)[trip])  # -1 is before all
    still = still[~on_trip & (still < duration)]
    return np.unique(np.concatenate([[0.0], moving, still]))


def _drops(count: int, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Whether each moving sample is lost: a random number after each of some samples."""
    first = np.flatnonzero(rng.random(count) < _DROPS)
    after = np.minimum(first + rng.integers(1, _LONGEST_DROP + 1, len(first)), count)
    change = np.zeros(count + 1, np.int64)
    np.add.at(change, first, 1)
    np.add.at(change, after, -1)
    return np.cumsum(change[:-1]) > 0
