"""What follows a route, from what followed its ends before: a mixture over orders.

Of every context (the last 1, 2, 3, ... edges) the model counts which exits followed. Two ways lead
from counts to probabilities:

- A chain of Dirichlet estimates over the orders k, from the angles of the turns on:
  ``p[k](e) = (n[k](e) + c p[k-1](e)) / (n[k] + c)`` with c = 0.7 for each exit seen so far, as in
  the escapes of PPM (Cleary and Witten 1984).
- Logarithms of each order's own estimates, whose weights depend on how often the context was seen
  and whether always the same followed, as in logistic mixing (Mahoney 2005).

A softmax adds both up. Further experts say what this route did itself after the same edges, what
this agent does, and what is done at this hour. The weights are those that make the history's own
decisions the most probable, each predicted from what came before it.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.history.prediction.contexts import MASK, ORDERS, context_keys, label_keys, route_keys
from gpszip.history.prediction.counting import (
    CLASS_COUNTS,
    KINDS,
    Groups,
    count_all,
    count_before,
    group_contexts,
    kinds_of_counts,
)
from gpszip.history.prediction.exits import Exits
from gpszip.history.prediction.softmax import Feature, fit_weights, mix, softmax

__all__ = ["Passes", "SequenceModel", "train"]

#: Decisions from which the weights are learned, spread evenly over the later seven eighths of a
#: history. Three times as many change no digit that matters.
_DECISIONS = 12_000

#: Share of a history at its begin in which nothing is known yet.
_WARM_UP = 1 / 8

#: Traversals of a history, its latest, whose contexts of more than _SHORT edges are counted.
_LONG_MEMORY = 200_000
_SHORT = 2

#: Counts added to each exit in an order's own estimate.
_ADDED = 0.4

#: The c of the chain, for each exit seen.
_ESCAPE = 0.7

#: Before anything is known, the logarithm of a probability is this times the cosine of the turn,
#: and less by that for a turn back.
_STRAIGHT, _TURN_BACK = 1.5, 4.0

#: First weights: of the chain, and of each other expert. The search begins there.
_CHAIN_WEIGHT, _EXPERT_WEIGHT = 1.0, 0.15

#: Orders in which a route's own past, an agent and an hour are looked up.
_OWN_ORDERS = (1, 2, 4)
_SIDE_ORDERS = (1, 2)

#: Kinds of labels (:func:`label_keys`).
_EDGE, _ROUTE, _AGENT, _HOUR = range(4)

#: Logarithms of small counts with what is added, as most counts are small.
_LOGS = [math.log(count + _ADDED) for count in range(256)]

#: Least probability of the chain whose logarithm is taken.
_MIN_PROBABILITY = 1e-9

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Passes(NamedTuple):
    """Directed edges of many routes, end to end, in the order of time.

    Parameters
    ----------
    directed : int64 array, shape (n,)
        Twice the edge, plus 1 where it was travelled backward.
    starts : bool array, shape (n,)
        Whether a route begins with the edge.
    hour : int64 array, shape (n,)
        Hour of the day, -1 where unknown.
    agent : int64 array, shape (n,)
        Number of the agent.
    """

    directed: Ints
    starts: NDArray[np.bool_]
    hour: Ints
    agent: Ints


class _Weights(NamedTuple):
    """Weights of the experts; rows are orders, columns are classes of counts."""

    straight: float
    turn_back: float
    chain: float
    orders: Floats
    own: Floats


class _SideWeights(NamedTuple):
    """Weights where agent or hour are known; rows of both are _SIDE_ORDERS."""

    base: float
    agent: Floats
    hour: Floats


class _SideDecisions(NamedTuple):
    """Decisions from which the weights of agent and hour are learned, when first asked for.

    Parameters
    ----------
    base : float64 array, shape (m, D)
        Logarithms of the probabilities without them.
    exists : bool array, shape (m, D)
        Whether there is an exit.
    chosen : int64 array, shape (m,)
        The exit taken.
    counts : list of float64 arrays, shape (m, D)
        Counts by agent and hour by turns, for one order after the other.
    """

    base: Floats
    exists: NDArray[np.bool_]
    chosen: Ints
    counts: list[Floats]


class SequenceModel:
    """Probabilities of what follows a route; made by :func:`train`.

    Predicting takes 50 microseconds. A model learns further routes one by one.
    """

    def __init__(
        self,
        exits: Exits,
        weights: _Weights,
        decisions: _SideDecisions,
        keys: list[NDArray[np.uint64]],
        counts: list[Floats],
    ) -> None:
        # Exits as lists, since routes are asked about one at a time.
        self.exits = exits
        exists = exits.exists
        self._options: list[list[int]] = [
            row[there].tolist() for row, there in zip(exits.options, exists, strict=True)
        ]
        self._labels: list[int] = label_keys(np.arange(len(exits)), _EDGE).tolist()

        # What is known without a context.
        self._weights = weights
        self._side_decisions = decisions
        self._side_weights: dict[tuple[bool, bool], _SideWeights] = {}
        start = weights.straight * exits.cosines + weights.turn_back * exits.turns_back
        self._start: list[list[float]] = start.tolist()
        self._angle_prior: list[list[float]] = _angle_prior(exits).tolist()
        self._order_weights: list[list[float]] = weights.orders.tolist()
        self._own_weights: list[list[float]] = weights.own.tolist()

        # Rows of counts by the key of their context.
        all_keys = np.concatenate(keys)
        self._rows: dict[int, int] = dict(zip(all_keys.tolist(), range(len(all_keys)), strict=True))
        self._counts = np.concatenate(counts).astype(np.float32)
        self._used = len(all_keys)

    def __len__(self) -> int:
        """Return the number of contexts."""
        return self._used

    @property
    def options(self) -> list[list[int]]:
        """Directed edges that may follow each, in the order of :meth:`predict`."""
        return self._options

    def predict(
        self, route: Sequence[int], hour: int | None = None, agent: int | None = None
    ) -> list[float]:
        """Probability of each exit of a route's last edge.

        Parameters
        ----------
        route : sequence of int
            Directed edges, at least one, the last one last.
        hour : int, optional
            Hour of the day.
        agent : int, optional
            Number of the agent.

        Returns
        -------
        list of float
            In the order of ``options[route[-1]]``.
        """
        last = route[-1]
        width = len(self._options[last])
        if width < 2:
            return [1.0] * width

        # Counts of the route's contexts, from order 1 up to the longest that was seen.
        labels = [self._labels[edge] for edge in route[-ORDERS[-1] :]]
        keys: list[int] = []
        rows: list[int] = []
        for _, key in route_keys(labels):
            row = self._rows.get(key)
            if len(keys) < len(_SIDE_ORDERS):
                keys.append(key)
            if row is None:
                break
            rows.append(row)

        # The orders, their chain, and the route's own past.
        scores = self._start[last][:width]
        chain = self._angle_prior[last][:width]
        for weights, counts in zip(
            self._order_weights, self._counts[rows, :width].tolist(), strict=False
        ):
            chain = _add_order(scores, chain, counts, weights)
        factor = self._weights.chain
        for i in range(width):
            scores[i] += factor * math.log(max(chain[i], _MIN_PROBABILITY))
        self._add_own_past(scores, route, self._options[last])

        # The agent and the hour.
        probabilities = _softmax(scores)
        if hour is None and agent is None:
            return probabilities
        return self._with_sides(probabilities, keys, hour, agent)

    def learn(
        self, route: Sequence[int], hours: Sequence[int | None], agent: int | None = None
    ) -> None:
        """Count what followed in a route; the weights stay.

        Parameters
        ----------
        route : sequence of int
            Directed edges.
        hours : sequence of int or None
            Hour of the day of each.
        agent : int, optional
            Number of the agent.
        """
        labels = [self._labels[edge] for edge in route]
        for i in range(len(route) - 1):
            options = self._options[route[i]]
            if route[i + 1] not in options:
                continue
            exit_taken = options.index(route[i + 1])
            keys = [key for _, key in route_keys(labels[max(0, i + 1 - ORDERS[-1]) : i + 1])]
            sides = [_side_label(agent, _AGENT), _side_label(hours[i], _HOUR)]
            keys += [
                (key + label) & MASK
                for key in keys[: len(_SIDE_ORDERS)]
                for label in sides
                if label is not None
            ]
            for key in keys:
                row = self._row(key)  # may replace the array
                self._counts[row, exit_taken] += 1

    def _row(self, key: int) -> int:
        """Row of a context's counts, which may be a new one."""
        row = self._rows.get(key)
        if row is None:
            row = self._rows[key] = self._used
            self._used += 1
            if row == len(self._counts):
                new = np.zeros((row + 1, self._counts.shape[1]), np.float32)
                self._counts = np.concatenate((self._counts, new))
        return row

    def _add_own_past(
        self, scores: list[float], route: Sequence[int], options: Sequence[int]
    ) -> None:
        """Add what followed the same edges earlier in the route."""
        # Earlier passes over the last edge, with what followed and how many edges before agree.
        past = list(route)
        last, end = past[-1], len(past) - 1
        if past.count(last) == 1:
            return
        counts = [[0.0] * len(options) for _ in _OWN_ORDERS]
        at = past.index(last)
        while at < end:
            if past[at + 1] in options:
                exit_taken = options.index(past[at + 1])
                for row, order in zip(counts, _OWN_ORDERS, strict=True):
                    if at + 1 < order or past[at + 1 - order : at] != past[end + 1 - order : end]:
                        break
                    row[exit_taken] += 1.0
            at = past.index(last, at + 1)

        for row, weights in zip(counts, self._own_weights, strict=True):
            _add_expert(scores, row, weights)

    def _with_sides(
        self, probabilities: list[float], keys: list[int], hour: int | None, agent: int | None
    ) -> list[float]:
        """Probabilities with what the agent does, and what is done at the hour."""
        knows = agent is not None, hour is not None
        weights = self._side_weights.get(knows)
        if weights is None:
            weights = self._side_weights[knows] = _fit_sides(self._side_decisions, *knows)
        scores = [weights.base * math.log(max(p, _MIN_PROBABILITY)) for p in probabilities]
        known = (
            (_side_label(agent, _AGENT), weights.agent),
            (_side_label(hour, _HOUR), weights.hour),
        )
        for label, own in known:
            if label is None:
                continue
            for key, row_weights in zip(keys, own.tolist(), strict=False):
                row = self._rows.get((key + label) & MASK)
                if row is not None:
                    counts = self._counts[row, : len(scores)].tolist()
                    _add_expert(scores, counts, row_weights)
        return _softmax(scores)


