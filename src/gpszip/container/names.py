"""Track ids as bytes: any text comes back verbatim, numbered ids take almost nothing.

An id list begins with a varint of the number of ids times 4 plus how they are stored. Lists of
texts have several packings; the shortest is written.
"""

from __future__ import annotations

from functools import lru_cache

from gpszip.container.expansion import deflate, inflate, pack_lzma, unpack_lzma
from gpszip.container.layout import Cursor, encode_varint, max_tracks
from gpszip.container.number_steps import encode_number_steps, read_number_steps
from gpszip.container.text_model import MODEL_LIMIT, encode_text, read_text
from gpszip.errors import InputError

__all__ = ["TEXT_LIMIT", "encode_names", "read_names"]

#: Compressed names expand to at most this many bytes of text; longer lists are not packed.
TEXT_LIMIT = 1 << 24

#: How ids are stored.
_COUNTED = 0  # consecutive numbers
_PADDED = 1  # the same with leading zeros
_LISTED = 2  # each with its length
_PACKED = 3  # compressed

#: How compressed ids are packed.
_DEFLATED = 0
_LZMA = 1
_MODEL = 2  # adaptive model of text
_STEPS = 3  # growing numbers

#: Bits of either number below what it is packed with.
_METHOD_BITS = 2
_METHOD_MASK = 3

#: Numbers are below this, and have at most so many digits.
_NUMBER_LIMIT = 1 << 63
_MAX_WIDTH = 64

#: UTF-8 never holds the byte 255, so that it can stand for a newline within an id.
_INNER_NEWLINE = b"\xff"


# The size of an archive, its bound and its file each need the bytes of the same names.
@lru_cache(maxsize=1)
def encode_names(ids: tuple[str, ...]) -> bytes:
    """Encode track ids in the shortest of the forms of docs/format.md.

    Parameters
    ----------
    ids : tuple of str
        Any text without lone surrogates.

    Raises
    ------
    InputError
        If an id is no text that UTF-8 can encode.

    Examples
    --------
    >>> encode_names(("000", "001", "002")).hex()
    '0d0003'
    """
    # Encode all ids first, so that any that is no text is refused in every form.
    encoded = [_encode_text(name) for name in ids]
    numbered = _encode_numbered(ids)
    if numbered is not None:
        return numbered
    forms = [(_LISTED, b"".join(encode_varint(len(name)) + name for name in encoded))]
    forms += [(_PACKED, body) for body in _pack(ids, encoded)]
    return min((_head(len(ids), form) + body for form, body in forms), key=len)


def read_names(cursor: Cursor, file_size: int) -> tuple[str, ...]:
    """Undo :func:`encode_names`; reads up to the end of the names.

    Parameters
    ----------
    cursor : Cursor
        At the first byte of the names.
    file_size : int
        Size of the archive in bytes, which limits the number of tracks.
    """
    head = cursor.read_varint("the number of tracks")
    count, form = head >> _METHOD_BITS, head & _METHOD_MASK
    # Forged numbers of tracks must not ask for memory.
    if count > max_tracks(file_size):
        raise cursor.error(f"{count} tracks in {file_size} bytes")
    if form in {_COUNTED, _PADDED}:
        return _read_numbered(cursor, count, form == _PADDED)
    return _read_listed(cursor, count) if form == _LISTED else _read_packed(cursor, count)


def _encode_text(name: str) -> bytes:
    """UTF-8 of an id."""
    try:
        return name.encode()
    except UnicodeEncodeError:
        raise InputError(
            f"track id {name!r:.80} holds a lone surrogate, which is no text",
            remedy="rename the track",
        ) from None


def _decode_text(data: bytes, cursor: Cursor) -> str:
    """Undo :func:`_encode_text`."""
    try:
        return data.decode()
    except UnicodeDecodeError:
        raise cursor.error("a track's name is no text") from None


def _head(count: int, form: int) -> bytes:
    """Number of ids, and how they are stored."""
    return encode_varint(count << _METHOD_BITS | form)


