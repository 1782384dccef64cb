"""Compiling all kernels into the cache, in processes side by side."""

from __future__ import annotations

import math
import os
from collections.abc import Callable

import numpy as np

from gpszip.model import GridWalk, GridWalks, Listener, Network, Options, Progress, Track

__all__ = ["TASKS", "warm"]


def warm(progress: Listener | None = None) -> None:
    """Compile all kernels now, so that the first log needn't wait.

    Kernels that came compiled with a wheel are only loaded. Tasks that share kernels run in one
    process, one after the other, so that no kernel is compiled twice.

    Parameters
    ----------
    progress : callable, optional
        Called with :class:`~gpszip.model.report.Progress` events.
    """
    from gpszip.run import Processes

    with Processes(min(os.cpu_count() or 1, len(TASKS))) as processes:
        for done, _ in enumerate(processes.map(_call, TASKS), 1):
            if progress is not None:
                progress(Progress("compile", done / len(TASKS)))


def _call(task: Callable[[], None]) -> None:
    task()


def _learn_maps() -> None:
    _code_walks()
    _code_curves()
    _compress()
    _find_waypoints()
    _segment_mean()


def _loops() -> list[Track]:
    """One loop travelled twice; the second track has a gap before its end."""
    turn = np.linspace(0, 4 * math.pi, 120)
    loop = np.stack((40 * np.cos(turn), 30 * np.sin(turn)), axis=1)
    return [
        Track("0", np.arange(120.0), loop),
        Track("1", np.append(np.arange(119.0), 1e4), loop[::-1] + 0.1),
    ]


def _code_walks() -> None:
    from gpszip.codec.modes import encode_smallest
    from gpszip.codec.walks import decode, encode_with_statistics

    square = np.array([[0, 0], [9, 0], [9, 9], [0, 9]])
    walk = GridWalk(np.arange(12, dtype=np.int32) % 4, np.arange(0, 36, 3), np.zeros(11, bool))
    walks = GridWalks(square, (walk, walk))
    encode_with_statistics(walks)
    decode(encode_smallest(walks), 2, 2)


def _code_curves() -> None:
    from gpszip.archive.curves import curves_section, read_curves
    from gpszip.codec.curves import fit_column

    column = fit_column([np.arange(3.0)], [np.array([5.0, 6.0, 5.0])], 0.5)
    section = curves_section({"ele": column})
    read_curves(section.kind, bytes(section.body), 1)


def _compress() -> None:
    from gpszip.archive import open_archive
    from gpszip.mapping.assignment import enlarge_map
    from gpszip.mapping.initial_map import allocate_working_map
    from gpszip.mapping.kernels.conjugate_gradients import improve_positions
    from gpszip.mapping.kernels.extreme_samples import mark_extreme_samples
    from gpszip.model.merge_options import MergeOptions
    from gpszip.pipeline.compress import compress
    from gpszip.pipeline.merge import merge

    for options in (Options(rmse=1.0), Options(max_error=2.0)):
        archive, _ = compress(_loops(), options)
        decoded = open_archive(archive.to_bytes())
        decoded.decompress()
        decoded.clean_map()
        compress(_loops(), options, map=decoded)
    merge([decoded, archive], MergeOptions(same_id="prefix"), names=["a", "b"])

    # Maps of small logs never grow, their nodes are placed at once, and this one is not dense.
    enlarge_map(allocate_working_map(2, 4, 4, 1.0), 4)
    row, one = np.array([0, 1], np.int32), np.ones(1)
    improve_positions(row, row[:1], one, np.zeros((1, 2)), np.zeros((1, 2)), 1e-3, 1)
    mark_extreme_samples(
        np.arange(3.0), np.zeros((3, 2)), np.array([0, 3]), np.eye(2), 1, np.zeros(3, np.bool_)
    )


