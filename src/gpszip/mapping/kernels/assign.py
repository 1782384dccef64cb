"""The E-step of the connected map: knots of one window of a walk are chosen anew, all at once, at their marginal price.

Within a window the walk's own uses are taken out of the counts. Then a dynamic program over slots and candidate nodes may insert,
delete, move and relabel knots: a node that others use is free, one that nobody uses pays for its place, and every step
pays what it would cost to code.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.mapping.kernels.assign_max_error import fill_table_within_max_error
from gpszip.mapping.kernels.grid_moments import best_line_cost, moments_between
from gpszip.mapping.kernels.initial_map import (
    WorkingMap,
    add_node,
    count_step,
    find_near_nodes,
    free_capacity,
    release_node,
    step_count,
)
from gpszip.mapping.kernels.time_grid import DPTable, TimeGridArrays

__all__ = ["CANDIDATES", "assign_slice"]

#: Prices in bits, in the order of the array ``prices``; the last is what a candidate may cost beyond the cheapest of its slot.
ERROR, TIME, STAY_TIME, NEW, PLACE, LINK, STAY, JUMP, ESCAPE, BEAM = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9

CANDIDATES = 8
_MAX_LINE_BITS = 200.0
_NEW_NODE = -2


@jit
def _step_price(working_map: WorkingMap, u: int, v: int, prices: NDArray[np.float64]) -> float:
    """Bits of a step between two nodes that others use."""
    weight = step_count(working_map, u, v) + 0.5 * step_count(working_map, v, u)
    if weight <= 0.0:
        return prices[LINK]
    return min(
        np.log2((working_map.outgoing_weight[u] + 1.0) / weight) + prices[ESCAPE], prices[LINK]
    )


@jit
def _find_candidates(
    working_map: WorkingMap,
    positions: NDArray[np.float64],
    slot_nodes: NDArray[np.int64],
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
        count = find_near_nodes(working_map, positions[slot], most, candidates[row], distances)
        own = slot_nodes[slot]
        if own >= 0:
            known = False
            for i in range(count):
                known |= candidates[row, i] == own
            if not known:
                candidates[row, count] = own
                count += 1
        candidates[row, count] = _NEW_NODE
        counts[row] = count + 1


@jit
def _number_used_candidates(
    working_map: WorkingMap,
    candidates: NDArray[np.int64],
    counts: NDArray[np.int64],
    marks: NDArray[np.int64],
    members: NDArray[np.int64],
) -> int:
    """Number the used nodes among the candidates from 1 on; 0 stands for all that nobody uses."""
    count = 0
    for row in range(len(counts)):
        for i in range(counts[row]):
            node = candidates[row, i]
            if node >= 0 and working_map.uses[node] > 0 and marks[node] == 0:
                count += 1
                marks[node] = count
                members[count] = node
    return count


@jit
def _price_steps(
    working_map: WorkingMap,
    members: NDArray[np.int64],
    count: int,
    marks: NDArray[np.int64],
    prices: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Bits of the steps between all used candidates; row and column 0 are for fresh nodes."""
    table = np.full((count + 1, count + 1), prices[LINK])
    table[:, 0] = prices[NEW] + prices[PLACE]
    for i in range(1, count + 1):
        u = members[i]
        half = working_map.first_half_edge[u]
        while half >= 0:
            v = working_map.into[half]
            if marks[v] > 0:
                table[i, marks[v]] = _step_price(working_map, u, v, prices)
            half = working_map.next_half_edge[half]
        table[i, i] = prices[STAY]
    return table


