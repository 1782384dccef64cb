"""A draft of the connected map: nodes, and the knots of all walks on a time grid."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.linalg import splu

from gpszip.codec.prior import Prior
from gpszip.codec.walks import number_by_visit
from gpszip.mapping.kernels.grid_moments import segment_costs, segment_moments
from gpszip.mapping.kernels.initial_map import (
    WorkingMap,
    count_prior_steps,
    count_walks,
    index_nodes,
)
from gpszip.mapping.kernels.rounding import round_node_positions
from gpszip.mapping.time_grid import TimeGrid
from gpszip.model import GridWalk, GridWalks
from gpszip.walks.kernels.along import sample_distances

__all__ = [
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

#: Pull of every node to where it is, so that one that no sample binds stays there.
_ANCHOR = 1e-5


@dataclass(frozen=True, eq=False)
class Segments:
    """The parts between consecutive knots of all pieces.

    ``froms`` and ``tos`` are slots, ``starts`` and ``ends`` nodes, all int64 arrays of shape (k,); ``moments`` has the
    columns W, U1, U2, Q, M..., N... about the places ``centers``, in quanta. ``nodes`` is the number of nodes.
    """

    first_slots: NDArray[np.int64]
    last_slots: NDArray[np.int64]
    starts: NDArray[np.int64]
    ends: NDArray[np.int64]
    moments: NDArray[np.float64]
    centers: NDArray[np.float64]
    nodes: int

    def relabelled(self, slot_nodes: NDArray[np.int64], nodes: int) -> Segments:
        """Return the same parts between other nodes."""
        return replace(
            self, starts=slot_nodes[self.first_slots], ends=slot_nodes[self.last_slots], nodes=nodes
        )

    @cached_property
    def stiffness(self) -> csr_array:
        """How firmly the samples hold each node, and each pair of nodes together; it does not depend on where they are."""
        w, u1, u2 = self.moments[:, 0], self.moments[:, 1], self.moments[:, 2]
        every = np.arange(self.nodes)
        rows = np.concatenate([self.starts, self.ends, self.starts, self.ends, every])
        columns = np.concatenate([self.starts, self.ends, self.ends, self.starts, every])
        values = np.concatenate(
            [w - 2 * u1 + u2, u2, u1 - u2, u1 - u2, np.full(self.nodes, _ANCHOR)]
        )
        return csr_array(coo_array((values, (rows, columns)), shape=(self.nodes, self.nodes)))


def list_segments(time_grid: TimeGrid, slot_nodes: NDArray[np.int64], nodes: int) -> Segments:
    """List the parts of a draft on so many nodes, with the moments of their samples."""
    knots = np.flatnonzero(slot_nodes >= 0)
    piece = np.searchsorted(time_grid.last_slots, knots)
    inside = piece[1:] == piece[:-1]
    froms, tos = knots[:-1][inside], knots[1:][inside]
    moments = segment_moments(
        time_grid.sums, froms, tos, time_grid.ticks, time_grid.centers, time_grid.ticks_per_step
    )
    return Segments(
        froms,
        tos,
        slot_nodes[froms],
        slot_nodes[tos],
        moments,
        time_grid.centers[froms] / time_grid.ticks_per_step,
        nodes,
    )


def squared_error(segments: Segments, positions: NDArray[np.float64]) -> float:
    """Sum of squared synchronised distances in squared quanta, the thesis's tau."""
    return float(
        segment_costs(
            segments.moments, positions[segments.starts], positions[segments.ends], segments.centers
        ).sum()
    )


