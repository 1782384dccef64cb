"""A page that tells what the history of an archive knows: sentences, tables, pictures, map."""

from __future__ import annotations

import html
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from gpszip.archive import Archive, ArchiveSource, open_archive
from gpszip.files.atomic_write import atomic_write
from gpszip.model import Options, ReadResult, Track
from gpszip.model.text import count_phrase
from gpszip.model.timestamps import Times, to_seconds
from gpszip.view.generator import generator_name
from gpszip.view.inputs import check_ids, list_tracks, put_on_plane
from gpszip.view.page import build_frame, build_page
from gpszip.view.scene import ShownArchive, build_scene

if TYPE_CHECKING:
    from gpszip.pipeline.findings import Findings
    from gpszip.view.report.sections import Section

__all__ = ["HistoryReport", "build_report", "report"]

#: What stands in the template for the parts of a report, each once.
_TITLE, _BODY = "<!-- TITLE -->", "<!-- BODY -->"

#: Height of the report in a notebook, in pixels of CSS.
_HEIGHT = 700

#: Effort of compressing a log on the way.
_EFFORT = 1


@dataclass(frozen=True, eq=False, repr=False)
class HistoryReport:
    """A report on the history of an archive.

    Parameters
    ----------
    name : str
        Name of the archive.
    numbers : dict
        All numbers of the report: metres, seconds, bytes; what can't be told is None, and
        ``numbers["cannot_tell"]`` says why.
    html : str
        The page: one file that opens from disk, needs no network, and sends nothing anywhere.
    """

    name: str
    numbers: dict[str, Any]
    html: str

    def __repr__(self) -> str:
        return f"HistoryReport({self.name!r}, {len(self.html.encode()):,} bytes)"

    def _repr_html_(self) -> str:
        """The report in a frame of a notebook."""
        return (
            f'<iframe srcdoc="{html.escape(self.html)}" sandbox="allow-scripts" '
            f'title="{html.escape(self.name)}" '
            f'style="width: 100%; height: {_HEIGHT}px; border: 0"></iframe>'
        )

    def write(self, target: str | os.PathLike[str], *, force: bool = False) -> int:
        """Write the page as a file, such as ``report.html``; return its bytes.

        Raises
        ------
        OutputError
            If the file exists and ``force`` is not given, or it can't be written.
        """
        with atomic_write(target, force=force) as temporary:
            return temporary.write_bytes(self.html.encode())


def report(
    source: Archive | ArchiveSource | Track | Sequence[Track],
    *,
    raw: Track | Sequence[Track] = (),
    timezone: str | None = None,
    since: Times | None = None,
    title: str = "",
) -> HistoryReport:
    """Report what the history of an archive tells, in one page with the map.

    Parameters
    ----------
    source : Archive, path or bytes, or Track or sequence of Track
        An archive, or a log as :func:`gpszip.read` returns it, which is compressed on the way.
    raw : Track or sequence of Track
        The log of the archive: the map shows its samples, and its stated errors tell trips better.
    timezone : str, optional
        Time zone of hours, such as ``Europe/Berlin``. By default that of the place, if the package
        timezonefinder is there, else UTC.
    since : time, optional
        The changes, unusual trips and rounds from then on are told, compared with the time before.
        By default, changes are sought in the last quarter of all travel. A time as for
        :meth:`Archive.position`.
    title : str, optional
        Title of the page; by default the name of the archive.

    Returns
    -------
    HistoryReport
        Its ``numbers``, and its page, which ``write`` writes.

    Raises
    ------
    OptionError
        If there is no such time zone, ``since`` lies outside of the archive's times, or the log is
        another one than the archive holds.

    Examples
    --------
    >>> corners = [[0, 0], [90, 0], [90, 60], [0, 60]]
    >>> guard = Track("guard", [30.0 * i for i in range(41)], [*corners * 10, [0, 0]])
    >>> told = report(guard)
    >>> told.numbers["rounds"]["rounds"], told.numbers["cannot_tell"]
    (10, {'unusual': 'there are too few trips to tell what is usual'})
    """
    from gpszip.pipeline.findings import find_all

    # The archive, and the log on its plane.
    archive, tracks, name = _open(source, list_tracks(raw))
    tracks = put_on_plane(tracks, archive)
    check_ids(tracks, [archive])

    # What it tells.
    first = None if since is None else float(to_seconds(since, name="since"))
    found = find_all(archive, timezone=timezone, since=first, tracks=tracks)
    read_result = raw if isinstance(raw, ReadResult) else None
    if read_result is None and isinstance(source, ReadResult):
        read_result = source
    return build_report(found, archive, title or name, tracks, read_result)