@lru_cache(maxsize=100_000)
def _side_label(number: int | None, kind: int) -> int | None:
    """Key of an agent or an hour."""
    if number is None:
        return None
    return int(label_keys(np.array([number]), kind)[0])


def _softmax(scores: list[float]) -> list[float]:
    most = max(scores)
    weights = [math.exp(score - most) for score in scores]
    total = sum(weights)
    return [weight / total for weight in weights]


def _add_expert(scores: list[float], counts: list[float], weights: list[float]) -> float:
    """Add the weighted logarithms of an expert's estimates; return the sum of its counts."""
    total = sum(counts)
    if not total:
        return 0.0
    kind = bisect_left(CLASS_COUNTS, total) + 1
    if max(counts) == total:
        kind += len(CLASS_COUNTS) + 1
    weight = weights[kind]
    base = math.log(total + _ADDED * len(counts))
    for i, count in enumerate(counts):
        log = _LOGS[int(count)] if count < len(_LOGS) else math.log(count + _ADDED)
        scores[i] += weight * (log - base)
    return total


def _add_order(
    scores: list[float], chain: list[float], counts: list[float], weights: list[float]
) -> list[float]:
    """Add an order's estimates to the scores; return the chain with that order."""
    total = _add_expert(scores, counts, weights)
    escape = _ESCAPE * max(1, len(counts) - counts.count(0.0))
    return [
        (count + escape * prior) / (total + escape)
        for count, prior in zip(counts, chain, strict=True)
    ]


