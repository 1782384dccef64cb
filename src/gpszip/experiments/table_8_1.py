"""Table 8.1: all logs of chapter 8 through the thesis's pipeline, and as archives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpszip.experiments.archive_pipeline import run_archive
from gpszip.experiments.comparison import Compared, archive_table, pipeline_table, stages_table
from gpszip.experiments.experiment import Outcome, Setting, first_samples
from gpszip.experiments.patched import patched
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

#: Days and seconds between two samples of the generated phone, and samples of each generated taxi,
#: before they are patched: with the samples added, both have about as many as the thesis's.
_PHONE_DAYS, _PHONE_PERIOD, _TAXI_POINTS = 243, 35.0, 1_600

#: Blocks along each side of the phone's town, 8 km: in one of 4 km, a straight line for all months
#: has an RMSE below the 800 m of the thesis.
_PHONE_TOWN = 30

#: Seconds between two samples above which the phone and the taxis are patched.
_PHONE_INTERVAL, _TAXI_INTERVAL = 70.0, 15.0

#: Days of the phone, and samples of a taxi, of a quick run.
_QUICK_DAYS, _QUICK_TAXI = 3, 120

#: Seconds between the track of one taxi and the next, where they are joined to one.
_BETWEEN_TAXIS = 86_400.0


@dataclass(frozen=True, eq=False)
class LogKind:
    """A generated log that stands for one of the thesis's.

    Parameters
    ----------
    name : str
        Its name.
    track : Track
        The generated log.
    rmse : float
        Metres that the thesis states.
    published : Published, optional
        What the thesis states of its own log; None where it has none of this kind.
    coreset : int, optional
        Blocks of its coreset.
    """

    name: str
    track: Track
    rmse: float
    published: Published | None
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
            kind.name,
            first_samples(kind.track, _QUICK) if setting.quick else kind.track,
            setting.rmse or kind.rmse,
            None if setting.quick else kind.coreset,
            kind.published,
            quick=setting.quick,
        )
        for kind in generated_logs(setting.seed, quick=setting.quick)
    ]
    notes = (
        "The logs of the thesis were never published; rows from here are of generated logs.",
        "k is the smallest, for m = 0.2 k, 0.4 k or 0.7 k, that keeps the RMSE.",
        "Phone and taxis are patched along the roads of their towns, to as many samples as the "
        "thesis's; bzip2 is of the patched log, too.",
    )
    return Outcome(_tables(compared), notes=notes)


def generated_logs(seed: int, *, quick: bool = False) -> list[LogKind]:
    """Return the generated logs, in the order of the thesis's table; the 3-D flight comes after it.

    Phone and taxi come twice, with a small and with a large error.
    """
    # One of each; a flight in three dimensions has no row in the thesis.
    robot = patrol(seed=seed)
    flight, high = (quadrotor(seed=seed, dimension=each).tracks[0] for each in (2, 3))
    phone = _phone(seed, quick=quick)
    cars = _taxis(seed, quick=quick)
    tracks = {
        "robot": (robot, _ROBOT_BLOCKS),
        "quadrotor": (flight, None),
        "phone a": (phone, _PHONE_BLOCKS),
        "phone b": (phone, _PHONE_BLOCKS),
        "taxi a": (cars[0], None),
        "taxi b": (cars[0], None),
        "taxis": (_join(cars), None),
    }

    # The rows of the thesis.
    kinds = []
    for published in TABLE_8_1:
        track, coreset = tracks[published.log]
        kinds.append(LogKind(published.log, track, published.rmse, published, coreset))
    flat = next(kind for kind in kinds if kind.name == "quadrotor")
    kinds.insert(kinds.index(flat) + 1, LogKind("quadrotor 3-D", high, flat.rmse, None))
    return kinds


def _phone(seed: int, *, quick: bool) -> Track:
    """Return a phone's log, patched along roads."""
    if quick:
        log = person(_QUICK_DAYS, seed=seed)
    else:
        log = person(_PHONE_DAYS, seed=seed, period=_PHONE_PERIOD, blocks=_PHONE_TOWN)
    return patched(log.tracks[0], log.network, _PHONE_INTERVAL)


def _taxis(seed: int, *, quick: bool) -> list[Track]:
    """Return the logs of four taxis, patched along roads."""
    log = taxis(4, points=_QUICK_TAXI if quick else _TAXI_POINTS, seed=seed)
    return [patched(track, log.network, _TAXI_INTERVAL) for track in log.tracks]


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
