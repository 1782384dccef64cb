"""gpszip map: write the map that an archive has learned."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from gpszip.cli.format_lists import CommandWithFormats
from gpszip.cli.options import (
    Settings,
    archive_argument,
    common_options,
    force,
    map_option,
    output_name,
    output_option,
)
from gpszip.cli.outcome import Outcome
from gpszip.cli.selecting import pop_selection, select_from, selection_options

if TYPE_CHECKING:
    from gpszip.model import CleanMap, RoadMap

__all__ = ["command"]


@click.command(
    "map", cls=CommandWithFormats, short_help="Write the map that an archive has learned."
)
@archive_argument
@map_option
@output_option("map.geojson", default="the name of ARCHIVE with -map.geojson")
@click.option(
    "--min-traversals",
    type=click.IntRange(1),
    default=1,
    metavar="N",
    help="Leave out edges with fewer traversals.",
)
@selection_options
@click.option(
    "--raw", is_flag=True, help="Write nodes and edges as they were learned, without cleaning."
)
@click.option(
    "--format",
    "kind",
    metavar="FORMAT",
    help="Format instead of the one of the output's suffix: MAP_FORMATS.",
)
@force
@common_options
@click.pass_obj
def command(
    settings: Settings,
    /,
    archive: str,
    target: str | None,
    min_traversals: int,
    raw: bool,
    kind: str | None,
    map_name: str | None,
    force: bool,
    **selecting: Any,
) -> Outcome:
    """Write the map of ARCHIVE in one of the formats MAP_FORMATS.

    The map is cleaned: there is one edge for each street, with its number of traversals. Of a
    selection, only travel in it counts.
    """
    from gpszip.cli.archives import open_archive_file
    from gpszip.cli.output import check_output, print_json, print_status
    from gpszip.io.maps.write import find_map_format, write_map

    # Read the map, as far as it is asked for.
    selection = pop_selection(selecting)
    target = output_name(target, [archive], "-map.geojson", "map.geojson")
    map_format = find_map_format(target, kind)
    check_output(target, force=force, binary=map_format.is_binary)
    with open_archive_file(archive, map_name) as whole:
        source = select_from(whole, selection)
        learned: RoadMap | CleanMap = (
            source.trimmed_map if raw else source.clean_map(min_traversals)
        )

    # Write it.
    write_map(learned, target, min_traversals, format=kind)
    # Count what was written: edges with fewer traversals are left out of the file.
    edges = int((learned.forward + learned.backward >= min_traversals).sum())
    if settings.json:
        print_json({"output": target, "edges": edges}, err=target == "-")
    elif target != "-":
        rare = not edges and min_traversals > 1
        hint = f"; none was travelled {min_traversals:,} times, ask for fewer" if rare else ""
        print_status(f"{target}: edges {edges:,}{hint}")
    return Outcome.DONE
