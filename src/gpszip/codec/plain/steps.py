"""Kinds of steps, and the known edge that a step takes; see ``gpszip.codec.kernels.step_coder``."""

from __future__ import annotations

from gpszip.codec.kernels.walk_priors import BIT_ESCAPE, BIT_NEW_NODE, BIT_STAY, BIT_TURN_BACK
from gpszip.codec.plain.model import (
    KIND_BACK,
    KIND_KNOWN,
    KIND_NEW_EDGE,
    KIND_NEW_NODE,
    KIND_STAY,
    PlainModel,
)
from gpszip.codec.plain.walk_map import HalfEdge

__all__ = ["read_known_edge", "read_step_kind"]

#: First contexts of the bits, as Python's integers.
_ESCAPE, _TURN_BACK, _STAY, _NEW_NODE = map(
    int, (BIT_ESCAPE, BIT_TURN_BACK, BIT_STAY, BIT_NEW_NODE)
)

#: Contexts tell at most so many edges of a node apart, and so many levels of traversals.
_MAX_DEGREE = 5
_MAX_LEVEL = 4

#: Largest sum of weights, half of what the range coder takes.
_MAX_WEIGHT_SUM = 1 << 40

#: The ratio at which edges of a turn are chosen is between these, in units of 2**-8.
_MIN_RATIO = 16
_MAX_RATIO = 4096

#: What the choice of an edge adds to the count of its turn.
_TURN_INCREMENT = 1 << 16

#: A pair of half-edges counts as at most so many.
_MAX_PAIR_COUNT = 1 << 16


def read_step_kind(model: PlainModel, u: int, incoming: HalfEdge | None, last_kind: int) -> int:
    """Read the kind of a step from u."""
    # Whether it leaves the known edges.
    edges = model.map.degree(u)
    degree, level = min(edges, _MAX_DEGREE), min(model.map.departures[u].bit_length(), _MAX_LEVEL)
    is_fresh = 1 if last_kind >= KIND_NEW_NODE else 0
    # A context is a number with mixed bases: 6 degrees, 5 levels, 2 kinds of freshness.
    if degree > 0 and not model.read_bit(_ESCAPE + (degree * 5 + level) * 2 + is_fresh):
        return _read_known_kind(model, degree, incoming, last_kind)

    # a stop, a new node, or a new edge, which leads from a known node to another one
    if model.read_bit(_STAY + last_kind * 2 + is_fresh):
        return KIND_STAY
    if len(model.map) < 2:
        return KIND_NEW_NODE
    is_new = model.read_bit(_NEW_NODE + min(degree, 3) * 5 + last_kind)
    return KIND_NEW_NODE if is_new else KIND_NEW_EDGE


def _read_known_kind(
    model: PlainModel, degree: int, incoming: HalfEdge | None, last_kind: int
) -> int:
    """Read whether a step along a known edge goes back; return its kind."""
    # Only one of the two is possible.
    if incoming is None:
        return KIND_KNOWN
    if degree == 1:
        return KIND_BACK

    # 2 if a walk went back here before, 1 if the half-edge back was ever taken
    back = incoming.opposite
    seen = 2 if incoming.followers.get(back, 0) else int(back.traversals > 0)
    context = (min(degree, 4) * 3 + seen) * 2 + (1 if last_kind == KIND_BACK else 0)
    return KIND_BACK if model.read_bit(_TURN_BACK + context) else KIND_KNOWN


def read_known_edge(
    model: PlainModel, u: int, before: int | None, incoming: HalfEdge | None
) -> HalfEdge:
    """Read the known half-edge from u that a step takes, save the one back, and learn the choice.

    See :func:`gpszip.codec.kernels.step_coder.code_known_edge`.
    """
    # a single one needs no choice
    back = incoming.opposite if incoming else None
    edges = [edge for edge in model.map.half_edges(u) if edge is not back]
    model.work.spend(len(edges))
    if len(edges) == 1:
        return edges[0]

    # Turns, and weights by these and by what followed the last half-edge.
    turns = [model.map.bearing(before, u, edge.end) for edge in edges]
    weights = [_weigh(model, edge, turn) for edge, turn in zip(edges, turns, strict=True)]
    if incoming and incoming.continued:
        total = sum(weights)
        weights = [
            weight + min(incoming.followers.get(edge, 0), _MAX_PAIR_COUNT) * total // 2
            for weight, edge in zip(weights, edges, strict=True)
        ]
    while sum(weights) > _MAX_WEIGHT_SUM:
        weights = [(weight >> 1) + 1 for weight in weights]

    # The choice; every edge could be chosen.
    choice, total = model.decoder.read_choice(weights), sum(weights)
    for turn, weight in zip(turns, weights, strict=True):
        model.turns_offered[turn] += (weight << 16) // total
    model.turns_chosen[turns[choice]] += _TURN_INCREMENT
    return edges[choice]


def _weigh(model: PlainModel, edge: HalfEdge, turn: int) -> int:
    """Weight of a half-edge by its traversals and its turn."""
    ratio = (model.turns_chosen[turn] << 8) // model.turns_offered[turn]
    traversals = 3 * edge.traversals + edge.opposite.traversals + 1
    return traversals * min(max(ratio, _MIN_RATIO), _MAX_RATIO)
