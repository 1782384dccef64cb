"""The layers of the map that the thesis's pipeline makes: segments, and transitions below them."""

from __future__ import annotations

from gpszip.drawing.layers import Lines
from gpszip.drawing.style import CYCLE, EDGE_COLOR
from gpszip.experiments.thesis_pipeline import ThesisResult

__all__ = ["thesis_layers"]

#: Line widths of transitions and segments, in points.
_WIDTHS = 0.4, 1.2

#: Colour of transitions: a light one, as there are many, and they cross what lies between.
_TRANSITIONS = CYCLE[4]


def thesis_layers(result: ThesisResult) -> list[Lines]:
    """Return the transitions and the segments of a map, to be drawn in this order."""
    segment_map = result.segment_map
    nodes = segment_map.road_map.nodes
    transitions, segments = nodes[segment_map.transitions], nodes[segment_map.segments]
    return [
        Lines("transitions", list(transitions), _TRANSITIONS, _WIDTHS[0]),
        Lines("segments", list(segments), EDGE_COLOR, _WIDTHS[1]),
    ]
