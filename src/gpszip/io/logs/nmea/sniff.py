"""Recognise logs in NMEA 0183 by their first bytes."""

from __future__ import annotations

__all__ = ["sniff_nmea"]

#: Files of other kinds that may have sentences in them: archives and databases.
_OTHER_KINDS = (b"PK\x03\x04", b"SQLite format 3")


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
    if head.startswith(_OTHER_KINDS) or not (b"$" in head or b"!" in head):
        return False

    # The reader takes .2 s to import.
    from gpszip.io.logs.nmea.sentences import has_right_checksum, is_plain_nmea, text_encoding

    text = head.decode(text_encoding(head), "replace")
    return has_right_checksum(text) or is_plain_nmea(text)
