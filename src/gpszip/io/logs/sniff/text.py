r"""Recognise logs in lines of text by their first lines.

All formats are asked about each file, so this module imports nothing heavy.
"""

from __future__ import annotations

import codecs
import re

from gpszip.io.logs.sniff.binary import is_binary_dataflash

__all__ = [
    "AIS_SHIP",
    "IGC_FIX",
    "column_names",
    "decode_head",
    "plain_name",
    "sniff_ais",
    "sniff_carmen",
    "sniff_dataflash",
    "sniff_igc",
    "sniff_nmea",
    "sniff_owntracks",
    "sniff_plt",
    "text_encoding",
]

#: A fix of IGC: time, latitude, longitude, validity. Altitudes follow.
IGC_FIX = r"^B\d{6}\d{7}[NS]\d{8}[EW][AV]"
_IGC_FIX = re.compile(IGC_FIX, re.MULTILINE)

#: What shows IGC besides a fix: the code of the maker at the start, or a date.
_IGC_MAKER = re.compile(r"\s*A[A-Z0-9]{3}")
_IGC_DATES = ("HFDTE", "HODTE", "HPDTE")

#: A line of OwnTracks: time of receipt, kind of message, and an object.
_OWNTRACKS = re.compile(r"\s*\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\S*\t[^\t]{1,200}\t\s*\{")

#: First line of track files of GeoLife and OziExplorer.
_PLT = re.compile(r"\s*(?:Geolife trajectory|OziExplorer Track Point File)", re.IGNORECASE)

#: Messages that a log of CARMEN has among its first lines.
_CARMEN = re.compile(
    r"^(?:FLASER \d+ [-\d.]|ROBOTLASER1 \d+ [-\d.]|ODOM (?:[-\d.e]+ ){6})", re.MULTILINE
)

#: A line of DataFlash as text that describes messages.
_DATAFLASH = re.compile(r"^FMT, ?\d+, ?\d+, ?\w+, ?\w", re.MULTILINE)

#: Files of other kinds that may have sentences of NMEA in them: archives and databases.
_NO_NMEA = (b"PK\x03\x04", b"SQLite format 3")

#: Columns of the header of an AIS table, without case and marks: the ship, and one of the others.
AIS_SHIP = "mmsi"
_AIS_OTHERS = frozenset({"sog", "cog", "typeofmobile", "basedatetime", "navigationalstatus"})


def text_encoding(head: bytes) -> str:
    """Return the encoding of a text that starts like this: UTF-16 by its mark, else UTF-8."""
    is_wide = head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    return "utf-16" if is_wide else "utf-8-sig"


def decode_head(head: bytes) -> str:
    r"""Return the text at the start of a file; bytes that are no text become question marks.

    Examples
    --------
    >>> decode_head(b"\xef\xbb\xbfHFDTE160701")
    'HFDTE160701'
    """
    return head.decode(text_encoding(head), "replace")


def sniff_igc(head: bytes) -> bool:
    r"""Whether a file that starts like this is IGC.

    Examples
    --------
    >>> sniff_igc(b"AXXX\nHFDTE160701\nB1602405407121N00249342WA0028000421")
    True
    >>> sniff_igc(b"name,B1602405407121N00249342WA0028000421")
    False
    """
    text = decode_head(head)
    if not _IGC_MAKER.match(text) and not any(word in text for word in _IGC_DATES):
        return False
    return _IGC_FIX.search(text.replace("\r", "\n")) is not None


def sniff_owntracks(head: bytes) -> bool:
    r"""Whether a file that starts like this is a log of OwnTracks.

    Examples
    --------
    >>> sniff_owntracks(b'2024-05-04T08:00:00Z\t*                 \t{"_type":"location"')
    True
    >>> sniff_owntracks(b"2024-05-04T08:00:00Z\t48.1\t11.5")
    False
    """
    return _OWNTRACKS.match(decode_head(head)) is not None


def sniff_plt(head: bytes) -> bool:
    r"""Whether a file that starts like this is a track file of OziExplorer or GeoLife.

    Examples
    --------
    >>> sniff_plt(b"Geolife trajectory\r\nWGS 84\r\n"), sniff_plt(b"t,x,y\n")
    (True, False)
    """
    return _PLT.match(decode_head(head)) is not None


def sniff_carmen(head: bytes) -> bool:
    r"""Whether a file that starts like this is a log of CARMEN.

    Examples
    --------
    >>> sniff_carmen(b"# robot\nODOM 0.1 0.2 0.3 0 0 0 9.5 host 9.5"), sniff_carmen(b"t,x,y")
    (True, False)
    """
    return _CARMEN.search(decode_head(head).replace("\r", "\n")) is not None


def sniff_dataflash(head: bytes) -> bool:
    r"""Whether a file that starts like this is a log of ArduPilot, binary or as text.

    Examples
    --------
    >>> sniff_dataflash(b"\xa3\x95\x80\x80\x59FMT\x00"), sniff_dataflash(b"FMT, 128, 89, FMT, BBn")
    (True, True)
    >>> sniff_dataflash(b"t,x,y")
    False
    """
    return is_binary_dataflash(head) or _DATAFLASH.search(decode_head(head)) is not None


def sniff_nmea(head: bytes) -> bool:
    """Whether a file that starts like this holds sentences of NMEA 0183.

    Parameters
    ----------
    head : bytes
        The first bytes of the file; other messages may stand between sentences.

    Examples
    --------
    >>> sniff_nmea(b"1714809600 $GPGLL,5327.04,N,00214.42,W,102929.00,A,A*7C")
    True
    >>> sniff_nmea(b"price,$GPGLL,5*00")
    False
    """
    # Every sentence begins with one of two signs; few other files have any.
    if head.startswith(_NO_NMEA) or not (b"$" in head or b"!" in head):
        return False

    # Importing the reader takes .2 s.
    from gpszip.io.logs.nmea.sentences import has_right_checksum, is_plain_nmea
    from gpszip.io.logs.nmea.sentences import text_encoding as nmea_encoding

    text = head.decode(nmea_encoding(head), "replace")
    return has_right_checksum(text) or is_plain_nmea(text)


def sniff_ais(head: bytes) -> bool:
    r"""Whether a file that starts like this is a table of AIS.

    Examples
    --------
    >>> sniff_ais(b"MMSI,BaseDateTime,LAT,LON,SOG\n1,2,3,4,5"), sniff_ais(b"mmsi,t,lat,lon\n")
    (True, False)
    """
    names = column_names(head)
    return AIS_SHIP in names and not _AIS_OTHERS.isdisjoint(names)


def column_names(head: bytes) -> dict[str, str]:
    """Return the columns that the first line names, by their plain names."""
    line = decode_head(head).lstrip().split("\n", 1)[0]
    names = [name.strip('\r "#') for name in re.split("[,;\t]", line)]
    return {plain_name(name): name.strip() for name in names}


def plain_name(name: str) -> str:
    """Return the name of a column without case and marks.

    Examples
    --------
    >>> plain_name("Type of mobile")
    'typeofmobile'
    """
    return re.sub("[^a-z]", "", name.lower())
