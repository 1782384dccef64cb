"""Changes to a valid file that keep most of its structure: of bytes, of lines, of words and of numbers."""

from __future__ import annotations

import gzip
import random
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

__all__ = ["BINARY", "TEXT", "Mutation", "applied", "drawn"]

#: Numbers that readers get wrong.
NUMBERS = (
    b"0", b"-0", b"-1", b"1e400", b"-1e400", b"1e-400", b"nan", b"NaN", b"inf", b"-Infinity", b"null", b"true", b"", b" ", b"90.0000001",
    b"180.0000001", b"-180", b"91", b"1e300", b"9007199254740993", b"9223372036854775807", b"-9223372036854775808",
    b"18446744073709551616", b"9" * 400, b"0." + b"3" * 400, b"1_000", b"0x10", b"1,5", b"1;5", b"--5", b"5-", b"1e", b"+7", b".5", b"5.",
    b"\xd9\xa3", b"4e1", b"253402300800", b"1e20", b"-62135596801", b"32768", b"65536", b"2147483648", b"4294967296",
)  # fmt: skip

#: Words and instants likewise.
WORDS = (
    b"2024-02-30T00:00:00Z", b"99999-01-01T00:00:00Z", b"2024-13-01", b"0000-00-00T00:00:00Z", b"2016-12-31T23:59:60Z", b"24:00:00",
    b"2024-05-04T08:00:00+99:99", b"2024-05-04T08:00:00.123456789123Z", b"12:00", b"Point", b"LineString", b"MultiLineString", b"Feature",
    b"geometry", b"coordinates", b"time", b"times", b"lat", b"lon", b"x", b"y", b"t", b"id", b"trkpt", b"trk", b"EPSG:4326",
    b"\xef\xbb\xbf",
    b"\x00", b"\xff\xfe", b'"', b"'", b'""', b"\\", b"\\u0000", b"\\ud800", b"<", b">", b"</", b"<!--", b"<![CDATA[", b"]]>", b"&amp;",
    b"&x;", b"&#0;", b"<?xml version='1.0' encoding='utf-16'?>", b'<!DOCTYPE x [<!ENTITY x "y">]>', b"[", b"]", b"{", b"}", b",", b";",
    b"\t", b"\r", b"\r\n", b"\n\n", b"[" * 5000, b"<a>" * 2000, b"a" * 200_000, b"../", b"<script>", "\u202e\U0001f600".encode(),
    b"\x1a", b"\x1b[2J",
)  # fmt: skip

_WORD = re.compile(rb"[A-Za-z_:]+")
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


@dataclass(frozen=True)
class Mutation:
    """One change.

    Parameters
    ----------
    kind : str
        Key of the table of changes.
    at, to : float
        Where, and how far or which, as shares from 0 to 1.
    """

    kind: str
    at: float
    to: float


def applied(data: bytes, mutations: Sequence[Mutation]) -> bytes:
    """Data after all changes, one after the other."""
    for one in mutations:
        data = _TABLE[one.kind](data, one.at, one.to)
    return data[:_LONGEST]


def drawn(chance: random.Random, kinds: Sequence[str]) -> list[Mutation]:
    """A few changes of these kinds."""
    return [
        Mutation(chance.choice(kinds), chance.random(), chance.random())
        for _ in range(chance.choice((0, 1, 1, 1, 2, 2, 3, 5, 8)))
    ]


#: Longest file that is tried.
_LONGEST = 1 << 21


def _place(size: int, share: float) -> int:
    return min(int(share * size), max(size - 1, 0))


def _span(data: bytes, at: float, to: float) -> tuple[int, int]:
    """A range, mostly a short one."""
    begin = _place(len(data), at)
    return begin, min(begin + 1 + int(to**4 * len(data)), len(data))


def _flip(data: bytes, at: float, to: float) -> bytes:
    i = _place(len(data), at)
    return data[:i] + bytes([data[i] ^ (1 << _place(8, to))]) + data[i + 1 :] if data else data


def _overwrite(data: bytes, at: float, to: float) -> bytes:
    i = _place(len(data), at)
    return data[:i] + bytes([_place(256, to)]) + data[i + 1 :]


def _insert(data: bytes, at: float, to: float) -> bytes:
    i = _place(len(data) + 1, at)
    return data[:i] + bytes([_place(256, to)]) + data[i:]


def _delete(data: bytes, at: float, to: float) -> bytes:
    begin, end = _span(data, at, to)
    return data[:begin] + data[end:]


