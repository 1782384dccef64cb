"""A draft of the connected map: nodes, and the knots of all walks on a time grid."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.linalg import splu

from gpszip.codec.prior import Past
from gpszip.codec.walks import number_by_visit
from gpszip.mapping.kernels.grid_moments import part_costs, part_moments
from gpszip.mapping.kernels.initial_map import Draft, enter_known, enter_nodes, enter_walks
from gpszip.mapping.kernels.rounding import round_places
from gpszip.mapping.time_grid import Slots
from gpszip.model import LatticeWalk, LatticeWalks
from gpszip.walks.kernels.along import distances_along

__all__ = [
    "Parts",
    "draft_of",
    "list_parts",
    "normal_equations",
    "place_nodes",
    "round_nodes",
    "sample_errors",
    "squared_error",
    "walks_of",
]

#: Pull of every node to where it is, so that one that no sample binds stays there.
_ANCHOR = 1e-5


@dataclass(frozen=True, eq=False)
class Parts:
    """The parts between consecutive knots of all pieces.

    ``froms`` and ``tos`` are slots, ``starts`` and ``ends`` nodes, all int64 arrays of shape (k,); ``moments`` has the
    columns W, U1, U2, Q, M..., N... about the places ``centers``, in quanta. ``nodes`` is the number of nodes.
    """

    froms: NDArray[np.int64]
    tos: NDArray[np.int64]
    starts: NDArray[np.int64]
    ends: NDArray[np.int64]
    moments: NDArray[np.float64]
    centers: NDArray[np.float64]
    nodes: int

    def renamed(self, at: NDArray[np.int64], nodes: int) -> Parts:
        """Return the same parts between other nodes."""
        return replace(self, starts=at[self.froms], ends=at[self.tos], nodes=nodes)

    @cached_property
    def stiffness(self) -> csr_array:
        """How firmly the samples hold each node, and each pair of nodes together; it does not depend on where they are."""
        w, u1, u2 = self.moments[:, 0], self.moments[:, 1], self.moments[:, 2]
        every = np.arange(self.nodes)
        rows = np.concatenate([self.starts, self.ends, self.starts, self.ends, every])
        columns = np.concatenate([self.starts, self.ends, self.ends, self.starts, every])
        values = np.concatenate([w - 2 * u1 + u2, u2, u1 - u2, u1 - u2, np.full(self.nodes, _ANCHOR)])
        return csr_array(coo_array((values, (rows, columns)), shape=(self.nodes, self.nodes)))


def list_parts(slots: Slots, at: NDArray[np.int64], nodes: int) -> Parts:
    """List the parts of a draft on so many nodes, with the moments of their samples."""
    knots = np.flatnonzero(at >= 0)
    piece = np.searchsorted(slots.lasts, knots)
    inside = piece[1:] == piece[:-1]
    froms, tos = knots[:-1][inside], knots[1:][inside]
    moments = part_moments(slots.sums, froms, tos, slots.ticks, slots.centers, slots.place_unit)
    return Parts(froms, tos, at[froms], at[tos], moments, slots.centers[froms] / slots.place_unit, nodes)


def squared_error(parts: Parts, places: NDArray[np.float64]) -> float:
    """Sum of squared synchronised distances in squared quanta, the thesis's tau."""
    return float(part_costs(parts.moments, places[parts.starts], places[parts.ends], parts.centers).sum())


