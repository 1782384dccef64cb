"""The E-step of the connected map: the knots of one window of a walk are chosen anew at once.

Within a window, the walk's own uses are taken out of the counts. A dynamic program over slots and
candidate nodes then inserts, deletes, moves and relabels knots at their marginal price: a node that
other knots use is free, a new one pays for its position, and each step pays the bits of its code.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.copying import copy_values
from gpszip.kernels.jit import inner, inner_uncounted, jit_uncounted
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

__all__ = [
    "BEGINS_PIECE",
    "ENDS_PIECE",
    "FIRST_SLOT",
    "LAST_SLOT",
    "Prices",
    "assign_slice",
]

#: Index in a time slice of its first slot.
FIRST_SLOT = 0
#: Index of its last slot.
LAST_SLOT = 1
#: Index of the flag that a piece begins at its first slot.
BEGINS_PIECE = 2
#: Index of the flag that a piece ends at its last slot.
ENDS_PIECE = 3

#: Bits of squared error beyond which no segment pays, unless it joins adjacent slots.
_MAX_LINE_BITS = 200.0

#: Stands for a new node among the candidates of a slot.
_NEW_NODE = -2

#: Columns of a window's table beside the near nodes: the present node and a new one.
_EXTRA_CANDIDATES = 2

#: Spare capacity in nodes and steps that a window needs beside one for each slot.
_SPARE_CAPACITY = 8


class Prices(NamedTuple):
    """Prices of the E-step in bits; all are floats."""

    error: float  # of a squared error of one grid step
    duration: float  # of a step to another node
    stay_duration: float  # of a stop
    new_node: float  # to announce a new node
    position: float  # of a new node
    new_edge: float  # of a step along a new edge
    stay: float  # to announce a stop
    start: float  # of the first node of a piece
    escape: float  # of a known edge beside its share of the traffic
    beam: float  # beyond the cheapest candidate of a slot at which others are left out


@inner_uncounted
def _price_step(working_map: WorkingMap, u: int, v: int, prices: Prices) -> float:
    """Bits of a step between two used nodes: log2 of its share of the steps from u.

    With n the counts, a step against the direction of travel weighs half:
    log2((outgoing_weight[u] + 1) / (n[u, v] + n[v, u] / 2)) + escape, at most a new edge's price.
    """
    weight = step_count(working_map, u, v) + 0.5 * step_count(working_map, v, u)
    if weight <= 0.0:
        return prices.new_edge
    return min(
        np.log2((working_map.outgoing_weight[u] + 1.0) / weight) + prices.escape, prices.new_edge
    )


@inner
def _find_candidates(
    working_map: WorkingMap,
    positions: NDArray[np.float64],
    slot_nodes: NDArray[np.int64],
    first: int,
    last: int,
    max_near: int,
    candidates: NDArray[np.int64],
    counts: NDArray[np.int64],
) -> None:
    """List the candidates of each slot: the nearest nodes, its present one, and a new one."""
    # The nearest nodes of the map come first.
    distances = np.empty(max_near + 1)
    for slot in range(first, last + 1):
        row = slot - first
        count = find_near_nodes(working_map, positions[slot], max_near, candidates[row], distances)

        # The present node stays a candidate even where others are nearer.
        present = slot_nodes[slot]
        if present >= 0:
            is_listed = False
            for i in range(count):
                is_listed |= candidates[row, i] == present
            if not is_listed:
                candidates[row, count] = present
                count += 1

        # A new node at the slot's own position is always the last candidate.
        candidates[row, count] = _NEW_NODE
        counts[row] = count + 1


@inner_uncounted
def _number_used_candidates(
    working_map: WorkingMap,
    candidates: NDArray[np.int64],
    counts: NDArray[np.int64],
    marks: NDArray[np.int64],
    used_nodes: NDArray[np.int64],
) -> int:
    """Number the used nodes among the candidates from 1 on; 0 stands for all unused ones.

    ``marks`` receives the number of each node, ``used_nodes`` the node of each number.

    Returns
    -------
    int
        The largest number.
    """
    count = 0
    for row in range(len(counts)):
        for i in range(counts[row]):
            node = candidates[row, i]
            if node >= 0 and working_map.uses[node] > 0 and marks[node] == 0:
                count += 1
                marks[node] = count
                used_nodes[count] = node
    return count


@inner
def _price_all_steps(
    working_map: WorkingMap,
    used_nodes: NDArray[np.int64],
    count: int,
    marks: NDArray[np.int64],
    prices: Prices,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Bits of the steps between all used candidates; row and column 0 are for unused nodes.

    Returns
    -------
    step_bits : float64 array, shape (count + 1, count + 1)
        From each candidate to each.
    least_bits : float64 array, shape (count + 1,)
        Least bits of a step to each candidate from another one.
    """
    step_bits = np.full((count + 1, count + 1), prices.new_edge)
    step_bits[:, 0] = prices.new_node + prices.position
    least_bits = step_bits[0].copy()
    for i in range(1, count + 1):
        # Only half-edges of the map lead to nodes at less than a new edge's price.
        u = used_nodes[i]
        half = working_map.first_half_edge[u]
        while half >= 0:
            j = marks[working_map.end_node[half]]
            if j > 0 and j != i:
                step_bits[i, j] = _price_step(working_map, u, used_nodes[j], prices)
                least_bits[j] = min(least_bits[j], step_bits[i, j])
            half = working_map.next_half_edge[half]
        step_bits[i, i] = prices.stay
    return step_bits, least_bits


