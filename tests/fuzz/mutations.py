"""Changes to a valid file that keep most of its structure: of bytes, lines, words and numbers."""

from __future__ import annotations

import gzip
import random
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

__all__ = ["BINARY", "TEXT", "Mutation", "apply", "draw"]

#: Numbers that readers get wrong.
NUMBERS = (
    b"0", b"-0", b"-1", b"1e400", b"-1e400", b"1e-400", b"nan", b"NaN", b"inf", b"-Infinity",
    b"null", b"true", b"", b" ", b"90.0000001", b"180.0000001", b"-180", b"91", b"1e300",
    b"9007199254740993", b"9223372036854775807", b"-9223372036854775808",
    b"18446744073709551616", b"9" * 400, b"0." + b"3" * 400, b"1_000", b"0x10", b"1,5", b"1;5",
    b"--5", b"5-", b"1e", b"+7", b".5", b"5.", b"\xd9\xa3", b"4e1", b"253402300800", b"1e20",
    b"-62135596801", b"32768", b"65536", b"2147483648", b"4294967296",
)  # fmt: skip

#: Words, times and marks that readers get wrong.
WORDS = (
    b"2024-02-30T00:00:00Z", b"99999-01-01T00:00:00Z", b"2024-13-01", b"0000-00-00T00:00:00Z",
    b"2016-12-31T23:59:60Z", b"24:00:00", b"2024-05-04T08:00:00+99:99",
    b"2024-05-04T08:00:00.123456789123Z", b"12:00", b"Point", b"LineString",
    b"MultiLineString", b"Feature", b"geometry", b"coordinates", b"time", b"times", b"lat",
    b"lon", b"x", b"y", b"t", b"id", b"trkpt", b"trk", b"EPSG:4326", b"\xef\xbb\xbf", b"\x00",
    b"\xff\xfe", b'"', b"'", b'""', b"\\", b"\\u0000", b"\\ud800", b"<", b">", b"</", b"<!--",
    b"<![CDATA[", b"]]>", b"&amp;", b"&x;", b"&#0;",
    b"<?xml version='1.0' encoding='utf-16'?>", b'<!DOCTYPE x [<!ENTITY x "y">]>', b"[", b"]",
    b"{", b"}", b",", b";", b"\t", b"\r", b"\r\n", b"\n\n", b"[" * 5000, b"<a>" * 2000,
    b"a" * 200_000, b"../", b"<script>", "\u202e\U0001f600".encode(), b"\x1a", b"\x1b[2J",
)  # fmt: skip

_WORD = re.compile(rb"[A-Za-z_:]+")
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")

#: Bytes of the longest file that is tried.
_MAX_BYTES = 1 << 21

#: Encodings that a file is converted to.
_ENCODINGS = ("utf-16", "utf-16-le", "utf-32", "latin-1", "utf-8-sig", "cp037", "utf-7")


@dataclass(frozen=True)
class Mutation:
    """One change.

    Parameters
    ----------
    kind : str
        Key of the table of changes.
    position : float
        Where in the file, as a share from 0 to 1.
    amount : float
        How far, or which value, as a share from 0 to 1.
    """

    kind: str
    position: float
    amount: float


def apply(data: bytes, mutations: Sequence[Mutation]) -> bytes:
    """Return data after all changes, one after the other."""
    for mutation in mutations:
        data = _CHANGES[mutation.kind](data, mutation.position, mutation.amount)
    return data[:_MAX_BYTES]


def draw(rng: random.Random, kinds: Sequence[str]) -> list[Mutation]:
    """Return a few changes of these kinds."""
    return [
        Mutation(rng.choice(kinds), rng.random(), rng.random())
        for _ in range(rng.choice((0, 1, 1, 1, 2, 2, 3, 5, 8)))
    ]


def _index(size: int, share: float) -> int:
    return min(int(share * size), max(size - 1, 0))


def _range(data: bytes, position: float, amount: float) -> tuple[int, int]:
    """Return a range, mostly a short one."""
    begin = _index(len(data), position)
    return begin, min(begin + 1 + int(amount**4 * len(data)), len(data))


# Changes of bytes


def _flip(data: bytes, position: float, amount: float) -> bytes:
    i = _index(len(data), position)
    return data[:i] + bytes([data[i] ^ (1 << _index(8, amount))]) + data[i + 1 :] if data else data


def _overwrite(data: bytes, position: float, amount: float) -> bytes:
    i = _index(len(data), position)
    return data[:i] + bytes([_index(256, amount)]) + data[i + 1 :]


def _insert(data: bytes, position: float, amount: float) -> bytes:
    i = _index(len(data) + 1, position)
    return data[:i] + bytes([_index(256, amount)]) + data[i:]