def sample_errors(slots: Slots, parts: Parts, places: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Synchronised distance of every sample in quanta, and the part that each lies in."""
    errors, part = np.empty(len(slots.times)), np.empty(len(slots.times), np.int64)
    starts, ends = places[parts.starts], places[parts.ends]
    distances_along(parts.froms, parts.tos, starts, ends, slots.cells, slots.ends, slots.times, slots.spots, errors, part)
    return errors, part


def normal_equations(parts: Parts, places: NDArray[np.float64]) -> tuple[csr_array, NDArray[np.float64]]:
    """Return K and r whose solution K x = r places all nodes at least squared error."""
    dimension = places.shape[1]
    m = parts.moments[:, 4 : 4 + dimension] + parts.centers * parts.moments[:, :1]
    n = parts.moments[:, 4 + dimension :] + parts.centers * parts.moments[:, 1:2]
    right = _ANCHOR * places
    np.add.at(right, parts.starts, m - n)
    np.add.at(right, parts.ends, n)
    return parts.stiffness, right


def free_equations(
    stiffness: csr_array, right: NDArray[np.float64], places: NDArray[np.float64], fixed: int
) -> tuple[csr_array, NDArray[np.float64]]:
    """Return the equations of all but the first ``fixed`` nodes, which stay where they are."""
    if fixed == 0:
        return stiffness, right
    return stiffness[fixed:, fixed:].tocsr(), right[fixed:] - stiffness[fixed:, :fixed] @ places[:fixed]


def place_nodes(stiffness: csr_array, right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve the M-step: the places of all nodes at once (one sparse symmetric positive definite system)."""
    if stiffness.shape[0] == 0:
        return right
    solver = splu(stiffness.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return np.asarray(solver.solve(right))


def round_nodes(stiffness: csr_array, right: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Round places to whole quanta, each given its neighbours."""
    rounded = places.copy()
    round_places(stiffness.indptr, stiffness.indices, stiffness.data, right, rounded, 4)
    return rounded


def walks_of(slots: Slots, at: NDArray[np.int64], places: NDArray[np.float64], tracks: int, fixed: int = 0) -> LatticeWalks:
    """Return the draft as walks on the lattice, nodes but the first ``fixed`` numbered by visit; ``places`` are whole."""
    knots = np.flatnonzero(at >= 0)
    piece = np.searchsorted(slots.lasts, knots)
    owner = slots.owners[piece]
    bounds = np.searchsorted(owner, np.arange(tracks + 1))
    walks = tuple(
        LatticeWalk(at[knots[a:b]].astype(np.int32), slots.cells[knots[a:b]], np.diff(piece[a:b]) > 0)
        for a, b in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True)
    )
    return number_by_visit(LatticeWalks(np.rint(places).astype(np.int64), walks), fixed)


def empty_draft(dimension: int, nodes: int, steps: int, reach: float) -> Draft:
    """Return a draft with room for so many nodes and steps; near nodes are those within ``reach`` quanta."""
    table = 1 << int(max(4 * steps, 64)).bit_length()
    return Draft(
        places=np.zeros((nodes, dimension)),
        uses=np.zeros(nodes, np.int64),
        free=np.zeros(nodes, np.int64),
        leaving=np.zeros(nodes),
        head=np.full(nodes, -1, np.int64),
        following=np.zeros(2 * steps, np.int64),
        into=np.zeros(2 * steps, np.int64),
        slot_of=np.zeros(2 * steps, np.int64),
        keys=np.full(table, -1, np.int64),
        counts=np.zeros(table, np.int64),
        buckets=np.full(1 << int(2 * nodes).bit_length(), -1, np.int64),
        chained=np.full(nodes, -1, np.int64),
        cell=np.array([reach]),
        scalars=np.zeros(4, np.int64),
    )


def draft_of(
    slots: Slots, at: NDArray[np.int64], places: NDArray[np.float64], reach: float, spare: int, known: Past | None = None
) -> Draft:
    """Return a draft of the present walks, and of those known before, with ``spare`` room for more nodes and steps."""
    knots = int((at >= 0).sum()) + (0 if known is None else len(known.steps[0]))
    draft = empty_draft(places.shape[1], len(places) + spare, knots + spare, reach)
    draft.places[: len(places)] = places
    draft.scalars[0] = len(places)
    enter_nodes(draft, len(places))
    enter_walks(draft, at, slots.lasts)
    if known is not None:
        draft.uses[: known.nodes] += known.visits
        enter_known(draft, *known.steps)
    return draft
