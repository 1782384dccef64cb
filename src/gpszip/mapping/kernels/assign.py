"""The E-step of the connected map: knots of one window of a walk are chosen anew, all at once, at their marginal price.

Within a window the walk's own uses are taken out of the counts. Then a dynamic program over slots and candidate nodes may insert,
delete, move and relabel knots: a node that others use is free, one that nobody uses pays for its place, and every step
pays what it would cost to code.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.mapping.kernels.assign_max_error import relax_within
from gpszip.mapping.kernels.grid_moments import free_cost, span_moments
from gpszip.mapping.kernels.initial_map import Draft, count_step, drop, near, room, steps, take_node
from gpszip.mapping.kernels.time_grid import Board, Ground

__all__ = ["CANDIDATES", "settle_stretch"]

#: Prices in bits, in the order of the array ``prices``; the last is what a candidate may cost beyond the cheapest of its slot.
ERROR, TIME, STAY_TIME, NEW, PLACE, LINK, STAY, JUMP, ESCAPE, BEAM = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9

CANDIDATES = 8
_TOO_DEAR = 200.0
_FRESH = -2


@jit
def _link_price(draft: Draft, u: int, v: int, prices: NDArray[np.float64]) -> float:
    """Bits of a step between two nodes that others use."""
    weight = steps(draft, u, v) + 0.5 * steps(draft, v, u)
    if weight <= 0.0:
        return prices[LINK]
    return min(np.log2((draft.leaving[u] + 1.0) / weight) + prices[ESCAPE], prices[LINK])


@jit
def _find_candidates(
    draft: Draft,
    places: NDArray[np.float64],
    at: NDArray[np.int64],
    first: int,
    last: int,
    most: int,
    candidates: NDArray[np.int64],
    counts: NDArray[np.int64],
) -> None:
    """List the nodes that each slot may take: the nearest, its present one, and a fresh one at its own place."""
    distances = np.empty(most + 1)
    for slot in range(first, last + 1):
        row = slot - first
        count = near(draft, places[slot], most, candidates[row], distances)
        own = at[slot]
        if own >= 0:
            known = False
            for i in range(count):
                known |= candidates[row, i] == own
            if not known:
                candidates[row, count] = own
                count += 1
        candidates[row, count] = _FRESH
        counts[row] = count + 1


@jit
def _index_locals(
    draft: Draft, candidates: NDArray[np.int64], counts: NDArray[np.int64], marks: NDArray[np.int64], members: NDArray[np.int64]
) -> int:
    """Number the used nodes among the candidates from 1 on; 0 stands for all that nobody uses."""
    count = 0
    for row in range(len(counts)):
        for i in range(counts[row]):
            node = candidates[row, i]
            if node >= 0 and draft.uses[node] > 0 and marks[node] == 0:
                count += 1
                marks[node] = count
                members[count] = node
    return count


@jit
def _price_steps(
    draft: Draft, members: NDArray[np.int64], count: int, marks: NDArray[np.int64], prices: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Bits of the steps between all used candidates; row and column 0 are for fresh nodes."""
    table = np.full((count + 1, count + 1), prices[LINK])
    table[:, 0] = prices[NEW] + prices[PLACE]
    for i in range(1, count + 1):
        u = members[i]
        half = draft.head[u]
        while half >= 0:
            v = draft.into[half]
            if marks[v] > 0:
                table[i, marks[v]] = _link_price(draft, u, v, prices)
            half = draft.following[half]
        table[i, i] = prices[STAY]
    return table


