"""Figure 6-4: the robot's log, and its segments for several m."""

from __future__ import annotations

import numpy as np

from gpszip.drawing.layers import Lines, draw_layers
from gpszip.drawing.style import CYCLE, FigureType
from gpszip.experiments.experiment import Outcome, Picture, Setting
from gpszip.experiments.mean_table import mean_table
from gpszip.experiments.table_8_2 import robot_log
from gpszip.model import SegmentMean, Track
from gpszip.segmentation.em import segment_mean

__all__ = ["run"]

#: Number of parts, that of the thesis's figure 8-7.
_K = 200

#: Numbers of segments: from too few to more than needed.
_MS = (10, 40, 107, 150)

#: Share of k and of the numbers of segments in a quick run.
_QUICK = 0.2

#: Samples of a part at least, so that a short log has fewer parts.
_PER_PART = 4


def run(setting: Setting) -> Outcome:
    """Draw the log with the segments of each m."""
    # A short log has fewer parts and segments.
    track = robot_log(setting)
    share = min(_QUICK if setting.quick else 1.0, len(track) / (_PER_PART * _K))
    k = max(round(_K * share), 1)
    ms = sorted({max(round(m * share), 1) for m in _MS})

    # A picture of each.
    means = {f"m-{m}": segment_mean(track, k, m) for m in ms}
    pictures = tuple(
        Picture(name, f"The log and m = {mean.m} segments of k = {k} parts.", _draw(track, mean))
        for name, mean in means.items()
    )
    return Outcome((mean_table(track, means),), pictures)


def _draw(track: Track, mean: SegmentMean) -> FigureType:
    """Draw the samples in grey, and the segments above them."""
    segments = Lines(
        f"{mean.m} segments", list(np.stack([mean.starts, mean.ends], axis=1)), CYCLE[0]
    )
    return draw_layers([track.positions], [segments])
