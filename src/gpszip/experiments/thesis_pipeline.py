"""The thesis's pipeline as chapter 8 runs it, the sizes of its texts, and its CPU time.

Coreset (chapter 5), (k,m)-segment mean (algorithm 1), map (algorithm 5), waypoints (algorithm 6),
bzip2. Sizes are those of texts: the thesis states ratios of text sizes, and leaves out times.
"""

from __future__ import annotations

import bz2
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.waypoints import Connection, Waypoints, find_waypoints_by_bisection
from gpszip.errors import BoundError
from gpszip.experiments.stages import measured
from gpszip.graph.road_graph import build_road_graph
from gpszip.graph.route import build_route
from gpszip.mapping.segment_map import SegmentMap, build_walk, make_map
from gpszip.mapping.thinning import reduce_to_coreset
from gpszip.model import SegmentMean, Track, Walk
from gpszip.pipeline.segment_mean import segment_mean as find_segment_mean
from gpszip.segmentation.bound import segment_mean_within
from gpszip.walks.error import measure_errors

__all__ = ["STAGES", "TextSizes", "ThesisResult", "at_elbow", "run_thesis", "within_rmse"]

#: Stages of the pipeline in their order.
STAGES = ("coreset", "segments", "map", "waypoints", "bzip2")

#: Shares of k that are tried for m. The thesis's tables have from 0.33 to 0.85.
_SHARES = (0.2, 0.4, 0.7)

#: Times at most that segments are learned, each within a smaller RMSE than before: a coreset may
#: hold one that its log misses. The factor makes up for steps of k.
_TRIALS, _TIGHTER = 4, 0.99

#: Multiple of the RMSE from which on the coreset is too small for that: k would grow for nothing.
_FAR = 1.5

#: Decimals of metres and seconds in texts.
_DECIMALS = 3

#: Finds the segment mean of a track.
Finder = Callable[[Track], SegmentMean]


@dataclass(frozen=True)
class TextSizes:
    """Bytes of the texts of a log and of what stands for it.

    Parameters
    ----------
    log : int
        The log, a line for each sample.
    semantic : int
        Coordinates of the waypoints, and the map.
    log_bzip2, semantic_bzip2 : int
        The same after bzip2.
    """

    log: int
    semantic: int
    log_bzip2: int
    semantic_bzip2: int

    @property
    def bzip2_ratio(self) -> float:
        """How many times smaller bzip2 makes the log."""
        return self.log / self.log_bzip2

    @property
    def semantic_ratio(self) -> float:
        """How many times smaller than the log the waypoints and the map are."""
        return self.log / self.semantic

    @property
    def both_ratio(self) -> float:
        """How many times smaller than the log they are after bzip2."""
        return self.log / self.semantic_bzip2

    @property
    def improvement(self) -> float:
        """How many times smaller than bzip2 of the log they are after bzip2."""
        return self.log_bzip2 / self.semantic_bzip2


@dataclass(frozen=True, eq=False)
class ThesisResult:
    """What the thesis's pipeline made of one track.

    Parameters
    ----------
    points : int
        Samples of the track.
    coreset : int or None
        Weighted samples that the segments were learned from; None for all samples.
    learned : Track
        These samples.
    mean : SegmentMean
        The (k,m)-segment mean.
    segment_map : SegmentMap
        Its map.
    walk : Walk
        The track as a walk on the map.
    waypoints : int
        Length of the compressed walk.
    sizes, timed_sizes : TextSizes
        Without times, as in the thesis, and with the time of each sample and knot.
    rmse, max_error : float
        Synchronised error at all samples of the track in metres.
    seconds : dict of str to float
        CPU seconds of each stage.
    """

    points: int
    coreset: int | None
    learned: Track
    mean: SegmentMean
    segment_map: SegmentMap
    walk: Walk
    waypoints: int
    sizes: TextSizes
    timed_sizes: TextSizes
    rmse: float
    max_error: float
    seconds: dict[str, float]

    @property
    def nodes(self) -> int:
        """Number of nodes of the map, two for each segment."""
        return len(self.segment_map.road_map.nodes)

    @property
    def edges(self) -> int:
        """Number of directed edges of the map: segments and transitions."""
        return len(self.segment_map.road_map.directed())


def within_rmse(rmse: float, share: float) -> Finder:
    """Return a function that finds the least k within an RMSE in metres, with m = share k."""
    return lambda track: segment_mean_within(track, rmse=rmse, m=share)


def at_elbow(track: Track) -> SegmentMean:
    """Return the segment mean at the elbow of the cost (algorithms 3 and 4)."""
    return find_segment_mean(track)