def sample_errors(
    time_grid: TimeGrid, segments: Segments, positions: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Synchronised distance of every sample in quanta, and the part that each lies in."""
    errors, part = np.empty(len(time_grid.times)), np.empty(len(time_grid.times), np.int64)
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
        part,
    )
    return errors, part


def normal_equations(
    segments: Segments, positions: NDArray[np.float64]
) -> tuple[csr_array, NDArray[np.float64]]:
    """Return K and r whose solution K x = r places all nodes at least squared error."""
    dimension = positions.shape[1]
    m = segments.moments[:, 4 : 4 + dimension] + segments.centers * segments.moments[:, :1]
    n = segments.moments[:, 4 + dimension :] + segments.centers * segments.moments[:, 1:2]
    right = _ANCHOR * positions
    np.add.at(right, segments.starts, m - n)
    np.add.at(right, segments.ends, n)
    return segments.stiffness, right


def free_equations(
    stiffness: csr_array, right: NDArray[np.float64], positions: NDArray[np.float64], fixed: int
) -> tuple[csr_array, NDArray[np.float64]]:
    """Return the equations of all but the first ``fixed`` nodes, which stay where they are."""
    if fixed == 0:
        return stiffness, right
    return stiffness[fixed:, fixed:].tocsr(), right[fixed:] - stiffness[fixed:, :fixed] @ positions[
        :fixed
    ]


def solve_positions(stiffness: csr_array, right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve the M-step: the places of all nodes at once (one sparse symmetric positive definite system)."""
    if stiffness.shape[0] == 0:
        return right
    solver = splu(
        stiffness.tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    return np.asarray(solver.solve(right))


def round_positions(
    stiffness: csr_array, right: NDArray[np.float64], positions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Round places to whole quanta, each given its neighbours."""
    rounded = positions.copy()
    round_node_positions(stiffness.indptr, stiffness.indices, stiffness.data, right, rounded, 4)
    return rounded


def walks_of(
    time_grid: TimeGrid,
    slot_nodes: NDArray[np.int64],
    positions: NDArray[np.float64],
    tracks: int,
    fixed: int = 0,
) -> GridWalks:
    """Return the draft as walks on the lattice, nodes but the first ``fixed`` numbered by visit; ``places`` are whole."""
    knots = np.flatnonzero(slot_nodes >= 0)
    piece = np.searchsorted(time_grid.last_slots, knots)
    owner = time_grid.piece_tracks[piece]
    bounds = np.searchsorted(owner, np.arange(tracks + 1))
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
    """Return a draft with room for so many nodes and steps; near nodes are those within ``reach`` quanta."""
    table = 1 << int(max(4 * steps, 64)).bit_length()
    return WorkingMap(
        positions=np.zeros((nodes, dimension)),
        uses=np.zeros(nodes, np.int64),
        free=np.zeros(nodes, np.int64),
        outgoing_weight=np.zeros(nodes),
        first_half_edge=np.full(nodes, -1, np.int64),
        next_half_edge=np.zeros(2 * steps, np.int64),
        into=np.zeros(2 * steps, np.int64),
        table_index=np.zeros(2 * steps, np.int64),
        keys=np.full(table, -1, np.int64),
        counts=np.zeros(table, np.int64),
        buckets=np.full(1 << int(2 * nodes).bit_length(), -1, np.int64),
        next_in_bucket=np.full(nodes, -1, np.int64),
        bucket_size=np.array([reach]),
        scalars=np.zeros(4, np.int64),
    )


def build_working_map(
    time_grid: TimeGrid,
    slot_nodes: NDArray[np.int64],
    positions: NDArray[np.float64],
    reach: float,
    spare: int,
    known: Prior | None = None,
) -> WorkingMap:
    """Return a draft of the present walks, and of those known before, with ``spare`` room for more nodes and steps."""
    knots = int((slot_nodes >= 0).sum()) + (0 if known is None else len(known.edge_traversals[0]))
    working_map = allocate_working_map(
        positions.shape[1], len(positions) + spare, knots + spare, reach
    )
    working_map.positions[: len(positions)] = positions
    working_map.scalars[0] = len(positions)
    index_nodes(working_map, len(positions))
    count_walks(working_map, slot_nodes, time_grid.last_slots)
    if known is not None:
        working_map.uses[: known.nodes] += known.node_visits
        count_prior_steps(working_map, *known.edge_traversals)
    return working_map
