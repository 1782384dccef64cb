"""Sentences of NMEA 0183: found in bytes, checked, and read into columns.

A sentence is ``$`` or ``!``, a talker (``GP``, ``GN``), a type (``RMC``), fields after commas, and
``*`` with the exclusive or of all letters between. Whatever stands between sentences is passed
over: timestamps of loggers, UBX messages, damaged lines.

GPSZip reads them by itself. pynmeagps makes a Python object of each sentence, which takes ten times
as long as reading the columns of all sentences together.
"""

from __future__ import annotations

import codecs
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.io.storage.expansion import read_chunk
from gpszip.io.storage.source import Source
from gpszip.io.values.arrow import to_floats
from gpszip.io.values.coordinates import Axis, parse_degrees

__all__ = [
    "KINDS",
    "POSITION_KINDS",
    "SentenceCounts",
    "has_right_checksum",
    "is_plain_nmea",
    "read_sentences",
    "text_encoding",
]

#: Types of sentences that are read. Of several positions at one time, the first type counts.
KINDS = ("GGA", "GNS", "RMC", "GLL", "ZDA", "VTG")

#: Number of the first types that hold a position.
POSITION_KINDS = 4

#: Letters of the fields of a sentence, at most. The standard allows 82 in all; receivers exceed it.
_MAX_LETTERS = 400

#: A sentence: its talker and type, its fields, and its checksum if it has one.
_SENTENCE = re.compile(
    rf"[$!]([A-Z][A-Z0-9]{{2,9}}),([^$!*\r\n]{{0,{_MAX_LETTERS}}})(?:\*([0-9A-Fa-f]{{2}}))?"
)

#: A line that starts with a sentence of a position without a checksum.
_PLAIN_LINE = re.compile(r"(?m)^\$[A-Z]{2}(?:RMC|GGA|GNS),\d{6}[.,][^*\r\n]*(?=[\r\n]|\Z)")

#: Bytes that are read at a time: 4 MiB.
_CHUNK_BYTES = 4 << 20

#: Letters of a talker and a type.
_NAME_LETTERS = 5

#: Different names of other sentences that are counted one by one.
_MAX_NAMES = 100

#: Columns of texts, and the field that holds them for each of KINDS, counted from 0; -1 for none.
#: The status is that of RMC and GLL, the quality of GGA and the modes of GNS.
_FIELDS = {
    "time": (0, 0, 0, 4, 0, -1),
    "status": (5, 5, 1, 5, -1, -1),
    "lat": (1, 1, 2, 0, -1, -1),
    "north": (2, 2, 3, 1, -1, -1),
    "lon": (3, 3, 4, 2, -1, -1),
    "east": (4, 4, 5, 3, -1, -1),
    "date": (-1, -1, 8, -1, -1, -1),
    "day": (-1, -1, -1, -1, 1, -1),
    "month": (-1, -1, -1, -1, 2, -1),
    "year": (-1, -1, -1, -1, 3, -1),
    "alt": (8, 8, -1, -1, -1, -1),
    "speed": (-1, -1, 6, -1, -1, 4),
    "course": (-1, -1, 7, -1, -1, 0),
    "satellites": (6, 6, -1, -1, -1, -1),
    "hdop": (7, 7, -1, -1, -1, -1),
}

#: Metres per second in a knot: 1852 m an hour.
_KNOT = 1852 / 3600

#: Decimals of speeds in m/s. Receivers write knots with three decimals, which are 0.0005 m/s.
_SPEED_DECIMALS = 6

#: Decimals of the seconds of a day: finer ones don't fit in seconds since 1970.
_TIME_DECIMALS = 6

#: Two-digit years from which on the year is in the last century.
_LAST_CENTURY = 80

#: The value of each letter as a hexadecimal digit; 0 for others, which no checksum has.
_HEX_VALUES = np.array(
    [int(chr(i), 16) if chr(i) in "0123456789abcdefABCDEF" else 0 for i in range(256)], np.uint8
)

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: The columns of sentences: index in KINDS, seconds of the day, days since 1970, degrees, whether
#: the receiver marks the position as not valid, metres, m/s, degrees, number and dilution.
SENTENCE = np.dtype(
    [("kind", np.int8), ("void", np.bool_)]
    + [(name, np.float64) for name in ("time", "day", "lat", "lon")]
    + [(name, np.float64) for name in ("alt", "speed", "course", "satellites", "hdop")]
)


@dataclass
class SentenceCounts:
    """Counts of what was found in a file.

    Parameters
    ----------
    read : int
        Sentences of KINDS that were read.
    wrong : int
        Sentences of KINDS left out since their checksum is wrong or missing.
    others : Counter of str
        Sentences of other types, by type.
    """

    read: int = 0
    wrong: int = 0
    others: Counter[str] = field(default_factory=Counter)