def run_thesis(
    track: Track, rmse: float | None = None, *, coreset: int | None = None
) -> ThesisResult:
    """Run the thesis's pipeline on one track.

    Parameters
    ----------
    track : Track
        n samples with times.
    rmse : float, optional
        RMSE in metres at all samples, unless the coreset is too small for it. Each share of m in k
        is tried, and the result with the smallest text after bzip2 is returned. By default, k and m
        are those at the elbow.
    coreset : int, optional
        Blocks of the coreset to learn from.

    Raises
    ------
    BoundError
        If no k keeps the RMSE with any of the shares.

    Examples
    --------
    >>> track = Track("lane", range(400), [[abs(t % 40 - 20.0), 0.0] for t in range(400)])
    >>> result = run_thesis(track, rmse=0.6)
    >>> result.nodes, result.rmse <= 0.6, result.sizes.both_ratio > 5
    (8, True, True)
    """
    if rmse is None:
        return _run(track, at_elbow, coreset)

    # Few segments may not suffice, however many intervals there are.
    results, failure = [], None
    for share in _SHARES:
        try:
            results.append(_run_within(track, rmse, share, coreset))
        except BoundError as error:
            failure = error
    if failure is not None and not results:
        raise failure
    return min(results, key=lambda result: result.sizes.semantic_bzip2)


def _run_within(track: Track, rmse: float, share: float, coreset: int | None) -> ThesisResult:
    """Run all stages with the least k within an RMSE at all samples, with m = share k."""
    target = rmse
    for _ in range(_TRIALS):
        result = _run(track, within_rmse(target, share), coreset)
        if result.rmse <= rmse or result.rmse > _FAR * rmse:
            break
        target *= _TIGHTER * rmse / result.rmse
    return result


def _run(track: Track, find: Finder, coreset: int | None) -> ThesisResult:
    """Run all stages with one way to find the segment mean."""
    # Learn segments from the coreset or all samples.
    seconds = dict.fromkeys(STAGES, 0.0)
    learned = track
    if coreset is not None:
        with measured(seconds, "coreset"):
            no_gaps = np.zeros(len(track) - 1, np.bool_)
            (learned,), _ = reduce_to_coreset([track], [no_gaps], coreset)
    with measured(seconds, "segments"):
        mean = find(learned)

    # Connect them to a map, and compress the walk on it.
    with measured(seconds, "map"):
        segment_map = make_map(mean)
        walk = build_walk(mean, learned)
    with measured(seconds, "waypoints"):
        waypoints = _find_waypoints(segment_map, walk)

    # Write and pack the texts.
    road_map = segment_map.road_map
    with measured(seconds, "bzip2"):
        semantic = _semantic_text(segment_map, waypoints)
        sizes = _sizes(_rows(track.positions), semantic)
    assert walk.times is not None
    timed_log = _rows(np.column_stack([track.times, track.positions]))
    timed_sizes = _sizes(timed_log, semantic + _rows(walk.times[:, None]))
    errors = measure_errors([track], [walk], road_map.nodes)
    return ThesisResult(
        points=len(track),
        coreset=None if coreset is None else len(learned),
        learned=learned,
        mean=mean,
        segment_map=segment_map,
        walk=walk,
        waypoints=len(waypoints),
        sizes=sizes,
        timed_sizes=timed_sizes,
        rmse=errors.rmse,
        max_error=errors.max_error,
        seconds=seconds,
    )


def _find_waypoints(segment_map: SegmentMap, walk: Walk) -> Waypoints:
    """Compress a walk on the directed map by algorithm 6."""
    road_map = segment_map.road_map
    directed = np.array([(u, v) for u, v, _ in road_map.directed()], np.int32).reshape(-1, 2)
    one_way = np.ones(len(directed), np.bool_)
    graph = build_road_graph(road_map.nodes, directed, oneway=one_way)
    return find_waypoints_by_bisection(graph, build_route(graph, walk.nodes, walk.gaps))


def _semantic_text(segment_map: SegmentMap, waypoints: Waypoints) -> bytes:
    """Return the text of nodes, directed edges, and coordinates of the waypoints.

    A waypoint from which no shortest path leads on has the number of its connection as well, which
    the thesis doesn't mention.
    """
    # The map.
    nodes = segment_map.road_map.nodes
    edges = "".join(f"{u},{v}\n" for u, v, _ in segment_map.road_map.directed())

    # The walk.
    kinds = [*waypoints.connections.tolist(), int(Connection.PATH)]
    lines = _rows(nodes[waypoints.nodes]).decode().splitlines()
    path = "".join(
        f"{line}\n" if kind == Connection.PATH else f"{line},{kind}\n"
        for line, kind in zip(lines, kinds, strict=True)
    )
    return _rows(nodes) + edges.encode() + path.encode()


def _rows(values: NDArray[np.float64]) -> bytes:
    r"""Format rows of numbers as text, to the millimetre and millisecond.

    Examples
    --------
    >>> _rows(np.array([[1.0, -2.5]]))
    b'1.000,-2.500\n'
    """
    form = ",".join([f"%.{_DECIMALS}f"] * values.shape[1]) + "\n"
    return (form * len(values) % tuple(values.ravel().tolist())).encode()


def _sizes(log: bytes, semantic: bytes) -> TextSizes:
    return TextSizes(len(log), len(semantic), len(bz2.compress(log)), len(bz2.compress(semantic)))
