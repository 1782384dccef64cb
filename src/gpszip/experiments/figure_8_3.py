"""Figure 8-3: the robot's log in x, y and time, with its segments in colours."""

from __future__ import annotations

from gpszip.experiments.experiment import Outcome, Picture, Setting
from gpszip.experiments.mean_table import mean_table
from gpszip.experiments.published import TABLE_8_1
from gpszip.experiments.space import draw_parts
from gpszip.experiments.table_8_2 import robot_log
from gpszip.experiments.target_rmse import target_rmse
from gpszip.experiments.thesis_pipeline import run_thesis

__all__ = ["run"]

#: RMSE in metres that the thesis states.
_RMSE = TABLE_8_1[0].rmse

#: Blocks of the coreset that segments are learned from, as in table 8.1, and in a quick run.
_BLOCKS, _QUICK = 1_000, 200


def run(setting: Setting) -> Outcome:
    """Draw the parts of the robot's log, or of the user's first track."""
    # Segments are learned from a coreset, whose samples are drawn.
    track = robot_log(setting)
    blocks = _QUICK if setting.quick else _BLOCKS
    result = run_thesis(track, target_rmse(setting, track, _RMSE), coreset=blocks)
    caption = f"The log in x, y and time, with {result.mean.k} parts on {result.mean.m} segments."
    picture = Picture("", caption, draw_parts(result.learned, result.mean))
    return Outcome((mean_table(result.learned, {"figure-8.3": result.mean}),), (picture,))
