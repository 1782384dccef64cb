"""Following a stream: batches are read, learned and written until it ends, or a signal comes."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType

from gpszip.errors import BoundError, NoPositionsError, OutputError
from gpszip.live.notices import Notices
from gpszip.live.stream.compressor import StreamCompressor
from gpszip.live.stream.lines import StreamLines
from gpszip.live.stream.rows import StreamReader, StreamRows

__all__ = ["BATCH_LINES", "BATCH_SECONDS", "StreamResult", "follow_stream", "stop_at_signals"]

#: Lines after which a batch is complete.
BATCH_LINES = 10_000

#: Seconds after which it is complete in any case.
BATCH_SECONDS = 60.0

#: How often rows that can't be held together are halved: one wrong row costs a few others.
_MAX_SPLITS = 6

#: A batch waits this many times as long as the last one took: at most a fifth of the time goes to
#: batches, however long the archive is.
_REST = 4.0


@dataclass
class StreamResult:
    """What came, and what was made of it.

    Parameters
    ----------
    lines : int
        Lines that were read.
    batches : int
        Times that the archive was written.
    lost : int
        Lines and rows that are not in the archive.
    """

    lines: int = 0
    batches: int = 0
    lost: int = 0


def follow_stream(
    lines: StreamLines,
    reader: StreamReader,
    compressor: StreamCompressor,
    target: Path,
    notices: Notices,
    *,
    batch_lines: int = BATCH_LINES,
    batch_seconds: float = BATCH_SECONDS,
    name: str = "standard input",
) -> StreamResult:
    """Write the archive batch by batch until the stream ends.

    The archive on disk is replaced at once by the longer one, so that it is whole whenever the
    process is killed.

    Parameters
    ----------
    lines : StreamLines
        The stream.
    reader : StreamReader
        Makes rows of lines.
    compressor : StreamCompressor
        Makes an archive of rows.
    target : Path
        The archive.
    notices : Notices
        Is told what can't be used.
    batch_lines : int
        Lines after which a batch is written.
    batch_seconds : float
        Seconds after which a batch is written, if it has any line.
    name : str
        Name of the stream in messages.

    Raises
    ------
    InputError
        If the first lines can't be read, or none has a position.
    OutputError
        If the archive can't be written at the end.
    """
    result = StreamResult()
    told: dict[str, int] = {}
    unwritten: OutputError | None = None
    seconds, goes_on = batch_seconds, True
    while goes_on:
        # A batch of lines.
        taken, goes_on = lines.take(batch_lines, seconds)
        start = time.monotonic()
        result.lines += len(taken)
        changed = bool(taken) and _add(taken, reader, compressor, notices, result)
        _tell_counts(compressor, told, notices, result)

        # The archive; on a full disk, the next batch tries again.
        if changed or unwritten is not None:
            unwritten = _save(compressor, target, notices, result)
        seconds = max(batch_seconds, _REST * (time.monotonic() - start))

    # The end.
    if unwritten is not None:
        raise unwritten
    if lines.cut:
        notices.note("line cut off when reading stopped; left out")
    if compressor.archive is None:
        raise NoPositionsError("no position came", path=name)
    return result


def _add(
    lines: Sequence[bytes],
    reader: StreamReader,
    compressor: StreamCompressor,
    notices: Notices,
    result: StreamResult,
) -> bool:
    """Read and learn a batch; return whether the archive has changed."""
    # Only the first rows may end the stream.
    rows = reader.read(lines)
    for repair in rows.repairs:
        notices.add(repair.what, repair.count, repair.where, repair.value)
        result.lost += repair.count if repair.drops else 0
    return _add_rows(rows, compressor, notices, result, _MAX_SPLITS)


def _add_rows(
    rows: StreamRows,
    compressor: StreamCompressor,
    notices: Notices,
    result: StreamResult,
    splits: int,
) -> bool:
    """Learn rows; of those that can't be held together, each half by itself."""
    try:
        return compressor.add(rows)
    except BoundError as error:
        if compressor.archive is None:
            raise
        if not splits or len(rows) == 1:
            result.lost += len(rows)
            notices.add(f"rows left out: {error.detail}", len(rows), "")
            return False
    halves = [_add_rows(each, compressor, notices, result, splits - 1) for each in _halves(rows)]
    return any(halves)


def _halves(rows: StreamRows) -> Iterator[StreamRows]:
    """Yield the first and the second half of the rows of each track."""
    for part in (0, 1):
        tracks = {}
        for name, (times, coordinates) in rows.tracks.items():
            middle = (len(times) + 1) // 2
            half = slice(middle, None) if part else slice(middle)
            tracks[name] = times[half], coordinates[half]
        yield replace(rows, tracks={name: own for name, own in tracks.items() if len(own[0])})


def _tell_counts(
    compressor: StreamCompressor, told: dict[str, int], notices: Notices, result: StreamResult
) -> None:
    """Tell what the compressor left out or put elsewhere since the last batch."""
    for what, count in compressor.counts.items():
        new = count - told.get(what, 0)
        told[what] = count
        if new:
            notices.add(what, new, "")
            result.lost += new if what in compressor.LOSSES else 0


def _save(
    compressor: StreamCompressor, target: Path, notices: Notices, result: StreamResult
) -> OutputError | None:
    """Replace the archive on disk; return the error if that fails."""
    assert compressor.archive is not None
    try:
        compressor.archive.save(target, force=True)
    except OutputError as error:
        notices.note("archive not written; tried again with the next batch", value=error.detail)
        return error
    result.batches += 1
    return None


@contextlib.contextmanager
def stop_at_signals(stop: Callable[[], None]) -> Iterator[None]:
    """Call a function at SIGINT, SIGTERM and SIGHUP; at a second one, interrupt.

    Signals that are ignored stay so: nohup ignores SIGHUP on purpose.
    """
    # Only the main thread may handle signals.
    handlers = {}
    if threading.current_thread() is threading.main_thread():
        numbers = [
            getattr(signal, name)
            for name in ("SIGINT", "SIGTERM", "SIGHUP")
            if hasattr(signal, name)
        ]
        current = {number: signal.getsignal(number) for number in numbers}
        handlers = {each: known for each, known in current.items() if known != signal.SIG_IGN}

    def handle(number: int, frame: FrameType | None) -> None:
        del frame
        stop()
        # Whoever asks twice doesn't want to wait.
        signal.signal(number, signal.default_int_handler)

    # Handle them until the stream has ended.
    for number in handlers:
        signal.signal(number, handle)
    try:
        yield
    finally:
        for number, known in handlers.items():
            signal.signal(number, known)
