"""The live page of ``gpszip listen``: what is drawn before any position comes."""

from __future__ import annotations

import os
from pathlib import Path

from gpszip.archive import open_archive
from gpszip.view.page import build_frame, to_json
from gpszip.view.scene import live_scene

__all__ = ["build_live_page", "build_live_scene"]


def build_live_page() -> str:
    """Return the page, as HTML; it asks its server for the map and for what happens.

    Examples
    --------
    >>> page = build_live_page()
    >>> "connect-src 'self'" in page, "<!-- SCENE -->" in page
    (True, False)
    """
    page = build_frame("live.html", ("page.css", "live.css"), "live.js", connect="'self'")
    return page.replace("<!-- TITLE -->", "<title>Live positions</title>")


def build_live_scene(archive: str | os.PathLike[str] | None) -> bytes:
    """Return the map of an archive, or a plane without one, as JSON.

    Parameters
    ----------
    archive : path or None
        The archive.

    Raises
    ------
    GPSZipError
        If it can't be read.
    """
    if archive is None:
        return to_json(live_scene(None, title="Live positions")).encode()
    return to_json(live_scene(open_archive(archive), title=Path(archive).name)).encode()
