"""Pages as files: the map and the walks of an archive, to look at in a browser."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from gpszip.errors import OptionError, OutputError
from gpszip.files.atomic_write import atomic_write
from gpszip.view.generator import generator_name
from gpszip.view.on_plane import put_on_plane
from gpszip.view.page import build_page
from gpszip.view.scene import Subject, build_scene

if TYPE_CHECKING:
    from gpszip.archive import Archive
    from gpszip.model import Network, Track

__all__ = ["MAX_ARCHIVES", "build_archive_page", "write_page"]

#: Archives that a page shows side by side.
MAX_ARCHIVES = 2


def write_page(
    archives: Archive | Sequence[Archive],
    path: str | os.PathLike[str],
    *,
    tracks: Sequence[Track] | Track = (),
    network: Network | None = None,
    title: str = "GPSZip",
    force: bool = False,
) -> int:
    """Write a page that shows an archive, or two side by side, in a browser.

    The page is one file. It opens from disk, needs no network, and sends nothing anywhere.

    Parameters
    ----------
    archives : Archive or sequence of Archive
        One archive, or two whose coordinates are of one kind.
    path : path
        The file, such as ``walks.html``.
    tracks : sequence of Track, or Track, optional
        The log that was compressed: the page shows its samples beside the walks, and their errors.
    network : Network, optional
        Roads to show behind everything.
    title : str, default "GPSZip"
        Title of the page.
    force : bool, default False
        Replace an existing file.

    Returns
    -------
    int
        Bytes of the page.

    Raises
    ------
    OptionError
        If there are more archives than two, or coordinates of different kinds.
    OutputError
        If the file exists and ``force`` is not given, or it can't be written.
    """
    # Do the work only if the file can be written.
    target = Path(path)
    if target.exists() and not force:
        raise OutputError("exists already", path=target, remedy="give force=True to replace it")
    page = build_archive_page(archives, tracks, network, title).encode("utf-8")
    with atomic_write(target) as temporary:
        temporary.write_bytes(page)
    return len(page)


def build_archive_page(
    archives: Archive | Sequence[Archive],
    tracks: Sequence[Track] | Track = (),
    network: Network | None = None,
    title: str = "GPSZip",
) -> str:
    """HTML of the page that :func:`write_page` writes."""
    # An archive is a sequence of names, too.
    from gpszip.archive import Archive
    from gpszip.model import Track

    shown = [archives] if isinstance(archives, Archive) else list(archives)
    samples = [tracks] if isinstance(tracks, Track) else list(tracks)
    if not 1 <= len(shown) <= MAX_ARCHIVES:
        raise OptionError(f"a page shows one archive or two, not {len(shown)}")
    if len({archive.grid.plane is None for archive in shown}) > 1:
        raise OptionError("archives in degrees and in metres don't share a page")

    names = ["archive"] if len(shown) == 1 else ["first archive", "second archive"]
    subjects = [
        Subject(archive, name, put_on_plane(samples, archive))
        for archive, name in zip(shown, names, strict=True)
    ]
    scene = build_scene(subjects, network, title=title, generator=generator_name())
    return build_page(scene)
