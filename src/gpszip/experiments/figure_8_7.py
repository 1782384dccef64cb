"""Figure 8-7: RMSE of the robot's log over m, and over the size of the coreset, for k = 200."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpszip.experiments.curves import Curve, draw_curves
from gpszip.experiments.experiment import Outcome, Picture, Setting
from gpszip.experiments.table import Column, Table
from gpszip.experiments.table_8_2 import robot_log
from gpszip.mapping.segment_map import build_walk
from gpszip.mapping.thinning import reduce_to_coreset
from gpszip.model import SegmentMean, Track
from gpszip.segmentation.em import segment_mean
from gpszip.walks.error import measure_errors

__all__ = ["run"]

#: Number of intervals, that of the thesis.
_K = 200

#: Numbers of segments.
_MS = (5, 10, 20, 40, 60, 80, 100, 125, 150, 200)

#: Numbers of segments of the curves over the size of the coreset.
_CURVES = (20, 60, 100, 150)

#: Blocks of the coreset, each of at most 8 samples.
_BLOCKS = (50, 100, 200, 400, 800, 1600)

#: Share of all these numbers, and of k, in a quick run, whose log is shorter.
_QUICK = 0.2


def run(setting: Setting) -> Outcome:
    """Measure the RMSE at all samples of the robot's log, or of the user's first track."""
    # A log of few samples has fewer intervals.
    track = robot_log(setting)
    share = min(_QUICK if setting.quick else 1.0, len(track) / (4 * _K))
    k = max(round(_K * share), 1)
    ms, curves, blocks = (_scaled(numbers, share) for numbers in (_MS, _CURVES, _BLOCKS))

    # Over m, from all samples; over the size of the coreset, from its samples.
    by_m = [(m, _rmse(segment_mean(track, k, m), track, track)) for m in ms if m <= k]
    by_size = []
    no_gaps = np.zeros(len(track) - 1, np.bool_)
    for count in blocks:
        (coreset,), _ = reduce_to_coreset([track], [no_gaps], count)
        by_size += [
            (m, len(coreset), _rmse(segment_mean(coreset, k, m), coreset, track))
            for m in curves
            if m <= k <= len(coreset)
        ]
    return Outcome(_tables(k, by_m, by_size), _pictures(k, by_m, by_size))


def _scaled(numbers: Sequence[int], share: float) -> list[int]:
    """Return a share of each number, each once."""
    return sorted({max(round(number * share), 1) for number in numbers})


def _rmse(mean: SegmentMean, learned: Track, track: Track) -> float:
    """Return the RMSE at all samples of a track of a segment mean of it or of its coreset."""
    nodes = np.concatenate([mean.starts, mean.ends])
    return measure_errors([track], [build_walk(mean, learned)], nodes).rmse


def _tables(
    k: int, by_m: list[tuple[int, float]], by_size: list[tuple[int, int, float]]
) -> tuple[Table, ...]:
    m, rmse = Column("m", "m"), Column("rmse_m", "RMSE m", 3)
    return (
        Table(
            "left",
            f"RMSE over m, k = {k}",
            (m, rmse),
            tuple({"m": m, "rmse_m": rmse} for m, rmse in by_m),
        ),
        Table(
            "right",
            f"RMSE over the samples of the coreset, k = {k}",
            (m, Column("coreset", "samples of the coreset"), rmse),
            tuple({"m": m, "coreset": size, "rmse_m": rmse} for m, size, rmse in sorted(by_size)),
        ),
    )


def _pictures(
    k: int, by_m: list[tuple[int, float]], by_size: list[tuple[int, int, float]]
) -> tuple[Picture, ...]:
    # A curve over m, and one over the coreset for each m.
    left = [Curve(f"k = {k}", [m for m, _ in by_m], [rmse for _, rmse in by_m])]
    right = []
    for m in sorted({m for m, _, _ in by_size}):
        points = sorted((size, rmse) for each, size, rmse in by_size if each == m)
        sizes, errors = [size for size, _ in points], [rmse for _, rmse in points]
        right.append(Curve(f"m = {m}", sizes, errors))

    # RMSE spans powers of ten.
    return (
        Picture(
            "left",
            f"RMSE of the (k,m)-segment mean over m for k = {k}.",
            draw_curves(left, "m", "RMSE in metres", log_y=True),
        ),
        Picture(
            "right",
            f"RMSE at all samples over the samples of the coreset for k = {k}.",
            draw_curves(right, "samples of the coreset", "RMSE in metres", log_x=True, log_y=True),
        ),
    )
