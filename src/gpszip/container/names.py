"""Track ids as bytes: text that comes back verbatim, numbered ones for almost nothing."""

from __future__ import annotations

from gpszip.container.expansion import deflate, inflate, pack_lzma, unpack_lzma
from gpszip.container.layout import Cursor, encode_varint, max_tracks
from gpszip.container.number_steps import encode_number_steps, read_number_steps
from gpszip.container.text_model import MODEL_LIMIT, encode_text, read_text
from gpszip.errors import InputError

__all__ = ["TEXT_LIMIT", "encode_names", "read_names"]

#: Compressed names expand to at most this many bytes of text; longer lists are stored as they are.
TEXT_LIMIT = 1 << 24

_COUNTED, _PADDED, _LISTED, _PACKED = range(4)
_DEFLATED, _LZMA, _MODEL, _STEPS = range(4)
_NUMBER_LIMIT = 1 << 63
_WIDTH_LIMIT = 64


def encode_names(ids: tuple[str, ...]) -> bytes:
    """Code track ids in the shortest of the ways of docs/format.md.

    Parameters
    ----------
    ids : tuple of str
        Any text without lone surrogates.

    Raises
    ------
    InputError
        If an id is no text that UTF-8 can carry.

    Examples
    --------
    >>> encode_names(("000", "001", "002")).hex()
    '0d0003'
    """
    raw = [_encoded(name) for name in ids]
    numbered = _numbered(ids)
    if numbered is not None:
        return numbered
    return min((_head(len(ids), method) + body for method, body in _texts(ids, raw)), key=len)


def read_names(cursor: Cursor, file_size: int) -> tuple[str, ...]:
    """Undo :func:`encode_names`; reads as far as the names go.

    Parameters
    ----------
    cursor : Cursor
        At the first byte of the names.
    file_size : int
        Size of the archive in bytes, from which follows how many tracks are believed.
    """
    head = cursor.read_varint("the number of tracks")
    count, method = head >> 2, head & 3
    if count > max_tracks(file_size):
        raise cursor.error(f"{count} tracks in {file_size} bytes")
    if method in {_COUNTED, _PADDED}:
        return _read_numbered(cursor, count, method == _PADDED)
    return _read_listed(cursor, count) if method == _LISTED else _read_packed(cursor, count)


def _encoded(name: str) -> bytes:
    try:
        return name.encode()
    except UnicodeEncodeError:
        raise InputError(
            f"track id {name!r:.80} holds a lone surrogate, which is no text; rename the track"
        ) from None


def _head(count: int, method: int) -> bytes:
    return encode_varint(count << 2 | method)


def _numbered(ids: tuple[str, ...]) -> bytes | None:
    if not ids:
        return _head(0, _COUNTED) + encode_varint(0)
    first = ids[0]
    if (
        not (first.isascii() and first.isdigit() and len(first) <= _WIDTH_LIMIT)
        or int(first) + len(ids) >= _NUMBER_LIMIT
    ):
        return None
    start, width = int(first), len(first)
    if all(name == str(start + i) for i, name in enumerate(ids)):
        return _head(len(ids), _COUNTED) + encode_varint(start)
    if all(name == str(start + i).zfill(width) for i, name in enumerate(ids)):
        return _head(len(ids), _PADDED) + encode_varint(start) + encode_varint(width)
    return None


def _read_numbered(cursor: Cursor, count: int, padded: bool) -> tuple[str, ...]:
    start = cursor.read_varint("the first track's number")
    width = cursor.read_varint("the width of numbers") if padded else 0
    if width > _WIDTH_LIMIT:
        raise cursor.error(f"numbers padded to {width} digits")
    return tuple(str(start + i).zfill(width) for i in range(count))


def _texts(ids: tuple[str, ...], raw: list[bytes]) -> list[tuple[int, bytes]]:
    ways = [(_LISTED, b"".join(encode_varint(len(name)) + name for name in raw))]
    # UTF-8 never holds the byte 255, so it can stand for a newline within an id
    text = b"\n".join(name.replace(b"\n", b"\xff") for name in raw)
    if len(text) <= TEXT_LIMIT:
        ways += [
            (_PACKED, encode_varint(len(body) << 2 | code) + body)
            for code, body in _packed(ids, text)
        ]
    return ways


def _packed(ids: tuple[str, ...], text: bytes) -> list[tuple[int, bytes]]:
    ways = [(_DEFLATED, deflate(text)), (_LZMA, pack_lzma(text))]
    if len(text) < MODEL_LIMIT:
        ways.append((_MODEL, encode_text(text + b"\n")))
    steps = encode_number_steps(ids)
    return ways if steps is None else [*ways, (_STEPS, steps)]


def _read_listed(cursor: Cursor, count: int) -> tuple[str, ...]:
    if count > cursor.remaining:
        raise cursor.error(f"{count} names in {cursor.remaining} bytes")
    return tuple(
        _text(cursor.read_bytes(cursor.read_varint("a name's length"), "a name"), cursor)
        for _ in range(count)
    )


def _read_packed(cursor: Cursor, count: int) -> tuple[str, ...]:
    if not count:
        raise cursor.error("no names are packed")
    shape = cursor.read_varint("the length of names")
    body = cursor.read_bytes(shape >> 2, "the names")
    offset = cursor.base + cursor.offset - len(body)
    if shape & 3 == _STEPS:
        return read_number_steps(body, count, offset)
    text = _unpacked(shape & 3, body, count, offset)
    if text.count(b"\n") != count - 1:
        raise cursor.error(f"names are not those of {count} tracks")
    return tuple(_text(name.replace(b"\xff", b"\n"), cursor) for name in text.split(b"\n"))


def _unpacked(code: int, body: bytes, count: int, offset: int) -> bytes:
    if code == _MODEL:
        return read_text(body, count, offset)[:-1]
    return (inflate if code == _DEFLATED else unpack_lzma)(body, TEXT_LIMIT, offset)


def _text(raw: bytes, cursor: Cursor) -> str:
    try:
        return raw.decode()
    except UnicodeDecodeError:
        raise cursor.error("a track's name is no text") from None