def text_encoding(head: bytes) -> str:
    r"""Find the encoding of a file from its first bytes; bytes of other protocols don't matter.

    Examples
    --------
    >>> text_encoding("$GPRMC,".encode("utf-16")), text_encoding(b"\xb5b$GPRMC,")
    ('utf-16', 'latin-1')
    """
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    # Without a byte order mark, the sign before a sentence shows it.
    first = head.find(b"$\0G")
    if first < 0 or b"$G" in head:
        return "latin-1"
    return "utf-16-be" if first % 2 else "utf-16-le"


def has_right_checksum(text: str) -> bool:
    """Whether a text contains a sentence with a right checksum.

    Examples
    --------
    >>> has_right_checksum("12:00:01 $GPGLL,5327.04,N,00214.42,W,102929.00,A,A*7C")
    True
    """
    sentences = pa.array([match.group()[1:] for match in _SENTENCE.finditer(text) if match[3]])
    return len(sentences) > 0 and bool(_is_right(sentences).any())


def is_plain_nmea(text: str) -> bool:
    """Whether a line of a text is a sentence with a position and without a checksum.

    Examples
    --------
    >>> is_plain_nmea("$GPGGA,102929,5327.04,N,00214.42,W,1,08,1.16,36.3,M,48.5,M,,")
    True
    """
    return _PLAIN_LINE.search(text) is not None


def read_sentences(source: Source, counts: SentenceCounts) -> Iterator[NDArray[np.void]]:
    """Yield the sentences of KINDS in the order of the file, in batches.

    Parameters
    ----------
    source : Source
        The file or stream.
    counts : SentenceCounts
        Grows while the sentences are read.

    Yields
    ------
    structured array, shape (n,)
        Of the type SENTENCE; NaN for fields that are empty or can't be read.
    """
    # The start of the file shows how it is written.
    head = source.head()
    decoder = codecs.getincrementaldecoder(text_encoding(head))("replace")
    # If a file has checksums, a sentence without one is damaged.
    start = head.decode(text_encoding(head), "replace")
    is_checked = any(match[3] for match in _SENTENCE.finditer(start))

    # The last sentence in memory may go on in the next chunk.
    text = ""
    with source.open() as stream:
        while chunk := read_chunk(stream, _CHUNK_BYTES):
            text += decoder.decode(chunk)
            cut = _start_of_last_sentence(text)
            yield _parse(text[:cut], counts, is_checked=is_checked)
            text = text[cut:]
    yield _parse(text + decoder.decode(b"", final=True), counts, is_checked=is_checked)


def _start_of_last_sentence(text: str) -> int:
    # A sentence that began farther from the end is complete, or none.
    start = max(0, len(text) - 2 * _MAX_LETTERS)
    last = max(text.rfind("$", start), text.rfind("!", start))
    return last if last >= 0 else len(text)


def _parse(text: str, counts: SentenceCounts, *, is_checked: bool) -> NDArray[np.void]:
    """Read the sentences in a text."""
    # Find all sentences, and count those of other types.
    found = _SENTENCE.findall(text)
    columns = zip(*found, strict=True) if found else ((), (), ())
    names, bodies, checksums = (pa.array(column, pa.string()) for column in columns)
    types = pc.utf8_slice_codeunits(names, 2, None)
    is_ours = pc.and_(
        pc.is_in(types, pa.array(KINDS)), pc.equal(pc.utf8_length(names), _NAME_LETTERS)
    )
    _count_others(names.filter(pc.invert(is_ours)), counts)

    # Check the others.
    names, bodies, checksums, types = (
        column.filter(is_ours) for column in (names, bodies, checksums, types)
    )
    if is_checked:
        checked = pc.binary_join_element_wise(bodies, checksums, "*")
        right = _is_right(pc.binary_join_element_wise(names, checked, ","))
        counts.wrong += int((~right).sum())
        bodies, types = bodies.filter(pa.array(right)), types.filter(pa.array(right))

    # Read their fields.
    counts.read += len(bodies)
    kinds = pc.index_in(types, pa.array(KINDS)).to_numpy(zero_copy_only=False)
    return _read_fields(bodies, np.asarray(kinds, dtype=np.int8))


def _count_others(names: Any, counts: SentenceCounts) -> None:
    # GPGSV and GLGSV are one type; proprietary sentences have no talker.
    is_standard = pc.and_(
        pc.equal(pc.utf8_length(names), _NAME_LETTERS), pc.invert(pc.starts_with(names, "P"))
    )
    types = pc.if_else(is_standard, pc.utf8_slice_codeunits(names, 2, None), names)
    for item in pc.value_counts(types).to_pylist():
        name = item["values"] if len(counts.others) < _MAX_NAMES else "others"
        counts.others[name] += item["counts"]


