r"""Recognise logs in JSON by their first letters.

All formats are asked about each file, so this module imports nothing heavy.
"""

from __future__ import annotations

import json
import re

__all__ = ["history_list", "sniff_geojson", "sniff_google", "sniff_google_paths", "sniff_readsb"]

#: Letters by which JSON is recognised.
_SNIFFED_LETTERS = 2000

#: Bytes of a letter, at most: UTF-32.
_LETTER_BYTES = 4

#: Space before the first object, with the record separator of RFC 8142 and the byte order mark.
_SPACE = " \t\r\n\x1e\ufeff"

#: The start of a history: the first member of its object, or of the first entry of its list.
_HISTORY = re.compile(
    r"[\s\ufeff]*(?:\{\s*\"(locations|rawSignals|timelineEdits|semanticSegments|timelineObjects"
    r"|userLocationProfile)\"\s*:"
    r"|\[\s*\{\s*\"(?:startTime|endTime|timelinePath|visit|activity|timelineMemory)\"\s*:)"
)

#: What follows the name of a list without entries.
_NO_ENTRY = re.compile(r"\s*\[\s*\]")

#: The start of a trace: its address comes first; ~ marks one that is no address of ICAO.
_TRACE = re.compile(r'[\s\ufeff]*\{\s*"icao"\s*:\s*"~?[0-9A-Fa-f]{6}"')


def sniff_geojson(head: bytes) -> bool:
    """Whether a file that starts like this is JSON with objects.

    Examples
    --------
    >>> sniff_geojson(b'{"type": "FeatureCollection"'), sniff_geojson(b'[ {"type": "Feature"')
    (True, True)
    >>> sniff_geojson(b"[t],x,y")
    False
    """
    # A list holds objects or nothing; `[t],x,y` is the header of a table.
    text = _first_letters(head).lstrip(_SPACE)
    return text[:1] == "{" or (text[:1] == "[" and text[1:].lstrip()[:1] in ("{", "]"))


def sniff_google(head: bytes) -> bool:
    """Whether a file that starts like this is a location history of Google.

    Examples
    --------
    >>> sniff_google(b'{"locations": [{"latitudeE7": 480000000'), sniff_google(b'{"type": "Fea')
    (True, False)
    """
    return _HISTORY.match(_first_letters(head)) is not None


def sniff_google_paths(_head: bytes) -> bool:
    """Return False: paths of a history are read instead of its positions only if asked for."""
    return False


def history_list(head: bytes) -> str | None:
    """Return the name of the list with which a history begins.

    Returns
    -------
    str or None
        Empty for a list without a name; None for a list without entries, and if it is no history.

    Examples
    --------
    >>> history_list(b'{"locations": [{"latitudeE7": 480000000'), history_list(b'{"locations": []}')
    ('locations', None)
    """
    text = _first_letters(head)
    start = _HISTORY.match(text)
    if start is None or _NO_ENTRY.match(text, start.end()):
        return None
    return start[1] or ""


def sniff_readsb(head: bytes) -> bool:
    """Whether a file that starts like this is a trace of readsb.

    Examples
    --------
    >>> sniff_readsb(b'{"icao":"3c6444","r":"D-AIBD","timestamp": 1714780800.0,"trace":[')
    True
    >>> sniff_readsb(b'{"type":"FeatureCollection"')
    False
    """
    return _TRACE.match(_first_letters(head)) is not None


def _first_letters(head: bytes) -> str:
    """Return the first letters of JSON, in the encoding that its first bytes show."""
    encoding = json.detect_encoding(head[:_LETTER_BYTES])
    return head[: _LETTER_BYTES * _SNIFFED_LETTERS].decode(encoding, "ignore")[:_SNIFFED_LETTERS]
