"""Coding of walks: one loop that writes or reads, knot by knot.

A knot is reached by a part. First comes what kind of step the part is (back, along a known way, to a known node by a new way,
to a new node, a stop, or a gap), then how long it takes, then where a new node lies. Every probability follows from what was
coded before.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.adaptive import (
    HISTOGRAM,
    ONE_SIDED,
    PARTS,
    SIZES,
    TWO_SIDED,
    code_bit,
    code_choice,
    code_mixture,
    code_whole,
)
from gpszip.kernels.heading import direction, rotate, rotate_back
from gpszip.kernels.jit import jit
from gpszip.kernels.range_coder import Coder, code_interval, target, used_bits
from gpszip.kernels.walk_model import (
    F_BACK,
    F_END,
    F_ESCAPE,
    F_GAP,
    F_GAP_KIND,
    F_KNOWN_START,
    F_NEAR,
    F_NEW,
    F_STAY,
    FLAGS,
    GAP_BITS,
    KIND_BITS,
    NODES,
    PACE,
    PACE_SLOW,
    PLACE_BITS,
    SPAN_BITS,
    START_BITS,
    STEP_LENGTH,
    WalkModel,
    add_node,
    book,
    follow,
    half_edge,
    length,
    pair_count,
    pick,
    weigh,
    weight_below,
)

__all__ = ["code_walks"]

#: Kinds of steps.
_BACK, _KNOWN, _LINK, _NEW, _STAY = 0, 1, 2, 3, 4

#: Mixtures: durations by kind of step, then places.
_T_KNOWN, _T_LINK, _T_NEW, _T_STAY, _T_GAP = 0, 1, 2, 3, 4
_ALONG, _ACROSS, _BESIDE, _JUMP = 5, 6, 7, 8

_REACH = np.int64(1) << 25
_PACE_UNIT = 20
_MOST = np.int64(1) << 36
_LINKS = 384

#: Coordinates and times that an archive may hold are below these.
_FARTHEST, _LATEST = np.int64(1) << 45, np.int64(1) << 60
_WEIGHTS_END = 24


@jit
def _code_far(coder: Coder, model: WalkModel, slot: int, value: int) -> int:
    return code_whole(coder, model.flags, FLAGS + slot * SIZES, value)


@jit
def _fill(
    at: int, kind: int, center: int, scale: int, kinds: NDArray[np.int64], centers: NDArray[np.int64], scales: NDArray[np.int64]
) -> int:
    kinds[at] = kind
    centers[at] = center
    scales[at] = min(max(scale, np.int64(6)), _MOST)
    return at + 1


@jit
def _code_span(coder: Coder, model: WalkModel, mixture: int, expected: NDArray[np.int64], known: int, cells: int) -> int:
    """Code a duration in cells; ``expected`` holds ``known`` guesses in sixteenths of a cell."""
    kinds, centers, scales = np.empty(28, np.int64), np.empty(28, np.int64), np.empty(28, np.int64)
    count = _fill(0, HISTOGRAM, 0, 16, kinds, centers, scales)
    for i in range(9):
        count = _fill(count, ONE_SIDED, 0, PARTS << (i if i < 5 else 2 * i - 4), kinds, centers, scales)
    for i in range(known):
        for shift in range(1, 5):
            count = _fill(count, TWO_SIDED, expected[i], expected[i] >> shift, kinds, centers, scales)
    far = cells >= _REACH
    cells_near = min(cells, _REACH - 1)
    coded = code_mixture(coder, cells_near, 1, _REACH, kinds, centers, scales, count, model.weights[mixture], model.histograms[mixture])
    if coded == _REACH - 1:
        return coded + _code_far(coder, model, 0, cells - coded if far else np.int64(0))
    return coded


@jit
def _code_axis(
    coder: Coder,
    model: WalkModel,
    mixture: int,
    value: int,
    kinds: NDArray[np.int64],
    centers: NDArray[np.int64],
    scales: NDArray[np.int64],
    count: int,
) -> int:
    for i in range(9):
        count = _fill(count, TWO_SIDED, 0, PARTS << (2 * i + (1 if i > 0 else 0)), kinds, centers, scales)
    outside = value >= _REACH - 1 or value < -_REACH
    near = _REACH - 1 if outside else value
    coded = code_mixture(coder, near, -_REACH, _REACH, kinds, centers, scales, count, model.weights[mixture], model.histograms[mixture][:0])
    if coded == _REACH - 1:
        return _code_far(coder, model, 1, value)
    return coded


@jit
def _code_along(coder: Coder, model: WalkModel, value: int, reach: int) -> int:
    kinds, centers, scales = np.empty(28, np.int64), np.empty(28, np.int64), np.empty(28, np.int64)
    usual = model.scalars[STEP_LENGTH]
    count = 0
    for shift in range(1, 5):
        count = _fill(count, TWO_SIDED, reach, reach >> shift, kinds, centers, scales)
    count = _fill(count, TWO_SIDED, reach >> 1, reach >> 2, kinds, centers, scales)
    count = _fill(count, TWO_SIDED, 0, reach >> 2, kinds, centers, scales)
    count = _fill(count, TWO_SIDED, 0, reach, kinds, centers, scales)
    count = _fill(count, TWO_SIDED, usual, usual >> 2, kinds, centers, scales)
    return _code_axis(coder, model, _ALONG, value, kinds, centers, scales, count)


@jit
def _code_across(coder: Coder, model: WalkModel, value: int, reach: int, along: int) -> int:
    kinds, centers, scales = np.empty(28, np.int64), np.empty(28, np.int64), np.empty(28, np.int64)
    count = 0
    for shift in range(1, 6):
        count = _fill(count, TWO_SIDED, 0, reach >> shift, kinds, centers, scales)
    forth = min(abs(along), np.int64(1) << 26) * PARTS
    reach = min(reach, np.int64(1) << 30)
    side = np.int64(np.sqrt(np.float64(reach * reach - forth * forth))) if forth < reach else np.int64(0)
    for sign in (-1, 1):
        count = _fill(count, TWO_SIDED, sign * side, reach >> 4, kinds, centers, scales)
        count = _fill(count, TWO_SIDED, sign * side, reach >> 2, kinds, centers, scales)
    return _code_axis(coder, model, _ACROSS, value, kinds, centers, scales, count)


@jit
def _code_step(coder: Coder, model: WalkModel, u: int, before: int, node: int, reach: int, frame: bool) -> None:
    """Code the place of ``node`` relative to u, in the frame of the last step (``frame``) or of the axes."""
    places = model.places
    dimension = places.shape[1]
    kinds, centers, scales = np.empty(28, np.int64), np.empty(28, np.int64), np.empty(28, np.int64)
    first = 0
    if frame and dimension > 1:
        turn = 0
        if before >= 0:
            turn = direction(places[u, 0] - places[before, 0], places[u, 1] - places[before, 1])
        x, y = rotate(places[node, 0] - places[u, 0], places[node, 1] - places[u, 1], turn)
        x = _code_along(coder, model, x, reach)
        y = _code_across(coder, model, y, reach, x)
        x, y = rotate_back(x, y, turn)
        places[node, 0], places[node, 1] = places[u, 0] + x, places[u, 1] + y
        first = 2
    for axis in range(first, dimension):
        count = 0
        if frame:
            for shift in range(0, 6):
                count = _fill(count, TWO_SIDED, 0, reach >> shift, kinds, centers, scales)
        offset = places[node, axis] - places[u, axis]
        places[node, axis] = places[u, axis] + _code_axis(
            coder, model, _BESIDE if frame else _JUMP + axis % 4, offset, kinds, centers, scales, count
        )


@jit
def _guess_spans(model: WalkModel, half: int, far: int, expected: NDArray[np.int64]) -> int:
    """Durations to expect on a known way, from its own pace, the reverse one, the last and the usual one."""
    own = model.pace[half] if model.pace[half] > 0 else model.pace[half ^ 1]
    paces = (own if own > 0 else model.scalars[PACE_SLOW], model.scalars[PACE], model.scalars[PACE_SLOW])
    known = 0
    for pace in paces:
        if pace > 0:
            expected[known] = min((far * pace) >> _PACE_UNIT, np.int64(1) << 30)
            known += 1
    return known


@jit
def _pace(far: int, cells: int) -> int:
    """Sixteenths of a cell for a sixteenth of a quantum, in units of 2**-20; 0 if unknown."""
    if far == 0 or cells == 0:
        return np.int64(0)
    return min(max(((min(cells, _MOST) * PARTS) << _PACE_UNIT) // far, np.int64(1)), np.int64(1) << 26)


@jit
def _reach_of(model: WalkModel, cells: int, timed: bool) -> int:
    """Length in sixteenths that a step of this duration has at the usual pace."""
    pace = model.scalars[PACE_SLOW]
    if not timed or pace == 0:
        return max(model.scalars[STEP_LENGTH], np.int64(64))
    return max(min(((min(cells, _MOST) * PARTS) << _PACE_UNIT) // pace, np.int64(1) << 34), np.int64(32))


@jit
def _depth(model: WalkModel, u: int) -> tuple[int, int]:
    """Number of ways at u and how often they were left along, both capped for use as a context."""
    degree = 0
    visits = np.int64(0)
    half = model.head[u]
    while half >= 0:
        degree += 1
        visits += model.count[half]
        half = model.following[half]
    level = 0
    while level < 4 and visits >= (1 << level):
        level += 1
    return min(degree, 5), level


@jit
def _code_way(coder: Coder, model: WalkModel, u: int, arrived: int, back: int, v: int) -> int:
    """Code which known way is taken at u, save the one back; return its half-edge."""
    ways = 0
    half = model.head[u]
    while half >= 0:
        ways += half != back
        half = model.following[half]
    halves = np.empty(ways, np.int64)
    weights = np.empty(ways, np.int64)
    single = np.int64(0)
    choice = 0
    at = 0
    half = model.head[u]
    while half >= 0:
        if half != back:
            halves[at] = half
            weights[at] = 2 * model.count[half] + model.count[half ^ 1] + 1
            single += weights[at]
            if model.into[half] == v:
                choice = at
            at += 1
        half = model.following[half]
    if arrived >= 0 and model.passed[arrived] > 0:
        for i in range(ways):
            pairs = min(pair_count(model, arrived, halves[i]), np.int64(1) << 16)
            weights[i] += 2 * pairs * single // 3
    if ways > 1:
        choice = code_choice(coder, weights, ways, choice)
    return halves[choice]


@jit
def _octave(far: int, reach: int) -> int:
    """Ratio of two lengths in half octaves, 0 to 9."""
    ratio = 0
    bound = reach * 181 >> 10
    while ratio < 9 and far >= bound:
        bound = bound * 362 >> 8
        ratio += 1
    return ratio


@jit
def _bearing(places: NDArray[np.int64], before: int, u: int, v: int) -> int:
    """Turn from the last step towards v in eight classes by its cosine; 7 if there was none."""
    if before < 0:
        return 7
    dot = 0.0
    one = 0.0
    two = 0.0
    for axis in range(places.shape[1]):
        a = np.float64(places[u, axis] - places[before, axis])
        b = np.float64(places[v, axis] - places[u, axis])
        dot += a * b
        one += a * a
        two += b * b
    if one == 0.0 or two == 0.0:
        return 7
    square = dot * abs(dot) / (one * two)
    for i, bound in enumerate((0.97, 0.75, 0.25, -0.25, -0.75, -0.97)):
        if square > bound:
            return i
    return 6


@jit
def _code_link(coder: Coder, model: WalkModel, u: int, before: int, v: int, reach: int) -> int:
    """Code the node that a new way leads to: one of those near, by where it lies, or any."""
    nodes = model.scalars[NODES]
    near = np.empty(_LINKS, np.int64)
    classes = np.empty(_LINKS, np.int64)
    weights = np.empty(_LINKS, np.int64)
    count = 0
    choice = -1
    recent = max(nodes - 4096, np.int64(0))
    for w in range(nodes - 1, recent - 1, -1):
        if count == _LINKS:
            break
        if w == u or half_edge(model, u, w) >= 0:
            continue
        far = length(model.places, u, w)
        ratio = _octave(far, reach)
        if ratio > 8:
            continue
        near[count] = w
        classes[count] = ratio * 8 + _bearing(model.places, before, u, w)
        weights[count] = (model.hits[ratio, classes[count] % 8] << 16) // model.offers[ratio, classes[count] % 8] + 1
        if w == v:
            choice = count
        count += 1
    is_near = code_bit(coder, model.flags, F_NEAR, 1 if choice >= 0 else 0) if count > 0 else 0
    if is_near:
        choice = code_choice(coder, weights, count, choice)
        v = near[choice]
        model.hits[classes[choice] // 8, classes[choice] % 8] += 8
    else:
        if coder.cursor[1] == 1:
            v = target(coder, nodes)
        code_interval(coder, v, 1, nodes)
    for i in range(count):
        model.offers[classes[i] // 8, classes[i] % 8] += 1
    return v


@jit
def _code_start(coder: Coder, model: WalkModel, last: int, node: int) -> int:
    """Code the first node of a track: a known one, likelier where tracks began or ended, or a new one."""
    nodes = model.scalars[NODES]
    known = 0
    if nodes > 0:
        known = code_bit(coder, model.flags, F_KNOWN_START, 1 if node < nodes else 0)
    if known:
        total = weight_below(model, nodes)
        if coder.cursor[1] == 1:
            node = pick(model, target(coder, total))
        start = weight_below(model, node)
        code_interval(coder, start, weight_below(model, node + 1) - start, total)
        return node
    node = nodes
    if last < 0:
        for axis in range(model.places.shape[1]):
            model.places[node, axis] = _code_far(coder, model, 2, model.places[node, axis])
    else:
        _code_step(coder, model, last, -1, node, np.int64(64), False)
    return add_node(model)


@jit
def _code_gap(coder: Coder, model: WalkModel, u: int, node: int, cells: int, timed: bool) -> tuple[int, int]:
    """Code a part in which no travel is claimed: how long, and where the track goes on."""
    expected = np.empty(1, np.int64)
    if timed:
        cells = _code_span(coder, model, _T_GAP, expected, 0, cells)
    if code_bit(coder, model.flags, F_GAP_KIND, 1 if node == u else 0):
        return u, cells
    nodes = model.scalars[NODES]
    if code_bit(coder, model.flags, F_GAP_KIND + 1, 1 if node < nodes else 0):
        return _code_link(coder, model, u, -1, node, max(model.scalars[STEP_LENGTH], np.int64(64))), cells
    node = nodes
    _code_step(coder, model, u, -1, node, np.int64(64), False)
    return add_node(model), cells


@jit
def _kind(model: WalkModel, u: int, back: int, node: int) -> int:
    if node == model.scalars[NODES]:
        return _NEW
    if node == u:
        return _STAY
    half = half_edge(model, u, node)
    if half < 0:
        return _LINK
    return _BACK if half == back else _KNOWN


@jit
def _code_kind(coder: Coder, model: WalkModel, u: int, arrived: int, back: int, kind: int, last: int) -> int:
    """Code the kind of a step from u, reached on the half-edge ``arrived``."""
    flags = model.flags
    degree, level = _depth(model, u)
    fresh = 1 if last >= _NEW else 0
    if degree > 0:
        escape = code_bit(coder, flags, F_ESCAPE + (degree * 5 + level) * 2 + fresh, 1 if kind >= _LINK else 0)
    else:
        escape = 1
    if not escape:
        if back < 0:
            return _KNOWN
        if degree == 1:
            return _BACK
        seen = 2 if arrived >= 0 and pair_count(model, arrived, back) > 0 else (1 if model.count[back] > 0 else 0)
        context = F_BACK + (min(degree, 4) * 3 + seen) * 2 + (1 if last == _BACK else 0)
        return _BACK if code_bit(coder, flags, context, 1 if kind == _BACK else 0) else _KNOWN
    if code_bit(coder, flags, F_STAY + min(last, 4) * 2 + fresh, 1 if kind == _STAY else 0):
        return _STAY
    if model.scalars[NODES] < 2:
        return _NEW
    return _NEW if code_bit(coder, flags, F_NEW + min(degree, 3) * 5 + min(last, 4), 1 if kind == _NEW else 0) else _LINK


@jit
def _code_part(
    coder: Coder, model: WalkModel, u: int, before: int, arrived: int, last: int, node: int, cells: int, timed: bool
) -> tuple[int, int, int]:
    """Code one part from u: return its kind, the node it ends at and its cells."""
    back = arrived ^ 1 if arrived >= 0 else -1
    bits = used_bits(coder)
    kind = _code_kind(coder, model, u, arrived, back, _kind(model, u, back, node), last)
    expected = np.empty(3, np.int64)
    known = 0
    if kind <= _KNOWN:
        half = back if kind == _BACK else _code_way(coder, model, u, arrived, back, node)
        node = model.into[half]
        known = _guess_spans(model, half, length(model.places, u, node), expected)
    kind_bits = used_bits(coder) - bits
    if timed:
        bits = used_bits(coder)
        cells = _code_span(coder, model, (_T_KNOWN, _T_KNOWN, _T_LINK, _T_NEW, _T_STAY)[kind], expected, known, cells)
        book(model, SPAN_BITS + kind, used_bits(coder) - bits)
    reach = _reach_of(model, cells, timed)
    bits = used_bits(coder)
    if kind == _STAY:
        node = u
    elif kind == _LINK:
        node = _code_link(coder, model, u, before, node, reach)
        kind_bits += used_bits(coder) - bits
    elif kind == _NEW:
        node = model.scalars[NODES]
        _code_step(coder, model, u, before, node, reach, True)
        add_node(model)
        book(model, PLACE_BITS, used_bits(coder) - bits)
    book(model, KIND_BITS + kind, kind_bits)
    return kind, node, cells


@jit
def _is_sound(model: WalkModel, node: int, cell: int) -> bool:
    """Whether a node and a time that were read lie where no arithmetic overflows."""
    for axis in range(model.places.shape[1]):
        if abs(model.places[node, axis]) >= _FARTHEST:
            return False
    return abs(cell) < _LATEST


@jit
def code_walks(
    coder: Coder,
    model: WalkModel,
    nodes: NDArray[np.int64],
    cells: NDArray[np.int64],
    gaps: NDArray[np.int8],
    begins: NDArray[np.int8],
    tracks: int,
    timed: bool,
    gapped: bool,
) -> int:
    """Code all knots of all tracks, in place.

    Parameters
    ----------
    nodes, cells : int64 arrays, shape (K,)
        Node of each knot, numbered by first visit, and its time cell; filled in when reading.
    gaps, begins : int8 arrays, shape (K,)
        Whether the part that leads to the knot is a gap, and whether a track begins at the knot.
    tracks : int
        Number of tracks.
    timed, gapped : bool
        Whether there are times, and whether there is any gap.

    Returns
    -------
    int
        Number of nodes, or -1 if what was read is no walk.
    """
    knots = len(nodes)
    left = tracks
    u, before, arrived, last = -1, -1, -1, _NEW
    start = np.int64(0)
    ended = True
    for j in range(knots):
        if coder.cursor[1] == 1 and coder.cursor[0] > len(coder.data) + 8:
            return -1
        if ended:
            if left == 0:
                return -1
            left -= 1
            begins[j] = 1
            if timed:
                cells[j] = start + _code_far(coder, model, 3, cells[j] - start)
                start = cells[j]
            bits = used_bits(coder)
            u = _code_start(coder, model, u, nodes[j])
            book(model, START_BITS, used_bits(coder) - bits)
            nodes[j] = u
            weigh(model, u, _WEIGHTS_END)
            before, arrived, last = -1, -1, _NEW
        else:
            begins[j] = 0
            span = cells[j] - cells[j - 1]
            gap = 0
            if gapped:
                gap = code_bit(coder, model.flags, F_GAP + (1 if last == _STAY else 0), gaps[j])
            gaps[j] = gap
            if gap:
                bits = used_bits(coder)
                node, span = _code_gap(coder, model, u, nodes[j], span, timed)
                book(model, GAP_BITS, used_bits(coder) - bits)
                before, arrived, last = -1, -1, _NEW
            else:
                last, node, span = _code_part(coder, model, u, before, arrived, last, nodes[j], span, timed)
                if node != u:
                    far = length(model.places, u, node)
                    arrived = follow(model, arrived, u, node, _pace(far, span) if timed else np.int64(0))
                    before = u
            nodes[j] = node
            u = node
            cells[j] = cells[j - 1] + span if timed else 0
        if coder.cursor[1] == 1 and not _is_sound(model, u, cells[j]):
            return -1
        ended = False
        if left > 0:
            terminal = 1 if weight_below(model, u + 1) - weight_below(model, u) > 1 else 0
            ended = code_bit(coder, model.flags, F_END + terminal, 1 if j + 1 == knots or begins[j + 1] == 1 else 0) == 1
            if ended:
                weigh(model, u, _WEIGHTS_END)
    return model.scalars[NODES] if left == 0 else np.int64(-1)
