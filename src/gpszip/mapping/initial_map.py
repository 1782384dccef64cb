"""The map under construction: knots on a time grid, the segments between them, and their nodes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.numbering import number_by_visit
from gpszip.codec.prior import Prior
from gpszip.mapping.kernels.conjugate_gradients import improve_positions
from gpszip.mapping.kernels.grid_moments import segment_costs, segment_moments
from gpszip.mapping.kernels.initial_map import (
    NODE_COUNT,
    WorkingMap,
    count_prior_steps,
    count_walks,
    index_nodes,
)
from gpszip.mapping.kernels.rounding import round_node_positions
from gpszip.mapping.time_grid import TimeGrid
from gpszip.model import GridWalk, GridWalks
from gpszip.walks.kernels.along import sample_distances

if TYPE_CHECKING:
    from scipy.sparse import csr_array

__all__ = [
    "MAX_DENSE_NODES",
    "Segments",
    "build_working_map",
    "list_segments",
    "normal_equations",
    "round_positions",
    "sample_errors",
    "solve_positions",
    "squared_error",
    "walks_of",
]

#: A symmetric matrix of the M-step, dense for few nodes.
Matrix: TypeAlias = "NDArray[np.float64] | csr_array[Any]"

#: Nodes up to which matrices are dense. Below it, NumPy takes less time than SciPy's sparse
#: matrices do for their checks, and SciPy, which takes .28 s to import, is not needed.
MAX_DENSE_NODES = 64

#: Stiffness that holds every node where it is, so that a node without samples stays.
_ANCHOR = 1e-5

#: Nodes up to which the M-step is solved at once: below, it takes less than 40 ms. Of 6,000 nodes
#: with 12 neighbours each, it takes 40 ms where these have near numbers, and 3 s where they have
#: any; steps towards the solution take 2 ms.
_MAX_DIRECT_NODES = 1000
#: Grid steps by which a node may miss its optimum between its neighbours.
_TOLERANCE = 1e-3
#: Largest number of steps: most maps take 5 to 30; those that take more hold nodes that hardly any
#: sample binds. Each step lessens the error; of 7,454 nodes that take more than 100, a millionth of
#: what the direct solution saves was left.
_MAX_STEPS = 100

#: Passes over all nodes when their positions are rounded.
_ROUNDING_SWEEPS = 4

#: Entries of the table of pairs for each step that fits: two directions, half full.
_TABLE_ENTRIES_PER_STEP = 4

#: Least number of entries of the table of pairs.
_MIN_TABLE_ENTRIES = 64


@dataclass(frozen=True, eq=False)
class Segments:
    """Segments between consecutive knots of all pieces.

    Parameters
    ----------
    first_slots, last_slots : int64 arrays, shape (k,)
        Slots of each segment's knots.
    starts, ends : int64 arrays, shape (k,)
        Nodes of each segment's knots.
    moments : float64 array, shape (k, 2d + 4)
        Columns W, U1, U2, Q, M..., N... about the positions ``centers``, see
        :mod:`gpszip.mapping.kernels.grid_moments`.
    centers : float64 array, shape (k, d)
        In grid steps.
    nodes : int
        Number of nodes.
    """

    first_slots: NDArray[np.int64]
    last_slots: NDArray[np.int64]
    starts: NDArray[np.int64]
    ends: NDArray[np.int64]
    moments: NDArray[np.float64]
    centers: NDArray[np.float64]
    nodes: int

    def relabelled(self, slot_nodes: NDArray[np.int64], nodes: int) -> Segments:
        """Return the same segments between other nodes."""
        return replace(
            self, starts=slot_nodes[self.first_slots], ends=slot_nodes[self.last_slots], nodes=nodes
        )

    @cached_property
    def stiffness(self) -> Matrix:
        """Matrix K of the normal equations; it does not depend on the nodes' positions.

        A segment between the nodes u and v adds W - 2 U1 + U2 to K[u, u], U2 to K[v, v], and
        U1 - U2 to K[u, v] and K[v, u].
        """
        w, u1, u2 = self.moments[:, 0], self.moments[:, 1], self.moments[:, 2]
        nodes = np.arange(self.nodes)
        rows = np.concatenate([self.starts, self.ends, self.starts, self.ends, nodes])
        columns = np.concatenate([self.starts, self.ends, self.ends, self.starts, nodes])
        values = np.concatenate(
            [w - 2 * u1 + u2, u2, u1 - u2, u1 - u2, np.full(self.nodes, _ANCHOR)]
        )
        if self.nodes <= MAX_DENSE_NODES:
            dense = np.zeros((self.nodes, self.nodes))
            np.add.at(dense, (rows, columns), values)
            return dense

        from scipy.sparse import coo_array, csr_array

        return csr_array(coo_array((values, (rows, columns)), shape=(self.nodes, self.nodes)))


def list_segments(time_grid: TimeGrid, slot_nodes: NDArray[np.int64], nodes: int) -> Segments:
    """List the segments between knots, with the moments of their samples.

    Parameters
    ----------
    time_grid : TimeGrid
        The slots.
    slot_nodes : int64 array, shape (S,)
        Node of each slot, -1 where there is no knot.
    nodes : int
        Number of nodes.
    """
    # Pair consecutive knots of the same piece.
    knots = np.flatnonzero(slot_nodes >= 0)
    piece = np.searchsorted(time_grid.last_slots, knots)
    is_inside = piece[1:] == piece[:-1]
    first_slots, last_slots = knots[:-1][is_inside], knots[1:][is_inside]

    # Sum their samples up about the position of the first slot.
    moments = segment_moments(
        time_grid.sums,
        first_slots,
        last_slots,
        time_grid.ticks,
        time_grid.centers,
        time_grid.ticks_per_step,
    )
    return Segments(
        first_slots,
        last_slots,
        slot_nodes[first_slots],
        slot_nodes[last_slots],
        moments,
        time_grid.centers[first_slots] / time_grid.ticks_per_step,
        nodes,
    )


def squared_error(segments: Segments, positions: NDArray[np.float64]) -> float:
    """Sum of squared synchronised distances in squared grid steps, the thesis's tau."""
    return float(
        segment_costs(
            segments.moments, positions[segments.starts], positions[segments.ends], segments.centers
        ).sum()
    )