def _angle_prior(exits: Exits) -> Floats:
    """Probability of each exit by the angle of the turn, shape (2 E, D)."""
    scores = _STRAIGHT * exits.cosines - _TURN_BACK * exits.turns_back
    return softmax(scores, exits.exists | ~exits.exists.any(axis=1, keepdims=True))


def train(exits: Exits, passes: Passes) -> SequenceModel:
    """Learn a model from a history.

    Parameters
    ----------
    exits : Exits
        Exits of each directed edge.
    passes : Passes
        Routes in the order of time.

    Returns
    -------
    SequenceModel
        Deterministic.

    Examples
    --------
    >>> from gpszip.history.prediction.exits import list_exits
    >>> from gpszip.testing import ring
    >>> exits = list_exits(ring(4).network)
    >>> rounds = np.tile([0, 4, 7, 3], 20)  # edges 0 and 2 forward, then 3 and 1 backward
    >>> none = np.full(80, -1)
    >>> model = train(exits, Passes(rounds, np.arange(80) == 0, none, none + 1))
    >>> model.options[0], [round(p, 3) for p in model.predict([7, 3, 0])]
    ([1, 4], [0.0, 1.0])
    """
    # The exit taken at each moment, and the decisions from which weights are learned.
    chosen = _exits_taken(exits, passes)
    width = exits.options.shape[1]
    is_decision = (chosen >= 0) & (exits.exists.sum(axis=1) > 1)[passes.directed]
    decisions = np.flatnonzero(is_decision[int(_WARM_UP * len(chosen)) :])
    decisions += int(_WARM_UP * len(chosen))
    spread = np.linspace(0, len(decisions) - 1, min(len(decisions), _DECISIONS))
    decisions = decisions[spread.astype(np.int64)]

    # Counts of all contexts, and those before each decision.
    keys: list[NDArray[np.uint64]] = []
    counts: list[Floats] = []
    before: list[Floats] = []
    own: list[Floats] = []
    sides: list[Floats] = []
    routes = label_keys(np.cumsum(passes.starts), _ROUTE)
    for order, context, is_whole in context_keys(passes.directed, passes.starts):
        if order > _SHORT:
            is_whole[: max(0, len(chosen) - _LONG_MEMORY)] = False
        groups = group_contexts(context, is_whole & (chosen >= 0) | _asked(is_whole, decisions))
        _keep(groups, chosen, width, keys, counts)
        before.append(count_before(groups, chosen, width, decisions))
        if order in _OWN_ORDERS:
            groups = group_contexts(context + routes, is_whole)
            own.append(count_before(groups, chosen, width, decisions))
        if order in _SIDE_ORDERS:
            for kind, labels in ((_AGENT, passes.agent), (_HOUR, passes.hour)):
                groups = group_contexts(
                    context + label_keys(labels, kind), is_whole & (labels >= 0)
                )
                _keep(groups, chosen, width, keys, counts)
                sides.append(count_before(groups, chosen, width, decisions))

    # Weights of the experts that need the route only, then of those that know agent or hour.
    empty = np.zeros((len(decisions), width))
    before += [empty] * (len(ORDERS) - len(before))
    own += [empty] * (len(_OWN_ORDERS) - len(own))
    sides += [empty] * (2 * len(_SIDE_ORDERS) - len(sides))
    last = passes.directed[decisions]
    weights, base = _fit_weights(exits, last, chosen[decisions], before, own)
    known = _SideDecisions(base, exits.exists[last], chosen[decisions], sides)
    if not keys:
        keys, counts = [np.zeros(0, np.uint64)], [np.zeros((0, width))]
    return SequenceModel(exits, weights, known, keys, counts)


