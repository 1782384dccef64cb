"""Frames as sources of a log, beside files and streams."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pyarrow as pa

from gpszip.io.deferred import deferred
from gpszip.io.frames.recognise import class_names
from gpszip.io.frames.stream import open_stream, stream_batches
from gpszip.io.logs.log_format import LogFormat
from gpszip.io.storage.source import Source
from gpszip.io.storage.temporary import disk_errors_as_output_errors

__all__ = ["FrameSource", "StoredFrame", "frame_sources"]

#: Classes with a stream whose rows are in memory, so that they can be read again.
_IN_MEMORY = {("pyarrow", "Table"), ("pandas", "DataFrame"), ("polars", "DataFrame")}

#: How frames are read: as the formats of files are.
FRAME_FORMAT = LogFormat(
    name="frame",
    suffixes=(),
    description="a table of another package",
    sniff=lambda _head: False,
    read=deferred("gpszip.io.frames.read", "read_frame"),
    read_batches=deferred("gpszip.io.frames.read", "read_frame_batches"),
)


@dataclass(frozen=True)
class FrameSource(Source):
    """A frame that is yet to be read.

    Parameters
    ----------
    frame : frame
        See :func:`gpszip.io.frames.recognise.is_frame`.
    """

    frame: Any = field(default=None, repr=False, compare=False)

    @property
    def stem(self) -> str:
        """Name of the frame."""
        return self.name

    @property
    def size(self) -> int:
        """Number of bytes as stored: none, as no file holds it."""
        return 0

    @property
    def is_gzip(self) -> bool:
        """Whether it is compressed with gzip: never."""
        return False

    def log_bytes(self, points: int, dimension: int) -> int:
        """Size as times and coordinates of 8 bytes, as for tracks that came from no file."""
        return 8 * (1 + dimension) * points

    def stored_at(self, path: Path) -> FrameSource:
        """Return a source that can be read several times: a stream is written to a file.

        Raises
        ------
        InputError
            If the stream can't be read.
        OutputError
            If the disk is full.
        """
        is_stream = hasattr(self.frame, "__arrow_c_stream__")
        if not is_stream or class_names(self.frame) & _IN_MEMORY:
            return self
        return replace(self, frame=_store(self.frame, path, self.name))


@dataclass(frozen=True, eq=False)
class StoredFrame:
    """A stream of Arrow batches that was written to a file.

    Parameters
    ----------
    path : Path
        The file, in the format of Arrow's streams.
    num_rows : int
        Number of rows.
    """

    path: Path
    num_rows: int

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        return pa.ipc.open_stream(str(self.path)).__arrow_c_stream__(requested_schema)


def frame_sources(frames: Sequence[Any]) -> list[FrameSource]:
    """Return sources named after the classes of frames, and numbered if there are several.

    Examples
    --------
    >>> [source.name for source in frame_sources([{"t": [0]}])]
    ['dict']
    >>> [source.name for source in frame_sources([{"t": [0]}, {"t": [1]}])]
    ['dict-1', 'dict-2']
    """
    names = [type(frame).__name__ for frame in frames]
    if len(frames) > 1:
        names = [f"{name}-{number}" for number, name in enumerate(names, 1)]
    return [FrameSource(name, frame=frame) for name, frame in zip(names, frames, strict=True)]


def _store(frame: Any, path: Path, name: str) -> StoredFrame:
    """Write all batches of a stream to a file."""
    # Arrow's streams, unlike its files, may replace the dictionary of a column.
    rows = 0
    reader = open_stream(frame, name)
    with (
        disk_errors_as_output_errors(),
        pa.OSFile(str(path), "wb") as file,
        pa.ipc.new_stream(file, reader.schema) as writer,
    ):
        for batch in stream_batches(reader, name):
            writer.write_batch(batch)
            rows += batch.num_rows
    return StoredFrame(path, rows)