def sample_errors(
    time_grid: TimeGrid, segments: Segments, positions: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Synchronised distance of every sample in grid steps, and the segment of each."""
    # Compare each sample with the point of its segment at the same time.
    errors = np.empty(len(time_grid.times))
    segment = np.empty(len(time_grid.times), np.int64)
    starts, ends = positions[segments.starts], positions[segments.ends]
    sample_distances(
        segments.first_slots,
        segments.last_slots,
        starts,
        ends,
        time_grid.time_steps,
        time_grid.ends,
        time_grid.times,
        time_grid.sample_positions,
        errors,
        segment,
    )
    return errors, segment


def normal_equations(
    segments: Segments, positions: NDArray[np.float64]
) -> tuple[Matrix, NDArray[np.float64]]:
    """Return K and r; the solution of K x = r are the node positions of least squared error."""
    # Move the moments M and N from the segments' centres to the origin.
    dimension = positions.shape[1]
    m = segments.moments[:, 4 : 4 + dimension] + segments.centers * segments.moments[:, :1]
    n = segments.moments[:, 4 + dimension :] + segments.centers * segments.moments[:, 1:2]

    right = _ANCHOR * positions
    np.add.at(right, segments.starts, m - n)
    np.add.at(right, segments.ends, n)
    return segments.stiffness, right


def free_equations(
    stiffness: Matrix, right: NDArray[np.float64], positions: NDArray[np.float64], fixed: int
) -> tuple[Matrix, NDArray[np.float64]]:
    """Return the equations of all but the first ``fixed`` nodes, which stay where they are."""
    if fixed == 0:
        return stiffness, right
    free_right = right[fixed:] - stiffness[fixed:, :fixed] @ positions[:fixed]
    free = stiffness[fixed:, fixed:]
    return free if isinstance(free, np.ndarray) else free.tocsr(), free_right


def solve_positions(
    stiffness: Matrix, right: NDArray[np.float64], start: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Solve the M-step: the positions of all nodes at once.

    It is one sparse symmetric positive definite system. With many nodes, it is solved from the
    positions ``start`` on, if these are given, until no node alone would move by a thousandth of a
    grid step.
    """
    if stiffness.shape[0] == 0:
        return right
    if isinstance(stiffness, np.ndarray):
        return np.asarray(np.linalg.solve(stiffness, right), np.float64)
    if start is not None and len(start) > _MAX_DIRECT_NODES:
        solved = start.copy()
        improve_positions(*_compress_rows(stiffness), right, solved, _TOLERANCE, _MAX_STEPS)
        return solved

    from scipy.sparse.linalg import splu

    # A positive definite matrix needs no pivoting, so that the ordering keeps it sparse.
    solver = splu(
        stiffness.tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    return np.asarray(solver.solve(right))


def round_positions(
    stiffness: Matrix, right: NDArray[np.float64], positions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Round positions to whole grid steps, each given its neighbours."""
    rounded = positions.copy()
    round_node_positions(*_compress_rows(stiffness), right, rounded, _ROUNDING_SWEEPS)
    return rounded


def _compress_rows(
    matrix: Matrix,
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float64]]:
    """Offsets, columns and values of a matrix in CSR form."""
    # SciPy keeps indices of 64 bits, with which kernels would be compiled once more.
    if not isinstance(matrix, np.ndarray):
        return matrix.indptr.astype(np.int32), matrix.indices.astype(np.int32), matrix.data
    rows, columns = np.nonzero(matrix)
    offsets = np.searchsorted(rows, np.arange(len(matrix) + 1))
    return offsets.astype(np.int32), columns.astype(np.int32), matrix[rows, columns]


def walks_of(
    time_grid: TimeGrid,
    slot_nodes: NDArray[np.int64],
    positions: NDArray[np.float64],
    tracks: int,
    fixed: int = 0,
) -> GridWalks:
    """Return the knots on a time grid as walks.

    Parameters
    ----------
    time_grid : TimeGrid
        The slots.
    slot_nodes : int64 array, shape (S,)
        Node of each slot, -1 where there is no knot.
    positions : float64 array, shape (V, d)
        Whole positions of the nodes, in grid steps.
    tracks : int
        Number of tracks.
    fixed : int, default 0
        The first nodes keep their numbers; the others are numbered by their first visits.
    """
    # Find the knots of each track.
    knots = np.flatnonzero(slot_nodes >= 0)
    piece = np.searchsorted(time_grid.last_slots, knots)
    owner = time_grid.piece_tracks[piece]
    bounds = np.searchsorted(owner, np.arange(tracks + 1))

    # A step to another piece is a gap.
    walks = tuple(
        GridWalk(
            slot_nodes[knots[a:b]].astype(np.int32),
            time_grid.time_steps[knots[a:b]],
            np.diff(piece[a:b]) > 0,
        )
        for a, b in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True)
    )
    return number_by_visit(GridWalks(np.rint(positions).astype(np.int64), walks), fixed)


def allocate_working_map(dimension: int, nodes: int, steps: int, reach: float) -> WorkingMap:
    """Return an empty map with capacity for ``nodes`` nodes and ``steps`` different steps.

    Near nodes are those within ``reach`` grid steps.
    """
    # Sizes of hash tables are powers of two.
    entries = 1 << int(max(_TABLE_ENTRIES_PER_STEP * steps, _MIN_TABLE_ENTRIES)).bit_length()
    buckets = 1 << int(2 * nodes).bit_length()
    return WorkingMap(
        positions=np.zeros((nodes, dimension)),
        uses=np.zeros(nodes, np.int64),
        free=np.zeros(nodes, np.int64),
        outgoing_weight=np.zeros(nodes),
        first_half_edge=np.full(nodes, -1, np.int64),
        next_half_edge=np.zeros(2 * steps, np.int64),
        end_node=np.zeros(2 * steps, np.int64),
        table_index=np.zeros(2 * steps, np.int64),
        pair_keys=np.full(entries, -1, np.int64),
        pair_counts=np.zeros(entries, np.int64),
        first_in_bucket=np.full(buckets, -1, np.int64),
        next_in_bucket=np.full(nodes, -1, np.int64),
        cell_size=float(reach),
        counters=np.zeros(4, np.int64),
    )


def build_working_map(
    time_grid: TimeGrid,
    slot_nodes: NDArray[np.int64],
    positions: NDArray[np.float64],
    reach: float,
    spare: int,
    prior: Prior | None = None,
) -> WorkingMap:
    """Return a map of the present walks and the prior ones.

    Parameters
    ----------
    time_grid : TimeGrid
        The slots.
    slot_nodes : int64 array, shape (S,)
        Node of each slot, -1 where there is no knot.
    positions : float64 array, shape (V, d)
        The nodes, in grid steps; those of the prior walks first.
    reach : float
        Grid steps within which nodes are near.
    spare : int
        Capacity for further nodes and steps.
    prior : Prior, optional
        Walks that stay as they are.
    """
    knots = int((slot_nodes >= 0).sum()) + (0 if prior is None else len(prior.edge_traversals[0]))
    working_map = allocate_working_map(
        positions.shape[1], len(positions) + spare, knots + spare, reach
    )

    # Enter the nodes, then the walks.
    working_map.positions[: len(positions)] = positions
    working_map.counters[NODE_COUNT] = len(positions)
    index_nodes(working_map, len(positions))
    count_walks(working_map, slot_nodes, time_grid.last_slots)
    if prior is not None:
        working_map.uses[: prior.nodes] += prior.node_visits
        count_prior_steps(working_map, *prior.edge_traversals)
    return working_map
