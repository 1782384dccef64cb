"""gpszip view: write a page that shows an archive in a browser."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gpszip.cli.completing import complete_files
from gpszip.cli.histories import timezone_option
from gpszip.cli.options import Settings, common_options, force, map_option, quiet
from gpszip.cli.outcome import Outcome
from gpszip.cli.raw_log import CommandWithLogs, raw_log_options, read_raw_log
from gpszip.cli.selecting import pop_selection, select_from, selection_options

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gpszip.archive import Archive
    from gpszip.model import Listener, Network, ReadResult, Track
    from gpszip.model.match import Matching
    from gpszip.pipeline.findings import Findings

__all__ = ["command"]

#: Name of the output where the archive comes from standard input.
_PAGE_OF_STDIN = "archive.html"


@click.command(
    "view", cls=CommandWithLogs, short_help="Write a page that shows an archive in a browser."
)
@click.argument(
    "archives",
    metavar="ARCHIVE...",
    nargs=-1,
    required=True,
    shell_complete=complete_files(".gpsz"),
)
@raw_log_options
@click.option(
    "--network",
    metavar="ROADS...",
    multiple=True,
    help="Roads to show behind everything: NETWORK_FORMATS.",
    shell_complete=complete_files(),
)
@selection_options
@click.option(
    "--match", "is_matched", is_flag=True, help="Show the routes of the log on the roads, too."
)
@click.option(
    "--history",
    metavar="PARTS",
    help="Show what the history tells, too: all, or some of trips,usage,changes,unusual,rounds.",
)
@timezone_option
@map_option
@click.option(
    "-o",
    "--output",
    "target",
    metavar="FILE",
    help="Page to write; by default the archive's name with .html; - is standard output.",
    shell_complete=complete_files(),
)
@click.option("--open", "is_opened", is_flag=True, help="Open the page in the browser.")
@quiet
@force
@common_options
@click.pass_obj
def command(
    settings: Settings,
    /,
    archives: tuple[str, ...],
    raw: tuple[str, ...],
    network: tuple[str, ...],
    is_matched: bool,
    history: str | None,
    timezone: str | None,
    map_name: str | None,
    target: str | None,
    is_opened: bool,
    quiet: bool,
    force: bool,
    **reading: Any,
) -> Outcome:
    """Write a page that shows ARCHIVE in a browser: map, walks, samples, errors.

    The page is one file. It opens from disk, needs no network, and sends nothing anywhere. Two
    archives are shown side by side. --history adds places, trips, the use of edges by hour,
    changes, unusual trips and rounds, which takes time.
    """
    from gpszip.cli.archives import read_decoded_archive
    from gpszip.cli.output import check_output, print_status
    from gpszip.cli.progress import progress_bar
    from gpszip.errors import OptionError
    from gpszip.view.write import check_coordinates_of, check_count, find_histories

    # Refuse what can be refused before any work.
    selection = pop_selection(reading)
    check_count(len(archives))
    parts = _read_parts(history, timezone)
    if is_matched and not (network and raw):
        raise OptionError("--match needs a log and roads", remedy="give --raw and --network, too")
    target = target or _page_name(archives[0])
    if is_opened and target == "-":
        raise OptionError("--open needs a file", remedy="name one with -o")
    check_output(target, force=force)

    # Read, and write the page.
    with progress_bar(quiet=quiet or settings.json) as listener:
        whole = [read_decoded_archive(name, map_name) for name in archives]
        opened = [select_from(archive, selection) for archive in whole]
        check_coordinates_of(opened)
        reading["selection"] = selection
        read_result = read_raw_log(raw, opened[0], reading) if raw else None
        findings = find_histories(opened, parts, timezone)
        page, drawn = _build(opened, archives, read_result, network, is_matched, findings, listener)
    _write(target, page)
    if settings.json or not quiet:
        _print_result(target, len(page), read_result, drawn, settings)

    # Open it.
    if is_opened and click.launch(str(Path(target).resolve())) != 0:
        print_status(f"{target}: no browser was found to open it with")
    return Outcome.DONE if read_result is None or read_result.complete else Outcome.LEFT_OUT


def _page_name(archive: str) -> str:
    """Name of the page of an archive: in the current folder."""
    return _PAGE_OF_STDIN if archive == "-" else f"{Path(archive).stem}.html"


def _read_parts(history: str | None, timezone: str | None) -> tuple[str, ...]:
    """Parts of the history that were asked for, checked as the time zone is."""
    from gpszip.errors import OptionError

    if history is None:
        if timezone is not None:
            raise OptionError(
                "--timezone is for hours of the history",
                remedy="give --history, too, such as --history all",
            )
        return ()
    from gpszip.history.local_time import find_zone
    from gpszip.pipeline.findings import check_parts

    if timezone is not None:
        find_zone(timezone)
    return check_parts(history.split(","))


def _build(
    archives: Sequence[Archive],
    names: tuple[str, ...],
    read_result: ReadResult | None,
    network: tuple[str, ...],
    is_matched: bool,
    findings: Sequence[Findings | None],
    listener: Listener | None,
) -> tuple[bytes, int]:
    """Return the page, and how many samples of the log it holds."""
    from gpszip.view.inputs import check_ids, put_on_plane
    from gpszip.view.page import build_page
    from gpszip.view.scene import ShownArchive, build_scene

    # The log on the plane of the first archive, the roads, and the routes.
    log = () if read_result is None else read_result.tracks
    log_bytes = None if read_result is None else read_result.bytes
    tracks = put_on_plane(log, archives[0])
    check_ids(tracks, archives)
    roads = _read_roads(network, archives[0], tracks)
    matching = _match(tracks, roads, listener) if is_matched and roads is not None else None

    # The page.
    shown = [
        ShownArchive(
            archive, Path(name).name, put_on_plane(tracks, archive), log_bytes, matching, found
        )
        for archive, name, found in zip(archives, names, findings, strict=True)
    ]
    scene = build_scene(shown, roads, title=" and ".join(each.name for each in shown))
    samples = scene["archives"][0]["raw"]
    return build_page(scene).encode("utf-8"), samples["drawn"] if samples else 0


def _read_roads(
    network: tuple[str, ...], archive: Archive, tracks: Sequence[Track]
) -> Network | None:
    """Read the roads near the log, or near the walks where there is no log."""
    from gpszip.pipeline.match import read_network

    if not network:
        return None
    return read_network(list(network), near=tracks or archive.decompress()).network


def _match(tracks: Sequence[Track], roads: Network, listener: Listener | None) -> Matching:
    from gpszip.pipeline.match import match

    return match(tracks, roads, progress=listener)


def _write(target: str, page: bytes) -> None:
    from gpszip.io.storage.sink import open_sink

    with open_sink(target) as stream:
        stream.write(page)


def _print_result(
    target: str, size: int, read_result: ReadResult | None, drawn: int, settings: Settings
) -> None:
    """Say what was written, and what of the log the page leaves out."""
    from gpszip.cli.output import print_json, print_status
    from gpszip.cli.summary import (
        describe_repairs,
        output_label,
        print_json_result,
        print_losses,
    )
    from gpszip.cli.units import format_count

    # For programs.
    if settings.json:
        if read_result is None:
            print_json({"output": target, "bytes": size}, err=target == "-")
        else:
            facts = {"bytes": size, "points": read_result.kept, "points_drawn": drawn}
            print_json_result(target, facts, read_result, read_result.repairs)
        return

    # For a person.
    text = f"{output_label(target)}: a page of {size / 1e6:.1f} MB"
    if read_result is not None:
        print_losses(read_result)
        text += f" with {format_count(drawn, 'point')}"
        if drawn < read_result.kept:
            text += f" of {read_result.kept:,}: of neighbours, those with the largest errors"
        text = "; ".join([text, *describe_repairs(read_result.repairs)])
    print_status(text)
