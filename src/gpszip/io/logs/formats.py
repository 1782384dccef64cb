"""The formats that logs come in and go out as; a further format is one file and one line here."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import BinaryIO

from gpszip.errors import InputError, OptionError, OutputError, UnknownFormatError
from gpszip.io.logs.csv import read_csv, sniff_csv, write_csv
from gpszip.io.logs.geojson.read import read_geojson, sniff_geojson
from gpszip.io.logs.geojson.write import write_geojson
from gpszip.io.logs.gpx.read import read_gpx, sniff_gpx
from gpszip.io.logs.gpx.write import write_gpx
from gpszip.io.logs.gpx.xml_text import root_element
from gpszip.io.logs.parquet import read_parquet, sniff_parquet, write_parquet
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.logs.track_rows import TrackRows
from gpszip.io.storage.source import Source

__all__ = ["FORMATS", "Format", "format_for_reading", "format_for_writing", "format_named"]


@dataclass(frozen=True)
class Format:
    """One format of logs.

    Parameters
    ----------
    name : str
        As ``format=`` names it.
    suffixes : tuple of str
        Of files, lower case; any may be followed by ``.gz`` when read, and lie in a zip archive.
    description : str
        One line on what is read.
    sniff : callable
        Whether a file may be of this format, from its first bytes.
    read : callable
        Reads one log.
    write : callable or None
        Writes tracks to a binary file, metres with a number of decimals; None for a format that is only read.
    """

    name: str
    suffixes: tuple[str, ...]
    description: str
    sniff: Callable[[bytes], bool]
    read: Callable[[Source, Request], RawLog]
    write: Callable[[Iterable[TrackRows], BinaryIO], None] | None


#: In the order in which they are asked whether they know a file; text comes last, as it is least sure.
FORMATS: tuple[Format, ...] = (
    Format(
        "parquet",
        (".parquet", ".pq"),
        "columns as in CSV; a folder of files, too",
        sniff_parquet,
        read_parquet,
        write_parquet,
    ),
    Format(
        "gpx",
        (".gpx",),
        "tracks and routes; extensions with --keep",
        sniff_gpx,
        read_gpx,
        write_gpx,
    ),
    Format(
        "geojson",
        (".geojson", ".json"),
        "LineStrings with coordTimes or times, or as shapes; Points with a time; one on each line, too",
        sniff_geojson,
        read_geojson,
        write_geojson,
    ),
    Format(
        "csv",
        (".csv", ".tsv", ".txt", ".tab"),
        "a header with t and x,y[,z] or lat,lon, in any order; track_id",
        sniff_csv,
        read_csv,
        write_csv,
    ),
)

#: What else people bring, by its first bytes.
_REFUSED_MAGIC = (
    (b"PK\x03\x04", "a zip archive inside another file; unpack the outer one first"),
    (b"BZh", "packed with bzip2; unpack it first: bzip2 -d"),
    (b"\xfd7zXZ", "packed with xz; unpack it first: xz -d"),
    (b"\x28\xb5\x2f\xfd", "packed with zstd; unpack it first: zstd -d"),
    (b"SQLite format 3", "a database; export the log from it as CSV"),
)

#: XML that people bring, by the root element in lower case, with the remedy.
_REFUSED_XML = {
    "kml": "it is KML; turn it into GPX: gpsbabel -i kml -f FILE -o gpx -F FILE.gpx",
    "trainingcenterdatabase": "it is TCX; turn it into GPX: gpsbabel -i gtrnctr -f FILE -o gpx -F FILE.gpx",
    "osm": "it is OpenStreetMap's, which has roads, not logs; 'gpszip network' reads it",
    "graphml": "it is GraphML, which has roads, not logs; 'gpszip network' reads it",
    "html": "it is a web page, perhaps of an error or a login; fetch the file again",
}


def format_named(name: str) -> Format:
    """Return the format of this name.

    Raises
    ------
    OptionError
        If there is none.

    Examples
    --------
    >>> format_named("csv").suffixes[0]
    '.csv'
    """
    for known in FORMATS:
        if known.name == name.lower() or f".{name.lower().lstrip('.')}" in known.suffixes:
            return known
    raise OptionError(f"no format {name!r}; there are {', '.join(known.name for known in FORMATS)}")


def format_for_reading(source: Source) -> Format:
    """Find out what a log is: by its content, whatever its name says.

    Raises
    ------
    InputError
        If it is empty.
    UnknownFormatError
        If no format knows it.
    """
    head = source.head()
    if not head.strip():
        raise InputError(f"{source.name}: empty file; name one that holds a log")
    for magic, what in _REFUSED_MAGIC:
        if head.startswith(magic):
            raise UnknownFormatError(f"{source.name}: is {what}")
    if source.name.lower().endswith(".gpsz"):
        raise UnknownFormatError(
            f"{source.name}: is an archive, not a log; 'gpszip decompress' turns it into one"
        )
    root = root_element(head)
    if root is not None and root.lower() != "gpx":
        raise UnknownFormatError(f"{source.name}: is XML, but not GPX: {_explain_xml(root)}")
    for known in FORMATS:
        if known.sniff(head):
            if _is_unnamed_text(known, source):
                raise UnknownFormatError(
                    f"{source.name}: is text, but not named as a table; if it is a log, name it .csv"
                )
            return known
    raise UnknownFormatError(
        f"{source.name}: neither text nor a format that is known; 'gpszip formats' lists what can be read"
    )


def _is_unnamed_text(known: Format, source: Source) -> bool:
    """Whether a member of a zip archive is text, but not named as a table: a page or a licence that came with the logs."""
    name = source.name.lower().removesuffix(".gz")
    return bool(source.archive) and known.name == "csv" and not name.endswith(known.suffixes)


def _explain_xml(root: str) -> str:
    """Say what an XML file is, and what to do with it."""
    if not root:
        return "no element comes within its first 256 KiB; if it is GPX, say so with --format gpx"
    what = _REFUSED_XML.get(root.lower(), "convert it to GPX or CSV first")
    return f"its root element is {root[:40]!r}; {what}"


def format_for_writing(name: str, format: str | None = None) -> Format:
    """Find the format to write, by name or by the file's suffix; CSV for a stream.

    Raises
    ------
    OutputError
        If the suffix says nothing, or the format is only read.

    Examples
    --------
    >>> format_for_writing("walk.GPX").name, format_for_writing("-").name
    ('gpx', 'csv')
    """
    if format is not None:
        found = format_named(format)
    else:
        found = next(
            (known for known in FORMATS if name.lower().endswith(known.suffixes)),
            FORMATS[-1] if name == "-" else None,
        )  # type: ignore[assignment]
    if found is None or found.write is None:
        writable = ", ".join(
            suffix for known in FORMATS if known.write is not None for suffix in known.suffixes[:1]
        )
        raise OutputError(
            f"{name}: can't tell the format from this name; end it with one of {writable}"
        )
    return found
