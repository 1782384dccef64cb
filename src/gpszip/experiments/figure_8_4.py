"""Figure 8-4: a phone's months on a map, with the places where its person stays."""

from __future__ import annotations

from collections.abc import Mapping

from gpszip.drawing.layers import Label, Lines, draw_layers
from gpszip.drawing.style import EDGE_COLOR, FigureType
from gpszip.experiments.archive_map import archive_lines
from gpszip.experiments.experiment import Outcome, Picture, Setting, first_samples
from gpszip.experiments.map_table import map_table
from gpszip.experiments.stays import find_stays, hours_near
from gpszip.experiments.table import Column, Table, Value
from gpszip.experiments.target_rmse import target_rmse
from gpszip.experiments.thesis_map import thesis_layers
from gpszip.experiments.thesis_pipeline import run_thesis
from gpszip.experiments.without_outliers import without_outliers
from gpszip.model import Options, Track
from gpszip.pipeline.compress import compress
from gpszip.testing import person, person_places

__all__ = ["run"]

#: RMSE in metres of the map: without outliers, a phone needs less than the thesis's 300 m.
_RMSE = 50.0

#: Samples of a quick run.
_QUICK = 1_500

#: Blocks of the coreset, as in table 8.1, and of a quick run.
_BLOCKS, _QUICK_BLOCKS = 850, 150

#: Places of a log of the user.
_PLACES = 5

#: Metres from a place within which a sample is at it.
_RADIUS = 100.0


def run(setting: Setting) -> Outcome:
    """Draw the maps of the thesis's pipeline and of the archive, and name places."""
    # The log without outliers, and its places.
    track, labels = _find(setting)
    rmse = target_rmse(setting, track, _RMSE)
    result = run_thesis(track, rmse, coreset=_QUICK_BLOCKS if setting.quick else _BLOCKS)
    options = Options(rmse=rmse, effort=1) if setting.quick else Options(rmse=rmse)
    archive, _ = compress([track], options)

    # A picture of each map.
    pictures = (
        Picture(
            "thesis",
            f"The map of the thesis's pipeline, RMSE {result.rmse:.0f} m.",
            _draw(track, thesis_layers(result), labels),
        ),
        Picture(
            "archive",
            f"The map of the archive, RMSE {rmse:.0f} m.",
            _draw(track, [Lines("map", archive_lines(archive), EDGE_COLOR)], labels),
        ),
    )
    notes = ("Samples that jump far away and back were left out before.",)
    return Outcome((_places_table(track, labels), map_table({"thesis": result})), pictures, notes)


def _find(setting: Setting) -> tuple[Track, list[Label]]:
    """Return the track without outliers, and its places: names are known of the generated log."""
    log = setting.logs[0] if setting.logs else person(seed=setting.seed).tracks[0]
    track = without_outliers(log)
    track = first_samples(track, _QUICK) if setting.quick else track
    if not setting.logs:
        places = person_places(seed=setting.seed)
        return track, [Label(name, at[0]) for name, at in places.items() if name != "errand"]
    stays = find_stays(track, _PLACES)
    return track, [Label(f"place {number}", at) for number, at in enumerate(stays, 1)]


def _draw(track: Track, layers: list[Lines], labels: list[Label]) -> FigureType:
    return draw_layers([track.positions], layers, labels, frame=[track.positions])


def _places_table(track: Track, labels: list[Label]) -> Table:
    columns = (Column("place", "place"), Column("hours", "hours between two samples there", 1))
    rows: tuple[Mapping[str, Value], ...] = tuple(
        {"place": label.text, "hours": hours_near(track, label.position, _RADIUS)}
        for label in labels
    )
    return Table("places", f"Places, within {_RADIUS:.0f} m", columns, rows)