@inner
def _locate_candidates(
    working_map: WorkingMap,
    slot_positions: NDArray[np.float64],
    first: int,
    candidates: NDArray[np.int64],
    counts: NDArray[np.int64],
    marks: NDArray[np.int64],
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Position of each candidate, and its number among the used ones."""
    positions = np.empty((*candidates.shape, slot_positions.shape[1]))
    numbers = np.zeros(candidates.shape, np.int64)
    for row in range(len(counts)):
        for i in range(counts[row]):
            node = candidates[row, i]
            copy_values(
                slot_positions[first + row] if node == _NEW_NODE else working_map.positions[node],
                positions[row, i],
            )
            numbers[row, i] = 0 if node == _NEW_NODE else marks[node]
    return positions, numbers


@inner_uncounted
def _sum_end_terms(
    positions: NDArray[np.float64],
    row: int,
    count: int,
    exact_centers: NDArray[np.float64],
    origin: int,
    u2: float,
    n: NDArray[np.float64],
    end_terms: NDArray[np.float64],
    ends: NDArray[np.float64],
) -> None:
    """Ends y about the origin's centre, and the terms of the squared error of these alone.

    These terms are U2 |y|^2 - 2 y.N.
    """
    for c in range(count):
        end_terms[c] = 0.0
        for axis in range(len(n)):
            y = positions[row, c, axis] - exact_centers[origin, axis]
            ends[c, axis] = y
            end_terms[c] += u2 * y * y - 2.0 * y * n[axis]


@inner
def _bound_arrivals(
    candidates: NDArray[np.int64],
    counts: NDArray[np.int64],
    numbers: NDArray[np.int64],
    least_bits: NDArray[np.float64],
    prices: Prices,
) -> NDArray[np.float64]:
    """Least bits of a step to each candidate, with its duration."""
    arrivals = np.empty(candidates.shape)
    for row in range(len(counts)):
        for c in range(counts[row]):
            arrivals[row, c] = least_bits[numbers[row, c]] + prices.duration
            if candidates[row, c] >= 0:
                arrivals[row, c] = min(arrivals[row, c], prices.stay + prices.stay_duration)
    return arrivals


@inner_uncounted
def _find_limit(
    best: NDArray[np.float64],
    arrivals: NDArray[np.float64],
    row: int,
    count: int,
    cheapest: NDArray[np.float64],
    beam: float,
) -> float:
    """Bits of an origin from which on no step to a row pays.

    A step costs at least the arrival bits of its candidate, and pays where it costs less than the
    candidate did so far, and less than the beam's edge.
    """
    for c in range(count):
        cheapest[row] = min(cheapest[row], best[row, c])
    limit = -np.inf
    for c in range(count):
        limit = max(limit, min(best[row, c], cheapest[row] + beam) - arrivals[row, c])
    return limit


@inner
def _fill_table(
    grid_arrays: TimeGridArrays,
    dp_table: DPTable,
    first: int,
    max_slots: int,
    prices: Prices,
) -> None:
    """Fill a table from its first row on: squared error costs its price.

    Row r stands for slot ``first`` + r. With B[r, c] the least bits to reach candidate c of row r,

        B[r, c] = min over r - max_slots <= o < r and k of  B[o, k] + S(k, c) + lambda E(o, k, r, c)

    S is the price of the step and of its duration, lambda the price of a squared error. E is the
    squared error of the samples between the slots; about the centre of slot o, with x the position
    of candidate k and y that of c, and the moments of :mod:`grid_moments`, it is

        E = [(W - 2 U1 + U2) |x|^2 - 2 x.(M - N) + Q] + [U2 |y|^2 - 2 y.N] + 2 (U1 - U2) x.y

    Origins o are tried from the nearest to the farthest. The error of the best line between the
    slots bounds E from below and only grows, so that it ends the search. So does, for one x, that
    of the best y, of which the terms sum up to -|N - (U1 - U2) x|^2 / U2. ``Prices.beam`` leaves
    out candidates that cost that much more than the cheapest of their slot.

    The innermost loops stay in this function: to pass these arrays to another for each pair of
    slots takes longer than the arithmetic.
    """
    # No path to a row costs less than its origin and the least step to a candidate.
    sums, ticks, centers = grid_arrays.sums, grid_arrays.ticks, grid_arrays.centers
    unit = grid_arrays.ticks_per_step
    candidates, counts, positions, numbers = dp_table[:4]
    step_bits, arrivals, best, parent_rows, parent_choices = dp_table[4:]
    rows, width, dimension = positions.shape
    error_price, move_price = prices.error, prices.duration
    stay_price = prices.stay + prices.stay_duration
    m, n = np.empty(dimension), np.empty(dimension)
    end_terms, slopes = np.empty(width), np.empty(dimension)
    ends = np.empty((width, dimension))

    # Centres of the rows in grid steps.
    exact_centers = centers[first : first + rows] / unit

    # Least bits of each row, and of all rows up to it.
    cheapest, cheapest_so_far = np.full(rows, np.inf), np.full(rows, np.inf)
    for c in range(counts[0]):
        cheapest[0] = min(cheapest[0], best[0, c])
    cheapest_so_far[0] = cheapest[0]

    # Reach each row from the rows before it; an origin of ``limit`` bits or more does not pay.
    for row in range(1, rows):
        g = first + row
        limit = np.inf
        line_bits = 0.0

        # Try the origin of the slot before first: a good guess bounds the rest. Turn row + 1
        # stands for the guess, turn t <= row for origin t - 1.
        guess = parent_rows[row - 1, np.argmin(best[row - 1, : counts[row - 1]])]
        oldest = max(row - max_slots, 0)
        for turn in range(row if guess < oldest else row + 1, oldest, -1):
            origin = turn - 1 if turn <= row else guess

            # Leave out what can't pay, by the best line of the origin before.
            if turn < row:
                if cheapest_so_far[origin] + line_bits >= limit:
                    break
                if origin == guess:
                    continue
            elif turn == row:
                line_bits = 0.0
                if origin == guess:
                    continue
            if cheapest[origin] + line_bits >= limit:
                continue

            # The best line between the two slots bounds the error of all segments.
            a = first + origin
            w, u1, u2, q = moments_between(sums, a, g, ticks[a], ticks[g], centers[a], unit, m, n)
            line_bits = error_price * best_line_cost(w, u1, u2, q, m, n)
            if line_bits > _MAX_LINE_BITS and origin < row - 1:
                if turn < row:
                    break
                continue
            if cheapest[origin] + line_bits >= limit:
                continue

            # Try each start x at the origin.
            has_improved = has_ends = False
            for o in range(counts[origin]):
                reached = best[origin, o]
                if reached + line_bits >= limit:
                    continue

                # Terms of the start x alone, and slopes of the cross term 2 (U1 - U2) x.y.
                start_terms, pull = q, 0.0
                for axis in range(dimension):
                    x = positions[origin, o, axis] - exact_centers[origin, axis]
                    start_terms += (w - 2.0 * u1 + u2) * x * x - 2.0 * x * (m[axis] - n[axis])
                    slopes[axis] = 2.0 * (u1 - u2) * x
                    pull += (n[axis] - (u1 - u2) * x) ** 2

                # The best end for this start bounds the error, too.
                start_bits = line_bits
                if u2 > 0.0:
                    start_bits = max(line_bits, error_price * (start_terms - pull / u2))
                if reached + start_bits >= limit:
                    continue

                # Sum up the terms of each end y once.
                if not has_ends:
                    has_ends = True
                    _sum_end_terms(
                        positions, row, counts[row], exact_centers, origin, u2, n, end_terms, ends
                    )

                # Relax all candidates of the row.
                for c in range(counts[row]):
                    if candidates[origin, o] == candidates[row, c] and candidates[row, c] >= 0:
                        cost = reached + stay_price
                    else:
                        cost = reached + move_price + step_bits[numbers[origin, o], numbers[row, c]]
                    if cost + start_bits >= best[row, c]:
                        continue
                    square = start_terms + end_terms[c]
                    for axis in range(dimension):
                        square += slopes[axis] * ends[c, axis]
                    cost += error_price * max(square, 0.0)
                    if cost < best[row, c]:
                        best[row, c] = cost
                        parent_rows[row, c] = origin
                        parent_choices[row, c] = o
                        has_improved = True

            # A cheaper path to the row lowers the limit for the origins that are left.
            if has_improved:
                limit = _find_limit(best, arrivals, row, counts[row], cheapest, prices.beam)
        cheapest_so_far[row] = min(cheapest_so_far[row - 1], cheapest[row])


@inner_uncounted
def _subtract_window(
    working_map: WorkingMap,
    slot_nodes: NDArray[np.int64],
    first: int,
    last: int,
    with_first: bool,
    with_last: bool,
) -> None:
    """Take the window's steps, and the uses of its open knots, out of the counts."""
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


@inner
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
    """Enter the chosen knots, ``count`` rows and nodes, last first; release unused nodes."""
    # Take the old knots off their slots; a list of them is kept to release their nodes.
    old = slot_nodes[first : last + 1].copy()
    slot_nodes[first : last + 1] = -1

    # Count the uses of the open knots, and all steps.
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

    # Release nodes that only the old knots used; -1 keeps one from being released twice.
    for i in range(len(old)):
        if old[i] >= 0 and working_map.uses[old[i]] == 0:
            working_map.uses[old[i]] = -1
            release_node(working_map, old[i])


@inner
def _build_table(
    working_map: WorkingMap,
    grid_arrays: TimeGridArrays,
    slot_nodes: NDArray[np.int64],
    first: int,
    last: int,
    open_first: bool,
    open_last: bool,
    max_near: int,
    prices: Prices,
    marks: NDArray[np.int64],
) -> DPTable:
    """Table of a window with its first row filled; an end that isn't open keeps its node."""
    # List the candidates; a closed end has one.
    rows, width = last - first + 1, max_near + _EXTRA_CANDIDATES
    candidates, counts = np.empty((rows, width), np.int64), np.empty(rows, np.int64)
    _find_candidates(
        working_map, grid_arrays.positions, slot_nodes, first, last, max_near, candidates, counts
    )
    if not open_first:
        candidates[0, 0] = slot_nodes[first]
        counts[0] = 1
    if not open_last:
        candidates[rows - 1, 0] = slot_nodes[last]
        counts[rows - 1] = 1

    # Price the steps between them.
    used_nodes = np.empty(rows * width + 1, np.int64)
    used = _number_used_candidates(working_map, candidates, counts, marks, used_nodes)
    step_bits, least_bits = _price_all_steps(working_map, used_nodes, used, marks, prices)
    positions, numbers = _locate_candidates(
        working_map, grid_arrays.positions, first, candidates, counts, marks
    )
    for i in range(1, used + 1):
        marks[used_nodes[i]] = 0
    arrivals = _bound_arrivals(candidates, counts, numbers, least_bits, prices)

    # At an open start, a node that nobody uses pays for its position.
    bits = np.full((rows, width), np.inf)
    for i in range(counts[0]):
        node = candidates[0, i]
        is_unused = open_first and (node == _NEW_NODE or working_map.uses[node] == 0)
        bits[0, i] = prices.start + prices.position if is_unused else 0.0

    # No candidate has a parent yet; those of the first row never get one, and end each path.
    parent_rows = np.full((rows, width), -1, np.int64)
    parent_choices = np.zeros((rows, width), np.int64)
    return DPTable(
        candidates,
        counts,
        positions,
        numbers,
        step_bits,
        arrivals,
        bits,
        parent_rows,
        parent_choices,
    )


@inner_uncounted
def _backtrace(
    dp_table: DPTable,
    slot_nodes: NDArray[np.int64],
    first: int,
    path_rows: NDArray[np.int64],
    path_nodes: NDArray[np.int64],
) -> int:
    """List rows and nodes of the cheapest path, the last first, and return their number.

    Where no path reaches the end, these are the present knots.
    """
    # The cheapest path ends in the cheapest candidate of the last slot.
    row = len(dp_table.counts) - 1
    choice = np.argmin(dp_table.bits[row, : dp_table.counts[row]])
    count = 0

    # Keep the present knots.
    if dp_table.bits[row, choice] == np.inf:
        for old in range(row, -1, -1):
            if slot_nodes[first + old] >= 0:
                path_rows[count] = old
                path_nodes[count] = slot_nodes[first + old]
                count += 1
        return count

    # Follow the parents.
    while row >= 0:
        path_rows[count] = row
        path_nodes[count] = dp_table.candidates[row, choice]
        count += 1
        row, choice = dp_table.parent_rows[row, choice], dp_table.parent_choices[row, choice]
    return count


@inner
def _assign_window(
    working_map: WorkingMap,
    grid_arrays: TimeGridArrays,
    slot_nodes: NDArray[np.int64],
    first: int,
    last: int,
    open_first: bool,
    open_last: bool,
    max_near: int,
    max_slots: int,
    prices: Prices,
    marks: NDArray[np.int64],
) -> None:
    """Choose the knots of slots [first, last] anew."""
    # Leave the present knots out of the counts, else the edges that only they use look cheap.
    _subtract_window(working_map, slot_nodes, first, last, open_first, open_last)

    # Find the cheapest path through the window.
    dp_table = _build_table(
        working_map,
        grid_arrays,
        slot_nodes,
        first,
        last,
        open_first,
        open_last,
        max_near,
        prices,
        marks,
    )
    if grid_arrays.max_distance > 0.0:
        fill_table_within_max_error(
            grid_arrays,
            dp_table,
            first,
            max_slots,
            prices.duration,
            prices.stay + prices.stay_duration,
            prices.error,
            prices.beam,
        )
    else:
        _fill_table(grid_arrays, dp_table, first, max_slots, prices)
    rows = last - first + 1
    path_rows, path_nodes = np.empty(rows, np.int64), np.empty(rows, np.int64)
    count = _backtrace(dp_table, slot_nodes, first, path_rows, path_nodes)

    # Enter the knots of the path, and count their uses and steps.
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


@inner_uncounted
def _find_window_end(slot_nodes: NDArray[np.int64], first: int, end: int, size: int) -> int:
    """Slot of the knot that is ``size`` knots after slot ``first``, at most ``end``."""
    last = first
    knots = 0
    while last < end and (knots < size or slot_nodes[last] < 0):
        last += 1
        if slot_nodes[last] >= 0:
            knots += 1
            if knots >= size:
                break
    return last


@jit_uncounted
def assign_slice(
    working_map: WorkingMap,
    grid_arrays: TimeGridArrays,
    slot_nodes: NDArray[np.int64],
    start: int,
    time_slice: NDArray[np.int64],
    phase: int,
    window: int,
    max_near: int,
    max_slots: int,
    prices: Prices,
    marks: NDArray[np.int64],
) -> int:
    """Choose the knots of a time slice of a piece anew, window by window, from slot ``start`` on.

    Parameters
    ----------
    working_map : WorkingMap
        The map; its counts and nodes change in place.
    grid_arrays : TimeGridArrays
        Slots and samples. With a maximum distance, only segments within it are chosen.
    slot_nodes : int64 array, shape (S,)
        Node of each slot, -1 where there is no knot; changed in place.
    start : int
        Slot with a knot.
    time_slice : int64 array, shape (4,)
        First and last slot, both with knots, and whether the piece begins and ends there: only then
        do their knots change.
    phase, window : int
        Knots in the first window, and in the others.
    max_near : int
        Near nodes to try at a slot.
    max_slots : int
        Slots that a segment may span.
    prices : Prices
        Prices in bits.
    marks : int64 array, shape (nodes,)
        Scratch space: all 0, before and after.

    Returns
    -------
    int
        Slot from which to go on once the map has more capacity; the last one when all is done.
    """
    # The first window of a slice has its own size, so that windows end elsewhere in each round.
    begin, end = time_slice[FIRST_SLOT], time_slice[LAST_SLOT]
    first = start
    size = phase if start == begin else window
    while first < end:
        # Stop where the map is full, before anything changes.
        last = _find_window_end(slot_nodes, first, end, size)
        if free_capacity(working_map) < last - first + _SPARE_CAPACITY:
            return first

        # Only the ends of a piece are open; windows share the knots between them.
        open_first = first == begin and time_slice[BEGINS_PIECE] == 1
        open_last = last == end and time_slice[ENDS_PIECE] == 1
        _assign_window(
            working_map,
            grid_arrays,
            slot_nodes,
            first,
            last,
            open_first,
            open_last,
            max_near,
            max_slots,
            prices,
            marks,
        )
        first = last
        size = window
    return end
