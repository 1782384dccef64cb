"""Walks that writer and reader both have already, after which coding goes on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from gpszip.kernels.range_coder import listener
from gpszip.kernels.walk_coder import code_walks
from gpszip.kernels.walk_model import WalkModel, grown, new_model
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
    >>> from gpszip.coding.walks import decode, encode
    >>> from gpszip.model import LatticeWalk
    >>> there = LatticeWalk(np.array([0, 1], np.int32), np.array([0, 9]), np.zeros(1, bool))
    >>> back = LatticeWalk(np.array([1, 0], np.int32), np.array([20, 29]), np.zeros(1, bool))
    >>> past = Past(LatticeWalks(np.array([[0, 0], [30, 4]]), (there,)))
    >>> data = encode(LatticeWalks(past.walks.nodes, (back,)), past)
    >>> decode(data, 2, 1, past).walks[0].nodes.tolist()
    [1, 0]
    """

    walks: LatticeWalks

    @property
    def knots(self) -> int:
        """Number of knots of all walks."""
        return sum(len(walk.nodes) for walk in self.walks.walks)

    @property
    def nodes(self) -> int:
        """Number of nodes that both sides know."""
        return len(self.walks.nodes)

    def model(self, knots: int) -> WalkModel:
        """What has been learned, with room for so many further knots; the caller's own copy."""
        return grown(self._model, self.knots + knots)

    @cached_property
    def _model(self) -> WalkModel:
        from gpszip.coding.walks import flatten

        knots = flatten(self.walks)
        model = new_model(self.knots, self.walks.nodes.shape[1])
        model.places[: self.nodes] = self.walks.nodes
        code_walks(listener(), model, *knots, len(self.walks.walks), self.walks.timed, bool(knots[2].any()))
        return model
