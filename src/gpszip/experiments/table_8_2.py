"""Table 8.2: the first 10 % to 100 % of the robot's log at an RMSE of about 20 cm, no coreset."""

from __future__ import annotations

from functools import lru_cache

from gpszip.experiments.archive_pipeline import run_archive
from gpszip.experiments.comparison import Compared, archive_table, pipeline_table, stages_table
from gpszip.experiments.experiment import Outcome, Setting, first_samples
from gpszip.experiments.published import TABLE_8_2
from gpszip.experiments.target_rmse import target_rmse
from gpszip.experiments.thesis_pipeline import run_thesis
from gpszip.model import Track
from gpszip.testing import patrol

__all__ = ["compare_prefixes", "robot_log", "run"]

#: RMSE in metres that the thesis aims at.
_RMSE = 0.2

#: Samples of the robot's log of a quick run.
_QUICK = 2_000

#: Tenths of the log that are compressed.
_TENTHS = tuple(range(1, 11))

#: Those of a quick run.
_QUICK_TENTHS = (2, 6, 10)


def run(setting: Setting) -> Outcome:
    """Compress the first parts of the robot's log, or of the user's first track."""
    compared = compare_prefixes(setting)
    notes = (
        "The log of the thesis was never published; rows from here are of a generated patrol."
        if not setting.logs
        else f"Rows from here are of track {setting.logs[0].id}.",
        "k is the smallest, for m = 0.2 k, 0.4 k or 0.7 k, that keeps the RMSE.",
    )
    tables = (pipeline_table(compared), archive_table(compared), stages_table(compared))
    return Outcome(tables, notes=notes)


@lru_cache(maxsize=1)  # figure 8-8 shows the same
def compare_prefixes(setting: Setting) -> tuple[Compared, ...]:
    """Compress each of the first parts both ways."""
    track = robot_log(setting)
    rmse = target_rmse(setting, track, _RMSE)
    compared = []
    for tenth in _QUICK_TENTHS if setting.quick else _TENTHS:
        part = first_samples(track, max(len(track) * tenth // 10, 2))
        thesis = run_thesis(part, rmse)
        archive = run_archive([part], thesis.rmse, quick=setting.quick)
        compared.append(Compared(f"{10 * tenth} %", thesis, archive, TABLE_8_2[tenth - 1]))
    return tuple(compared)


def robot_log(setting: Setting) -> Track:
    """Return the user's first track, or the generated patrol."""
    if setting.logs:
        return setting.logs[0]
    return patrol(_QUICK, seed=setting.seed) if setting.quick else patrol(seed=setting.seed)