def _duplicate(data: bytes, at: float, to: float) -> bytes:
    begin, end = _span(data, at, to)
    return data[:end] + data[begin:end] + data[end:]


def _zero(data: bytes, at: float, to: float) -> bytes:
    begin, end = _span(data, at, to)
    return data[:begin] + bytes(end - begin) + data[end:]


def _fill(data: bytes, at: float, to: float) -> bytes:
    begin, end = _span(data, at, to)
    return data[:begin] + b"\xff" * (end - begin) + data[end:]


def _truncate(data: bytes, at: float, to: float) -> bytes:
    return data[: _place(len(data), at)]


def _lines(
    change: Callable[[list[bytes], int, int], list[bytes]],
) -> Callable[[bytes, float, float], bytes]:
    def changed(data: bytes, at: float, to: float) -> bytes:
        lines = data.split(b"\n")
        return b"\n".join(change(lines, _place(len(lines), at), _place(len(lines), to)))

    return changed


def _replaced(
    pattern: re.Pattern[bytes], values: Sequence[bytes]
) -> Callable[[bytes, float, float], bytes]:
    def changed(data: bytes, at: float, to: float) -> bytes:
        found = list(pattern.finditer(data))
        if not found:
            return data
        one = found[_place(len(found), at)]
        return data[: one.start()] + values[_place(len(values), to)] + data[one.end() :]

    return changed


def _swapped(pattern: re.Pattern[bytes]) -> Callable[[bytes, float, float], bytes]:
    """A word or number takes the place of another one."""

    def changed(data: bytes, at: float, to: float) -> bytes:
        found = list(pattern.finditer(data))
        if not found:
            return data
        one, other = found[_place(len(found), at)], found[_place(len(found), to)]
        return data[: one.start()] + other[0] + data[one.end() :]

    return changed


def _all_of_a_word(data: bytes, at: float, to: float) -> bytes:
    """A word takes the place of another one everywhere: a column or an element has another name."""
    found = list(_WORD.finditer(data[:100_000]))
    if not found:
        return data
    word = found[_place(len(found), at)][0]
    others = [*WORDS, *(one[0] for one in found[:50])]
    other = others[_place(len(others), to)][:1000]
    return data.replace(word, other, _LONGEST // (len(other) + 1))[:_LONGEST]


def _put(data: bytes, at: float, to: float) -> bytes:
    i, things = _place(len(data) + 1, at), (*WORDS, *NUMBERS)
    return data[:i] + things[_place(len(things), to)] + data[i:]


def _encoded(data: bytes, at: float, to: float) -> bytes:
    text = data.decode("utf-8", "replace")
    codec = ("utf-16", "utf-16-le", "utf-32", "latin-1", "utf-8-sig", "cp037", "utf-7")[
        _place(7, at)
    ]
    return text.encode(codec, "replace")


def _packed(data: bytes, at: float, to: float) -> bytes:
    packed = gzip.compress(data, 1, mtime=0)
    return packed if to < 0.7 else packed[: _place(len(packed), at)]


_TABLE: dict[str, Callable[[bytes, float, float], bytes]] = {
    "flip": _flip,
    "overwrite": _overwrite,
    "insert": _insert,
    "delete": _delete,
    "duplicate": _duplicate,
    "zero": _zero,
    "fill": _fill,
    "truncate": _truncate,
    "drop line": _lines(lambda lines, i, j: lines[:i] + lines[i + 1 :]),
    "repeat line": _lines(lambda lines, i, j: lines[:i] + lines[i : i + 1] * (1 + j) + lines[i:]),
    "move line": _lines(lambda lines, i, j: [*(rest := lines[:i] + lines[i + 1 :])[:j], lines[i], *rest[j:]]),
    "number": _replaced(_NUMBER, NUMBERS),
    "word": _replaced(_WORD, WORDS),
    "word for number": _replaced(_NUMBER, WORDS),
    "number for word": _replaced(_WORD, NUMBERS),
    "other number": _swapped(_NUMBER),
    "other word": _swapped(_WORD),
    "all of a word": _all_of_a_word,
    "put": _put,
    "encode": _encoded,
    "pack": _packed,
}  # fmt: skip

#: Kinds for files of bytes, and for text.
BINARY = ("flip", "overwrite", "insert", "delete", "duplicate", "zero", "fill", "truncate")
TEXT = tuple(_TABLE)
