"""Figure 8-5: a taxi's map at two errors, over the true roads."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.drawing.layers import Lines, draw_layers
from gpszip.drawing.style import EDGE_COLOR, LOG_COLOR
from gpszip.experiments.archive_map import archive_lines
from gpszip.experiments.experiment import Outcome, Picture, Setting, first_samples
from gpszip.experiments.map_table import map_table
from gpszip.experiments.patched import patched
from gpszip.experiments.published import TABLE_8_1
from gpszip.experiments.target_rmse import target_rmse
from gpszip.experiments.thesis_map import thesis_layers
from gpszip.experiments.thesis_pipeline import run_thesis
from gpszip.model import Network, Options, Track
from gpszip.pipeline.compress import compress
from gpszip.testing import taxis

__all__ = ["run"]

#: RMSE in metres of both maps, those of the thesis.
_RMSES = tuple(row.rmse for row in TABLE_8_1 if row.log in ("taxi a", "taxi b"))

#: Samples of the generated taxi, and those of a quick run.
_SAMPLES, _QUICK = 4_281, 400

#: Seconds between two samples of the patched log.
_INTERVAL = 15.0

#: Width of roads in points.
_ROAD = 0.6


def run(setting: Setting) -> Outcome:
    """Draw the map of the thesis's pipeline at each error, over the roads if they are known."""
    # The taxi or the user's first track, patched where roads are known.
    count = _QUICK if setting.quick else _SAMPLES
    log = taxis(1, points=count, seed=setting.seed)
    recorded = setting.logs[0] if setting.logs else log.tracks[0]
    recorded = first_samples(recorded, count) if setting.quick else recorded
    network = setting.network if setting.logs else log.network
    track = recorded if network is None else patched(recorded, network, _INTERVAL)

    # A map for each error.
    bounds = dict.fromkeys(target_rmse(setting, track, published) for published in _RMSES)
    results = {f"{rmse:.3g}m": run_thesis(track, rmse) for rmse in bounds}
    roads, frame = _roads(network, track), [track.positions]
    samples = frame if network is None else []
    pictures = tuple(
        Picture(
            name,
            f"The map of {result.nodes} nodes, RMSE {result.rmse:.0f} m.",
            draw_layers(samples, [*roads, *thesis_layers(result)], frame=frame),
        )
        for name, result in results.items()
    )

    # The map of the archive at the first of them.
    rmse = next(iter(bounds))
    options = Options(rmse=rmse, effort=1) if setting.quick else Options(rmse=rmse)
    archive, _ = compress([track], options)
    lines = Lines("map of the archive", archive_lines(archive), EDGE_COLOR)
    caption = f"The map of the archive, {archive.size:,} bytes, RMSE {rmse:.3g} m."
    figure = draw_layers(samples, [*roads, lines], frame=frame)
    pictures = (*pictures, Picture(f"archive-{rmse:.3g}m", caption, figure))
    notes = (
        f"Recorded: {len(recorded):,} samples; patched along roads: {len(track):,}."
        if network is not None
        else "No roads are known of this log, so it is not patched.",
    )
    return Outcome((map_table(results),), pictures, notes)


def _roads(network: Network | None, track: Track) -> list[Lines]:
    """Return the roads about a track, if there are any."""
    if network is None:
        return []
    low, high = track.positions.min(axis=0), track.positions.max(axis=0)
    roads: list[NDArray[np.float64]] = [
        network.points[begin:end]
        for begin, end in zip(network.offsets[:-1], network.offsets[1:], strict=True)
    ]
    is_near = [
        bool((road.max(axis=0) >= low).all() and (road.min(axis=0) <= high).all()) for road in roads
    ]
    near = [road for road, near in zip(roads, is_near, strict=True) if near]
    return [Lines("roads", near, LOG_COLOR, _ROAD)]
