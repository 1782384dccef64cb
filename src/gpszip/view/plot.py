"""Pictures for papers: of a map, its walks, and their errors. Needs the extra ``plot``."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, cast

from gpszip.archive import Archive, ArchiveSource, open_archive
from gpszip.drawing.style import (
    DPI,
    PAGE_WIDTH,
    Page,
    picture_format,
    require_matplotlib,
    save_figure,
    style,
)
from gpszip.errors import OptionError
from gpszip.files.atomic_write import atomic_write
from gpszip.geo.planes import reproject_track
from gpszip.io.deferred import deferred
from gpszip.model import Track
from gpszip.model.text import axes_text
from gpszip.view.plots.subject import Subject

if TYPE_CHECKING:
    import matplotlib.figure

__all__ = ["PLOT_KINDS", "PlotKind", "draw", "find_kind", "plot"]


@dataclass(frozen=True)
class PlotKind:
    """One kind of picture.

    Parameters
    ----------
    name : str
        Name by which users choose it.
    description : str
        What it shows.
    draw : callable
        Draws a subject on a page, and returns the figure.
    needs_log : bool, default False
        Whether it needs the log.
    several : bool, default False
        Whether it compares several archives.
    """

    name: str
    description: str
    draw: Callable[[Subject, Page], matplotlib.figure.Figure]
    needs_log: bool = False
    several: bool = False


#: All kinds; the first is the default.
PLOT_KINDS: tuple[PlotKind, ...] = (
    PlotKind(
        "map",
        "the clean map, over the samples if the log is given",
        deferred("gpszip.view.plots.map", "draw_map"),
    ),
    PlotKind(
        "segments",
        "the segments of the walks, in colours that tell edges apart",
        deferred("gpszip.view.plots.segments", "draw_segments"),
    ),
    PlotKind(
        "space-time",
        "the tracks in x, y and time",
        deferred("gpszip.view.plots.space_time", "draw_space_time"),
    ),
    PlotKind(
        "error",
        "the error at each sample over time, RMSE and maximum",
        deferred("gpszip.view.plots.error", "draw_errors"),
        needs_log=True,
    ),
    PlotKind(
        "rate",
        "bytes against error of several archives",
        deferred("gpszip.view.plots.rate", "draw_rates"),
        several=True,
    ),
    PlotKind(
        "heat",
        "the clean map, coloured by traversals",
        deferred("gpszip.view.plots.heat", "draw_heat"),
    ),
)


def plot(
    archives: Archive | ArchiveSource | Sequence[Archive | ArchiveSource],
    target: str | os.PathLike[str] | None = None,
    *,
    kind: str = "map",
    raw: Track | Sequence[Track] = (),
    width: float = PAGE_WIDTH,
    dpi: int = DPI,
    title: str | None = None,
    legend: bool = True,
) -> matplotlib.figure.Figure:
    """Draw a picture of an archive for a paper. Needs the extra ``plot``.

    Parameters
    ----------
    archives : Archive, path or bytes, or sequence of these
        The archive; several for the kind ``rate``.
    target : path, optional
        File to write: ``.png``, ``.svg`` or ``.pdf``. It replaces another file of this name.
    kind : str, default "map"
        ``map``: the clean map, over the samples of ``raw`` if given.
        ``segments``: the segments of the walks, in colours that tell edges apart.
        ``space-time``: the tracks in x, y and time.
        ``error``: the synchronised error at each sample over time, with RMSE and maximum.
        ``rate``: bytes against error, measured at the samples of ``raw`` if given, else as stated.
        ``heat``: the clean map, coloured by traversals.
    raw : Track or sequence of Track
        The log that was compressed. The kind ``error`` needs it.
    width : float, default 175.0
        Millimetres; one column of a paper has about 85.
    dpi : int, default 300
        Dots per inch of PNG, and of samples in SVG and PDF where there are many.
    title : str, optional
        Line above the picture.
    legend : bool, default True
        Whether colours, widths and numbers are explained.

    Returns
    -------
    matplotlib.figure.Figure
        The figure, for further changes.

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    OptionError
        If there is no such kind, or it can't be drawn of what was given.
    OutputError
        If the file can't be written.

    Examples
    --------
    >>> from gpszip import compress
    >>> lane = Track("lane", range(20), [[abs(t % 8 - 4.0), 0.0] for t in range(20)])
    >>> figure = plot(compress(lane, max_error=0.1), kind="error", raw=lane, width=85.0)
    >>> figure.axes[0].get_ylabel()
    'error in metres'
    """
    # Open the archives; only paths have names.
    listed = _as_list(archives)
    opened = tuple(each if isinstance(each, Archive) else open_archive(each) for each in listed)
    names = tuple(Path(each).stem if isinstance(each, str | os.PathLike) else "" for each in listed)
    tracks = (raw,) if isinstance(raw, Track) else tuple(raw)

    # Draw, and write.
    page = Page(width, title, legend)
    figure = draw(kind, opened, names, tracks, page)
    if target is not None:
        file_format = picture_format(os.fspath(target))
        with atomic_write(target) as temporary:
            save_figure(figure, temporary, file_format, dpi)
    return figure


def _as_list(
    archives: Archive | ArchiveSource | Sequence[Archive | ArchiveSource],
) -> list[Archive | ArchiveSource]:
    """Return the archives that were given: several, or one as itself, a file, bytes or a stream."""
    single = isinstance(archives, Archive | str | os.PathLike | bytes) or hasattr(archives, "read")
    if single:
        return [cast("Archive | ArchiveSource", archives)]
    return list(cast("Sequence[Archive | ArchiveSource]", archives))


def draw(
    kind: str,
    archives: Sequence[Archive],
    names: Sequence[str],
    tracks: Sequence[Track],
    page: Page,
) -> matplotlib.figure.Figure:
    """Draw a figure of one of :data:`PLOT_KINDS`; errors as for :func:`plot`."""
    chosen = find_kind(kind, len(archives), has_log=bool(tracks))

    # Bring the log to the planes of the archive.
    for archive in archives:
        _check_coordinates(archive, tracks)
    plane = archives[0].grid.plane
    on_plane = tuple(track if plane is None else reproject_track(track, plane) for track in tracks)
    with style():
        return chosen.draw(Subject(tuple(archives), tuple(names), on_plane), page)


def find_kind(name: str, archives: int, *, has_log: bool) -> PlotKind:
    """Return a kind of pictures that can be drawn of a number of archives, with a log or without.

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    OptionError
        If there is no such kind, or it can't be drawn of that.
    """
    require_matplotlib()
    chosen = next((each for each in PLOT_KINDS if each.name == name), None)
    if chosen is None:
        raise OptionError(f"no kind {name!r} of pictures", remedy=f"there are {_names_of()}")

    # Number of archives, and the log.
    if archives == 0:
        raise OptionError("no archive was given to draw")
    if archives > 1 and not chosen.several:
        raise OptionError(
            f"a picture of the kind {name} shows one archive, not {archives}",
            remedy=f"draw one after the other; {_names_of(several=True)} compares several",
        )
    if chosen.needs_log and not has_log:
        raise OptionError(
            f"a picture of the kind {name} compares the walks with the log",
            remedy="give the log with --raw, in Python raw=",
        )
    return chosen


def _check_coordinates(archive: Archive, tracks: Sequence[Track]) -> None:
    """Refuse a log whose coordinates are of another kind than those of the archive."""
    grid = archive.grid
    expected = axes_text(grid.dimension, grid.plane)
    for track in tracks:
        given = axes_text(track.dimension, track.plane)
        if given != expected:
            raise OptionError(
                f"the log is in {given}, the archive in {expected}",
                location=f"track {track.id!r}",
                remedy="give the log that was compressed",
            )


def _names_of(*, several: bool = False) -> str:
    """Return the names of all kinds, or of those that compare several archives."""
    return ", ".join(each.name for each in PLOT_KINDS if each.several or not several)
