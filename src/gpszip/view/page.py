"""One page of HTML that shows a scene, with its style, its script and all data in it."""

from __future__ import annotations

import html
import json
from functools import lru_cache
from importlib.resources import files
from typing import Any

from gpszip.view.script import ENTRY, join_modules

__all__ = ["build_frame", "build_page", "to_json"]

#: What stands in the template for the parts of a page, each once.
_TITLE = "<!-- TITLE -->"
_STYLE = "/* STYLE */"
_SCENE = "<!-- SCENE -->"
_SCRIPT = "/* SCRIPT */"


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
    page = build_frame()
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
    """
    # The style.
    assets = files("gpszip.view") / "assets"
    style = "".join((assets / name).read_text(encoding="utf-8") for name in styles)
    page = (assets / template).read_text(encoding="utf-8").replace(_STYLE, style)
    if entry is None:
        return page

    # The script.
    sources = {
        file.name: file.read_text(encoding="utf-8")
        for file in (assets / "script").iterdir()
        if file.name.endswith(".js")
    }
    return page.replace(_SCRIPT, join_modules(sources, entry))
