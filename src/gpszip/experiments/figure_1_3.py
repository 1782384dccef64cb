"""Figure 1-3: a noisy log, and the segments that smooth it, over time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.experiments.experiment import Outcome, Picture, Setting, first_samples
from gpszip.experiments.space import draw_log, draw_parts
from gpszip.experiments.table import Column, Table
from gpszip.experiments.thesis_pipeline import at_elbow, within_rmse
from gpszip.model import SegmentMean, Track
from gpszip.segmentation.em import segment_mean
from gpszip.segmentation.evaluate import positions_at
from gpszip.testing import ring

__all__ = ["run"]

#: Nodes and laps of the generated ring, whose roads are straight, and samples for each road.
_NODES, _LAPS, _PER_ROAD = 6, 4, 40

#: Standard deviation of the errors of its samples along each axis, in metres.
_NOISE = 6.0

#: Share of m in k for a log of the user within an RMSE.
_SHARE = 0.4

#: Samples of a log of the user that are shown.
_SAMPLES = 1_500

Floats = NDArray[np.float64]


def run(setting: Setting) -> Outcome:
    """Draw the log and its segments; of a generated log, measure both against the truth."""
    track, mean, truth = _find(setting)
    smoothed = positions_at(mean, track)
    pictures = (
        Picture("log", "The noisy log in x, y and time.", draw_log(track)),
        Picture("segments", f"Its {mean.k} parts on {mean.m} segments.", draw_parts(track, mean)),
    )
    return Outcome((_table(track, mean, smoothed, truth),), pictures)


def _find(setting: Setting) -> tuple[Track, SegmentMean, Floats | None]:
    """Return the log, its segment mean, and where the agent truly was, if that is known."""
    # The generated ring has a part for each road, and a segment for each of different roads.
    if not setting.logs:
        log = ring(_NODES, laps=_LAPS, samples=_PER_ROAD, noise=_NOISE, seed=setting.seed)
        (track,), (truth,) = log.tracks, log.positions
        return track, segment_mean(track, _LAPS * _NODES, _NODES), truth

    # Of another log, k and m follow from the RMSE or the elbow.
    track = first_samples(setting.logs[0], _SAMPLES)
    find = at_elbow if setting.rmse is None else within_rmse(setting.rmse, _SHARE)
    return track, find(track), None


def _table(track: Track, mean: SegmentMean, smoothed: Floats, truth: Floats | None) -> Table:
    """Return k, m, and the distances between samples, segments and truth."""
    # The truth of a log of the user is not known.
    row = {
        "points": len(track),
        "k": mean.k,
        "m": mean.m,
        "segments_to_log_m": _rms(smoothed - track.positions),
        "log_to_truth_m": None if truth is None else _rms(track.positions - truth),
        "segments_to_truth_m": None if truth is None else _rms(smoothed - truth),
    }

    # RMS distances.
    columns = (
        Column("points", "points"),
        Column("k", "k"),
        Column("m", "m"),
        Column("segments_to_log_m", "RMSE m, segments to log", 2),
        Column("log_to_truth_m", "log to truth", 2),
        Column("segments_to_truth_m", "segments to truth", 2),
    )
    return Table("", "Distances between samples, segments and true positions", columns, (row,))


def _rms(differences: Floats) -> float:
    return float(np.sqrt((differences**2).sum(axis=1).mean()))
