"""Pages as files: the map and the walks of an archive, to look at in a browser."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

from gpszip.archive import Archive
from gpszip.errors import OptionError
from gpszip.files.atomic_write import atomic_write
from gpszip.model.read_result import ReadResult
from gpszip.view.inputs import Archives, check_ids, list_tracks, open_archives, put_on_plane
from gpszip.view.page import build_page
from gpszip.view.scene import ShownArchive, build_scene

if TYPE_CHECKING:
    from gpszip.model import Network, Track
    from gpszip.pipeline.findings import Findings

__all__ = ["check_coordinates_of", "check_count", "find_histories", "write_page"]

#: Archives that a page shows side by side.
_MAX_ARCHIVES = 2


def write_page(
    archives: Archives,
    target: str | os.PathLike[str],
    *,
    raw: Track | Sequence[Track] = (),
    network: Network | None = None,
    history: Sequence[str] = (),
    timezone: str | None = None,
    title: str = "",
    force: bool = False,
) -> int:
    """Write a page that shows an archive, or two side by side, in a browser.

    The page is one file. It opens from disk, needs no network, and sends nothing anywhere.

    Parameters
    ----------
    archives : Archive, path or bytes, or sequence of these
        One archive, or two whose coordinates are of one kind.
    target : path
        File to write, such as ``walks.html``.
    raw : Track or sequence of Track
        The log that was compressed: the page shows its samples beside the walks, and their errors.
    network : Network, optional
        Roads to show behind everything.
    history : sequence of str, optional
        Parts of the history to show: ``trips`` (with stays and places), ``usage``, ``changes``,
        ``unusual``, ``rounds``, or ``all``.
    timezone : str, optional
        Time zone of its hours; by default that of the place, if the package timezonefinder is
        there, else UTC.
    title : str, optional
        Title of the page; by default the names of the archives.
    force : bool, default False
        Replace an existing file.

    Returns
    -------
    int
        Bytes of the page.

    Raises
    ------
    OptionError
        If there are more archives than two, coordinates of different kinds, the log is another one
        than the archives hold, there is no such part of a history or time zone, or a time zone
        without a history.
    OutputError
        If the file exists and ``force`` is not given, or it can't be written.
    """
    # What is shown, by its names.
    opened, names = open_archives(archives)
    check_count(len(opened))
    check_coordinates_of(opened)
    tracks, log_bytes = list_tracks(raw), raw.bytes if isinstance(raw, ReadResult) else None
    check_ids(tracks, opened)
    findings = find_histories(opened, [history] if isinstance(history, str) else history, timezone)
    shown = [
        ShownArchive(
            archive,
            name or "archive",
            put_on_plane(tracks, archive),
            log_bytes,
            findings=found,
        )
        for archive, name, found in zip(opened, names, findings, strict=True)
    ]
    title = title or " and ".join(each.name for each in shown)

    # The page.
    with atomic_write(target, force=force) as temporary:
        return temporary.write_bytes(build_page(build_scene(shown, network, title=title)).encode())


def find_histories(
    archives: Sequence[Archive], parts: Sequence[str], timezone: str | None
) -> list[Findings | None]:
    """Find what the history of each archive tells; nothing if no parts are asked for.

    Raises
    ------
    OptionError
        If there is no such part or time zone, or a time zone without parts.
    """
    if not parts:
        if timezone is not None:
            raise OptionError(
                "a time zone is for hours of the history, which is not shown",
                remedy="ask for parts of the history, such as all, or leave out the time zone",
            )
        return [None for _ in archives]
    from gpszip.pipeline.findings import check_parts, find_all

    chosen = check_parts(parts)
    return [find_all(archive, chosen, timezone=timezone) for archive in archives]


def check_count(archives: int) -> None:
    """Refuse no archives, or more than a page shows.

    Raises
    ------
    OptionError
        If there are none or more than two.
    """
    if not 1 <= archives <= _MAX_ARCHIVES:
        raise OptionError(f"a page shows one archive or two, not {archives}")


def check_coordinates_of(archives: Sequence[Archive]) -> None:
    """Refuse archives that can't share a page.

    Raises
    ------
    OptionError
        If one is in degrees and the other in metres.
    """
    if len({archive.grid.plane is None for archive in archives}) > 1:
        raise OptionError(
            "one archive is in degrees, the other in metres", remedy="make a page of each"
        )