def _is_right(sentences: Any) -> Flags:
    """Whether the checksum of each sentence, which follows its last ``*``, is right."""
    # reduceat needs at least one.
    if not len(sentences):
        return np.zeros(0, dtype=np.bool_)

    # The texts of an Arrow column follow each other in one buffer.
    sentences = pa.concat_arrays([sentences])  # without an offset
    _, offsets, data = sentences.buffers()
    starts = np.frombuffer(offsets, np.int32)[: len(sentences) + 1]
    letters = np.frombuffer(data, np.uint8)[: starts[-1]]

    # Undo the last three letters, which exclusive or takes back out of the sum.
    ends = starts[1:]
    sums = np.bitwise_xor.reduceat(letters, starts[:-1])
    has_checksum = (np.diff(starts) > 3) & (letters[np.maximum(ends - 3, 0)] == ord("*"))
    high, low = letters[np.maximum(ends - 2, 0)], letters[ends - 1]
    sums = sums ^ ord("*") ^ high ^ low
    right: Flags = has_checksum & (sums == _HEX_VALUES[high] * 16 + _HEX_VALUES[low])
    return right


def _read_fields(bodies: Any, kinds: NDArray[np.int8]) -> NDArray[np.void]:
    """Read the fields of sentences whose types are known."""
    # Take the texts of each column out of all fields, which follow each other in one array.
    fields = pc.split_pattern(bodies, ",")
    starts = fields.offsets.to_numpy()
    lengths = np.diff(starts)
    column = {}
    for name, positions in _FIELDS.items():
        position = np.array(positions)[kinds]
        is_missing = (position < 0) | (position >= lengths)
        rows = np.where(is_missing, 0, starts[:-1] + position)
        column[name] = pa.chunked_array([fields.values.take(pa.array(rows, mask=is_missing))])

    # Read them.
    out = np.zeros(len(kinds), SENTENCE)
    out["kind"] = kinds
    out["void"] = pc.fill_null(
        pc.match_substring_regex(column["status"], "^(V|0|N+)$"), False
    ).to_numpy()
    out["time"] = _seconds_of_day(column["time"])
    out["day"] = _days(column)
    axes: tuple[tuple[Axis, str], ...] = (("lat", "north"), ("lon", "east"))
    for axis, hemisphere in axes:
        is_packed = pc.match_substring_regex(column[axis], r"^\d{3,5}(\.\d*)?$")
        out[axis] = parse_degrees(
            pc.if_else(is_packed, column[axis], None),
            axis,
            hemisphere=column[hemisphere],
            packed_minutes=True,
        )
    for name in ("alt", "course", "satellites", "hdop"):
        out[name] = to_floats(column[name])
    out["speed"] = np.round(to_floats(column["speed"]) * _KNOT, _SPEED_DECIMALS)
    return out


def _seconds_of_day(texts: Any) -> Floats:
    """Read times such as 102929.20; NaN for what is none."""
    is_time = pc.match_substring_regex(texts, r"^\d{6}(\.\d*)?$")
    values = to_floats(pc.if_else(is_time, texts, None))
    hours, minutes, seconds = values // 10_000, values // 100 % 100, values % 100
    # A second that is inserted at the end of a day has the number 60.
    is_valid = (hours < 24) & (minutes < 60) & (seconds < 61)
    day_seconds = np.round(hours * 3600 + minutes * 60 + seconds, _TIME_DECIMALS)
    return np.where(is_valid, day_seconds, np.nan)


def _days(column: dict[str, Any]) -> Floats:
    """Return the dates of RMC and ZDA in days since 1970; NaN for sentences without one."""
    # RMC writes day, month and year as 070321, ZDA in three fields.
    dates = _digits(column["date"], 6)
    is_short = np.isfinite(dates)
    short_year = dates % 100
    long_year = np.where(short_year >= _LAST_CENTURY, 1900 + short_year, 2000 + short_year)
    year = np.where(is_short, long_year, _digits(column["year"], 4))
    month = np.where(is_short, dates // 100 % 100, _digits(column["month"], 2))
    day = np.where(is_short, dates // 10_000, _digits(column["day"], 2))

    # A date is valid if it is in its month.
    is_valid = (year >= 1970) & (year < 2100) & (month >= 1) & (month <= 12)
    is_valid &= (day >= 1) & (day <= 31)
    months = np.where(is_valid, (year - 1970) * 12 + month - 1, 0).astype("M8[M]")
    dated = months.astype("M8[D]") + np.where(is_valid, day - 1, 0).astype("m8[D]")
    is_valid &= dated.astype("M8[M]") == months
    return np.where(is_valid, dated.astype(np.float64), np.nan)


def _digits(texts: Any, count: int) -> Floats:
    """Return whole numbers of this number of digits; NaN for what is none."""
    is_number = pc.match_substring_regex(texts, rf"^\d{{{count}}}$")
    return to_floats(pc.if_else(is_number, texts, None))
