"""Figure 6-5: from segments to a map: the segments, their nodes, the transitions between them."""

from __future__ import annotations

import numpy as np

from gpszip.drawing.layers import Dots, Lines, draw_layers
from gpszip.drawing.style import CYCLE, FigureType
from gpszip.experiments.experiment import Outcome, Picture, Setting, first_samples
from gpszip.experiments.table import Column, Table
from gpszip.experiments.thesis_pipeline import at_elbow, within_rmse
from gpszip.mapping.segment_map import SegmentMap, make_map
from gpszip.model import SegmentMean, Track
from gpszip.segmentation.em import segment_mean
from gpszip.testing import quadrotor

__all__ = ["run"]

#: Samples of the generated quadrotor, and numbers of parts and segments: so few can be told apart.
_SAMPLES, _K, _M = 6_000, 40, 8

#: The same of a quick run.
_QUICK = 2_000, 16, 8

#: Samples of a log of the user in which the elbow is looked for.
_ELBOW = 1_500

#: Share of m in k for a log of the user within an RMSE.
_SHARE = 0.7


def run(setting: Setting) -> Outcome:
    """Draw the segments, then with their nodes, then with the transitions."""
    # The map of a segment mean.
    track, mean = _find(setting)
    segment_map = make_map(mean)
    pictures = (
        Picture("segments", f"{mean.m} segments.", _draw(track, segment_map, 1)),
        Picture("nodes", f"Their {2 * mean.m} nodes.", _draw(track, segment_map, 2)),
        Picture(
            "transitions",
            f"The {len(segment_map.transitions)} transitions between them.",
            _draw(track, segment_map, 3),
        ),
    )
    return Outcome((_table(mean, segment_map),), pictures)


def _find(setting: Setting) -> tuple[Track, SegmentMean]:
    """Return the samples that are shown, and their segment mean."""
    if not setting.logs:
        samples, k, m = _QUICK if setting.quick else (_SAMPLES, _K, _M)
        track = first_samples(quadrotor(seed=setting.seed).tracks[0], samples)
        return track, segment_mean(track, k, m)
    if setting.rmse is not None:
        track = first_samples(setting.logs[0], _SAMPLES)
        return track, within_rmse(setting.rmse, _SHARE)(track)
    track = first_samples(setting.logs[0], _ELBOW)
    return track, at_elbow(track)


def _table(mean: SegmentMean, segment_map: SegmentMap) -> Table:
    """Return the sizes of the map, and how often parts lie on segments and transitions."""
    # Sizes, and the busiest segment and transition.
    columns = (
        Column("k", "k"),
        Column("m", "m"),
        Column("nodes", "nodes"),
        Column("transitions", "transitions"),
        Column("edges", "edges"),
        Column("most_traversals", "most parts on a segment"),
        Column("most_passages", "most passages of a transition"),
    )

    # One map, one row.
    row = {
        "k": mean.k,
        "m": mean.m,
        "nodes": 2 * mean.m,
        "transitions": len(segment_map.transitions),
        "edges": mean.m + len(segment_map.transitions),
        "most_traversals": int(segment_map.traversals.max()),
        "most_passages": int(segment_map.passages.max(initial=0)),
    }
    return Table("", "The map of the segments (algorithm 5)", columns, (row,))


def _draw(track: Track, segment_map: SegmentMap, layers: int) -> FigureType:
    """Draw the first of these layers: segments, nodes, transitions."""
    # Nodes lie above both.
    nodes = segment_map.road_map.nodes
    segments = Lines("segments", list(nodes[segment_map.segments]), CYCLE[0], 1.5)
    transitions = Lines(
        "transitions", list(nodes[segment_map.transitions]), CYCLE[1], 1.2, dashed=True
    )
    shown: list[Lines | Dots] = [segments]
    if layers > 1:
        shown.append(Dots("nodes", np.asarray(nodes)))
    if layers > 2:
        shown.insert(1, transitions)
    return draw_layers([track.positions], shown)
