"""Agents are compared with those who came by the same route: a plain twin, and two bus lines."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gpszip.history.changes.alike_routes import compare_routes
from gpszip.history.changes.choices import list_choices
from gpszip.history.changes.closures import find_closures
from gpszip.history.traversals import Traversals
from gpszip.model import Network
from history_rows import drives, street, true_traversals

#: Nodes of a square with both diagonals of its middle: two loops that share edge 0, and its chord.
_NODES = np.array([[0.0, 0], [100, 0], [200, 60], [100, 120], [200, -60], [100, -120]])

#: From the shared edge the loops lead up (edges 1 to 3) or down (4 to 6).
_EDGES = np.array([[0, 1], [1, 2], [2, 3], [3, 0], [1, 4], [4, 5], [5, 0]])
_UP, _DOWN = [0, 1, 2, 3], [0, 4, 5, 6]


def loops(rounds: list[tuple[int, list[int]]]) -> tuple[Network, Traversals]:
    """Rounds of cars over edges, each taking 600 s, car by car."""
    points = _NODES[_EDGES].reshape(-1, 2)
    yes = np.ones(7, bool)
    network = Network(
        _NODES,
        _EDGES[:, 0].astype(np.int32),
        _EDGES[:, 1].astype(np.int32),
        2 * np.arange(8),
        points,
        yes,
        yes,
        np.full(7, np.nan),
    )
    rounds = sorted(rounds, key=lambda each: each[0])
    car = np.concatenate([[number] * len(way) for number, way in rounds])
    edge = np.concatenate([way for _, way in rounds])
    starts = np.append(True, np.diff(car) != 0)
    index = np.arange(len(car))
    since = index - np.maximum.accumulate(np.where(starts, index, 0))
    enter = 150.0 * since + car
    zero = np.zeros(len(car))
    return network, Traversals(
        tuple(f"car {i}" for i in range(car.max() + 1)),
        car.astype(np.int32),
        edge,
        np.ones(len(car), bool),
        enter,
        enter + 150,
        zero,
        network.lengths[edge],
        zero,
        starts,
    )


def test_probabilities_are_those_of_a_plain_twin(vans):
    rows, network = true_traversals(vans), vans.network
    known = rows.enter < np.quantile(rows.enter, 0.4)
    choices = list_choices(network, rows, known, ~known)
    found = compare_routes(rows, known, choices)

    def recent(at):
        own = [
            int(rows.directed[at - k])
            if at >= k
            and rows.track[at - k] == rows.track[at]
            and rows.enter[at] - rows.enter[at - k] < 3 * 3600
            else -1
            for k in range(1, 31)
        ]
        return own, set(own) - {-1}

    def apart(one, other):
        (a, a_set), (b, b_set) = recent(one), recent(other)
        return len(a_set ^ b_set) + sum(4 * (a[k] != b[k]) for k in (1, 2, 3))

    rng = np.random.default_rng(1)
    counts = np.bincount(choices.traversal)
    several = np.flatnonzero(counts[choices.traversal] > 1)
    for row in rng.choice(several, 25, replace=False).tolist():
        at, option = int(choices.traversal[row]), choices.option[row]
        others = [
            i
            for i in np.flatnonzero(known & ~rows.starts).tolist()
            if rows.directed[i - 1] == rows.directed[at - 1]
        ]
        others = sorted(others, key=lambda i: rows.enter[i])[-300:]
        far = np.array([apart(at, i) for i in others])
        weight = np.where(far <= far.min() + 8, np.exp(-0.35 * (far - far.min())), 0.0)
        took = rows.directed[others] == option
        expected = (weight @ took + choices.probability[row]) / (weight.sum() + 1)
        assert found.probability[row] == pytest.approx(expected, rel=1e-5)
        assert found.is_usual[row] == (far.min() <= 9)


def test_a_line_that_is_not_served_is_not_closed():
    # Two cars serve both loops by turns, a day each; then both go down only.
    rounds = [(car, way) for car in (0, 1) for way in [*[_UP] * 20, *[_DOWN] * 20] * 3]
    network, rows = loops(rounds + [(car, _DOWN) for car in (0, 1) for _ in range(40)])
    after = rows.enter >= 150 * 4 * 121
    assert not len(find_closures(network, rows, after, 7.0).directed)


def test_turning_back_before_the_junction_or_on_the_edge_is_no_closure():
    # Cars go on to an edge and turn back at a stop after 30 of 100 m, but five go to its end.
    rows, ends = [], []
    for car in range(60):
        time, whole = 1000.0 * car, car < 5
        way = [(0, True), (1, True), (1, False)] if car < 40 or car % 2 else [(0, True), (0, False)]
        rows += [(car, *each, time + 10 * i, time + 10 * i + 10) for i, each in enumerate(way)]
        reach = (100.0 if whole else 30.0) if len(way) == 3 else 50.0
        ends += (
            [(0.0, 100.0), (0.0, reach), (reach, 0.0)]
            if len(way) == 3
            else [
                (0.0, reach),
                (reach, 0.0),
            ]
        )
    begin, end = np.array(ends).T
    traversals = replace(drives(rows), begin=begin, end=end)
    after = traversals.enter >= 20_000
    assert not len(find_closures(street(2), traversals, after, 2.0).directed)


def test_a_closed_edge_is_found_in_a_few_rounds():
    # They go up, and in the end have to go round by the other loop.
    rounds = [(car, way) for car in (0, 1) for way in [*[_DOWN] * 20, *[_UP] * 20] * 3]
    rounds += [(car, _UP) for car in (0, 1) for _ in range(3)]
    network, rows = loops(rounds + [(car, _DOWN) for car in (0, 1) for _ in range(4)])
    after = rows.enter >= 150 * 4 * 120
    found = find_closures(network, rows, after, 5.0)
    assert found.directed.tolist() == [2]
    assert found.missed.tolist() == [2]
    assert found.evidence[0] <= 2 * 2 * -math.log(0.05)
