"""JSON read piece by piece: of a list of any length, one element is in memory at a time.

A text may hold one value, or several one after the other: on lines of their own (NDJSON, GeoJSONL) or each after a record
separator (RFC 8142). What hostile text can do is bounded: nesting by the interpreter's limit, a single value by its length and
by the number of values in it, numbers by the digits that Python reads. NaN and Infinity, which JSON doesn't have, and integers
that are too long become texts, so that they are no numbers, but don't spoil what is beside them.
"""

from __future__ import annotations

import codecs
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from gpszip.errors import InputError
from gpszip.io.storage.expansion import read_chunk

__all__ = ["Document", "Element", "detect_encoding", "read_json"]

#: Letters that a single value may take at most.
_MAX_VALUE_LETTERS = 64 << 20

#: Marks between values (commas, colons and opening brackets) that may be in it: what they part takes up to 100 bytes each.
_MAX_VALUE_MARKS = 8_000_000

#: Members of an object at the top, of which GeoJSON has a handful.
_MAX_MEMBERS = 10_000

#: Bytes that are read at a time.
_CHUNK_BYTES = 4 << 20

#: Letters from the end in which a mistake may come from the text being cut there: the longest word is -Infinity.
_WORD = 16

#: Letters that may follow a number and still belong to it, if the text goes on: e-
_TAIL = 2

#: Space between values; the record separator is one of RFC 8142, the mark one of a file joined of several.
_SPACE = " \t\r\n\x1e\ufeff"


@dataclass(frozen=True)
class Element:
    """One element of the list ``features`` of an object, or of a list that is not in an object."""

    value: Any


@dataclass(frozen=True)
class Document:
    """The members of an object, of which ``features`` is left empty if it is a list, as its elements come before."""

    members: dict[str, Any]


def detect_encoding(head: bytes) -> str:
    r"""Tell the encoding of JSON from its first bytes.

    Examples
    --------
    >>> detect_encoding(b"{}"), detect_encoding("{}".encode("utf-16-le")), detect_encoding(codecs.BOM_UTF8)
    ('utf-8', 'utf-16-le', 'utf-8-sig')
    """
    return json.detect_encoding(head[:4])


def read_json(stream: Any, name: str) -> Iterator[Element | Document]:
    r"""Read the objects in a text, and what is in their lists of features.

    Parameters
    ----------
    stream : binary file
        UTF-8, or UTF-16 or UTF-32 as its first bytes tell.
    name : str
        Its name for messages.

    Yields
    ------
    Element or Document
        In the order of the text; an object follows the elements in it.

    Raises
    ------
    InputError
        If it is damaged, or a value in it is too large.

    Examples
    --------
    >>> import io
    >>> [*read_json(io.BytesIO(b'{"features": [1, 2], "type": "a"} {"b": NaN}'), "stream")]
    [Element(value=1), Element(value=2), Document(members={'features': [], 'type': 'a'}), Document(members={'b': 'NaN'})]
    """
    window = _Window(stream, name)
    while letter := window.peek():
        if letter == "{":
            yield from _object(window)
        elif letter == "[":
            yield from _elements(window)
        else:
            raise window.damage("an object or a list is expected")


def _object(window: _Window) -> Iterator[Element | Document]:
    members: dict[str, Any] = {}
    window.take("{")
    window.begin()
    while window.goes_on("}", first=not members):
        # the name of a member
        name = window.value()
        if not isinstance(name, str):
            raise window.damage("a name in quotes is expected")
        window.take(":")

        # what it holds: the last one counts, as for all readers of JSON, but features are handed over before that is known
        if name == "features" and window.peek() == "[":
            if name in members:
                raise window.damage("there is another list of features")
            yield from _elements(window)
            members[name] = []
            window.begin()
        else:
            members[name] = window.value()
        if len(members) > _MAX_MEMBERS:
            raise window.damage(f"an object with more than {_MAX_MEMBERS:,} members is no GeoJSON")
    yield Document(members)


def _elements(window: _Window) -> Iterator[Element]:
    window.take("[")
    first = True
    while window.goes_on("]", first=first):
        first = False
        window.begin()
        yield Element(window.value())


