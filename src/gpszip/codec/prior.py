"""Walks that writer and reader both have already, after which coding goes on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.range_coder import listener
from gpszip.codec.kernels.walk_coder import code_walks
from gpszip.codec.kernels.walk_model import WalkModel, grown, new_model
from gpszip.codec.knots import flatten
from gpszip.model import LatticeWalks

__all__ = ["Past"]


@dataclass(frozen=True, eq=False)
class Past:
    """Walks known to both sides, and what the coder's model has learned from them.

    Parameters
    ----------
    walks : LatticeWalks
        Nodes numbered in the order of their first visit.

    Examples
    --------
    >>> import numpy as np
    >>> from gpszip.codec.walks import decode, encode
    >>> from gpszip.model import LatticeWalk
    >>> there = LatticeWalk(np.array([0, 1], np.int32), np.array([0, 9]), np.zeros(1, bool))
    >>> back = LatticeWalk(np.array([1, 0], np.int32), np.array([20, 29]), np.zeros(1, bool))
    >>> past = Past(LatticeWalks(np.array([[0, 0], [30, 4]]), (there,)))
    >>> data = encode(LatticeWalks(past.walks.nodes, (back,)), past)
    >>> decode(data, 2, 1, past).walks[0].nodes.tolist()
    [1, 0]
    """

    walks: LatticeWalks

    @cached_property
    def row(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int8], NDArray[np.int8]]:
        """All knots in a row: nodes, cells, whether a gap leads there, whether a track begins there."""
        return flatten(self.walks)

    @cached_property
    def steps(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Each pair of nodes between which a step leads, shape (s, 2), and how many do, shape (s,)."""
        nodes, _, gaps, begins = self.row
        inside = (gaps[1:] == 0) & (begins[1:] == 0)
        pairs, counts = np.unique(nodes[:-1][inside] * max(self.nodes, 1) + nodes[1:][inside], return_counts=True)
        return np.stack(np.divmod(pairs, max(self.nodes, 1)), axis=1), counts

    @cached_property
    def visits(self) -> NDArray[np.int64]:
        """How many knots each node has, shape (V,)."""
        return np.bincount(self.row[0], minlength=self.nodes).astype(np.int64)

    @property
    def nodes(self) -> int:
        """Number of nodes that both sides know."""
        return len(self.walks.nodes)

    def model(self, knots: int) -> WalkModel:
        """What has been learned, with room for so many further knots; the caller's own copy."""
        return grown(self._model, knots)

    @cached_property
    def _model(self) -> WalkModel:
        nodes, cells, gaps, begins = self.row
        model = new_model(len(nodes), self.walks.nodes.shape[1])
        model.places[: self.nodes] = self.walks.nodes
        code_walks(listener(), model, nodes, cells, gaps, begins, len(self.walks.walks), self.walks.timed, bool(gaps.any()))
        # each copy is as large as what was learned, however long that took
        return grown(model, 0)
