"""Walks that writer and reader both have already, after which coding goes on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.range_coder import new_listener
from gpszip.codec.kernels.walk_coder import code_walks
from gpszip.codec.kernels.walk_model import WalkModel, extended, new_model
from gpszip.codec.knots import concatenate_knots
from gpszip.model import GridWalks

__all__ = ["Prior"]


@dataclass(frozen=True, eq=False)
class Prior:
    """Walks known to both sides, and what the coder's model has learned from them.

    Parameters
    ----------
    walks : LatticeWalks
        Nodes numbered in the order of their first visit.

    Examples
    --------
    >>> import numpy as np
    >>> from gpszip.codec.walks import decode, encode
    >>> from gpszip.model import GridWalk
    >>> there = GridWalk(np.array([0, 1], np.int32), np.array([0, 9]), np.zeros(1, bool))
    >>> back = GridWalk(np.array([1, 0], np.int32), np.array([20, 29]), np.zeros(1, bool))
    >>> prior = Prior(GridWalks(np.array([[0, 0], [30, 4]]), (there,)))
    >>> data = encode(GridWalks(prior.walks.nodes, (back,)), prior)
    >>> decode(data, 2, 1, prior).walks[0].nodes.tolist()
    [1, 0]
    """

    walks: GridWalks

    @cached_property
    def knots(
        self,
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int8], NDArray[np.int8]]:
        """All knots in a row: nodes, cells, whether a gap leads there, whether a track begins there."""
        return concatenate_knots(self.walks)

    @cached_property
    def edge_traversals(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Each pair of nodes between which a step leads, shape (s, 2), and how many do, shape (s,)."""
        nodes, _, gaps, begins = self.knots
        inside = (gaps[1:] == 0) & (begins[1:] == 0)
        pairs, counts = np.unique(
            nodes[:-1][inside] * max(self.nodes, 1) + nodes[1:][inside], return_counts=True
        )
        return np.stack(np.divmod(pairs, max(self.nodes, 1)), axis=1), counts

    @cached_property
    def node_visits(self) -> NDArray[np.int64]:
        """How many knots each node has, shape (V,)."""
        return np.bincount(self.knots[0], minlength=self.nodes).astype(np.int64)

    @property
    def nodes(self) -> int:
        """Number of nodes that both sides know."""
        return len(self.walks.nodes)

    def model(self, knots: int) -> WalkModel:
        """What has been learned, with room for so many further knots; the caller's own copy."""
        return extended(self._model, knots)

    @cached_property
    def _model(self) -> WalkModel:
        nodes, cells, gaps, begins = self.knots
        model = new_model(len(nodes), self.walks.nodes.shape[1])
        model.places[: self.nodes] = self.walks.nodes
        code_walks(
            new_listener(),
            model,
            nodes,
            cells,
            gaps,
            begins,
            len(self.walks.walks),
            self.walks.timed,
            bool(gaps.any()),
        )
        # each copy is as large as what was learned, however long that took
        return extended(model, 0)
