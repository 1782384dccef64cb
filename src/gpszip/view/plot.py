"""Pictures for papers: of a map, its walks, and their errors. Needs the extra ``plot``."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gpszip.archive import Archive
from gpszip.drawing.style import (
    DPI,
    PAGE_WIDTH,
    Layout,
    picture_format,
    require_matplotlib,
    save_figure,
    style,
)
from gpszip.errors import OptionError
from gpszip.files.atomic_write import atomic_write
from gpszip.io.deferred import deferred
from gpszip.model import Track
from gpszip.view.inputs import Archives, check_coordinates, list_tracks, open_archives, put_on_plane
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
        Draws a subject in a layout, and returns the figure.
    needs_log : bool, default False
        Whether it needs the log.
    several : bool, default False
        Whether it compares several archives.
    """

    name: str
    description: str
    draw: Callable[[Subject, Layout], matplotlib.figure.Figure]
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
    archives: Archives,
    target: str | os.PathLike[str] | None = None,
    *,
    kind: str = "map",
    raw: Track | Sequence[Track] = (),
    width: float = PAGE_WIDTH,
    dpi: int = DPI,
    title: str | None = None,
    legend: bool = True,
    force: bool = False,
) -> matplotlib.figure.Figure:
    """Draw a picture of an archive for a paper. Needs the extra ``plot``.

    Parameters
    ----------
    archives : Archive, path or bytes, or sequence of these
        The archive; several for the kind ``rate``.
    target : path, optional
        File to write: ``.png``, ``.svg`` or ``.pdf``.
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
    force : bool, default False
        Replace an existing file.

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
        If the file exists and ``force`` is not given, or it can't be written.

    Examples
    --------
    >>> from gpszip import compress
    >>> lane = Track("lane", range(20), [[abs(t % 8 - 4.0), 0.0] for t in range(20)])
    >>> figure = plot(compress(lane, max_error=0.1), kind="error", raw=lane, width=85.0)
    >>> figure.axes[0].get_ylabel()
    'error in metres'
    """
    # Draw, and write.
    opened, names = open_archives(archives)
    figure = draw(kind, opened, names, list_tracks(raw), Layout(width, title, legend))
    if target is not None:
        file_format = picture_format(os.fspath(target))
        with atomic_write(target, force=force) as temporary:
            save_figure(figure, temporary, file_format, dpi)
    return figure


def draw(
    kind: str,
    archives: Sequence[Archive],
    names: Sequence[str],
    tracks: Sequence[Track],
    layout: Layout,
) -> matplotlib.figure.Figure:
    """Draw a figure of one of :data:`PLOT_KINDS`; errors as for :func:`plot`."""
    chosen = find_kind(kind, len(archives), has_log=bool(tracks))

    # Bring the log to the planes of the first archive.
    for archive in archives:
        check_coordinates(tracks, archive)
    on_plane = put_on_plane(tracks, archives[0])
    with style():
        return chosen.draw(Subject(tuple(archives), tuple(names), on_plane), layout)


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


def _names_of(*, several: bool = False) -> str:
    """Return the names of all kinds, or of those that compare several archives."""
    return ", ".join(each.name for each in PLOT_KINDS if each.several or not several)