@jit
def _locate_candidates(
    working_map: WorkingMap,
    positions: NDArray[np.float64],
    first: int,
    candidates: NDArray[np.int64],
    counts: NDArray[np.int64],
    marks: NDArray[np.int64],
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Place of each candidate, and its index among the used ones."""
    spot = np.empty((*candidates.shape, positions.shape[1]))
    local = np.zeros(candidates.shape, np.int64)
    for row in range(len(counts)):
        for i in range(counts[row]):
            node = candidates[row, i]
            spot[row, i] = (
                positions[first + row] if node == _NEW_NODE else working_map.positions[node]
            )
            local[row, i] = 0 if node == _NEW_NODE else marks[node]
    return spot, local


@jit
def _fill_table(
    grid_arrays: TimeGridArrays,
    dp_table: DPTable,
    first: int,
    max_slots: int,
    prices: NDArray[np.float64],
) -> None:
    """Fill the board from its first row on: squared error costs its price.

    Origins are looked at from the nearest to the farthest: what the best line misses only grows, and ends the search. A
    candidate that costs so much more than the cheapest of its slot as the last of the prices says is left out.
    One long loop on purpose: handing these arrays to a function for each pair of slots takes longer than the arithmetic.
    """
    sums, ticks, centers, unit = (
        grid_arrays.sums,
        grid_arrays.ticks,
        grid_arrays.centers,
        grid_arrays.ticks_per_step[0],
    )
    candidates, counts, spot, local, table, best, parent_row, parent_choice = dp_table
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
        for turn in range(
            row if guess < max(row - max_slots, 0) else row + 1, max(row - max_slots, 0), -1
        ):
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
            w, u1, u2, q = moments_between(sums, a, g, ticks[a], ticks[g], centers[a], unit, m, n)
            missed = error * best_line_cost(w, u1, u2, q, m, n)
            if missed > _MAX_LINE_BITS and origin < row - 1:
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
def _subtract_window(
    working_map: WorkingMap,
    slot_nodes: NDArray[np.int64],
    first: int,
    last: int,
    with_first: bool,
    with_last: bool,
) -> None:
    """Take the window's steps, and the uses of its free knots, out of the counts."""
    before = slot_nodes[first]
    if with_first:
        working_map.uses[before] -= 1
    for slot in range(first + 1, last + 1):
        node = slot_nodes[slot]
        if node >= 0:
            count_step(working_map, before, node, -1)
            if slot < last or with_last:
                working_map.uses[node] -= 1
            before = node


@jit
def _add_window(
    working_map: WorkingMap,
    slot_nodes: NDArray[np.int64],
    positions: NDArray[np.float64],
    first: int,
    last: int,
    rows: NDArray[np.int64],
    nodes: NDArray[np.int64],
    count: int,
    with_first: bool,
    with_last: bool,
) -> None:
    """Enter the chosen knots (``count`` rows and nodes, last first) and drop what nobody uses any more."""
    old = slot_nodes[first : last + 1].copy()
    slot_nodes[first : last + 1] = -1
    before = -1
    for i in range(count - 1, -1, -1):
        slot = first + rows[i]
        node = nodes[i]
        if node == _NEW_NODE:
            node = add_node(working_map, positions[slot])
        slot_nodes[slot] = node
        if (slot > first or with_first) and (slot < last or with_last):
            working_map.uses[node] += 1
        if before >= 0:
            count_step(working_map, before, node, 1)
        before = node
    for i in range(len(old)):
        if old[i] >= 0 and working_map.uses[old[i]] == 0:
            working_map.uses[old[i]] = -1
            release_node(working_map, old[i])


@jit
def _build_table(
    working_map: WorkingMap,
    grid_arrays: TimeGridArrays,
    slot_nodes: NDArray[np.int64],
    first: int,
    last: int,
    open_first: bool,
    open_last: bool,
    most: int,
    prices: NDArray[np.float64],
    marks: NDArray[np.int64],
) -> DPTable:
    """Board of a window before the first move; an end that isn't open keeps its node."""
    rows, width = last - first + 1, most + 2
    candidates, counts = np.empty((rows, width), np.int64), np.empty(rows, np.int64)
    _find_candidates(
        working_map, grid_arrays.positions, slot_nodes, first, last, most, candidates, counts
    )
    if not open_first:
        candidates[0, 0] = slot_nodes[first]
        counts[0] = 1
    if not open_last:
        candidates[rows - 1, 0] = slot_nodes[last]
        counts[rows - 1] = 1
    members = np.empty(rows * width + 1, np.int64)
    used = _number_used_candidates(working_map, candidates, counts, marks, members)
    table = _price_steps(working_map, members, used, marks, prices)
    spot, local = _locate_candidates(
        working_map, grid_arrays.positions, first, candidates, counts, marks
    )
    for i in range(1, used + 1):
        marks[members[i]] = 0
    best = np.full((rows, width), np.inf)
    for i in range(counts[0]):
        node = candidates[0, i]
        lone = open_first and (node == _NEW_NODE or working_map.uses[node] == 0)
        best[0, i] = prices[JUMP] + prices[PLACE] if lone else 0.0
    parents = np.full((rows, width), -1, np.int64)
    return DPTable(
        candidates, counts, spot, local, table, best, parents, np.zeros((rows, width), np.int64)
    )


@jit
def _backtrace(
    dp_table: DPTable,
    slot_nodes: NDArray[np.int64],
    first: int,
    path_rows: NDArray[np.int64],
    path_nodes: NDArray[np.int64],
) -> int:
    """List rows and nodes of the cheapest way, last first; the present ones where no way reaches the end."""
    row = len(dp_table.counts) - 1
    choice = np.argmin(dp_table.best[row, : dp_table.counts[row]])
    count = 0
    if dp_table.best[row, choice] == np.inf:
        for old in range(row, -1, -1):
            if slot_nodes[first + old] >= 0:
                path_rows[count] = old
                path_nodes[count] = slot_nodes[first + old]
                count += 1
        return count
    while row >= 0:
        path_rows[count] = row
        path_nodes[count] = dp_table.candidates[row, choice]
        count += 1
        row, choice = dp_table.parent_row[row, choice], dp_table.parent_choice[row, choice]
    return count


@jit
def _assign_window(
    working_map: WorkingMap,
    grid_arrays: TimeGridArrays,
    slot_nodes: NDArray[np.int64],
    first: int,
    last: int,
    open_first: bool,
    open_last: bool,
    most: int,
    max_slots: int,
    prices: NDArray[np.float64],
    marks: NDArray[np.int64],
) -> None:
    _subtract_window(working_map, slot_nodes, first, last, open_first, open_last)
    dp_table = _build_table(
        working_map,
        grid_arrays,
        slot_nodes,
        first,
        last,
        open_first,
        open_last,
        most,
        prices,
        marks,
    )
    if grid_arrays.reach[0] > 0.0:
        fill_table_within_max_error(
            grid_arrays,
            dp_table,
            first,
            max_slots,
            prices[TIME],
            prices[STAY] + prices[STAY_TIME],
            prices[ERROR],
        )
    else:
        _fill_table(grid_arrays, dp_table, first, max_slots, prices)
    rows = last - first + 1
    path_rows, path_nodes = np.empty(rows, np.int64), np.empty(rows, np.int64)
    count = _backtrace(dp_table, slot_nodes, first, path_rows, path_nodes)
    _add_window(
        working_map,
        slot_nodes,
        grid_arrays.positions,
        first,
        last,
        path_rows,
        path_nodes,
        count,
        open_first,
        open_last,
    )


@jit
def assign_slice(
    working_map: WorkingMap,
    grid_arrays: TimeGridArrays,
    slot_nodes: NDArray[np.int64],
    start: int,
    time_slice: NDArray[np.int64],
    phase: int,
    window: int,
    most: int,
    max_slots: int,
    prices: NDArray[np.float64],
    marks: NDArray[np.int64],
) -> int:
    """Settle the windows of a stretch of a piece from slot ``start`` on.

    Parameters
    ----------
    grid_arrays : Ground
        The slots and samples; where it has a reach, only parts within it are taken.
    slot_nodes : int64 array, shape (slots,)
        Node of each slot, -1 where there is no knot; changed in place.
    time_slice : int64 array, shape (4,)
        First and last slot, both with knots, and whether the piece begins and ends there: only then do their knots change.
    phase, window : int
        Knots in the first window and in the others.
    most, max_slots : int
        Near nodes to try at a slot, and slots that a part may span.

    Returns
    -------
    int
        Slot from which to go on once the draft has been given more room; the last one when all is done.
    """
    begin, end = time_slice[0], time_slice[1]
    first = start
    size = phase if start == begin else window
    while first < end:
        last = first
        knots = 0
        while last < end and (knots < size or slot_nodes[last] < 0):
            last += 1
            if slot_nodes[last] >= 0:
                knots += 1
                if knots >= size:
                    break
        if free_capacity(working_map) < last - first + 8:
            return first
        open_first, open_last = (
            first == begin and time_slice[2] == 1,
            last == end and time_slice[3] == 1,
        )
        _assign_window(
            working_map,
            grid_arrays,
            slot_nodes,
            first,
            last,
            open_first,
            open_last,
            most,
            max_slots,
            prices,
            marks,
        )
        first = last
        size = window
    return end
