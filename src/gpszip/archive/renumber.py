"""Number the nodes of walks that are taken out of archives, for new ones on the same grid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gpszip.archive.archive import Archive
from gpszip.codec.numbering import number_by_visit
from gpszip.model.grid_walks import GridWalks

__all__ = ["number_on_known_map"]


def number_on_known_map(archive: Archive, walks: GridWalks) -> GridWalks:
    """Number nodes as the coder wants them: those of the known map, then others as visited.

    Parameters
    ----------
    archive : Archive
        An archive on the grid of the walks, and on the known map if there is one.
    walks : GridWalks
        Walks on nodes of any numbers, of which several may be at one position.
    """
    prior = archive._prior
    if prior is None:
        return number_by_visit(_merge_equal_nodes(walks))
    known = prior.walks.nodes
    own = GridWalks(
        np.concatenate([known, walks.nodes]),
        tuple(replace(walk, nodes=walk.nodes + np.int32(len(known))) for walk in walks.walks),
        walks.timed,
        untimed=walks.untimed,
    )
    return number_by_visit(_merge_equal_nodes(own), len(known))


def _merge_equal_nodes(walks: GridWalks) -> GridWalks:
    """Give nodes at one position the number of the first of them."""
    _, first, number = np.unique(walks.nodes, axis=0, return_index=True, return_inverse=True)
    numbers = first[number.reshape(-1)].astype(np.int32)
    renumbered = tuple(replace(walk, nodes=numbers[walk.nodes]) for walk in walks.walks)
    return replace(walks, walks=renumbered)
