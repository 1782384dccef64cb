"""What a page says of an archive as text, and the bytes of its parts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gpszip.model.grid import step_size

if TYPE_CHECKING:
    from gpszip.archive import Archive
    from gpszip.view.samples import Samples

__all__ = ["archive_facts", "bytes_by_part"]

#: Rows of the coder's bit statistics that make a part of the walks.
_PARTS = {
    "positions of nodes": slice(10, 11),
    "paths": slice(0, 5),
    "times": slice(5, 10),
    "starts": slice(11, 12),
    "gaps": slice(12, 13),
}

#: Walks of more knots are not encoded again only to see what their bytes are spent on.
_MAX_KNOTS = 200_000


def archive_facts(archive: Archive, samples: Samples | None) -> list[list[str | float]]:
    """Label and text of each row of the table of numbers; a number is a length in metres.

    Parameters
    ----------
    archive : Archive
        The archive.
    samples : Samples or None
        All samples of the log, where it is given.
    """
    # What is stored. Waypoints, which info counts, too, take a while for thousands of tracks.
    bound, walks = archive.error_bound, archive.walks
    rows: list[list[str | float]] = [
        ["Bytes", f"{archive.size:,}"],
        ["Tracks", f"{len(archive.ids):,}"],
    ]
    if bound is not None:
        rows.append([f"{'Error' if bound.maximum else 'RMSE'} at most", bound.metres])
        if bound.max_error is not None and not bound.maximum:
            rows.append(["Error at most", bound.max_error])
    rows += [
        ["Nodes", f"{len(archive.road_map.nodes):,}"],
        ["Edges", f"{len(archive.road_map.edges):,}"],
        ["Segments", f"{sum(len(walk.gaps) for walk in walks):,}"],
        ["Gaps", f"{sum(int(walk.gaps.sum()) for walk in walks):,}"],
        ["Position step", step_size(archive.grid.space)],
    ]
    if archive.timed:
        rows.append(["Time step", f"{step_size(archive.grid.time):.3g} s"])

    # What was measured.
    if samples is None:
        return rows
    rows.append(["Points of the log", f"{samples.total:,}"])
    rows.append(["Bits per point", f"{8 * archive.size / max(samples.total, 1):.3g}"])
    if samples.rmse is not None and samples.max_error is not None:
        rows += [["RMSE", samples.rmse], ["Largest error", samples.max_error]]
    without = int(np.isnan(samples.errors).sum())
    if without:
        rows.append(["Points without an error", f"{without:,}"])
    return rows


def bytes_by_part(archive: Archive) -> list[list[str | int]]:
    """Name and bytes of each part of an archive; all together they are its size.

    The bits of the walks are those that the coder counts, in proportion to their bytes.
    """
    # The walks, and all the rest: the head, names, kept columns, checksums.
    walks = sum(len(group.payload) for group in archive.contents.groups)
    rest = archive.size - walks
    parts = _walk_parts(archive, walks)
    return [[name, count] for name, count in [*parts, ("names, head and checks", rest)] if count]


def _walk_parts(archive: Archive, total: int) -> list[tuple[str, int]]:
    """Name and bytes of each part of the walks."""
    from gpszip.codec.walks import encode_with_statistics

    knots = sum(len(walk.nodes) for walk in archive.grid_walks.walks)
    if knots > _MAX_KNOTS or archive.contents.map is not None:
        return [("walks", total)]

    # Round so that the parts sum up: differences of rounded sums.
    _, statistics = encode_with_statistics(archive.grid_walks)
    bits = np.array([statistics[rows, 0].sum() for rows in _PARTS.values()])
    ends = np.rint(np.cumsum(bits) / max(bits.sum(), 1e-9) * total).astype(int)
    return list(zip(_PARTS, np.diff(ends, prepend=0).tolist(), strict=True))
