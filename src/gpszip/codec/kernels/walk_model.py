"""What the coder of walks knows so far: the graph, and how often and how fast edges were taken.

An undirected edge is two half-edges with numbers 2 e and 2 e + 1, so that ``half_edge ^ 1`` is the
opposite one. The half-edges of a node are a linked list, the newest first. Everything is on arrays
that kernels change in place. Positions are in space steps, times in time steps, and logarithms in
units of 2**-16.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.adaptive import MIXTURE_ROWS, SUBSTEPS
from gpszip.codec.kernels.log2 import fixed_log2
from gpszip.codec.kernels.rotation import DIRECTIONS, nearest_direction
from gpszip.codec.kernels.walk_priors import (
    DISTRIBUTIONS,
    HISTOGRAM_BINS,
    MIXTURES,
    initial_bit_counts,
    initial_chosen,
    initial_mixture_weights,
    initial_offered,
)
from gpszip.kernels.jit import inner_uncounted, jit, jit_uncounted
from gpszip.kernels.pair_table import find_pair_slot

__all__ = [
    "CHEAP_CHOICES",
    "DURATION_BITS",
    "DURATION_SUM",
    "GAP_BITS",
    "HAS_PACE",
    "HEADING",
    "LAST_DURATION",
    "LAST_LENGTH",
    "LAST_LOG_DURATION",
    "LAST_TRACK_END",
    "LAST_TRACK_START",
    "LENGTH_CLASSES",
    "LENGTH_SUM",
    "LOG_PACE",
    "MARK_RANK",
    "MARK_SEARCH",
    "MAX_EDGE_SAMPLES",
    "MAX_MAGNITUDE",
    "MAX_MEAN_SAMPLES",
    "MAX_SEARCH_NODES",
    "MEAN_LOG",
    "MEAN_LOG_PACE",
    "MEAN_SAMPLES",
    "MODES",
    "NEXT_START",
    "NODE_COUNT",
    "NO_TURN",
    "PATH_END",
    "PATH_NEXT",
    "POSITION_BITS",
    "ROW_GAP",
    "ROW_NEW_NODE",
    "ROW_STAY",
    "SEARCHES",
    "SHORTEST_PATHS",
    "SORTED_STARTS",
    "START_BITS",
    "START_IS_TAKEN",
    "START_TIME_STEP",
    "STATISTICS",
    "STEP_KIND_BITS",
    "STEP_LENGTH",
    "TIME_FIRST",
    "TURN",
    "WalkModel",
    "add_end_weight",
    "add_node",
    "end_weight_below",
    "extended",
    "find_by_end_weight",
    "find_half_edge",
    "forget_heading",
    "learn_step",
    "length_class",
    "log_duration",
    "new_model",
    "node_distance",
    "pair_count",
    "record_bits",
    "update_mean_log",
    "with_modes",
]

#: Index of each number in ``WalkModel.scalars``.
NODE_COUNT = np.int64(0)
_HALF_EDGE_COUNT = np.int64(1)
LOG_PACE = np.int64(2)  # logarithm of duration by length, of the last step
MEAN_LOG_PACE = np.int64(3)  # its fading mean
STEP_LENGTH = np.int64(4)  # fading mean of the lengths of steps, in sixteenths of a space step
LAST_TRACK_END = np.int64(5)  # last node of the latest track, plus 1
LAST_TRACK_START = np.int64(6)  # first time step of the latest track
HAS_PACE = np.int64(7)  # 1 once a step of some length had a duration
HEADING = np.int64(8)  # direction of the last step, or -1
TURN = np.int64(9)  # turn that led to it, in directions, or NO_TURN
CHEAP_CHOICES = np.int64(10)  # choices that took few bits, less others
MODES = np.int64(11)
LAST_LENGTH = np.int64(12)  # length and duration of the last step that had a length
LAST_DURATION = np.int64(13)
LENGTH_SUM = np.int64(14)  # fading sums of these
DURATION_SUM = np.int64(15)
LAST_LOG_DURATION = np.int64(16)  # of the last step to a new node, where durations come first
PATH_NEXT = np.int64(17)  # next node, and end, of the path in ``WalkModel.target_path``
PATH_END = np.int64(18)
NEXT_START = np.int64(19)  # row of ``WalkModel.track_starts`` from which the next one is sought
SEARCHES = np.int64(20)  # searches for targets so far
_SCALARS = 21

#: Stands for no turn.
NO_TURN = 1 << 10

#: Modes; any of them may be on.
SORTED_STARTS = np.int64(1)  # starts of all tracks come first, in the order of time
TIME_FIRST = np.int64(2)  # the duration of a step to a new node comes before its position
SHORTEST_PATHS = np.int64(4)  # walks may name a target, to which they take the shortest path

#: Rows of ``WalkModel.duration_means``: classes of length, then other things that last.
LENGTH_CLASSES = 48
ROW_STAY = np.int64(48)
ROW_GAP = np.int64(49)
ROW_NEW_NODE = np.int64(50)  # where durations come first
_MEAN_ROWS = 51

#: Columns of ``WalkModel.duration_means``.
MEAN_LOG = np.int64(0)
MEAN_SAMPLES = np.int64(1)

#: Columns of ``WalkModel.track_starts``.
START_TIME_STEP = np.int64(0)
START_IS_TAKEN = np.int64(1)

#: Columns of ``WalkModel.search_marks``.
MARK_RANK = np.int64(0)
MARK_SEARCH = np.int64(1)

#: A mean of durations, and that of an edge, weigh a new duration as one of at most this many.
MAX_MEAN_SAMPLES = np.int64(20)
MAX_EDGE_SAMPLES = np.int64(12)

#: Nodes that a search for targets reaches at most.
MAX_SEARCH_NODES = 256

#: Rows of ``WalkModel.statistics``. Kinds of steps and their durations have five rows each, in the
#: order of the kinds: back, known edge, new edge, new node, stop.
STEP_KIND_BITS: int = np.int64(0)
DURATION_BITS: int = np.int64(5)
POSITION_BITS: int = np.int64(10)  # of new nodes
START_BITS: int = np.int64(11)
GAP_BITS: int = np.int64(12)
STATISTICS = 13

#: Durations count as at most this many time steps when they are learned; lengths are below it.
MAX_MAGNITUDE = np.int64(1) << 36

#: A step counts as at most this long, and as this many time steps, for the speed: products of
#: both with other lengths and durations stay below 2**63.
_MAX_SPEED_LENGTH = np.int64(1) << 34
_MAX_SPEED_DURATION = np.int64(1) << 25

#: Differences of coordinates count as at most this: squares of 15 axes sum up to less than 2**63.
_MAX_DIFFERENCE = np.int64(1) << 29

#: Two half-edges in one key: the first is shifted by so many bits.
_PAIR_SHIFT = np.int64(1) << 31


class WalkModel(NamedTuple):
    """State shared by encoder and decoder, on arrays. V nodes, E edges, K knots, T tracks."""

    #: int32 (contexts, 2): zeros and ones by context
    bit_counts: NDArray[np.int32]
    #: (MIXTURES, DISTRIBUTIONS + 1): weights of each mixture's distributions, numbers coded
    mixture_weights: NDArray[np.int64]
    #: (MIXTURES, HISTOGRAM_BINS): counts of each mixture's smallest values
    histograms: NDArray[np.int64]
    #: (V, d): positions of the nodes in space steps
    places: NDArray[np.int64]
    #: (V,): newest half-edge of a node, or -1
    first_half_edge: NDArray[np.int64]
    #: (2 E,): node to which a half-edge leads
    end_node: NDArray[np.int64]
    #: (2 E,): next half-edge of the same node, or -1
    next_half_edge: NDArray[np.int64]
    #: (2 E,): times that a half-edge was taken
    traversals: NDArray[np.int64]
    #: (2 E,): mean logarithm of its durations
    mean_log_duration: NDArray[np.int64]
    #: (2 E,): times that a step followed on a half-edge
    continued: NDArray[np.int64]
    #: (a power of 2,): hash table of pairs of half-edges taken one after the other
    pair_keys: NDArray[np.int64]
    #: as ``pair_keys``: times that each pair was taken
    pair_counts: NDArray[np.int64]
    #: (V + 1,): Fenwick tree over the nodes' weights as ends of tracks
    end_weight_tree: NDArray[np.int64]
    #: (V,): times that a gap began or ended at a node
    gap_ends: NDArray[np.int64]
    #: (51, 2): mean logarithm of durations, and samples, by length and by what lasts
    duration_means: NDArray[np.int64]
    #: (21,): single numbers, by the indices above
    scalars: NDArray[np.int64]
    #: (tables, OCTAVES, KINDS_PER_OCTAVE): times that candidates could be chosen
    offered: NDArray[np.int64]
    #: as ``offered``: times that candidates were chosen
    chosen: NDArray[np.int64]
    #: (MIXTURE_ROWS, DISTRIBUTIONS): the distributions that are being mixed
    mixture: NDArray[np.int64]
    #: (T, 2): sorted first time steps of the tracks, and whether each is taken
    track_starts: NDArray[np.int64]
    #: (MAX_SEARCH_NODES,): nodes of the path to the target
    target_path: NDArray[np.int64]
    #: (V, 2): rank at which the latest search reached a node, and number of that search
    search_marks: NDArray[np.int64]
    #: float64 (K,): bits of the step to each knot without targets; an encoder chooses by them
    step_bits: NDArray[np.float64]
    #: float64 (STATISTICS, 2): bits written, and how often; nothing is decided by it
    statistics: NDArray[np.float64]


def new_model(knots: int, dimension: int) -> WalkModel:
    """Return the model before the first knot; it takes about 250 bytes for each knot."""
    return _empty(max(knots, 1), max(knots, 1), max(knots, 1), dimension)


def _empty(nodes: int, edges: int, pairs: int, dimension: int) -> WalkModel:
    """Return the model before the first knot, with capacity for nodes, edges and pairs of edges."""
    # Before the first step, there is neither heading nor turn.
    scalars = np.zeros(_SCALARS, np.int64)
    scalars[HEADING] = -1
    scalars[TURN] = NO_TURN

    # At most half of the hash table is in use.
    slots = 1 << (2 * pairs).bit_length()
    return WalkModel(
        bit_counts=initial_bit_counts(),
        mixture_weights=initial_mixture_weights(),
        histograms=np.full((MIXTURES, HISTOGRAM_BINS), 2, np.int64),
        places=np.zeros((nodes, dimension), np.int64),
        first_half_edge=np.full(nodes, -1, np.int64),
        end_node=np.zeros(2 * edges, np.int64),
        next_half_edge=np.zeros(2 * edges, np.int64),
        traversals=np.zeros(2 * edges, np.int64),
        mean_log_duration=np.zeros(2 * edges, np.int64),
        continued=np.zeros(2 * edges, np.int64),
        pair_keys=np.full(slots, -1, np.int64),
        pair_counts=np.zeros(slots, np.int64),
        end_weight_tree=np.zeros(nodes + 1, np.int64),
        gap_ends=np.zeros(nodes, np.int64),
        duration_means=np.zeros((_MEAN_ROWS, 2), np.int64),
        scalars=scalars,
        offered=initial_offered(),
        chosen=initial_chosen(),
        mixture=np.zeros((MIXTURE_ROWS, DISTRIBUTIONS), np.int64),
        track_starts=np.zeros((0, 2), np.int64),
        target_path=np.zeros(0, np.int64),
        search_marks=np.zeros((0, 2), np.int64),
        step_bits=np.zeros(0),
        statistics=np.zeros((STATISTICS, 2)),
    )


#: Fields that an extended model copies as far as they are filled.
_COPIED_FIELDS = (
    "bit_counts",
    "mixture_weights",
    "histograms",
    "scalars",
    "offered",
    "chosen",
    "places",
    "first_half_edge",
    "end_node",
    "next_half_edge",
    "traversals",
    "mean_log_duration",
    "continued",
    "gap_ends",
    "duration_means",
)


def extended(model: WalkModel, knots: int) -> WalkModel:
    """Return a copy of a trained model with capacity for more knots; its statistics are zero."""
    nodes, edges = int(model.scalars[NODE_COUNT]), int(model.scalars[_HALF_EDGE_COUNT]) // 2
    pairs, more = int((model.pair_keys >= 0).sum()), max(knots, 1)
    longer = _empty(nodes + more, edges + more, pairs + more, model.places.shape[1])

    # Arrays by node, half-edge and class keep their indices.
    for field in _COPIED_FIELDS:
        old, new = getattr(model, field), getattr(longer, field)
        filled = min(len(old), len(new))
        new[:filled] = old[:filled]

    # a hash table and a Fenwick tree of another size are built anew
    _enter_pairs(model.pair_keys, model.pair_counts, longer.pair_keys, longer.pair_counts)
    _extend_tree(model.end_weight_tree[: nodes + 1], longer.end_weight_tree)
    return longer


@jit_uncounted
def _enter_pairs(
    keys: NDArray[np.int64],
    counts: NDArray[np.int64],
    to_keys: NDArray[np.int64],
    to_counts: NDArray[np.int64],
) -> None:
    """Enter all pairs of one hash table into another."""
    for i in range(len(keys)):
        if keys[i] != -1:
            slot = find_pair_slot(to_keys, keys[i])
            to_keys[slot] = keys[i]
            to_counts[slot] = counts[i]


@jit
def _extend_tree(tree: NDArray[np.int64], longer: NDArray[np.int64]) -> None:
    """Fill a longer Fenwick tree, in which nodes beyond the shorter one weigh nothing yet."""
    known = len(tree)
    longer[:known] = tree
    for i in range(known, len(longer)):
        child = 1
        while child < (i & -i):
            longer[i] += longer[i - child]
            child *= 2


def with_modes(
    model: WalkModel, modes: int, starts: NDArray[np.int64], step_bits: NDArray[np.float64]
) -> WalkModel:
    """Return a model that codes in these modes.

    Parameters
    ----------
    model : WalkModel
        Before the first knot that is coded; its ``scalars`` are changed.
    modes : int
        A sum of ``SORTED_STARTS``, ``TIME_FIRST`` and ``SHORTEST_PATHS``, or 0.
    starts : int64 array, shape (tracks,)
        For ``SORTED_STARTS`` the first time steps of the tracks, in order; a decoder fills them in.
    step_bits : float64 array, shape (K,) or (0,)
        For an encoder with ``SHORTEST_PATHS``, bits that the step to each knot takes without; they
        are filled in where no mode is on.
    """
    model.scalars[MODES] = modes
    track_starts = model.track_starts
    if modes & SORTED_STARTS:
        track_starts = np.column_stack([starts, np.zeros_like(starts)])
    if not modes & SHORTEST_PATHS:
        return model._replace(track_starts=track_starts, step_bits=step_bits)
    return model._replace(
        track_starts=track_starts,
        step_bits=step_bits,
        target_path=np.zeros(MAX_SEARCH_NODES, np.int64),
        search_marks=np.zeros((len(model.first_half_edge), 2), np.int64),
    )


@inner_uncounted
def record_bits(model: WalkModel, row: int, bits: float) -> None:
    """Add written bits to a row of the statistics."""
    model.statistics[row, 0] += bits
    model.statistics[row, 1] += 1.0


@inner_uncounted
def node_distance(positions: NDArray[np.int64], u: int, v: int) -> int:
    """Distance between two nodes in sixteenths of a space step, below 2**36."""
    square = np.int64(0)
    for axis in range(positions.shape[1]):
        step = min(abs(positions[u, axis] - positions[v, axis]), _MAX_DIFFERENCE)
        square += step * step
    return np.int64(SUBSTEPS * np.sqrt(np.float64(square)))


@inner_uncounted
def find_half_edge(model: WalkModel, u: int, v: int) -> int:
    """Half-edge from u to v, or -1."""
    half_edge = model.first_half_edge[u]
    while half_edge >= 0 and model.end_node[half_edge] != v:
        half_edge = model.next_half_edge[half_edge]
    return half_edge


@inner_uncounted
def _add_edge(model: WalkModel, u: int, v: int) -> int:
    """Add an edge; return its half-edge from u to v."""
    half_edge = model.scalars[_HALF_EDGE_COUNT]
    for new, start, end in ((half_edge, u, v), (half_edge + 1, v, u)):
        model.end_node[new] = end
        model.next_half_edge[new] = model.first_half_edge[start]
        model.first_half_edge[start] = new
    model.scalars[_HALF_EDGE_COUNT] = half_edge + 2
    return half_edge


@inner_uncounted
def _pair_key(incoming: int, half_edge: int) -> int:
    """Key of two half-edges taken one after the other."""
    return incoming * _PAIR_SHIFT + half_edge


@inner_uncounted
def pair_count(model: WalkModel, incoming: int, half_edge: int) -> int:
    """Times that ``half_edge`` was taken right after the half-edge ``incoming``."""
    return model.pair_counts[find_pair_slot(model.pair_keys, _pair_key(incoming, half_edge))]


@inner_uncounted
def length_class(length: int) -> int:
    """Class of a length by half octaves from a space step on: its row of ``duration_means``."""
    if length < SUBSTEPS:
        return 0
    half_octaves = (fixed_log2(length) - (4 << 16)) >> 15
    return min(np.int64(1 + half_octaves), np.int64(LENGTH_CLASSES - 1))


@inner_uncounted
def log_duration(duration: int) -> int:
    """Logarithm of a duration, brought into 1 ... 2**36 time steps."""
    return fixed_log2(min(max(duration, np.int64(1)), MAX_MAGNITUDE))


@inner_uncounted
def update_mean_log(model: WalkModel, row: int, max_samples: int, logarithm: int) -> None:
    """Add a logarithm of a duration to the mean m of a row, with n samples so far.

    n = min(n + 1, max_samples), then m += (logarithm - m) // n.
    """
    means = model.duration_means
    means[row, MEAN_SAMPLES] = min(means[row, MEAN_SAMPLES] + 1, np.int64(max_samples))
    means[row, MEAN_LOG] += (logarithm - means[row, MEAN_LOG]) // means[row, MEAN_SAMPLES]


@inner_uncounted
def forget_heading(model: WalkModel) -> None:
    """Drop heading and turn, as a track begins or goes on after a gap."""
    model.scalars[HEADING] = -1
    model.scalars[TURN] = NO_TURN


@inner_uncounted
def _learn_heading(model: WalkModel, u: int, v: int) -> None:
    """Set the heading to that of the step from u to v, and the turn that led to it."""
    positions, scalars = model.places, model.scalars
    heading = nearest_direction(
        positions[v, 0] - positions[u, 0], positions[v, 1] - positions[u, 1]
    )
    scalars[TURN] = NO_TURN
    if scalars[HEADING] >= 0:
        half_turn = DIRECTIONS // 2
        scalars[TURN] = (heading - scalars[HEADING] + half_turn) % DIRECTIONS - half_turn
    scalars[HEADING] = heading


@inner_uncounted
def _learn_speed(scalars: NDArray[np.int64], length: int, duration: int) -> None:
    """Learn length and duration of the last step, and sums in which steps fade by 7/8 each."""
    scalars[LAST_LENGTH], scalars[LAST_DURATION] = length, duration
    scalars[LENGTH_SUM] += length - (scalars[LENGTH_SUM] >> 3)
    scalars[DURATION_SUM] += duration - (scalars[DURATION_SUM] >> 3)


@inner_uncounted
def _learn_duration(model: WalkModel, half_edge: int, length: int, duration: int) -> None:
    """Learn the duration of a step, by its length, by its half-edge, and as a pace."""
    scalars = model.scalars
    log = log_duration(duration)

    # Means by class of length and by half-edge.
    update_mean_log(model, length_class(length), MAX_MEAN_SAMPLES, log)
    samples = min(model.traversals[half_edge], MAX_EDGE_SAMPLES)
    model.mean_log_duration[half_edge] += (log - model.mean_log_duration[half_edge]) // samples

    # The last pace, and its mean, which moves by 5/32.
    if length > 0:
        pace = log - fixed_log2(length)
        scalars[LOG_PACE] = pace
        scalars[MEAN_LOG_PACE] = (
            pace
            if scalars[HAS_PACE] == 0
            else scalars[MEAN_LOG_PACE] + 5 * (pace - scalars[MEAN_LOG_PACE]) // 32
        )
        scalars[HAS_PACE] = 1
        _learn_speed(scalars, min(length, _MAX_SPEED_LENGTH), min(duration, _MAX_SPEED_DURATION))


@inner_uncounted
def learn_step(model: WalkModel, incoming: int, u: int, v: int, duration: int) -> int:
    """Learn a step from u to v.

    Parameters
    ----------
    incoming : int
        Half-edge on which the walk came to u, or -1.
    u, v : int
        Two different nodes; the edge between them is made if it is new.
    duration : int
        In time steps; 0 without times.

    Returns
    -------
    int
        The half-edge from u to v.
    """
    # Add the edge if no walk has taken it before.
    half_edge = find_half_edge(model, u, v)
    if half_edge < 0:
        half_edge = _add_edge(model, u, v)

    # Count the half-edge, and the pair that it makes with the one before.
    model.traversals[half_edge] += 1
    if incoming >= 0:
        key = _pair_key(incoming, half_edge)
        slot = find_pair_slot(model.pair_keys, key)
        model.pair_keys[slot] = key
        model.pair_counts[slot] += 1
        model.continued[incoming] += 1

    # Duration, heading, and the mean length of steps, which moves by 1/8.
    scalars = model.scalars
    length = node_distance(model.places, u, v)
    if duration != 0:
        _learn_duration(model, half_edge, length, duration)
    if model.places.shape[1] > 1:
        _learn_heading(model, u, v)
    scalars[STEP_LENGTH] = (
        length
        if scalars[STEP_LENGTH] == 0
        else scalars[STEP_LENGTH] + (length - scalars[STEP_LENGTH]) // 8
    )
    return half_edge


@inner_uncounted
def add_node(model: WalkModel) -> int:
    """Add a node whose position is set already; return it."""
    node = model.scalars[NODE_COUNT]
    model.scalars[NODE_COUNT] = node + 1
    add_end_weight(model, node, np.int64(1))
    return node


@inner_uncounted
def add_end_weight(model: WalkModel, node: int, weight: int) -> None:
    """Raise the weight of a node as the end of a track (Fenwick tree, P. Fenwick, 1994)."""
    tree = model.end_weight_tree
    i = node + 1
    while i < len(tree):
        tree[i] += weight
        i += i & -i


@inner_uncounted
def end_weight_below(model: WalkModel, node: int) -> int:
    """Sum of the weights of the nodes before ``node``."""
    tree = model.end_weight_tree
    total = np.int64(0)
    while node > 0:
        total += tree[node]
        node -= node & -node
    return total


@inner_uncounted
def find_by_end_weight(model: WalkModel, number: int) -> int:
    """Node in whose interval of the cumulative weights ``number`` lies."""
    tree = model.end_weight_tree
    step = 1
    while 2 * step < len(tree):
        step *= 2

    # Descend the tree: go right where the left half sums up to no more than the number.
    node = 0
    while step > 0:
        if node + step < len(tree) and tree[node + step] <= number:
            node += step
            number -= tree[node]
        step //= 2
    return node
