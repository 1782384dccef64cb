"""gpszip network: join roads of any format to one prepared file."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING

import click

from gpszip.cli.format_lists import CommandWithFormats
from gpszip.cli.options import (
    Settings,
    common_options,
    force,
    output_option,
    quiet,
)

if TYPE_CHECKING:
    from gpszip.io.networks.prepared import PreparedNetwork

__all__ = ["command"]


@click.command(
    "network", cls=CommandWithFormats, short_help="Prepare a road network for match and patch."
)
@click.argument("sources", metavar="IN...", nargs=-1, required=True)
@output_option("roads.gpsz")
@click.option(
    "--metres",
    is_flag=True,
    help="Coordinates are x and y in metres, as in a building; by default found from the file.",
)
@click.option(
    "--directed/--undirected",
    default=None,
    help="Lines without a one-way rule lead one way, or both; by default found from the lines.",
)
@quiet
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
    """Join roads to one network, of which match and patch read only the roads near a log.

    Formats of IN: NETWORK_FORMATS. Of an archive, the map is the network.
    """
    from gpszip.cli.output import check_output
    from gpszip.io.storage.sink import open_sink
    from gpszip.pipeline.match import prepare_network

    # Read and join.
    check_output(target, force=force, binary=True)
    start = time.perf_counter()
    # None lets the reader find out; there is no option for degrees.
    prepared = prepare_network(sources, metric=True if metres else None, directed=directed)

    # Write.
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

    # For programs.
    statistics = prepared.statistics
    if settings.json:
        repairs = repairs_as_dict(prepared.roads.repairs)
        print_json(
            {"output": target, "bytes": size, "seconds": seconds, **statistics, **repairs},
            err=target == STDOUT,
        )
        return

    # For a person.
    for line in describe_repairs(prepared.roads.repairs):
        print_status(line)
    facts = [
        f"{statistics['roads']:,} roads between {statistics['nodes']:,} nodes",
        format_length(statistics["length"]),
        f"{statistics['one_way']:,} one-way",
        f"{statistics['with_speed']:,} with a speed",
        f"{statistics['components']:,} connected components",
    ]
    print_status(f"{target}: {', '.join(facts)}; {format_bytes(size)} in {seconds:.1f} s")
