"""The archive at a given RMSE, with and without times, and the CPU time it takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gpszip.archive import Archive
from gpszip.experiments.stages import measured
from gpszip.model import Options, Track
from gpszip.pipeline.compress import compress

__all__ = ["ArchiveResult", "run_archive"]


#: RMSE in metres of an archive at least: the resolution of the thesis's texts.
_MIN_RMSE = 1e-3


@dataclass(frozen=True, eq=False)
class ArchiveResult:
    """What ``gpszip compress`` made of a log.

    Parameters
    ----------
    archive : Archive
        The archive with times.
    bytes, bytes_without_times : int
        Sizes of the archives with times and without (``--no-times``).
    nodes, edges, segments : int
        Size of the map, and of the walks on it.
    rmse, max_error : float
        Synchronised error of the decoded archive at all samples, in metres.
    seconds : float
        CPU seconds of ``compress`` with times.
    """

    archive: Archive
    bytes: int
    bytes_without_times: int
    nodes: int
    edges: int
    segments: int
    rmse: float
    max_error: float
    seconds: float


def run_archive(tracks: Sequence[Track], rmse: float, *, quick: bool = False) -> ArchiveResult:
    """Compress tracks with the default options, or with the least effort, within an RMSE in metres.

    The RMSE is at least a millimetre, to which the thesis's texts are rounded: its pipeline may fit
    a log exactly.

    Examples
    --------
    >>> track = Track("lane", range(400), [[abs(t % 40 - 20.0), 0.0] for t in range(400)])
    >>> result = run_archive([track], 0.6)
    >>> result.rmse <= 0.6, result.bytes_without_times < result.bytes < 200
    (True, True)
    """
    # With times, which the clock measures, and without.
    options = Options(rmse=max(rmse, _MIN_RMSE))
    options = replace(options, effort=1) if quick else options
    seconds: dict[str, float] = {}
    with measured(seconds, "compress"):
        archive, report = compress(tracks, options)
    shapes, _ = compress(tracks, replace(options, times=False))

    # Sizes and errors.
    return ArchiveResult(
        archive=archive,
        bytes=archive.size,
        bytes_without_times=shapes.size,
        nodes=report.nodes,
        edges=report.edges,
        segments=report.segments,
        rmse=report.rmse,
        max_error=report.max_error,
        seconds=seconds["compress"],
    )
