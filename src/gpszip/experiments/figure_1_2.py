"""Figure 1-2: the k segments of a log, and k parts of which m segments are distinct."""

from __future__ import annotations

import numpy as np

from gpszip.experiments.experiment import Outcome, Picture, Setting, first_samples
from gpszip.experiments.mean_table import mean_table
from gpszip.experiments.space import draw_log, draw_parts
from gpszip.experiments.thesis_pipeline import at_elbow, within_rmse
from gpszip.model import SegmentMean, Track
from gpszip.segmentation.em import segment_mean
from gpszip.testing import quadrotor

__all__ = ["run"]

#: Waypoints of a lap of the generated quadrotor, one for each colour, and laps that are shown.
_WAYPOINTS, _LAPS = 6, 4

#: Laps of a quick run.
_QUICK_LAPS = 2

#: Samples of other logs that are shown. More parts can't be told apart.
_SAMPLES = 5_000

#: Share of m in k for a log of the user within an RMSE.
_SHARE = 0.4

#: Samples of a log of the user in which the elbow is looked for.
_ELBOW = 1_500


def run(setting: Setting) -> Outcome:
    """Draw the log, its k segments, and its (k,m)-segment mean."""
    track, mean = _find(setting)
    means = {"k": segment_mean(track, mean.k, mean.k), "km": mean}
    pictures = (
        Picture("log", "The log in x, y and time.", draw_log(track)),
        Picture("k", f"Its {mean.k} segments, all distinct.", draw_parts(track, means["k"])),
        Picture(
            "km",
            f"Its {mean.k} parts, of which parts of one colour are one of {mean.m} segments.",
            draw_parts(track, mean),
        ),
    )
    return Outcome((mean_table(track, means),), pictures)


def _find(setting: Setting) -> tuple[Track, SegmentMean]:
    """Return the samples that are shown, and their (k,m)-segment mean."""
    # Of the generated log, k and m are known: a part for each way from waypoint to waypoint.
    if not setting.logs:
        laps = _QUICK_LAPS if setting.quick else _LAPS
        log = quadrotor(waypoints=_WAYPOINTS, seed=setting.seed)
        (track,), (walk,) = log.tracks, log.walks
        assert walk.times is not None
        end = np.searchsorted(track.times, walk.times[laps * _WAYPOINTS])
        track = first_samples(track, int(end))
        return track, segment_mean(track, laps * _WAYPOINTS, _WAYPOINTS)

    # Of another, they follow from the RMSE or the elbow.
    if setting.rmse is not None:
        track = first_samples(setting.logs[0], _SAMPLES)
        return track, within_rmse(setting.rmse, _SHARE)(track)
    track = first_samples(setting.logs[0], _ELBOW)
    return track, at_elbow(track)
