"""gpszip network: roads of any format in, one prepared file out, of which only the part near a log is read."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING

import click

from gpszip.cli.options import Settings, common_options, force, output_option

if TYPE_CHECKING:
    from gpszip.io.networks.prepared import PreparedNetwork

__all__ = ["command"]


@click.command("network", short_help="Prepare a road network for match and patch.")
@click.argument("sources", metavar="IN...", nargs=-1, required=True)
@output_option("roads.gpsz")
@click.option(
    "--metres",
    is_flag=True,
    help="Coordinates are x and y in metres, as in a building; told from the file where left out.",
)
@click.option(
    "--directed/--undirected",
    default=None,
    help="Lines that say nothing of their direction lead along it only, or both ways; told from them.",
)
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
@force
@common_options
@click.pass_obj
def command(
    settings: Settings,
    /,
    sources: tuple[str, ...],
    target: str,
    force: bool,
    quiet: bool,
    metres: bool,
    directed: bool | None,
) -> None:
    """Join roads to one network, and write it so that match and patch load only what is near a log.

    IN is OpenStreetMap PBF or XML, GeoJSON, GeoPackage, FlatGeobuf, Shapefile, GraphML, or an archive, for its map.
    """
    from gpszip.cli.output import check_output
    from gpszip.io.storage.sink import open_sink
    from gpszip.pipeline.match import prepare_network

    check_output(target, force=force, binary=True)
    start = time.perf_counter()
    prepared = prepare_network(sources, metric=True if metres else None, directed=directed)
    with open_sink(sys.stdout.buffer if target == "-" else target) as stream:
        size = prepared.write(stream)
    if settings.json or not quiet:
        _print_result(prepared, target, size, time.perf_counter() - start, settings)


def _print_result(
    prepared: PreparedNetwork, target: str, size: int, seconds: float, settings: Settings
) -> None:
    from gpszip.cli.output import STDOUT, print_json, print_status
    from gpszip.cli.summary import describe_repairs, repairs_as_dict
    from gpszip.cli.units import format_bytes, format_length

    facts = prepared.statistics
    if settings.json:
        account = repairs_as_dict(prepared.roads.repairs)
        print_json(
            {"output": target, "bytes": size, "seconds": seconds, **facts, **account},
            err=target == STDOUT,
        )
        return
    for words in describe_repairs(prepared.roads.repairs):
        print_status(words)
    print_status(
        f"{target}: {facts['roads']:,} roads between {facts['nodes']:,} nodes, {format_length(facts['length'])}, "
        f"{facts['one_way']:,} one-way, {facts['with_speed']:,} with a speed, {facts['components']:,} connected parts; "
        f"{format_bytes(size)} in {seconds:.1f} s"
    )