def _delete(data: bytes, position: float, amount: float) -> bytes:
    begin, end = _range(data, position, amount)
    return data[:begin] + data[end:]


def _duplicate(data: bytes, position: float, amount: float) -> bytes:
    begin, end = _range(data, position, amount)
    return data[:end] + data[begin:end] + data[end:]


def _zero(data: bytes, position: float, amount: float) -> bytes:
    begin, end = _range(data, position, amount)
    return data[:begin] + bytes(end - begin) + data[end:]


def _fill(data: bytes, position: float, amount: float) -> bytes:
    begin, end = _range(data, position, amount)
    return data[:begin] + b"\xff" * (end - begin) + data[end:]


def _truncate(data: bytes, position: float, amount: float) -> bytes:
    return data[: _index(len(data), position)]


# Changes of text


def _lines(
    change: Callable[[list[bytes], int, int], list[bytes]],
) -> Callable[[bytes, float, float], bytes]:
    def change_lines(data: bytes, position: float, amount: float) -> bytes:
        lines = data.split(b"\n")
        i, j = _index(len(lines), position), _index(len(lines), amount)
        return b"\n".join(change(lines, i, j))

    return change_lines


def _drop_line(lines: list[bytes], i: int, j: int) -> list[bytes]:
    return lines[:i] + lines[i + 1 :]


def _repeat_line(lines: list[bytes], i: int, j: int) -> list[bytes]:
    return lines[:i] + lines[i : i + 1] * (1 + j) + lines[i:]


def _move_line(lines: list[bytes], i: int, j: int) -> list[bytes]:
    others = _drop_line(lines, i, j)
    return [*others[:j], lines[i], *others[j:]]


def _replace(
    pattern: re.Pattern[bytes], values: Sequence[bytes]
) -> Callable[[bytes, float, float], bytes]:
    """Put a value in the place of a word or number."""

    def change_one(data: bytes, position: float, amount: float) -> bytes:
        matches = list(pattern.finditer(data))
        if not matches:
            return data
        match = matches[_index(len(matches), position)]
        return data[: match.start()] + values[_index(len(values), amount)] + data[match.end() :]

    return change_one


def _copy(pattern: re.Pattern[bytes]) -> Callable[[bytes, float, float], bytes]:
    """Put a word or number of the file in the place of another."""

    def change_one(data: bytes, position: float, amount: float) -> bytes:
        matches = list(pattern.finditer(data))
        if not matches:
            return data
        match = matches[_index(len(matches), position)]
        other = matches[_index(len(matches), amount)][0]
        return data[: match.start()] + other + data[match.end() :]

    return change_one


def _rename(data: bytes, position: float, amount: float) -> bytes:
    """Replace a word everywhere, so that a column or an element has another name."""
    matches = list(_WORD.finditer(data[:100_000]))
    if not matches:
        return data
    word = matches[_index(len(matches), position)][0]
    others = [*WORDS, *(match[0] for match in matches[:50])]
    other = others[_index(len(others), amount)][:1000]
    return data.replace(word, other, _MAX_BYTES // (len(other) + 1))[:_MAX_BYTES]


def _put(data: bytes, position: float, amount: float) -> bytes:
    """Insert a word or number."""
    i, values = _index(len(data) + 1, position), (*WORDS, *NUMBERS)
    return data[:i] + values[_index(len(values), amount)] + data[i:]


def _encode(data: bytes, position: float, amount: float) -> bytes:
    encoding = _ENCODINGS[_index(len(_ENCODINGS), position)]
    return data.decode("utf-8", "replace").encode(encoding, "replace")


def _gzip(data: bytes, position: float, amount: float) -> bytes:
    packed = gzip.compress(data, 1, mtime=0)
    return packed if amount < 0.7 else packed[: _index(len(packed), position)]


_CHANGES: dict[str, Callable[[bytes, float, float], bytes]] = {
    "flip": _flip,
    "overwrite": _overwrite,
    "insert": _insert,
    "delete": _delete,
    "duplicate": _duplicate,
    "zero": _zero,
    "fill": _fill,
    "truncate": _truncate,
    "drop line": _lines(_drop_line),
    "repeat line": _lines(_repeat_line),
    "move line": _lines(_move_line),
    "number": _replace(_NUMBER, NUMBERS),
    "word": _replace(_WORD, WORDS),
    "word for number": _replace(_NUMBER, WORDS),
    "number for word": _replace(_WORD, NUMBERS),
    "other number": _copy(_NUMBER),
    "other word": _copy(_WORD),
    "all of a word": _rename,
    "put": _put,
    "encode": _encode,
    "pack": _gzip,
}

#: Kinds for binary files.
BINARY = ("flip", "overwrite", "insert", "delete", "duplicate", "zero", "fill", "truncate")

#: Kinds for text.
TEXT = tuple(_CHANGES)
