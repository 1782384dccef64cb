"""Phones that people carry, with the kinds of noise that real ones have, and their true trips.

Ways follow streets with red lights; people walk to their cars, and wait for trains. The phone
drifts while it lies still, falls silent, gives poor fixes of the network, jumps to a wrong place
for minutes, and may begin with a stale fix.
"""

from dataclasses import dataclass, field

import numpy as np

from gpszip.testing.noise import drift

#: Metres by which a phone that lies still is off at most.
MAX_DRIFT = 74.0


@dataclass
class Day:
    """Where someone truly is: knots of a way that is linear in time, trips, and stays."""

    times: list = field(default_factory=lambda: [0.0])
    places: list = field(default_factory=lambda: [np.zeros(2)])
    trips: list = field(default_factory=list)
    stays: list = field(default_factory=list)

    @property
    def now(self):
        return self.times[-1]

    def wait(self, seconds):
        self.times.append(self.now + seconds)
        self.places.append(self.places[-1])

    def stay(self, seconds):
        begin = self.now
        if self.stays and self.stays[-1][1] == begin:
            begin = self.stays.pop()[0]
        self.wait(seconds)
        self.stays.append((begin, self.now, self.places[-1]))

    def go(self, goal, speed, rng):
        """Along streets of some hundred metres, with red lights for whoever drives."""
        while np.linalg.norm(goal - self.places[-1]) > 350:
            left = goal - self.places[-1]
            axis = int(rng.random() > abs(left[0]) / np.abs(left).sum())
            step = np.zeros(2)
            step[axis] = np.sign(left[axis]) * min(abs(left[axis]), rng.uniform(150, 400))
            self._line(self.places[-1] + step + rng.normal(0, 5, 2), speed * rng.uniform(0.7, 1.3))
            if speed > 3 and rng.random() < 0.25:
                self.wait(rng.uniform(10, 100))
        self._line(np.asarray(goal, float), speed)

    def _line(self, goal, speed):
        self.times.append(self.now + max(np.linalg.norm(goal - self.places[-1]) / speed, 1.0))
        self.places.append(goal)

    def at(self, times):
        return np.stack([np.interp(times, self.times, axis) for axis in np.array(self.places).T], 1)


def drive(day, goal, rng):
    """A trip by car, with a walk to it."""
    begin = day.now
    day.go(day.places[-1] + rng.normal(0, 60, 2), 1.3, rng)
    day.wait(rng.uniform(20, 90))
    day.go(goal, 9.0, rng)
    day.trips.append((begin, day.now))


def ride(day, goal, rng):
    """A trip by train, with ways to and from stations, and waits there."""
    begin, way = day.now, goal - day.places[-1]
    stations = [day.places[-1] + share * way + rng.normal(0, 150, 2) for share in (0.12, 0.88)]
    day.go(stations[0], 4.5, rng)
    day.wait(rng.uniform(120, 780))
    day.go(stations[1], 14.0, rng)
    day.wait(rng.uniform(60, 480))
    day.go(goal, 4.5, rng)
    day.trips.append((begin, day.now))


def a_round_trip(travel, seed, far=(3000, 12_000)):
    """There and back."""
    rng = np.random.default_rng(seed)
    day = Day()
    day.stay(rng.uniform(400, 2400))
    angle = rng.uniform(0, 2 * np.pi)
    goal = rng.uniform(*far) * np.array([np.cos(angle), np.sin(angle)])
    travel(day, goal, rng)
    day.stay(rng.uniform(150, 5000))
    travel(day, np.zeros(2), rng)
    day.stay(rng.uniform(400, 2400))
    return day


