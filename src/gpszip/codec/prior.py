"""Prior walks, shared by encoder and decoder, that train the model."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.range_coder import new_listener
from gpszip.codec.kernels.walk_coder import code_walks
from gpszip.codec.kernels.walk_model import WalkModel, extended, new_model
from gpszip.codec.knots import Knots, concatenate_knots
from gpszip.model import GridWalks

__all__ = ["Prior"]


@dataclass(frozen=True, eq=False)
class Prior:
    """Walks known to encoder and decoder, and the model trained on them.

    Parameters
    ----------
    walks : GridWalks
        Nodes are numbered in the order of their first visit.

    Examples
    --------
    >>> import numpy as np
    >>> from gpszip.codec.walks import decode, encode
    >>> from gpszip.model import GridWalk
    >>> forth = GridWalk(np.array([0, 1], np.int32), np.array([0, 9]), np.zeros(1, bool))
    >>> back = GridWalk(np.array([1, 0], np.int32), np.array([20, 29]), np.zeros(1, bool))
    >>> prior = Prior(GridWalks(np.array([[0, 0], [30, 4]]), (forth,)))
    >>> data = encode(GridWalks(prior.walks.nodes, (back,)), prior)
    >>> decode(data, 2, 1, prior).walks[0].nodes.tolist()
    [1, 0]
    """

    walks: GridWalks

    @cached_property
    def knots(self) -> Knots:
        """All knots, one walk after the other."""
        return concatenate_knots(self.walks)

    @cached_property
    def edge_traversals(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Pairs of nodes between which steps lead, shape (s, 2), and the number of steps, (s,)."""
        nodes, _, gaps, begins = self.knots
        # A step leads from the knot before, unless a gap does, or a track begins.
        is_step = (gaps[1:] == 0) & (begins[1:] == 0)
        base = max(self.nodes, 1)
        # One number for each pair, so that they can be counted; divmod takes it apart again.
        keys = nodes[:-1][is_step] * base + nodes[1:][is_step]
        keys, counts = np.unique(keys, return_counts=True)
        return np.stack(np.divmod(keys, base), axis=1), counts

    @cached_property
    def node_visits(self) -> NDArray[np.int64]:
        """Number of knots at each node, shape (V,)."""
        return np.bincount(self.knots.nodes, minlength=self.nodes).astype(np.int64)

    @property
    def nodes(self) -> int:
        """Number of nodes V."""
        return len(self.walks.nodes)

    def model(self, knots: int) -> WalkModel:
        """Return a copy of the trained model with capacity for ``knots`` more knots."""
        return extended(self._trained, knots)

    @cached_property
    def _trained(self) -> WalkModel:
        """The model after the walks."""
        knots = self.knots
        model = new_model(len(knots.nodes), self.walks.nodes.shape[1])
        model.places[: self.nodes] = self.walks.nodes
        tracks, gapped = len(self.walks.walks), bool(knots.gaps.any())
        # A listener learns as an encoder does, and writes nothing.
        code_walks(new_listener(), model, *knots, tracks, self.walks.timed, gapped)

        # Drop the capacity that is left, so that copies take time by nodes and not by knots.
        return extended(model, 0)