def _encode_numbered(ids: tuple[str, ...]) -> bytes | None:
    """Encode ids that are consecutive numbers; None for others."""
    # Only ids of digits qualify, as far as the last number stays below the limit.
    if not ids:
        return _head(0, _COUNTED) + encode_varint(0)
    first = ids[0]
    if (
        not (first.isascii() and first.isdigit() and len(first) <= _MAX_WIDTH)
        or int(first) + len(ids) >= _NUMBER_LIMIT
    ):
        return None

    # With leading zeros or without.
    start, width = int(first), len(first)
    if all(name == str(start + i) for i, name in enumerate(ids)):
        return _head(len(ids), _COUNTED) + encode_varint(start)
    if all(name == str(start + i).zfill(width) for i, name in enumerate(ids)):
        return _head(len(ids), _PADDED) + encode_varint(start) + encode_varint(width)
    return None


def _read_numbered(cursor: Cursor, count: int, padded: bool) -> tuple[str, ...]:
    """Undo :func:`_encode_numbered`."""
    start = cursor.read_varint("the first track's number")
    width = cursor.read_varint("the width of numbers") if padded else 0
    if width > _MAX_WIDTH:
        raise cursor.error(f"numbers padded to {width} digits")
    return tuple(str(start + i).zfill(width) for i in range(count))


def _pack(ids: tuple[str, ...], encoded: list[bytes]) -> list[bytes]:
    """Compressed lists: a varint of length and packing, the bytes; none of a list too long."""
    text = b"\n".join(name.replace(b"\n", _INNER_NEWLINE) for name in encoded)
    if len(text) > TEXT_LIMIT:
        return []
    packings = [(_DEFLATED, deflate(text)), (_LZMA, pack_lzma(text))]
    # The model needs a newline after the last name, too, which makes the text a byte longer.
    if len(text) < MODEL_LIMIT:
        packings.append((_MODEL, encode_text(text + b"\n")))
    steps = encode_number_steps(ids)
    if steps is not None:
        packings.append((_STEPS, steps))
    return [encode_varint(len(body) << _METHOD_BITS | packing) + body for packing, body in packings]


def _read_listed(cursor: Cursor, count: int) -> tuple[str, ...]:
    """Read ids that have their lengths."""
    # Each name takes a byte at least, for its length.
    if count > cursor.remaining:
        raise cursor.error(f"{count} names in {cursor.remaining} bytes")
    return tuple(
        _decode_text(cursor.read_bytes(cursor.read_varint("a name's length"), "a name"), cursor)
        for _ in range(count)
    )


def _read_packed(cursor: Cursor, count: int) -> tuple[str, ...]:
    """Undo :func:`_pack`."""
    # Read size and packing; steps of growing numbers are no text.
    if not count:
        raise cursor.error("no names are packed")
    head = cursor.read_varint("the length of names")
    size, packing = head >> _METHOD_BITS, head & _METHOD_MASK
    body = cursor.read_bytes(size, "the names")
    offset = cursor.base + cursor.offset - len(body)
    if packing == _STEPS:
        return read_number_steps(body, count, offset)

    # Split the text.
    text = _unpack(packing, body, count, offset)
    # Newlines only separate names; those within names have another byte.
    if text.count(b"\n") != count - 1:
        raise cursor.error(f"names are not those of {count} tracks")
    if _INNER_NEWLINE not in text:
        return tuple(_decode_text(text, cursor).split("\n"))
    return tuple(
        _decode_text(name.replace(_INNER_NEWLINE, b"\n"), cursor) for name in text.split(b"\n")
    )


def _unpack(packing: int, body: bytes, count: int, offset: int) -> bytes:
    """Text of a compressed list."""
    if packing == _MODEL:
        # Leave out the newline that ends the last name.
        return read_text(body, count, offset)[:-1]
    return (inflate if packing == _DEFLATED else unpack_lzma)(body, TEXT_LIMIT, offset)
