"""gpszip view: write a page that shows an archive in a browser."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gpszip.cli.options import Settings, common_options, force, map_option, quiet
from gpszip.cli.outcome import Outcome
from gpszip.cli.several_values import CommandWithLogs

if TYPE_CHECKING:
    from gpszip.archive import Archive
    from gpszip.model import Listener, Network, ReadResult, Track
    from gpszip.model.match import Matching

__all__ = ["command"]

#: Name of the output where the archive comes from standard input.
_PAGE_OF_STDIN = "archive.html"


@click.command(
    "view", cls=CommandWithLogs, short_help="Write a page that shows an archive in a browser."
)
@click.argument("archives", metavar="ARCHIVE...", nargs=-1, required=True)
@click.option(
    "--raw",
    metavar="LOG...",
    multiple=True,
    help="Logs that were compressed, to show beside the walks.",
)
@click.option(
    "--network",
    metavar="ROADS...",
    multiple=True,
    help="Roads to show behind everything: NETWORK_FORMATS.",
)
@click.option(
    "--match", "is_matched", is_flag=True, help="Show the routes of the log on the roads, too."
)
@map_option
@click.option(
    "-o",
    "--output",
    "target",
    metavar="FILE",
    help="Page to write; by default the archive's name with .html; - is standard output.",
)
@click.option("--open", "is_opened", is_flag=True, help="Open the page in the browser.")
@click.option(
    "--columns", metavar="ROLES", help="Which column of LOG is what: t=when,x=east,y=north."
)
@quiet
@force
@common_options
@click.pass_obj
def command(
    settings: Settings,
    archives: tuple[str, ...],
    raw: tuple[str, ...],
    network: tuple[str, ...],
    is_matched: bool,
    map_name: str | None,
    target: str | None,
    is_opened: bool,
    columns: str | None,
    quiet: bool,
    force: bool,
) -> Outcome:
    """Write a page that shows ARCHIVE in a browser: map, walks, samples, errors.

    The page is one file. It opens from disk, needs no network, and sends nothing anywhere. Two
    archives are shown side by side.
    """
    from gpszip.cli.output import check_output, print_status
    from gpszip.cli.progress import progress_bar
    from gpszip.errors import OptionError
    from gpszip.view.write import MAX_ARCHIVES

    # Check what was asked for before any work.
    if len(archives) > MAX_ARCHIVES:
        raise OptionError(f"a page shows one archive or two, not {len(archives)}")
    if is_matched and not (network and raw):
        raise OptionError("--match needs a log and roads", remedy="give --raw and --network, too")
    target = target or _page_name(archives[0])
    if is_opened and target == "-":
        raise OptionError("--open needs a file", remedy="name one with -o")
    check_output(target, force=force)

    # Read, and write the page.
    with progress_bar(quiet=quiet or settings.json) as listener:
        page, read_result, drawn = _build(
            archives, raw, network, is_matched, map_name, columns, listener
        )
    _write(target, page)
    if settings.json or not quiet:
        _print_result(target, page, read_result, drawn, settings)

    # Open it.
    if is_opened and click.launch(str(Path(target).resolve())) != 0:
        print_status(f"{target}: no browser was found to open it with")
    return Outcome.DONE if read_result is None or read_result.complete else Outcome.LEFT_OUT


def _page_name(archive: str) -> str:
    """Name of the page of an archive: in the current folder."""
    return _PAGE_OF_STDIN if archive == "-" else f"{Path(archive).stem}.html"


def _build(
    archives: tuple[str, ...],
    raw: tuple[str, ...],
    network: tuple[str, ...],
    is_matched: bool,
    map_name: str | None,
    columns: str | None,
    listener: Listener | None,
) -> tuple[str, ReadResult | None, int]:
    """Return the page, what was read of the log, and how many of its samples the page holds."""
    from contextlib import ExitStack

    from gpszip.cli.archives import open_archive_file
    from gpszip.view.generator import generator_name
    from gpszip.view.on_plane import put_on_plane
    from gpszip.view.page import build_page
    from gpszip.view.scene import Subject, build_scene

    with ExitStack() as stack:
        # Archives, log and roads.
        opened = [
            stack.enter_context(open_archive_file(name, map_name if not number else None))
            for number, name in enumerate(archives)
        ]
        _check_coordinates(opened, archives)
        read_result = _read_log(raw, opened[0], columns)
        tracks = [] if read_result is None else put_on_plane(read_result, opened[0])
        roads = _read_roads(network, opened[0], tracks)
        matching = _match(tracks, roads, listener) if is_matched and roads is not None else None

        # The page.
        log_bytes = None if read_result is None else read_result.bytes
        subjects = [
            Subject(archive, Path(name).name, put_on_plane(tracks, archive), log_bytes, matching)
            for archive, name in zip(opened, archives, strict=True)
        ]
        scene = build_scene(
            subjects,
            roads,
            title=" and ".join(Path(name).name for name in archives),
            generator=generator_name(),
        )
        scene["command"] = shlex.join(["gpszip", "view", *archives])
    samples = scene["archives"][0]["raw"]
    return build_page(scene), read_result, samples["drawn"] if samples else 0


def _check_coordinates(archives: list[Archive], names: tuple[str, ...]) -> None:
    """Refuse archives that can't share a page."""
    from gpszip.errors import OptionError

    if len({archive.grid.plane is None for archive in archives}) > 1:
        raise OptionError(
            f"{names[0]} and {names[1]} don't share a page: one is in degrees, the other isn't"
        )


def _read_log(raw: tuple[str, ...], archive: Archive, columns: str | None) -> ReadResult | None:
    """Read the log, on the plane of an archive."""
    from gpszip.pipeline.open_log import open_log

    if not raw:
        return None
    with open_log(raw, plane=archive.grid.plane, columns=columns, times=archive.timed) as log:
        return log.read_result


def _read_roads(network: tuple[str, ...], archive: Archive, tracks: list[Track]) -> Network | None:
    """Read the roads near the log, or near the walks where there is no log."""
    from gpszip.pipeline.match import read_network

    if not network:
        return None
    return read_network(list(network), near=tracks or archive.decompress()).network


def _match(tracks: list[Track], roads: Network, listener: Listener | None) -> Matching:
    from gpszip.pipeline.match import match

    return match(tracks, roads, progress=listener)


def _write(target: str, page: str) -> None:
    from gpszip.io.storage.sink import open_sink

    with open_sink(target) as stream:
        stream.write(page.encode("utf-8"))


def _print_result(
    target: str, page: str, read_result: ReadResult | None, drawn: int, settings: Settings
) -> None:
    """Say what was written, and what of the log the page leaves out."""
    from gpszip.cli.output import print_json, print_status
    from gpszip.cli.summary import output_label, print_losses
    from gpszip.cli.units import format_count

    # For programs.
    size = len(page.encode("utf-8"))
    total = 0 if read_result is None else sum(len(track) for track in read_result)
    if settings.json:
        result = {"output": target, "bytes": size, "points": total, "points_drawn": drawn}
        print_json(result, err=target == "-")
        return

    # For a person.
    if read_result is not None:
        print_losses(read_result)
    text = f"{output_label(target)}: a page of {size / 1e6:.1f} MB"
    if read_result is not None:
        text += f" with {format_count(drawn, 'point')}"
        if drawn < total:
            text += f" of {total:,}: of neighbours, those with the largest errors"
    print_status(text)
