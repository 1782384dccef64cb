"""The thesis's map of a segment mean (section 6.5, algorithm 5), and the track as a walk on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.model import RoadMap, SegmentMean, Track, Walk
from gpszip.segmentation.markov import count_transitions
from gpszip.walks.counting import build_road_map_from_counts

__all__ = ["SegmentMap", "build_walk", "make_map"]


@dataclass(frozen=True, eq=False)
class SegmentMap:
    """A (k,m)-segment map (thesis, definition 4.1.8): m segments and the transitions between them.

    Parameters
    ----------
    road_map : RoadMap
        Its 2m nodes are the starts of the segments, then their ends: segment l leads from node l
        to node m + l.
    segments : int32 array, shape (m, 2)
        Start and end node of each segment.
    traversals : int64 array, shape (m,)
        Number of pieces that run along each segment; 0 where no piece has its label.
    transitions : int32 array, shape (a, 2)
        Each different transition once, from the end of a segment to the start of the next one,
        sorted.
    passages : int64 array, shape (a,)
        Number of times that each transition was made.
    """

    road_map: RoadMap
    segments: NDArray[np.int32]
    traversals: NDArray[np.int64]
    transitions: NDArray[np.int32]
    passages: NDArray[np.int64]


def make_map(mean: SegmentMean) -> SegmentMap:
    """Connect the segments by the transitions that were made (Make_map, algorithm 5).

    Line 4 of the algorithm as printed asks for the pair of labels among the edges. The text of
    section 6.5 means the pair of nodes: the end of one segment and the start of the next. This
    function follows the text.

    A segment followed by itself makes a transition from its end back to its start. On the road map
    that is the segment's own edge, travelled backwards.

    Parameters
    ----------
    mean : SegmentMean
        Pieces and segments.

    Examples
    --------
    >>> starts, ends = np.array([[0.0, 0.0], [9.0, 1.0]]), np.array([[9.0, 0.0], [0.0, 1.0]])
    >>> mean = SegmentMean(np.arange(0, 13, 4), np.array([0, 1, 0]), starts, ends, cost=0.0)
    >>> segment_map = make_map(mean)
    >>> segment_map.segments.tolist(), segment_map.traversals.tolist()
    ([[0, 2], [1, 3]], [2, 1])
    >>> segment_map.transitions.tolist(), segment_map.road_map.edges.tolist()
    ([[2, 1], [3, 0]], [[0, 2], [0, 3], [1, 2], [1, 3]])
    """
    # Each segment is an edge from node l to node m + l.
    m, labels = mean.m, mean.labels.astype(np.int64)
    segments = np.stack((np.arange(m), np.arange(m, 2 * m)), axis=1).astype(np.int32)
    traversals = np.bincount(labels, minlength=m).astype(np.int64)

    # Consecutive labels of a run are transitions, from an end to a start.
    pairs, passages = count_transitions(mean)
    transitions = (pairs + np.array([m, 0])).astype(np.int32)

    positions = np.concatenate((mean.starts, mean.ends))
    road_map = build_road_map_from_counts(
        positions, np.concatenate((segments, transitions)), np.concatenate((traversals, passages))
    )
    return SegmentMap(road_map, segments, traversals, transitions, passages.astype(np.int64))


def build_walk(mean: SegmentMean, track: Track) -> Walk:
    """Follow a track on the map of its segment mean, nodes numbered as by :func:`make_map`.

    Each piece enters its segment's start at the time of its first sample and leaves the end at that
    of its last, so that the position interpolated between the knots is f(t) of the segment mean at
    every sample. A piece of a single sample has f(t) at the start; it leaves the end halfway to the
    next sample, where no sample asks for f(t). The last piece of a run, if single, ends at its
    start. The step from run to run is a gap. Where not even half a step can be told apart in double
    precision, the end is left out, and the step to the next start is marked as a gap, since it is
    no edge of the map.

    Parameters
    ----------
    mean : SegmentMean
        Pieces and segments of the track.
    track : Track
        The track of this segment mean.

    Raises
    ------
    ValueError
        If the mean is that of a track with another number of samples.

    Examples
    --------
    >>> track = Track("0", np.arange(5.0), np.zeros((5, 2)))
    >>> starts, ends = np.zeros((2, 2)), np.ones((2, 2))
    >>> mean = SegmentMean(np.array([0, 2, 3, 5]), np.array([0, 1, 0]), starts, ends, cost=0.0)
    >>> walk = build_walk(mean, track)
    >>> walk.nodes.tolist(), walk.times.tolist()
    ([0, 2, 1, 3, 0, 2], [0.0, 1.0, 2.0, 2.5, 3.0, 4.0])
    """
    if mean.boundaries[-1] != len(track):
        raise ValueError(
            f"the segment mean has {mean.boundaries[-1]} samples, track {track.id!r} {len(track)}"
        )

    # Interleave the starts of the segments with those ends that have a time.
    enter, leave, has_end = _find_piece_times(mean, track)
    is_kept = np.stack((np.ones(mean.k, np.bool_), has_end), axis=1).ravel()
    nodes = np.stack((mean.labels, mean.m + mean.labels), axis=1).ravel()[is_kept].astype(np.int32)
    times = np.stack((enter, leave), axis=1).ravel()[is_kept]

    # From start to start there is no edge, nor from run to run.
    gaps = (nodes[:-1] < mean.m) & (nodes[1:] < mean.m)
    entries = np.cumsum(is_kept)[::2] - 1
    gaps[entries[mean.heads[1:]] - 1] = True
    return Walk(track.id, nodes, times, gaps)


def _find_piece_times(
    mean: SegmentMean, track: Track
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Times at which each piece enters and leaves its segment, and whether it leaves at all."""
    first, last = mean.boundaries[:-1], mean.boundaries[1:] - 1
    enter, leave = track.times[first], track.times[last]
    following = np.append(enter[1:], enter[-1])
    ends_run = np.append(mean.heads[1:], mean.k) - 1
    halfway = enter + (following - enter) / 2
    halfway[ends_run] = enter[ends_run]
    leave = np.where(first == last, halfway, leave)
    has_end = (leave > enter) & ((leave < following) | (last == len(track) - 1))
    return enter, leave, has_end
