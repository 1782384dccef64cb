"""Table 8.1: all logs of chapter 8 through the thesis's pipeline, and as archives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpszip.experiments.archive_pipeline import run_archive
from gpszip.experiments.comparison import Compared, archive_table, pipeline_table, stages_table
from gpszip.experiments.experiment import Outcome, Setting, first_samples
from gpszip.experiments.published import TABLE_8_1, Published
from gpszip.experiments.table import Table
from gpszip.experiments.thesis_pipeline import run_thesis
from gpszip.model import Track
from gpszip.testing import patrol, person, quadrotor, taxis

__all__ = ["LogKind", "generated_logs", "run"]

#: Samples of each log of a quick run.
_QUICK = 300

#: Blocks of the robot's coreset, which have at most 8 samples each: about as many as in the thesis.
_ROBOT_BLOCKS = 1_000

#: Blocks of the phone's coreset, for the same reason.
_PHONE_BLOCKS = 850

#: Samples of the generated taxis.
_TAXI_POINTS = 4_281

#: Seconds between the track of one taxi and the next, where they are joined to one.
_BETWEEN_TAXIS = 86_400.0


@dataclass(frozen=True, eq=False)
class LogKind:
    """A generated log that stands for one of the thesis's.

    Parameters
    ----------
    published : Published
        What the thesis states of its own log.
    track : Track
        The generated log.
    coreset : int or None
        Blocks of its coreset.
    """

    published: Published
    track: Track
    coreset: int | None = None


def run(setting: Setting) -> Outcome:
    """Compress the log of each row, or each track of the user."""
    # Tracks of the user.
    if setting.logs:
        compared = [
            _compare(track.id, track, setting.rmse, quick=setting.quick) for track in setting.logs
        ]
        return Outcome(
            _tables(compared), notes=("Rows from here are of the tracks that were given.",)
        )

    # Generated logs, at the RMSE of the thesis.
    compared = [
        _compare(
            kind.published.log,
            first_samples(kind.track, _QUICK) if setting.quick else kind.track,
            setting.rmse or kind.published.rmse,
            None if setting.quick else kind.coreset,
            kind.published,
            quick=setting.quick,
        )
        for kind in generated_logs(setting.seed)
    ]
    notes = (
        "The logs of the thesis were never published; rows from here are of generated logs.",
        "k is the smallest, for m = 0.2 k, 0.4 k or 0.7 k, that keeps the RMSE.",
        "Unlike those of the thesis, logs of phone and taxis are not patched from a road network.",
    )
    return Outcome(_tables(compared), notes=notes)


def generated_logs(seed: int) -> list[LogKind]:
    """Return the generated logs, in the order of the thesis's table."""
    # One of each.
    robot = patrol(seed=seed)
    flight = quadrotor(seed=seed).tracks[0]
    phone = person(seed=seed).tracks[0]
    cars = taxis(4, points=_TAXI_POINTS, seed=seed).tracks

    # Phone and taxi come twice, with a small and with a large error.
    tracks: list[tuple[Track, int | None]] = [
        (robot, _ROBOT_BLOCKS),
        (flight, None),
        (phone, _PHONE_BLOCKS),
        (phone, _PHONE_BLOCKS),
        (cars[0], None),
        (cars[0], None),
        (_join(cars), None),
    ]
    return [
        LogKind(published, track, coreset)
        for published, (track, coreset) in zip(TABLE_8_1, tracks, strict=True)
    ]


def _join(tracks: Sequence[Track]) -> Track:
    """Return tracks one after the other as one track, as the thesis's pipeline takes one."""
    times, begin = [], 0.0
    for track in tracks:
        times.append(track.times - track.times[0] + begin)
        begin = float(times[-1][-1]) + _BETWEEN_TAXIS
    return Track("taxis", np.concatenate(times), np.vstack([each.positions for each in tracks]))


def _compare(
    name: str,
    track: Track,
    rmse: float | None,
    coreset: int | None = None,
    published: Published | None = None,
    *,
    quick: bool,
) -> Compared:
    """Compress a track both ways, the archive at the RMSE that the thesis's pipeline reached."""
    thesis = run_thesis(track, rmse, coreset=coreset)
    return Compared(name, thesis, run_archive([track], thesis.rmse, quick=quick), published)


def _tables(compared: Sequence[Compared]) -> tuple[Table, ...]:
    return pipeline_table(compared), archive_table(compared), stages_table(compared)