def _asked(is_whole: NDArray[np.bool_], decisions: Ints) -> NDArray[np.bool_]:
    """Whether each moment is a decision with a whole context."""
    asked = np.zeros(len(is_whole), np.bool_)
    asked[decisions] = is_whole[decisions]
    return asked


def _keep(
    groups: Groups,
    chosen: Ints,
    width: int,
    keys: list[NDArray[np.uint64]],
    counts: list[Floats],
) -> None:
    """Append the keys and counts of the contexts after which something followed."""
    total = count_all(groups, chosen, width)
    known = total.any(axis=1)
    keys.append(groups.keys[known])
    counts.append(total[known])


def _exits_taken(exits: Exits, passes: Passes) -> Ints:
    """Exit taken at the end of each edge, -1 where a route ends or goes on elsewhere."""
    following = np.append(passes.directed, -1)[1:]
    following[np.append(passes.starts, True)[1:]] = -2
    is_taken = exits.options[passes.directed] == following[:, None]
    return np.where(is_taken.any(axis=1), is_taken.argmax(axis=1), -1)


def _expert(counts: Floats, exists: NDArray[np.bool_]) -> Feature:
    """Logarithms of an expert's estimates; nothing where it has seen nothing."""
    total = counts.sum(axis=1, keepdims=True)
    exits = exists.sum(axis=1, keepdims=True)
    logs = np.log((counts + _ADDED) / (total + _ADDED * exits))
    kind = kinds_of_counts(counts)
    return Feature(np.where(exists & (total > 0), logs, 0.0), kind, KINDS, _EXPERT_WEIGHT)


