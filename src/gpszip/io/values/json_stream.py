"""JSON read as a stream: of a long list, one element is in memory at a time.

A text may hold one value, or several one after the other: on lines of their own (NDJSON,
GeoJSONL), or each after a record separator (RFC 8142).

Hostile text can do no harm. Nesting is bounded by the interpreter's limit, a single value by its
length and by the number of values in it, numbers by the digits that Python reads. NaN and
Infinity, which JSON doesn't have, and integers that are too long become texts, so that they are
no numbers, but don't spoil the values beside them.
"""

from __future__ import annotations

import codecs
import json
import sys
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any

from gpszip.errors import InputError
from gpszip.io.storage.expansion import read_chunk

__all__ = ["Document", "Element", "read_json"]

#: Letters of a single value, at most.
_MAX_VALUE_LETTERS = 64 << 20

#: Commas, colons and opening brackets of a single value, at most. Each value between them takes up
#: to 100 bytes of memory.
_MAX_VALUE_MARKS = 8_000_000

#: Marks that a position takes, for messages.
_MARKS_PER_POSITION = 4

#: Members of an object at the top, at most; logs have a handful.
_MAX_MEMBERS = 10_000

#: Bytes that are read at a time.
_CHUNK_BYTES = 4 << 20

#: Letters at the end of the text in memory within which an error may come from the text being cut
#: there: the longest word is -Infinity.
_MAX_WORD = 16

#: Letters after a number that may still belong to it when the text goes on: e-
_MAX_NUMBER_TAIL = 2

#: Letters of an error of Python's decoder that are shown.
_MAX_REASON_LETTERS = 120

#: Space between values, with the record separator of RFC 8142 and the byte order mark of files that
#: were concatenated.
_SPACE = " \t\r\n\x1e\ufeff"


@dataclass(frozen=True)
class Element:
    """One element of a list that is streamed.

    Parameters
    ----------
    value : object
        The element.
    member : str
        Name of the list in its object; empty for a list that is not in an object.
    """

    value: Any
    member: str = ""


@dataclass(frozen=True)
class Document:
    """The members of an object; streamed lists are empty, as their elements come before."""

    members: dict[str, Any]


def read_json(
    stream: Any, name: str, lists: Collection[str] = ("features",)
) -> Iterator[Element | Document]:
    r"""Yield the objects in a text, and the elements of their long lists.

    Parameters
    ----------
    stream : binary file
        UTF-8, or UTF-16 or UTF-32 as its first bytes show.
    name : str
        Its name for messages.
    lists : collection of str
        Names of the members of objects that are streamed if they are lists; by default those of
        GeoJSON.

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
    >>> text = b'{"features": [1, 2], "type": "a"} {"b": NaN}'
    >>> for part in read_json(io.BytesIO(text), "stream"):
    ...     print(part)
    Element(value=1, member='features')
    Element(value=2, member='features')
    Document(members={'features': [], 'type': 'a'})
    Document(members={'b': 'NaN'})
    """
    window = _Window(stream, name)
    while letter := window.peek():
        if letter == "{":
            yield from _read_object(window, lists)
        elif letter == "[":
            yield from _read_elements(window, "")
        else:
            raise window.damage("an object or a list is expected")


def _read_object(window: _Window, lists: Collection[str]) -> Iterator[Element | Document]:
    # Read member by member, so that the elements of a list are never all in memory.
    members: dict[str, Any] = {}
    streamed = set()
    window.take("{")
    window.begin()
    while window.has_item("}", first=not members):
        # Read the name of a member.
        name = window.value()
        if not isinstance(name, str):
            raise window.damage("a name in quotes is expected")
        window.take(":")

        # Read its value. As for all readers of JSON, the last member of a name counts; but
        # elements are yielded before a second list of them can come.
        if name in lists and window.peek() == "[":
            if name in streamed:
                raise window.damage(f"there is another list of {name}")
            streamed.add(name)
            yield from _read_elements(window, name)
            members[name] = []
            window.begin()
        else:
            members[name] = window.value()
        if len(members) > _MAX_MEMBERS:
            raise window.damage(f"an object with more than {_MAX_MEMBERS:,} members is no log")
    yield Document(members)


def _read_elements(window: _Window, member: str) -> Iterator[Element]:
    window.take("[")
    first = True
    while window.has_item("]", first=first):
        first = False
        # Elements are not kept here, so each may take as much memory as one value.
        window.begin()
        yield Element(window.value(), member)


