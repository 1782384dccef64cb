"""One page of HTML that shows a scene, with its style, its script and all data in it.

The script is packed, as notebooks keep a page for each archive that they show: 60 kB instead of
166.
"""

from __future__ import annotations

import base64
import html
import json
import re
import zlib
from functools import lru_cache
from importlib.resources import files
from typing import Any

from gpszip.view.script import ENTRY, join_modules

__all__ = ["build_frame", "build_page", "to_json"]

#: What stands in the template for the parts of a page, each once.
_TITLE = "<!-- TITLE -->"
_STYLE = "/* STYLE */"
_SCENE = "<!-- SCENE -->"
_PACKED = "<!-- PACKED -->"
_SCRIPT = "/* SCRIPT */"

#: Part of a template that others have, too: the name of its file.
_INCLUDE = re.compile(r"^<!-- INCLUDE ([a-z]+\.html) -->\n", re.MULTILINE)

#: What a page may connect to, in its policy.
_CONNECT = "CONNECT"

#: The module that unpacks the script of a page, and runs it.
_UNPACK = "unpack.js"

#: Level of deflate.
_DEFLATE_LEVEL = 9


def build_page(scene: dict[str, Any]) -> str:
    """Build a page that opens from disk, offline, and loads nothing.

    Parameters
    ----------
    scene : dict
        As :func:`gpszip.view.scene.build_scene` returns it.

    Returns
    -------
    str
        HTML.

    Examples
    --------
    >>> page = build_page({"title": "a <b>", "archives": []})
    >>> "<title>a &lt;b&gt;</title>" in page
    True
    """
    page = build_frame(packed=True)
    page = page.replace(_TITLE, f"<title>{html.escape(scene['title'])}</title>")
    data = f'<script type="application/json" id="scene">{to_json(scene)}</script>'
    return page.replace(_SCENE, data)


def to_json(value: Any) -> str:
    """JSON in which no text can end the element that holds it, nor begin another one."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    # A lone surrogate, of a file name that is no UTF-8, has no form in the page's encoding.
    return text.replace("<", "\\u003c").encode("utf-8", "backslashreplace").decode("utf-8")


@lru_cache(maxsize=3)
def build_frame(
    template: str = "page.html",
    styles: tuple[str, ...] = ("page.css",),
    entry: str | None = ENTRY,
    *,
    packed: bool = False,
    connect: str = "'none'",
) -> str:
    """A template with its style and script.

    Parameters
    ----------
    template : str
        Name of the template.
    styles : tuple of str
        Names of the files of its style.
    entry : str or None
        The module with which the script starts; None for a page without a script.
    packed : bool, default False
        Pack the script; a short one beside it unpacks it.
    connect : str, default "'none'"
        What the page may connect to, as its policy says it.
    """
    # The parts that templates share, and the style.
    assets = files("gpszip.view") / "assets"
    page = _INCLUDE.sub(
        lambda part: (assets / part[1]).read_text(encoding="utf-8"),
        (assets / template).read_text(encoding="utf-8"),
    )
    style = "".join((assets / name).read_text(encoding="utf-8") for name in styles)
    page = page.replace(_CONNECT, connect).replace(_STYLE, style)
    if entry is None:
        return page

    # The script.
    sources = {
        file.name: file.read_text(encoding="utf-8")
        for file in (assets / "script").iterdir()
        if file.name.endswith(".js")
    }
    script = join_modules(sources, entry)
    if not packed:
        return page.replace(f"{_PACKED}\n", "").replace(_SCRIPT, script)
    data = base64.b64encode(_deflate(script.encode())).decode()
    block = f'<script type="text/plain" id="packed">{data}</script>'
    return page.replace(_PACKED, block).replace(_SCRIPT, join_modules(sources, _UNPACK))


def _deflate(data: bytes) -> bytes:
    """A raw deflate stream."""
    packer = zlib.compressobj(_DEFLATE_LEVEL, zlib.DEFLATED, -zlib.MAX_WBITS)
    return packer.compress(data) + packer.flush()