def _open(
    source: Archive | ArchiveSource | Track | Sequence[Track], raw: tuple[Track, ...]
) -> tuple[Archive, tuple[Track, ...], str]:
    """Archive, log and name of what is reported on."""
    if isinstance(source, Archive):
        return source, raw, "archive"
    if isinstance(source, str | os.PathLike):
        return open_archive(source), raw, Path(source).stem
    if isinstance(source, bytes) or hasattr(source, "read"):
        return open_archive(cast("ArchiveSource", source)), raw, "archive"

    # A log.
    from gpszip.pipeline.compress import compress

    tracks = list_tracks(source)
    return compress(tracks, Options(effort=_EFFORT))[0], tracks, "log"


def build_report(
    found: Findings,
    archive: Archive,
    name: str,
    tracks: Sequence[Track] = (),
    read_result: ReadResult | None = None,
) -> HistoryReport:
    """Build a report of what was found.

    Parameters
    ----------
    found : Findings
        All parts of the history.
    archive : Archive
        The archive.
    name : str
        Its name.
    tracks : sequence of Track
        The log on the archive's plane, if the map shall show it.
    read_result : ReadResult, optional
        What reading the log repaired and left out.
    """
    from gpszip.view.report.numbers import collect_numbers
    from gpszip.view.report.sections import summarise, write_sections

    # Numbers and sentences.
    numbers = collect_numbers(found, archive, name, read_result)
    remarks = [] if read_result is None else _list_remarks(read_result)
    sections = write_sections(numbers, found.calendar, remarks)

    # The map is the page of the archive, in a frame: its keys and its style are its own.
    size = None if read_result is None else read_result.bytes
    shown = ShownArchive(archive, name, tracks, size, findings=found)
    scene = build_scene([shown], title=name)
    body = [
        f"<header><h1>{html.escape(name)}</h1>{summarise(numbers, found.calendar)}</header>",
        _write_contents(sections),
        '<section id="map" aria-label="Map"><iframe sandbox="allow-scripts" title="Map" srcdoc="'
        f'{html.escape(build_page(scene))}"></iframe></section>',
        *(_write_section(section) for section in sections),
        f"<footer>{html.escape(generator_name())}. This page is one file. It needs no network, and "
        "the browser lets it reach none.</footer>",
    ]
    page = build_frame("report.html", ("report.css",), entry=None)
    page = page.replace(_TITLE, f"<title>{html.escape(name)}</title>")
    page = page.replace(_BODY, "\n".join(body))
    # A lone surrogate, of a file name that is no UTF-8, has no form in the page's encoding.
    return HistoryReport(name, numbers, page.encode("utf-8", "xmlcharrefreplace").decode("utf-8"))


def _list_remarks(read_result: ReadResult) -> list[str]:
    """What reading a log repaired, lost and left out, for people."""
    return [
        *(
            f"{repair.where}: {count_phrase(repair.count, repair.what)}"
            for repair in read_result.repairs
        ),
        *(f"Lost: {loss}" for loss in read_result.losses),
        *(f"Left out: {left.name}, {left.reason}" for left in read_result.left_out),
        *(f"{others.where}: left out {others}" for others in read_result.other_files),
    ]


def _write_contents(sections: Sequence[Section]) -> str:
    """Links to the sections."""
    links = "".join(
        f'<a href="#{section.id}">{html.escape(section.title)}</a>' for section in sections
    )
    return f'<nav aria-label="Sections"><a href="#map">Map</a>{links}</nav>'


def _write_section(section: Section) -> str:
    title = html.escape(section.title)
    return f'<section id="{section.id}"><h2>{title}</h2>{section.body}</section>'
