"""Coordinates of KML as texts: longitude, latitude and height."""

from __future__ import annotations

import re
from typing import Any, NamedTuple

import pyarrow.compute as pc

__all__ = ["CoordinateTexts", "cut_positions", "split_angles", "split_coordinates"]

#: A number in a position, or what stands in its place.
_CELL = r"[^\s,]+"

#: The numbers of `<gx:coord>`, with blanks between them, and of `<coordinates>`, with commas.
#: A position with both can't be read: `11,5 48` is perhaps a decimal comma.
_FORMS = (
    rf"^\s*(?P<lon>{_CELL})\s+(?P<lat>{_CELL})(?:\s+(?P<alt>{_CELL}))?\s*$",
    rf"^\s*(?P<lon>{_CELL})\s*,\s*(?P<lat>{_CELL})\s*(?:,\s*(?P<alt>{_CELL})?\s*)?$",
)

#: Heading, tilt and roll of `<gx:angles>`.
_ANGLES = rf"^\s*(?P<heading>{_CELL})(?:\s+(?P<tilt>{_CELL}))?(?:\s+(?P<roll>{_CELL}))?\s*$"

#: What precedes a text that is no position, so that no part of it is read as one.
_NO_POSITION = "coordinates "

#: Blanks around a comma, which don't end a position.
_COMMA = re.compile(r"\s*,\s*")

#: The last position of a text and the blanks behind it.
_LAST = re.compile(r"\S*\s*\Z")


class CoordinateTexts(NamedTuple):
    """The numbers of positions as texts; null where there is none.

    Parameters
    ----------
    lat, lon, alt : pyarrow.ChunkedArray of string, shape (n,)
        Latitude, longitude and height.
    """

    lat: Any
    lon: Any
    alt: Any


def split_coordinates(texts: Any) -> CoordinateTexts:
    """Split positions into their numbers.

    Parameters
    ----------
    texts : pyarrow.ChunkedArray of string, shape (n,)
        One position each.

    Returns
    -------
    CoordinateTexts
        A text that is no position becomes the latitude ``coordinates TEXT``, which can't be read.

    Examples
    --------
    >>> import pyarrow as pa
    >>> texts = pa.chunked_array([["11.5 48.1 500", "11.5, 48.1", "", "11,5 48"]])
    >>> lat, lon, alt = split_coordinates(texts)
    >>> lat.to_pylist()
    ['48.1', '48.1', None, 'coordinates 11,5 48']
    >>> alt.to_pylist()
    ['500', None, None, None]
    """
    # Each text has at most one of the two forms.
    found = [pc.extract_regex(texts, pattern=form) for form in _FORMS]
    lat, lon, alt = (
        pc.coalesce(*(pc.struct_field(form, name) for form in found))
        for name in ("lat", "lon", "alt")
    )

    # Show what can't be split; a blank position is none. A group that didn't match is empty.
    is_odd = pc.and_(pc.is_null(lat), pc.greater(pc.utf8_length(pc.utf8_trim_whitespace(texts)), 0))
    shown = pc.binary_join_element_wise(_NO_POSITION, pc.utf8_trim_whitespace(texts), "")
    lat = pc.if_else(pc.fill_null(is_odd, False), shown, lat)
    return CoordinateTexts(lat, lon, _blank_to_null(alt))


def split_angles(texts: Any) -> dict[str, Any]:
    """Split orientations into heading, tilt and roll, which are null where there is none.

    Examples
    --------
    >>> import pyarrow as pa
    >>> angles = split_angles(pa.chunked_array([["45.5 66 10", "90", ""]]))
    >>> angles["heading"].to_pylist(), angles["roll"].to_pylist()
    (['45.5', '90', None], ['10', None, None])
    """
    found = pc.extract_regex(texts, pattern=_ANGLES)
    names = ("heading", "tilt", "roll")
    return {name: _blank_to_null(pc.struct_field(found, name)) for name in names}


def cut_positions(text: str, *, final: bool) -> tuple[list[str], str]:
    """Cut the text of ``<coordinates>`` into positions.

    Parameters
    ----------
    text : str
        The text so far.
    final : bool
        Whether it ends there; else its last position may go on.

    Returns
    -------
    list of str
        Complete positions.
    str
        The rest, to put before what comes next.

    Examples
    --------
    >>> cut_positions("11.5, 48.1 11.6,48.2,500 11.7", final=False)
    (['11.5,48.1', '11.6,48.2,500'], '11.7')
    """
    text = _COMMA.sub(",", text)
    if final:
        return text.split(), ""
    last = _LAST.search(text)
    start = last.start() if last else len(text)
    return text[:start].split(), text[start:]


def _blank_to_null(texts: Any) -> Any:
    return pc.if_else(pc.equal(texts, ""), None, texts)
