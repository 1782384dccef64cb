"""gpszip map: write the map that an archive has learned."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from gpszip.cli.options import Settings, archive_argument, common, force, on_map, output
from gpszip.cli.outcome import Outcome

if TYPE_CHECKING:
    from gpszip.model import RoadMap, WayMap

__all__ = ["command"]


@click.command("map", short_help="Write the map that an archive has learned.")
@archive_argument
@on_map
@output("map.geojson")
@click.option("--min-traversals", type=click.IntRange(1), default=1, metavar="N", help="Leave out ways that were travelled less often.")
@click.option("--raw", is_flag=True, help="Write nodes and edges as they were learned, without cleaning.")
@click.option("--format", "kind", metavar="FORMAT", help="Instead of the output's suffix: geojson, graphml, gpkg or csv.")
@force
@common
@click.pass_obj
def command(
    settings: Settings, archive: str, target: str, min_traversals: int, raw: bool, kind: str | None, map_name: str | None, force: bool
) -> Outcome:
    """Write the road map of ARCHIVE as GeoJSON, GraphML, GeoPackage or CSV: one way for each street, with its travels."""
    from gpszip.cli.archives import opened
    from gpszip.cli.output import check_output, say, show_json
    from gpszip.io.maps.write import write_map

    check_output(target, force=force, binary=kind == "gpkg")
    with opened(archive, map_name) as source:
        learned: RoadMap | WayMap = source.drawn_map if raw else source.clean_map(min_traversals)
    write_map(learned, target, min_traversals, format=kind)
    ways = int((learned.forward + learned.backward >= min_traversals).sum())
    if settings.json:
        show_json({"output": target, "edges": ways}, err=target == "-")
    elif target != "-":
        say(f"{target}: ways {ways:,}" + ("" if ways else f"; none was travelled {min_traversals:,} times, ask for fewer"))
    return Outcome.DONE
