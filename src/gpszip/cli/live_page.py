"""The option --page of gpszip listen, and what it opens."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from gpszip.live import Notices
    from gpszip.live.page.server import PageServer

__all__ = ["open_page", "page_option"]

page_option = click.option(
    "--page",
    metavar="HOST:PORT",
    help="Show agents, events and sources live in browsers; 8086 means 127.0.0.1:8086. Another "
    "host needs --token.",
)


def open_page(
    host: str, port: int, notices: Notices, archive: str | None, token: str | None
) -> PageServer:
    """Open the live page; the map first, as it is what may be wrong."""
    from gpszip.live.page.server import PageServer
    from gpszip.view.live import build_live_page, build_live_scene

    scene = build_live_scene(archive)
    return PageServer(host, port, notices, build_live_page(), scene, token=token)
