"""Two archives on one map, so that their traversals can be compared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive
from gpszip.errors import OptionError
from gpszip.geo.planes import reproject_positions
from gpszip.history.traversals import History, match_traversals
from gpszip.io.networks.from_archive import clean_map_network
from gpszip.model import Track, Walk
from gpszip.model.grid import step_size
from gpszip.simplification.simplify import clean_map
from gpszip.walks.counting import build_road_map

__all__ = ["join_histories"]


def join_histories(first: Archive, second: Archive) -> tuple[History, NDArray[np.bool_]]:
    """Match the tracks of two archives to one clean map, which is learned from both.

    Parameters
    ----------
    first, second : Archive
        Both in degrees or both in metres.

    Returns
    -------
    History
        Tracks of the first archive, then those of the second.
    bool array, shape (n,)
        Which traversals are of the second.

    Raises
    ------
    OptionError
        If one is in degrees and the other in metres, or only one has heights.
    InputError
        If nothing moves in them.
    """
    # One plane.
    plane = first.grid.plane
    if (plane is None) != (second.grid.plane is None):
        raise OptionError("one archive is in degrees and the other in metres")
    if first.trimmed_map.nodes.shape[1] != second.trimmed_map.nodes.shape[1]:
        raise OptionError(
            "only one of both archives has heights",
            remedy="compress both with heights, or both without",
        )

    # All nodes and walks, those of the second with higher numbers.
    nodes: list[NDArray[np.float64]] = []
    walks: list[Walk] = []
    pieces: list[Track] = []
    owners: list[int] = []
    ids = (*first.ids, *second.ids)
    for archive, shift in ((first, 0), (second, len(first.ids))):
        moved = archive.trimmed_map.nodes
        if plane is not None and archive.grid.plane is not None:
            moved = reproject_positions(moved, archive.grid.plane, plane, "the new archive")
        count = sum(len(each) for each in nodes)
        walks += [
            replace(walk, id=f"{shift}/{walk.id}", nodes=(walk.nodes + count).astype(np.int32))
            for walk in archive.trimmed_walks
        ]
        nodes.append(moved)
        number = {name: shift + i for i, name in enumerate(archive.ids)}
        names = archive.pieces
        for piece in archive.decompress():
            positions = piece.positions
            if plane is not None and piece.plane is not None:
                positions = reproject_positions(positions, piece.plane, plane, piece.id)
            pieces.append(replace(piece, positions=positions, plane=plane))
            owners.append(number[names[piece.id]])

    # One clean map, and all pieces on it.
    resolution = max(step_size(archive.grid.space) for archive in (first, second))
    road_map = build_road_map(np.concatenate(nodes), walks, plane=plane)
    network = clean_map_network(
        clean_map(road_map, walks, resolution), "both archives", resolution, plane=plane
    )
    rows = match_traversals(pieces, network, ids, owners, gap=np.inf, are_knots=True)
    return History(network, rows), rows.track >= len(first.ids)
