"""gpszip plot: draw pictures of archives for papers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gpszip.cli.completing import complete_files
from gpszip.cli.options import (
    Settings,
    common_options,
    force,
    map_option,
    output_option,
    quiet,
)
from gpszip.cli.outcome import Outcome
from gpszip.cli.raw_log import CommandWithLogs, raw_log_options, read_raw_log
from gpszip.cli.units import Quantity

if TYPE_CHECKING:
    from gpszip.model import ReadResult

__all__ = ["command"]

#: Choices of --kind, those of gpszip.view.plot, whose import takes longer than --help may.
_KINDS = ("map", "segments", "space-time", "error", "rate", "heat")

#: Widths in millimetres. The words are those of gpszip.drawing.style, for the same reason.
_WIDTH = Quantity(
    "width", {"mm": 1.0, "cm": 10.0, "in": 25.4}, words={"column": 85.0, "page": 175.0}
)


#: Help of the command; ``\\b`` keeps the lines below it.
_HELP = """Draw a picture of ARCHIVE as PNG, SVG or PDF, by the suffix of the output.

\b
map         the clean map, over the points of the log with --raw
segments    the segments of the walks, in colours that tell edges apart
space-time  the tracks in x, y and time
error       the error at each point over time, RMSE and maximum; needs --raw
rate        bytes against error of several archives, measured with --raw, else as stated
heat        the clean map, coloured by traversals
"""


@click.command(
    "plot", cls=CommandWithLogs, help=_HELP, short_help="Draw pictures of archives for papers."
)
@click.argument(
    "archives",
    metavar="ARCHIVE...",
    nargs=-1,
    required=True,
    shell_complete=complete_files(".gpsz"),
)
@output_option("map.pdf")
@click.option(
    "--kind",
    type=click.Choice(_KINDS),
    default="map",
    show_default=True,
    help="What to draw, as listed above.",
)
@raw_log_options
@map_option
@click.option(
    "--width",
    type=_WIDTH,
    default="page",
    metavar="WIDTH",
    show_default=True,
    help="Width in mm, or column (85 mm) or page (175 mm).",
)
@click.option(
    "--dpi",
    type=click.IntRange(50, 1200),
    default=300,
    show_default=True,
    help="Dots per inch of PNG, and of many points in SVG and PDF.",
)
@click.option("--title", metavar="TEXT", help="Line above the picture.")
@click.option("--no-legend", is_flag=True, help="Don't explain colours, widths and numbers.")
@quiet
@force
@common_options
@click.pass_obj
def command(
    settings: Settings,
    /,
    archives: tuple[str, ...],
    target: str,
    kind: str,
    raw: tuple[str, ...],
    map_name: str | None,
    width: float,
    dpi: int,
    title: str | None,
    no_legend: bool,
    quiet: bool,
    force: bool,
    **reading: Any,
) -> Outcome:
    """Draw a picture of archives."""
    from gpszip.cli.archives import read_decoded_archive
    from gpszip.cli.output import STDOUT, check_output
    from gpszip.drawing.style import Layout, picture_format, save_figure, size_in_mm
    from gpszip.io.storage.sink import atomic_write, to_stdout
    from gpszip.view.plot import draw, find_kind

    # Refuse what can be refused before any work.
    file_format = picture_format(target)
    check_output(target, force=force, binary=file_format != "svg")
    find_kind(kind, len(archives), has_log=bool(raw))
    layout = Layout(width, title, legend=not no_legend)

    # Read, and draw.
    opened = [read_decoded_archive(name, map_name) for name in archives]
    read_result = read_raw_log(raw, opened[0], reading) if raw else None
    tracks = () if read_result is None else read_result.tracks
    names = [Path(name).stem for name in archives]
    figure = draw(kind, opened, names, tracks, layout)
    with to_stdout(f".{file_format}") if target == STDOUT else atomic_write(target) as path:
        save_figure(figure, path, file_format, dpi)
    if settings.json or not quiet:
        _print_result(target, kind, size_in_mm(figure), read_result, settings)
    return Outcome.DONE if read_result is None or read_result.complete else Outcome.LEFT_OUT


def _print_result(
    target: str,
    kind: str,
    size: tuple[float, float],
    read_result: ReadResult | None,
    settings: Settings,
) -> None:
    """Say what was drawn, and what reading the log lost."""
    from gpszip.cli.output import STDOUT, print_json, print_status
    from gpszip.cli.summary import (
        describe_repairs,
        output_label,
        print_json_result,
        print_losses,
    )

    # For programs.
    width, height = size
    facts = {"kind": kind, "width_mm": width, "height_mm": height}
    if settings.json:
        if read_result is None:
            print_json({"output": target, **facts}, err=target == STDOUT)
        else:
            print_json_result(target, facts, read_result, read_result.repairs)
        return

    # For a person.
    text = f"{output_label(target)}: {kind}, {width:g} x {height:g} mm"
    if read_result is not None:
        print_losses(read_result)
        text = "; ".join([text, *describe_repairs(read_result.repairs)])
    print_status(text)