class _Window:
    """The part of a text that is in memory, and the place in it up to which it is read."""

    def __init__(self, stream: Any, name: str) -> None:
        self._stream, self._name = stream, name
        self._decoder: Any = None
        self._text, self._at = "", 0
        self._ended = False
        self._passed = 0  # letters that were read before those in memory
        self._marks = 0  # in the values read since begin()

    def begin(self) -> None:
        """Start counting: together, the values from here on may take so much memory."""
        self._marks = 0

    def damage(self, what: str) -> InputError:
        """Say what is wrong at the present place."""
        return InputError(
            f"{self._name}: damaged JSON file: {what[:120]} at character {self._passed + self._at + 1:,}"
        )

    def peek(self) -> str:
        """Return the next letter that is no space; none at the end."""
        while True:
            rest = len(self._text)
            while self._at < rest and self._text[self._at] in _SPACE:
                self._at += 1
            if self._at < rest:
                return self._text[self._at]
            if self._ended:
                return ""
            self._grow()

    def take(self, letter: str) -> None:
        """Pass over a letter that has to come next."""
        if (found := self.peek()) != letter:
            raise self.damage(
                f"{letter!r} is expected, not {found!r},"
                if found
                else f"it ends where {letter!r} is expected,"
            )
        self._at += 1

    def goes_on(self, closing: str, *, first: bool) -> bool:
        """Pass over the comma before another item of a list or an object, or over what closes it."""
        if self.peek() == closing:
            self._at += 1
            return False
        if not first:
            self.take(",")
        return True

    def value(self) -> Any:
        """Read a whole value."""
        self.peek()
        while True:
            try:
                found, end = _decode_value(self._text, self._at)
            except json.JSONDecodeError as error:
                if self._ended or not _may_be_cut(error):
                    cut = self._ended and _may_be_cut(error)
                    self._at = error.pos
                    raise self.damage(
                        "it is cut short: " * cut + error.msg.removesuffix(" at")
                    ) from None
            except RecursionError:
                raise self.damage("it is nested too deeply") from None
            else:
                if end + _TAIL < len(self._text) or self._ended:
                    self._count(end)
                    self._at = end
                    return found
            self._count(len(self._text), whole=False)
            self._grow()

    def _count(self, end: int, *, whole: bool = True) -> None:
        """Refuse a value, or what is in memory of it, before it takes too much memory."""
        marks = 1 + sum(self._text.count(mark, self._at, end) for mark in ",:[{")
        if end - self._at > _MAX_VALUE_LETTERS or self._marks + marks > _MAX_VALUE_MARKS:
            raise InputError(
                f"{self._name}: the value at character {self._passed + self._at + 1:,} is too large: more than "
                f"{_MAX_VALUE_LETTERS >> 20} million letters, or {_MAX_VALUE_MARKS // 4_000_000} million positions; write it as several features, or as CSV"
            )
        self._marks += marks * whole

    def _grow(self) -> None:
        """Read on: as much again as is in memory, which makes reading a value again and again cheap."""
        self._passed += self._at
        rest, self._at = self._text[self._at :], 0
        data = read_chunk(self._stream, max(_CHUNK_BYTES, len(rest)))
        if self._decoder is None:
            self._decoder = codecs.getincrementaldecoder(detect_encoding(data))()
        self._ended = not data
        try:
            self._text = rest + self._decoder.decode(data, final=self._ended)
        except UnicodeDecodeError as error:
            raise InputError(
                f"{self._name}: damaged JSON file: no {error.encoding.upper()} after character {self._passed + len(rest):,}; "
                "bring it to UTF-8: iconv -f latin1 -t utf-8"
            ) from None


def _may_be_cut(error: json.JSONDecodeError) -> bool:
    return error.pos >= len(error.doc) - _WORD or error.msg.startswith("Unterminated string")


def _decode_value(text: str, at: int) -> tuple[Any, int]:
    try:
        found, end = _QUICK.raw_decode(text, at)
    except json.JSONDecodeError:
        raise
    except ValueError:  # an integer of more digits than Python reads
        found, end = _PATIENT.raw_decode(text, at)
    if text.find("\\ud", at, end) >= 0 or text.find("\\uD", at, end) >= 0:
        found = _escape_surrogates(found)
    return found, end


def _integer(digits: str) -> int | str:
    longest = sys.get_int_max_str_digits()
    return digits if longest and len(digits) > longest else int(digits)


_QUICK = json.JSONDecoder(parse_constant=str)
_PATIENT = json.JSONDecoder(parse_constant=str, parse_int=_integer)


def _escape_surrogates(value: Any) -> Any:
    """Write halves of letters (surrogates), which no text can hold, as the file does: with a backslash."""
    if isinstance(value, str):
        return value.encode("utf-8", "backslashreplace").decode()
    if isinstance(value, list):
        return [_escape_surrogates(item) for item in value]
    if isinstance(value, dict):
        return {_escape_surrogates(name): _escape_surrogates(item) for name, item in value.items()}
    return value
