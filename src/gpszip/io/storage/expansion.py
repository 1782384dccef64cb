"""How far packed logs may expand: a few kilobytes that become gigabytes are a trap, and no log.

Text of logs expands 5 to 30 times, with much repetition about 100 times; what gzip and zip can do at most is 1,030 times.
Whatever the size of a file, its first 64 MiB unpacked are always read. From then on, each 64 MiB have to come from at least
a three hundredth of that, so that a trap is noticed before it has taken more than this memory.
"""

from __future__ import annotations

import io
from typing import Any

import pyarrow as pa

from gpszip.errors import InputError

__all__ = ["CHECKED_BYTES", "MAX_EXPANSION", "ExpansionMeter", "open_gzip", "read_chunk"]

#: Bytes unpacked that are looked at together.
CHECKED_BYTES = 64 << 20

#: How many times larger they may be than the bytes that they come from.
MAX_EXPANSION = 300

_REMEDY = "unpack it yourself: zcat FILE | gpszip compress - ..."

#: Bytes that are unpacked at a time.
_CHUNK_BYTES = 1 << 20


class ExpansionMeter:
    """Compares what comes out of a packed file with what went in.

    Parameters
    ----------
    name : str
        The file's name for the message.
    remedy : str
        What to do if it is meant.

    Attributes
    ----------
    refused : bool
        Whether too much has come out.
    """

    def __init__(self, name: str, remedy: str) -> None:
        self.refused = False
        self._name, self._remedy = name, remedy
        self._out = 0
        self._before = 0  # bytes read when the present 64 MiB began

    def count(self, out: int, read: int) -> None:
        """Count bytes that came out.

        Parameters
        ----------
        out : int
            Bytes that came out since the last call.
        read : int
            Bytes read from the packed file in all.

        Raises
        ------
        InputError
            If they are too many for what was read.

        Examples
        --------
        >>> meter = ExpansionMeter("log.csv.gz", "unpack it yourself")
        >>> meter.count(100 << 20, 10 << 20)
        >>> meter.count(100 << 20, (10 << 20) + 1000)
        Traceback (most recent call last):
        gpszip.errors.InputError: log.csv.gz: expands more than 300 times; if that is meant, unpack it yourself
        """
        self._out += out
        if self._out < CHECKED_BYTES:
            return
        if self._out > MAX_EXPANSION * (read - self._before):
            self.refused = True
            raise InputError(
                f"{self._name}: expands more than {MAX_EXPANSION} times; if that is meant, {self._remedy}"
            )
        self._out, self._before = 0, read


def open_gzip(packed: Any, name: str) -> Any:
    """Unpack a gzip file of one or more members while it is read.

    Parameters
    ----------
    packed : pyarrow.NativeFile
        The file, at its start; closed with what is returned.
    name : str
        Its name for messages.

    Returns
    -------
    pyarrow.NativeFile
        Reading it raises an InputError if the file is damaged, or expands beyond the limit.
    """
    return pa.PythonFile(_GzipReader(packed, name), mode="r")


def read_chunk(stream: Any, size: int) -> bytes:
    """Read at most so many bytes of a file; none at its end.

    The ``read`` of an Arrow file keeps the memory that it has set aside where reading fails; its buffers don't.

    Examples
    --------
    >>> read_chunk(pa.BufferReader(b"walks"), 4)
    b'walk'
    """
    return bytes(getattr(stream, "read_buffer", stream.read)(size))


class _GzipReader(io.RawIOBase):
    def __init__(self, packed: Any, name: str) -> None:
        self._packed, self._name, self._meter = packed, name, ExpansionMeter(name, _REMEDY)
        self._stream = pa.CompressedInputStream(packed, "gzip")

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        try:
            piece = read_chunk(self._stream, min(len(buffer), _CHUNK_BYTES))
        except OSError as error:
            raise InputError(
                f"{self._name}: damaged gzip file ({str(error)[:120]}); fetch it again, or unpack what is left of it with zcat"
            ) from None
        self._meter.count(len(piece), self._packed.tell())
        buffer[: len(piece)] = piece
        return len(piece)

    def close(self) -> None:
        if not self.closed:
            self._stream.close()
        super().close()