def _fit_weights(
    exits: Exits, last: Ints, chosen: Ints, before: list[Floats], own: list[Floats]
) -> tuple[_Weights, Floats]:
    """Fit the weights of the experts that need the route only; return them, and log p."""
    exists = exits.exists[last]
    one_kind = np.zeros(len(last), np.int64)

    # The chain over the orders.
    chain = _angle_prior(exits)[last]
    for counts in before:
        seen = np.maximum((counts > 0).sum(axis=1, keepdims=True), 1)
        escape = _ESCAPE * seen
        chain = (counts + escape * chain) / (counts.sum(axis=1, keepdims=True) + escape)
    log_chain = np.where(exists, np.log(np.maximum(chain, _MIN_PROBABILITY)), 0.0)

    # All features, in the order of the weights.
    features = [
        Feature(exits.cosines[last], one_kind, 1, 0.0),
        Feature(exits.turns_back[last].astype(np.float64), one_kind, 1, 0.0),
        Feature(log_chain, one_kind, 1, _CHAIN_WEIGHT),
        *(_expert(counts, exists) for counts in (*before, *own)),
    ]
    fitted = fit_weights(features, exists, chosen)
    straight, turn_back, chain_weight = fitted[:3].tolist()
    experts = fitted[3:].reshape(-1, KINDS)
    weights = _Weights(
        straight, turn_back, chain_weight, experts[: len(before)], experts[len(before) :]
    )
    probabilities = softmax(mix(features, fitted), exists)
    return weights, np.where(exists, np.log(np.maximum(probabilities, _MIN_PROBABILITY)), 0.0)


def _fit_sides(known: _SideDecisions, knows_agent: bool, knows_hour: bool) -> _SideWeights:
    """Fit the weights for what is known: the agent, the hour, or both."""
    one_kind = np.zeros(len(known.base), np.int64)
    none = np.zeros((len(_SIDE_ORDERS), KINDS))
    counts = [
        *(known.counts[0::2] if knows_agent else []),
        *(known.counts[1::2] if knows_hour else []),
    ]
    experts = [_expert(each, known.exists)._replace(start=0.0) for each in counts]
    features = [Feature(known.base, one_kind, 1, 1.0), *experts]
    fitted = fit_weights(features, known.exists, known.chosen)
    weights = fitted[1:].reshape(-1, len(_SIDE_ORDERS), KINDS)
    return _SideWeights(
        float(fitted[0]), weights[0] if knows_agent else none, weights[-1] if knows_hour else none
    )