@jit
def _locate(
    draft: Draft,
    places: NDArray[np.float64],
    first: int,
    candidates: NDArray[np.int64],
    counts: NDArray[np.int64],
    marks: NDArray[np.int64],
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Place of each candidate, and its index among the used ones."""
    spot = np.empty((*candidates.shape, places.shape[1]))
    local = np.zeros(candidates.shape, np.int64)
    for row in range(len(counts)):
        for i in range(counts[row]):
            node = candidates[row, i]
            spot[row, i] = places[first + row] if node == _FRESH else draft.places[node]
            local[row, i] = 0 if node == _FRESH else marks[node]
    return spot, local


@jit
def _relax(ground: Ground, board: Board, first: int, widest: int, prices: NDArray[np.float64]) -> None:
    """Fill the board from its first row on: squared error costs its price.

    Origins are looked at from the nearest to the farthest: what the best line misses only grows, and ends the search. A
    candidate that costs so much more than the cheapest of its slot as the last of the prices says is left out.
    One long loop on purpose: handing these arrays to a function for each pair of slots takes longer than the arithmetic.
    """
    sums, ticks, centers, unit = ground.sums, ground.ticks, ground.centers, ground.unit[0]
    candidates, counts, spot, local, table, best, parent_row, parent_choice = board
    rows, width, dimension = spot.shape
    error, time, stay = prices[ERROR], prices[TIME], prices[STAY] + prices[STAY_TIME]
    quickest = min(time, prices[STAY_TIME])
    m, n = np.empty(dimension), np.empty(dimension)
    ends, lean = np.empty(width), np.empty(dimension)
    cheapest, sofar = np.full(rows, np.inf), np.full(rows, np.inf)
    for c in range(counts[0]):
        cheapest[0] = min(cheapest[0], best[0, c])
    sofar[0] = cheapest[0]
    for row in range(1, rows):
        g = first + row
        limit = np.inf
        # what led to the slot before is a good guess, and bounds the rest
        guess = parent_row[row - 1, np.argmin(best[row - 1, : counts[row - 1]])]
        missed = 0.0
        for turn in range(row if guess < max(row - widest, 0) else row + 1, max(row - widest, 0), -1):
            origin = turn - 1 if turn <= row else guess
            if turn < row:
                if sofar[origin] + quickest + missed >= limit:
                    break
                if origin == guess:
                    continue
            elif turn == row:
                missed = 0.0
                if origin == guess:
                    continue
            if cheapest[origin] + quickest + missed >= limit:
                continue
            a = first + origin
            w, u1, u2, q = span_moments(sums, a, g, ticks[a], ticks[g], centers[a], unit, m, n)
            missed = error * free_cost(w, u1, u2, q, m, n)
            if missed > _TOO_DEAR and origin < row - 1:
                if turn < row:
                    break
                continue
            if cheapest[origin] + quickest + missed >= limit:
                continue
            for c in range(counts[row]):
                ends[c] = 0.0
                for axis in range(dimension):
                    y = spot[row, c, axis] - centers[a, axis] / unit
                    ends[c] += u2 * y * y - 2.0 * y * n[axis]
            better = False
            for o in range(counts[origin]):
                reached = best[origin, o]
                if reached + quickest + missed >= limit:
                    continue
                begin = q
                for axis in range(dimension):
                    x = spot[origin, o, axis] - centers[a, axis] / unit
                    begin += (w - 2.0 * u1 + u2) * x * x - 2.0 * x * (m[axis] - n[axis])
                    lean[axis] = 2.0 * (u1 - u2) * x
                for c in range(counts[row]):
                    if candidates[origin, o] == candidates[row, c] and candidates[row, c] >= 0:
                        cost = reached + stay
                    else:
                        cost = reached + time + table[local[origin, o], local[row, c]]
                    if cost + missed >= best[row, c]:
                        continue
                    square = begin + ends[c]
                    for axis in range(dimension):
                        square += lean[axis] * (spot[row, c, axis] - centers[a, axis] / unit)
                    cost += error * max(square, 0.0)
                    if cost < best[row, c]:
                        best[row, c] = cost
                        parent_row[row, c] = origin
                        parent_choice[row, c] = o
                        better = True
            if better:
                limit = 0.0
                for c in range(counts[row]):
                    limit = max(limit, best[row, c])
                    cheapest[row] = min(cheapest[row], best[row, c])
                limit = min(limit, cheapest[row] + prices[BEAM])
        sofar[row] = min(sofar[row - 1], cheapest[row])


@jit
def _take_out(draft: Draft, at: NDArray[np.int64], first: int, last: int, with_first: bool, with_last: bool) -> None:
    """Take the window's steps, and the uses of its free knots, out of the counts."""
    before = at[first]
    if with_first:
        draft.uses[before] -= 1
    for slot in range(first + 1, last + 1):
        node = at[slot]
        if node >= 0:
            count_step(draft, before, node, -1)
            if slot < last or with_last:
                draft.uses[node] -= 1
            before = node


@jit
def _put_back(
    draft: Draft,
    at: NDArray[np.int64],
    places: NDArray[np.float64],
    first: int,
    last: int,
    rows: NDArray[np.int64],
    nodes: NDArray[np.int64],
    count: int,
    with_first: bool,
    with_last: bool,
) -> None:
    """Enter the chosen knots (``count`` rows and nodes, last first) and drop what nobody uses any more."""
    old = at[first : last + 1].copy()
    at[first : last + 1] = -1
    before = -1
    for i in range(count - 1, -1, -1):
        slot = first + rows[i]
        node = nodes[i]
        if node == _FRESH:
            node = take_node(draft, places[slot])
        at[slot] = node
        if (slot > first or with_first) and (slot < last or with_last):
            draft.uses[node] += 1
        if before >= 0:
            count_step(draft, before, node, 1)
        before = node
    for i in range(len(old)):
        if old[i] >= 0 and draft.uses[old[i]] == 0:
            draft.uses[old[i]] = -1
            drop(draft, old[i])


@jit
def _set_up(
    draft: Draft,
    ground: Ground,
    at: NDArray[np.int64],
    first: int,
    last: int,
    open_first: bool,
    open_last: bool,
    most: int,
    prices: NDArray[np.float64],
    marks: NDArray[np.int64],
) -> Board:
    """Board of a window before the first move; an end that isn't open keeps its node."""
    rows, width = last - first + 1, most + 2
    candidates, counts = np.empty((rows, width), np.int64), np.empty(rows, np.int64)
    _find_candidates(draft, ground.places, at, first, last, most, candidates, counts)
    if not open_first:
        candidates[0, 0] = at[first]
        counts[0] = 1
    if not open_last:
        candidates[rows - 1, 0] = at[last]
        counts[rows - 1] = 1
    members = np.empty(rows * width + 1, np.int64)
    used = _index_locals(draft, candidates, counts, marks, members)
    table = _price_steps(draft, members, used, marks, prices)
    spot, local = _locate(draft, ground.places, first, candidates, counts, marks)
    for i in range(1, used + 1):
        marks[members[i]] = 0
    best = np.full((rows, width), np.inf)
    for i in range(counts[0]):
        node = candidates[0, i]
        lone = open_first and (node == _FRESH or draft.uses[node] == 0)
        best[0, i] = prices[JUMP] + prices[PLACE] if lone else 0.0
    parents = np.full((rows, width), -1, np.int64)
    return Board(candidates, counts, spot, local, table, best, parents, np.zeros((rows, width), np.int64))


@jit
def _trace(board: Board, at: NDArray[np.int64], first: int, path_rows: NDArray[np.int64], path_nodes: NDArray[np.int64]) -> int:
    """List rows and nodes of the cheapest way, last first; the present ones where no way reaches the end."""
    row = len(board.counts) - 1
    choice = np.argmin(board.best[row, : board.counts[row]])
    count = 0
    if board.best[row, choice] == np.inf:
        for old in range(row, -1, -1):
            if at[first + old] >= 0:
                path_rows[count] = old
                path_nodes[count] = at[first + old]
                count += 1
        return count
    while row >= 0:
        path_rows[count] = row
        path_nodes[count] = board.candidates[row, choice]
        count += 1
        row, choice = board.parent_row[row, choice], board.parent_choice[row, choice]
    return count


@jit
def _settle_window(
    draft: Draft,
    ground: Ground,
    at: NDArray[np.int64],
    first: int,
    last: int,
    open_first: bool,
    open_last: bool,
    most: int,
    widest: int,
    prices: NDArray[np.float64],
    marks: NDArray[np.int64],
) -> None:
    _take_out(draft, at, first, last, open_first, open_last)
    board = _set_up(draft, ground, at, first, last, open_first, open_last, most, prices, marks)
    if ground.reach[0] > 0.0:
        relax_within(ground, board, first, widest, prices[TIME], prices[STAY] + prices[STAY_TIME], prices[ERROR])
    else:
        _relax(ground, board, first, widest, prices)
    rows = last - first + 1
    path_rows, path_nodes = np.empty(rows, np.int64), np.empty(rows, np.int64)
    count = _trace(board, at, first, path_rows, path_nodes)
    _put_back(draft, at, ground.places, first, last, path_rows, path_nodes, count, open_first, open_last)


@jit
def settle_stretch(
    draft: Draft,
    ground: Ground,
    at: NDArray[np.int64],
    start: int,
    stretch: NDArray[np.int64],
    phase: int,
    window: int,
    most: int,
    widest: int,
    prices: NDArray[np.float64],
    marks: NDArray[np.int64],
) -> int:
    """Settle the windows of a stretch of a piece from slot ``start`` on.

    Parameters
    ----------
    ground : Ground
        The slots and samples; where it has a reach, only parts within it are taken.
    at : int64 array, shape (slots,)
        Node of each slot, -1 where there is no knot; changed in place.
    stretch : int64 array, shape (4,)
        First and last slot, both with knots, and whether the piece begins and ends there: only then do their knots change.
    phase, window : int
        Knots in the first window and in the others.
    most, widest : int
        Near nodes to try at a slot, and slots that a part may span.

    Returns
    -------
    int
        Slot from which to go on once the draft has been given more room; the last one when all is done.
    """
    begin, end = stretch[0], stretch[1]
    first = start
    size = phase if start == begin else window
    while first < end:
        last = first
        knots = 0
        while last < end and (knots < size or at[last] < 0):
            last += 1
            if at[last] >= 0:
                knots += 1
                if knots >= size:
                    break
        if room(draft) < last - first + 8:
            return first
        open_first, open_last = first == begin and stretch[2] == 1, last == end and stretch[3] == 1
        _settle_window(draft, ground, at, first, last, open_first, open_last, most, widest, prices, marks)
        first = last
        size = window
    return end
