"""Figure 5-1: a phone's log with gaps, joined by straight lines, and patched along roads."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.drawing.layers import Lines, draw_layers
from gpszip.drawing.style import CYCLE, INK, LOG_COLOR
from gpszip.experiments.experiment import Outcome, Picture, Setting
from gpszip.experiments.table import Column, Table, Value
from gpszip.experiments.without_outliers import without_outliers
from gpszip.matching.patch import patch
from gpszip.model import Network, Patch, Patching, Track
from gpszip.testing import LogWithTruth, person
from gpszip.testing.roads import positions_on

__all__ = ["run"]

#: Days of the generated log, so that single gaps are seen, and of a quick run.
_DAYS, _QUICK = 14, 5

#: Seconds above which an interval of the generated log is a gap: it has 12 s between two samples.
_GAP = 30.0

Floats = NDArray[np.float64]


def run(setting: Setting) -> Outcome:
    """Patch the gaps of a log over its roads, and draw both."""
    # The log without outliers, its roads, and the truth where it is known.
    tracks, network, log = _find(setting)
    patching = patch(tracks, network, gap=None if setting.logs else _GAP)
    samples = [track.positions for track in tracks]

    # Gaps as straight lines; then those that were filled as paths, and the others as before.
    straight = [_straight(patching, each) for each in patching.patches]
    filled = [each for each in patching.patches if not each.reason]
    paths = Lines(f"{len(filled)} patches", [_path(patching, each) for each in filled], CYCLE[5])
    left = [_straight(patching, each) for each in patching.open]
    pictures = (
        Picture(
            "joined",
            "The log, and its gaps joined by straight lines.",
            draw_layers(samples, [Lines("gaps", straight, INK, 0.8)], color=LOG_COLOR),
        ),
        Picture(
            "patched",
            "The log, and its gaps patched along roads; some stay open.",
            draw_layers(
                samples,
                [Lines(f"{len(left)} open", left, INK, 0.8, dashed=True), paths],
                color=LOG_COLOR,
            ),
        ),
    )
    notes = ("Samples that jump far away and back were left out before.",)
    return Outcome((_table(patching, log),), pictures, notes)


def _find(setting: Setting) -> tuple[list[Track], Network, LogWithTruth | None]:
    """Return tracks without outliers, the roads, and the generated log with its truth."""
    if setting.logs:
        assert setting.network is not None, "the command line asks for roads"
        return [without_outliers(track) for track in setting.logs], setting.network, None
    log = person(_QUICK if setting.quick else _DAYS, seed=setting.seed)
    return [without_outliers(log.tracks[0])], log.network, log


def _straight(patching: Patching, gap: Patch) -> Floats:
    """Return the samples before and after a gap."""
    positions: Floats = patching.tracks[gap.track].positions[gap.after : gap.after + 2]
    return positions


def _path(patching: Patching, gap: Patch) -> Floats:
    """Return the path of a patch, from the sample before it to the one after it."""
    before, after = _straight(patching, gap)
    return np.vstack([before, gap.positions, after])


def _table(patching: Patching, log: LogWithTruth | None) -> Table:
    """Count gaps, and measure both ways of filling them against the truth, where it is known."""
    # Gaps, and distances.
    row: dict[str, Value] = {
        "gap_s": patching.gap,
        "gaps": len(patching.patches),
        "filled": patching.filled,
        "added": patching.added,
    }
    if log is not None:
        row["joined_rmse_m"], row["patched_rmse_m"] = _errors(patching, log)

    # Distances are those at the samples that were added; blank where the truth is not known.
    columns = (
        Column("gap_s", "gap s"),
        Column("gaps", "gaps"),
        Column("filled", "filled"),
        Column("added", "samples added"),
        Column("joined_rmse_m", "RMSE m, joined to truth", 1),
        Column("patched_rmse_m", "patched to truth", 1),
    )
    return Table("", "Gaps, and distances from the truth at the samples added", columns, (row,))


def _errors(patching: Patching, log: LogWithTruth) -> tuple[float | None, float | None]:
    """Return the RMSE of straight lines and of patches at the samples added; None without any."""
    if not patching.added:
        return None, None

    # Positions at the times of the samples added: patched, straight, true.
    track = patching.tracks[0]
    filled = [each for each in patching.patches if len(each.times)]
    times = np.concatenate([each.times for each in filled])
    patched = np.concatenate([each.positions for each in filled])
    straight = np.column_stack([np.interp(times, track.times, axis) for axis in track.positions.T])
    truth = positions_on(log.walks[0], log.road_map.nodes, times)

    # Root mean squared distances.
    joined, along = (
        float(np.sqrt(((found - truth) ** 2).sum(axis=1).mean())) for found in (straight, patched)
    )
    return joined, along
