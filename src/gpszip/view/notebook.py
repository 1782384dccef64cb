"""Pages in notebooks: what a value shows of itself where the notebook asks for HTML."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING, Any

from gpszip.view.page import build_page
from gpszip.view.scene import ShownArchive, build_scene, log_scene, map_scene

if TYPE_CHECKING:
    from gpszip.archive import Archive
    from gpszip.model import RoadMap, Track

__all__ = ["show_archive", "show_map", "show_tracks"]

#: Height of the page in the notebook, in pixels of CSS.
_HEIGHT = 520

#: Archives of at most so many bytes are shown: a notebook keeps the page in its file.
_MAX_ARCHIVE_BYTES = 100_000

#: Maps of at most so many edges, and logs of at most so many samples.
_MAX_EDGES = 50_000
_MAX_SAMPLES = 50_000


def show_archive(archive: Archive) -> str:
    """HTML of an archive: its page, or for a large one what it is and how to see it."""
    if archive.size > _MAX_ARCHIVE_BYTES:
        return _hint(archive, 'gpszip.write_page(archive, "archive.html")')
    return _embed(build_scene([ShownArchive(archive, "archive")], title="archive"))


def show_map(road_map: RoadMap) -> str:
    """HTML of a map, as :func:`show_archive` does it of an archive."""
    if len(road_map.edges) > _MAX_EDGES or not len(road_map.nodes):
        return _hint(road_map, 'gpszip.write_page(archive, "archive.html")')
    return _embed(map_scene(road_map, title="map"))


def show_tracks(tracks: list[Track]) -> str:
    """HTML of a log, as :func:`show_archive` does it of an archive."""
    samples = sum(len(track) for track in tracks)
    if samples > _MAX_SAMPLES or not samples:
        shown = tracks[0] if len(tracks) == 1 else f"{len(tracks):,} tracks, {samples:,} samples"
        return _hint(shown, 'gpszip.write_page(archive, "log.html", raw=tracks)')
    return _embed(log_scene(tracks, title="log"))


def _embed(scene: dict[str, Any]) -> str:
    """A page in a frame: it can't reach the notebook, nor the notebook's style the page."""
    page = html.escape(build_page(scene))
    return (
        f'<iframe srcdoc="{page}" sandbox="allow-scripts" title="{html.escape(scene["title"])}" '
        f'style="width: 100%; height: {_HEIGHT}px; border: 0"></iframe>'
    )


def _hint(value: Any, call: str) -> str:
    return (
        f"<p><code>{html.escape(str(value))}</code></p>"
        f"<p>Too large to show here: <code>{html.escape(call)}</code> writes a page.</p>"
    )