def record(day, seed, *, period=5.0, idle=60.0, wakes=None, poor=0.08):
    """Times, positions and stated errors of a phone.

    Parameters
    ----------
    day : Day
        The truth.
    period, idle : float
        Seconds between fixes in motion, and two minutes after it.
    wakes : float, optional
        Metres from where it fell silent at which a phone wakes that is silent while it lies still.
    poor : float
        Share of fixes of the network.
    """
    # When it records.
    rng = np.random.default_rng(seed + 1000)
    times = np.arange(0.0, day.now, period)
    places = day.at(times)
    moves = np.append(True, np.linalg.norm(np.diff(places, axis=0), axis=1) > 0.1)
    rest = times - np.maximum.accumulate(np.where(moves, times, -np.inf))
    kept = (rest < 180) | (times % idle == 0)
    if wakes is not None:
        begins = np.flatnonzero((rest >= 180) & (np.append(0, rest[:-1]) < 180))
        kept = rest < 180
        for i in begins:
            away = np.linalg.norm(places[i:] - places[i], axis=1) > wakes
            kept[i : i + int(away.argmax() or len(away))] = False
    times, places, rest = times[kept], places[kept], rest[kept]

    # Errors of satellites, smaller in motion, and of the network.
    n, is_still = len(times), rest[:, None] > 60
    errors = np.where(is_still, drift(n, 18.0, 50, rng), drift(n, 4.0, 10, rng))
    size = np.linalg.norm(errors, axis=1, keepdims=True)
    errors *= np.minimum(size, MAX_DRIFT) / np.maximum(size, 1e-9)
    accuracy = rng.choice([8.0, 16.0, 35.0], n)
    is_poor = rng.random(n) < poor
    accuracy[is_poor] = np.exp(rng.uniform(np.log(150), np.log(4000), is_poor.sum()))
    angle = rng.uniform(0, 2 * np.pi, n)
    far = accuracy * rng.uniform(0.2, 1.0, n)
    errors[is_poor] = (far * np.stack([np.cos(angle), np.sin(angle)])).T[is_poor]

    # A wrong place for minutes, and a stale first fix.
    wrong = rng.uniform(0, day.now)
    is_wrong = (times > wrong) & (times < wrong + rng.uniform(10, 400))
    errors[is_wrong] = rng.normal(0, 2000, 2) + rng.normal(0, 10, (n, 2))[is_wrong]
    positions, accuracy = places + errors, np.where(is_wrong, 40.0, accuracy)
    stale = np.exp(rng.uniform(np.log(60), np.log(1e6)))
    return (
        np.append(times[0] - stale, times),
        np.vstack([rng.normal(0, 3000, 2), positions]),
        np.append(20.0, accuracy),
    )


def overlap(one, other):
    """Intersection of two time ranges as a share of their union."""
    both = min(one[1], other[1]) - max(one[0], other[0])
    return max(both, 0.0) / (max(one[1], other[1]) - min(one[0], other[0]))


def f1(pairs):
    """Score of lists of found and of true trips, which match if they overlap by more than half."""
    hits = sum(
        any(overlap(trip, each) > 0.5 for each in found) for found, true in pairs for trip in true
    )
    return 2 * hits / sum(len(found) + len(true) for found, true in pairs)


def plain_trips(times, positions, accuracy, radius=200.0, shortest=180.0, join=300.0):
    """Trips by a radius and a duration, as trackers find them, with short ones joined."""
    good = accuracy <= 100
    times, positions = times[good], positions[good]
    stays, i = [], 0
    while i < len(times):
        away = np.linalg.norm(positions[i:] - positions[i], axis=1) > radius
        after = i + int(away.argmax()) if away.any() else len(times)
        if times[after - 1] - times[i] >= shortest:
            stays.append((times[i], times[after - 1]))
            i = after
        else:
            i += 1

    trips = []
    for (_, begin), (end, _) in zip([(0, times[0]), *stays], [*stays, (times[-1], 0)], strict=True):
        if trips and begin - trips[-1][1] <= join:
            trips[-1] = (trips[-1][0], end)
        elif end > begin:
            trips.append((begin, end))
    return trips
