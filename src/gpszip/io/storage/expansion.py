"""A limit on the expansion of compressed logs, against decompression bombs.

Text of logs expands 5 to 30 times, with much repetition about 100 times. The most that gzip and zip
can reach is 1,030 times. The first 64 MiB of unpacked data are always read. After that, each 64 MiB
must come from at least a three hundredth of their size. So a bomb is detected before it takes
more memory than that.
"""

from __future__ import annotations

import io
from typing import Any

import pyarrow as pa

from gpszip.errors import InputError

__all__ = ["CHECKED_BYTES", "MAX_EXPANSION", "ExpansionMeter", "open_gzip", "read_chunk"]

#: Unpacked bytes that are checked together: 64 MiB.
CHECKED_BYTES = 64 << 20

#: Largest ratio of unpacked to compressed bytes.
MAX_EXPANSION = 300

#: What messages suggest for a gzip file.
_REMEDY = "unpack it yourself: zcat FILE | gpszip compress - ..."

#: Bytes that are unpacked at a time: 1 MiB.
_CHUNK_BYTES = 1 << 20


class ExpansionMeter:
    """Compares the unpacked bytes of a file with its compressed bytes.

    Parameters
    ----------
    name : str
        Name of the file for the message.
    remedy : str
        What the message suggests if the expansion is intended.

    Attributes
    ----------
    refused : bool
        Whether the file has exceeded the limit.
    """

    def __init__(self, name: str, remedy: str) -> None:
        self.refused = False
        self._name, self._remedy = name, remedy
        self._unpacked = 0  # bytes since the last check
        self._read_before = 0  # compressed bytes read until the last check

    def count(self, unpacked: int, read: int) -> None:
        """Count unpacked bytes.

        Parameters
        ----------
        unpacked : int
            Number of bytes unpacked since the last call.
        read : int
            Total number of compressed bytes read so far.

        Raises
        ------
        InputError
            If the expansion exceeds the limit.

        Examples
        --------
        >>> meter = ExpansionMeter("log.csv.gz", "unpack it yourself")
        >>> meter.count(100 << 20, 10 << 20)
        >>> meter.count(100 << 20, (10 << 20) + 1000)
        Traceback (most recent call last):
        gpszip.errors.InputError: log.csv.gz: expands more than 300 times; if that is meant, ...
        """
        self._unpacked += unpacked
        if self._unpacked < CHECKED_BYTES:
            return

        # Compare the bytes since the last check.
        if self._unpacked > MAX_EXPANSION * (read - self._read_before):
            self.refused = True
            raise InputError(
                f"expands more than {MAX_EXPANSION} times",
                path=self._name,
                remedy=f"if that is meant, {self._remedy}",
            )
        self._unpacked, self._read_before = 0, read


def open_gzip(packed: Any, name: str) -> Any:
    """Unpack a gzip file of one or more members while it is read.

    Parameters
    ----------
    packed : pyarrow.NativeFile
        The file, at its start; closed with the returned file.
    name : str
        Its name for messages.

    Returns
    -------
    pyarrow.NativeFile
        Reading it raises an InputError if the file is damaged or expands beyond the limit.
    """
    return pa.PythonFile(_GzipReader(packed, name), mode="r")


def read_chunk(stream: Any, size: int) -> bytes:
    """Read at most ``size`` bytes of a file; none at its end.

    Buffers of Arrow files are used, because ``read`` leaks its memory if reading fails.

    Examples
    --------
    >>> read_chunk(pa.BufferReader(b"walks"), 4)
    b'walk'
    """
    return bytes(getattr(stream, "read_buffer", stream.read)(size))


class _GzipReader(io.RawIOBase):
    """A raw stream that unpacks gzip and limits the expansion."""

    def __init__(self, packed: Any, name: str) -> None:
        self._packed, self._name, self._meter = packed, name, ExpansionMeter(name, _REMEDY)
        self._stream = pa.CompressedInputStream(packed, "gzip")

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        # Small chunks let the meter stop a bomb before much of it is in memory.
        try:
            chunk = read_chunk(self._stream, min(len(buffer), _CHUNK_BYTES))
        except OSError as error:
            raise InputError(
                f"damaged gzip file ({str(error)[:120]})",
                path=self._name,
                remedy="fetch it again, or unpack what is left of it with zcat",
            ) from None

        # The position in the packed file is the number of compressed bytes that were read.
        self._meter.count(len(chunk), self._packed.tell())
        buffer[: len(chunk)] = chunk
        return len(chunk)

    def close(self) -> None:
        if not self.closed:
            self._stream.close()
        super().close()