class _Window:
    """The text in memory, and the position in it up to which it is read."""

    def __init__(self, stream: Any, name: str) -> None:
        self._stream, self._name = stream, name
        self._decoder: Any = None
        self._text = ""
        self._position = 0
        self._is_at_end = False
        self._passed = 0  # letters that were read before those in memory
        self._marks = 0  # marks of the values read since begin()

    def begin(self) -> None:
        """Start to count what the following values take in memory together."""
        self._marks = 0

    def damage(self, what: str) -> InputError:
        """Return the error for what is wrong at the position."""
        character = self._passed + self._position + 1
        return InputError(
            f"damaged JSON file: {what[:_MAX_REASON_LETTERS]} at character {character:,}",
            path=self._name,
            remedy="fetch or write it again",
        )

    def peek(self) -> str:
        """Return the next letter that is no space; empty at the end."""
        while True:
            length = len(self._text)
            while self._position < length and self._text[self._position] in _SPACE:
                self._position += 1
            if self._position < length:
                return self._text[self._position]
            if self._is_at_end:
                return ""
            self._grow()

    def take(self, letter: str) -> None:
        """Pass over a letter that has to come next."""
        next_letter = self.peek()
        if next_letter == letter:
            self._position += 1
        elif next_letter:
            raise self.damage(f"{letter!r} is expected, not {next_letter!r},")
        else:
            raise self.damage(f"it ends where {letter!r} is expected,")

    def has_item(self, closing: str, *, first: bool) -> bool:
        """Pass over the comma before the next item of a list or object, or over its end."""
        if self.peek() == closing:
            self._position += 1
            return False
        if not first:
            self.take(",")
        return True

    def value(self) -> Any:
        """Read a value, with as much more of the stream as it takes."""
        # Start at the value: the decoder doesn't accept spaces before it.
        self.peek()
        while True:
            # Decode the value, which may be cut at the end of the text in memory.
            try:
                value, end = _decode_value(self._text, self._position)
            except json.JSONDecodeError as error:
                may_be_cut = _may_be_cut(error)
                if self._is_at_end or not may_be_cut:
                    self._position = error.pos
                    cut = "it is cut short: " if self._is_at_end and may_be_cut else ""
                    raise self.damage(cut + error.msg.removesuffix(" at")) from None
            except RecursionError:
                raise self.damage("it is nested too deeply") from None
            else:
                # A number at the end of the text may go on.
                if end + _MAX_NUMBER_TAIL < len(self._text) or self._is_at_end:
                    self._marks += self._count_marks(end)
                    self._position = end
                    return value

            # Read more and try again.
            self._count_marks(len(self._text))
            self._grow()

    def _count_marks(self, end: int) -> int:
        """Count the marks of a value; raise before it takes too much memory."""
        # Four calls take a fifth of the time of a loop.
        count, start = self._text.count, self._position
        marks = 1 + count(",", start, end) + count(":", start, end)
        marks += count("[", start, end) + count("{", start, end)
        is_too_long = end - self._position > _MAX_VALUE_LETTERS
        if is_too_long or self._marks + marks > _MAX_VALUE_MARKS:
            positions = _MAX_VALUE_MARKS // _MARKS_PER_POSITION // 1_000_000
            raise InputError(
                f"the value at character {self._passed + self._position + 1:,} is too large: more "
                f"than {_MAX_VALUE_LETTERS >> 20} million letters, or {positions} million "
                "positions",
                path=self._name,
                remedy="write it as several features, or as CSV",
            )
        return marks

    def _grow(self) -> None:
        """Read as much again as is in memory, so that decoding a value again and again is cheap."""
        self._passed += self._position
        unread, self._position = self._text[self._position :], 0
        data = read_chunk(self._stream, max(_CHUNK_BYTES, len(unread)))
        # The first bytes show the encoding. The decoder keeps the bytes of a letter that is cut at
        # the end of a chunk.
        if self._decoder is None:
            self._decoder = codecs.getincrementaldecoder(json.detect_encoding(data))()
        self._is_at_end = not data
        try:
            self._text = unread + self._decoder.decode(data, final=self._is_at_end)
        except UnicodeDecodeError as error:
            right = len(error.object[: error.start].decode(error.encoding, "ignore"))
            character = self._passed + len(unread) + right
            raise InputError(
                f"damaged JSON file: no {error.encoding.upper()} after character {character:,}",
                path=self._name,
                remedy="bring it to UTF-8: iconv -f latin1 -t utf-8",
            ) from None


def _may_be_cut(error: json.JSONDecodeError) -> bool:
    # An unclosed text fails at its opening quote, however far the end is. All else fails where the
    # text ends.
    is_near_end = error.pos >= len(error.doc) - _MAX_WORD
    return is_near_end or error.msg.startswith("Unterminated string")


def _decode_value(text: str, position: int) -> tuple[Any, int]:
    """Decode the value at a position.

    Returns
    -------
    object
        The value.
    int
        Position of its end.
    """
    # Few texts have such integers. Calling Python for each integer would be slow.
    try:
        value, end = _FAST_DECODER.raw_decode(text, position)
    except json.JSONDecodeError:
        raise
    except ValueError:  # an integer of more digits than Python reads
        value, end = _LONG_INTEGER_DECODER.raw_decode(text, position)
    # Only escapes \ud800 to \udfff make surrogates, so most values need no search inside.
    if text.find("\\ud", position, end) >= 0 or text.find("\\uD", position, end) >= 0:
        value = _escape_surrogates(value)
    return value, end


def _parse_integer(digits: str) -> int | str:
    # Python limits digits, as their conversion takes quadratic time. 0 means no limit.
    longest = sys.get_int_max_str_digits()
    return digits if longest and len(digits) > longest else int(digits)


#: Decoders that return NaN and Infinity as texts.
_FAST_DECODER = json.JSONDecoder(parse_constant=str)
_LONG_INTEGER_DECODER = json.JSONDecoder(parse_constant=str, parse_int=_parse_integer)


def _escape_surrogates(value: Any) -> Any:
    """Write half surrogate pairs, which no encoding can hold, with a backslash as in the file."""
    if isinstance(value, str):
        return value.encode("utf-8", "backslashreplace").decode()
    if isinstance(value, list):
        return [_escape_surrogates(item) for item in value]
    if isinstance(value, dict):
        return {_escape_surrogates(name): _escape_surrogates(item) for name, item in value.items()}
    return value