def _follow_roads() -> None:
    from gpszip.matching.live import LiveMatcher
    from gpszip.pipeline.match import match, patch

    # a rectangle of two-way roads around the loop, and a road that none of them leads to
    corners = np.array([[-40.0, -30.0], [40.0, -30.0], [40.0, 30.0], [-40.0, 30.0]])
    nodes = np.concatenate((corners, [[-40.0, 60.0], [40.0, 60.0]]))
    starts, ends = np.array([[0, 1, 2, 3, 4], [1, 2, 3, 0, 5]], np.int32)
    roads = Network(
        nodes=nodes,
        starts=starts,
        ends=ends,
        offsets=np.arange(0, 11, 2),
        points=np.stack((nodes[starts], nodes[ends]), axis=1).reshape(-1, 2),
        forward=np.ones(5, bool),
        backward=np.ones(5, bool),
        speeds=np.full(5, np.nan),
    )
    patch(_loops(), roads, gap=60.0)

    # A jump from one to the other, which no path explains.
    along = np.linspace(-30.0, 30.0, 9)
    positions = np.column_stack((np.append(along, along[::-1]), np.repeat([30.0, 60.0], 9)))
    match(Track("jump", np.arange(0.0, 180.0, 10.0), positions), roads)

    # Live, with samples at one position and at others.
    track = _loops()[0]
    matcher = LiveMatcher(roads, match(track, roads).scales, lag=1)
    for time, position in zip(track.times.tolist(), track.positions, strict=True):
        for delay in (0.0, 1e-6):
            matcher.push(time + delay, position)


def _sketch() -> None:
    from gpszip.sketches.partition import build_coreset
    from gpszip.sketches.pieces import polyline
    from gpszip.sketches.samples import weighted_samples
    from gpszip.sketches.stream import CoresetStream

    track = _loops()[0]
    coreset = build_coreset(track, size=40).reduced(10)
    coreset.cost(polyline(track.times[:2], track.positions[:2]))
    coreset.least_cost(2)
    weighted_samples(coreset, track)
    build_coreset(track, k=2, eps=0.5)

    stream = CoresetStream(10)
    stream.push(track.times, track.positions)
    stream.coreset()


def _find_waypoints() -> None:
    from gpszip.codec.waypoints import (
        expand_waypoints,
        find_waypoints,
        find_waypoints_by_bisection,
    )
    from gpszip.graph.road_graph import build_road_graph
    from gpszip.graph.route import build_route
    from gpszip.graph.trees import build_tree, find_distances

    graph = build_road_graph([[0, 0], [1, 0], [2, 0]], [[0, 1], [1, 2]])
    route = build_route(graph, [0, 1, 2, 1])
    find_waypoints_by_bisection(graph, route)
    expand_waypoints(graph, find_waypoints(graph, route), limit=4)
    build_tree(graph, 0)
    find_distances(graph, 0, [2])


def _segment_mean() -> None:
    from typing import get_args

    from gpszip.kernels.sums import track_sums
    from gpszip.pipeline.compress import compress
    from gpszip.segmentation.clustering import ward
    from gpszip.segmentation.em import ExpectationStep, segment_mean
    from gpszip.segmentation.kernels.shift import best_cuts
    from gpszip.segmentation.partition import penalised_partition
    from gpszip.segmentation.two_segment_mean import two_segment_mean

    # The partitions of the command, and of each form of the expectation step.
    track = _loops()[0]
    compress([track], Options(k=8, m=4))
    for expectation in get_args(ExpectationStep):
        segment_mean(track, 8, 4, expectation=expectation)
    rng = np.random.default_rng(0)
    segment_mean(track, 8, 8, initial="douglas-peucker", clustering="k-means++", rng=rng)

    # Long tracks get penalised ones, whose intervals are split; many intervals are merged in pairs.
    sums, segment = track_sums(track), (np.zeros((1, 2)), np.ones((1, 2)))
    boundaries, labels = penalised_partition(sums, *segment, 1.0)
    best_cuts(sums, boundaries, labels, *segment, 1)
    two_segment_mean(track, *segment)
    times = np.arange(4002.0)
    long = Track("long", times, np.stack((times, np.sin(times)), axis=1))
    ward(track_sums(long), np.arange(0, 4003, 2), 4)


def _keep_logs() -> None:
    from gpszip.container.layout import Cursor
    from gpszip.lossless.guide_search import GuideFinder
    from gpszip.lossless.text import decode_block, encode_block
    from gpszip.lossless.trails import NO_TRAILS

    text = b"".join(b"%d,%d\n" % (i, i * i % 7) for i in range(9))
    decode_block(Cursor(encode_block(text, GuideFinder(NO_TRAILS))), len(text), NO_TRAILS)


def _compare_lines() -> None:
    from gpszip.walks.polylines import polyline_distances

    line = _loops()[0].positions
    polyline_distances(line, line[::-1])


#: What calls all kernels, the longest first.
TASKS = (_learn_maps, _follow_roads, _sketch, _keep_logs, _compare_lines)
