"""The journal: fixes on disk before their senders are told so.

A journal is a folder of segments, ``00000001.log`` and so on. A segment begins with a line that
names the format. Each other line is a record: its CRC-32 in eight hexadecimal digits, a blank, and
the fields of a fix as JSON. A segment is only ever appended to, by the process that made it.

What was acknowledged stays, whenever the process is killed: a record is flushed to disk before
:meth:`Journal.append` returns. A record that was cut off is removed when the journal is opened
next.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import sys
import threading
import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from gpszip.errors import InputError, OutputError
from gpszip.files.os_errors import as_output_error
from gpszip.live.fix import Fix

__all__ = ["Journal", "Lock", "Tail", "archived_until", "mark_archived", "read_segment", "segments"]

#: First line of a segment.
_HEADER = b"gpszip journal 1\n"

#: Bytes after which a new segment is begun: it is read at once when it is archived.
_MAX_SEGMENT_BYTES = 64 << 20

#: Bytes of a line that are read; the fields of a fix are limited to far less.
_MAX_LINE_BYTES = 1 << 16

#: Hexadecimal digits of a checksum and the blank behind it.
_CHECKSUM_BYTES = 9

#: Name of the file that says which segments are archived.
_ARCHIVED = "archived"

#: Name of the file that the writer of a journal locks.
_LOCK = "lock"

_SUFFIX = ".log"


def encode_record(fix: Fix) -> bytes:
    """Return the line of a fix.

    Examples
    --------
    >>> encode_record(Fix("bus", "gpsd", 7.0, 8.0, (48.1, 11.5)))[:30]
    b'f7dc4cd5 ["bus","gpsd",7.0,8.0'
    """
    text = json.dumps(fix.to_row(), separators=(",", ":")).encode("ascii")
    return b"%08x %s\n" % (zlib.crc32(text), text)


def decode_record(line: bytes) -> Fix | None:
    """Return the fix of a line; None if the line is damaged."""
    text = line[_CHECKSUM_BYTES:-1]
    if not line.endswith(b"\n") or line[:_CHECKSUM_BYTES] != b"%08x " % zlib.crc32(text):
        return None
    try:
        return Fix.from_row(json.loads(text))
    except (ValueError, InputError):
        return None


@dataclass
class Tail:
    """What was found while a segment was read.

    Parameters
    ----------
    end : int
        Bytes up to the end of the last good record.
    damaged : int
        Damaged lines before that.
    torn : int
        Bytes after it.
    """

    end: int = 0
    damaged: int = 0
    torn: int = 0


def segments(folder: Path) -> list[Path]:
    """Return the segments of a journal in the order in which they were written."""
    try:
        names = [entry for entry in folder.iterdir() if entry.suffix == _SUFFIX]
    except FileNotFoundError:
        return []
    return sorted(path for path in names if path.stem.isdecimal())


def read_segment(path: Path, tail: Tail | None = None) -> Iterator[Fix]:
    """Yield the fixes of a segment; damaged lines are passed over.

    Parameters
    ----------
    path : Path
        The segment.
    tail : Tail, optional
        Takes what was found.

    Raises
    ------
    InputError
        If the file is no segment.
    """
    tail = Tail() if tail is None else tail
    damaged = 0
    with path.open("rb") as file:
        # A segment whose first line was cut off holds nothing. After a power failure, zeros may
        # stand in its place.
        head = file.read(len(_HEADER))
        if head != _HEADER:
            if not _HEADER.startswith(head.rstrip(b"\0")) or file.read(1):
                raise InputError(
                    "is no segment of a journal", path=path, remedy="name another folder"
                )
            tail.torn = len(head)
            return

        # Good records; damaged lines at the very end are what a killed process left.
        position = tail.end = len(_HEADER)
        while line := file.readline(_MAX_LINE_BYTES):
            position += len(line)
            fix = decode_record(line)
            if fix is None:
                damaged += 1
                continue
            tail.end, tail.damaged = position, damaged
            yield fix
    tail.torn = position - tail.end


class Lock:
    """A lock on a file of a folder, which ends with the process that holds it.

    Parameters
    ----------
    folder : Path
        The folder; it is made if it is missing.
    name : str
        Name of the file.
    """

    def __init__(self, folder: Path, name: str = _LOCK) -> None:
        self._path = folder / name
        self._file: IO[bytes] | None = None

    def acquire(self) -> bool:
        """Take the lock; return whether it was free."""
        with as_output_error(self._path):
            # Where people are is nobody else's matter.
            self._path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            file = self._path.open("ab")
            if not _lock_file(file):
                file.close()
                return False
        self._file = file
        return True

    def release(self) -> None:
        """Give the lock back."""
        if self._file is not None:
            self._file.close()
            self._file = None


if sys.platform == "win32":

    def _lock_file(file: IO[bytes]) -> bool:
        import msvcrt

        # The first byte, which need not be there.
        file.seek(0)
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        except OSError as error:
            if error.errno not in (errno.EACCES, errno.EDEADLK):
                raise
            return False
        return True

else:

    def _lock_file(file: IO[bytes]) -> bool:
        import fcntl

        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.EACCES):
                raise
            return False
        return True


class Journal:
    """Fixes on disk, one process at a time.

    Parameters
    ----------
    folder : path
        It is made if it is missing.

    Attributes
    ----------
    torn : int
        Bytes of a record that was cut off, which were removed.
    damaged : int
        Damaged records elsewhere in the segments that were read.

    Raises
    ------
    OutputError
        If another process writes to the journal, or the folder can't be written to.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     journal = Journal(folder)
    ...     journal.append([Fix("bus", "gpsd", 7.0, 8.0, (48.1, 11.5))])
    ...     [fix.agent for fix in journal.recent()]
    ...     journal.close()
    ['bus']
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder)
        self._file: IO[bytes] | None = None
        self._end = 0
        # Fixes are written beside the event loop, which may end the segment meanwhile.
        self._turn = threading.RLock()
        self._lock = Lock(self.folder)
        if not self._lock.acquire():
            raise OutputError(
                "another process writes to this journal",
                path=self.folder,
                remedy="end it first, or name another folder with --journal",
            )

        # Finish what a killed process left undone.
        self.torn = self.damaged = 0
        try:
            with as_output_error(self.folder):
                delete_archived(self.folder)
                for path in segments(self.folder)[-1:]:
                    with contextlib.suppress(FileNotFoundError):
                        self._cut(path)
        except BaseException:
            self._lock.release()
            raise

    def recent(self, max_bytes: int = 256 << 20) -> Iterator[Fix]:
        """Yield the fixes of the last segments, oldest first, of so many bytes at most."""
        # Choose them from the end. A segment may be archived and deleted meanwhile.
        chosen: list[Path] = []
        size = 0
        for path in reversed(segments(self.folder)):
            with contextlib.suppress(FileNotFoundError):
                size += path.stat().st_size
            if size > max_bytes and chosen:
                break
            chosen.append(path)

        # Read them.
        for path in reversed(chosen):
            tail = Tail()
            with contextlib.suppress(FileNotFoundError):
                yield from read_segment(path, tail)
            self.damaged += tail.damaged

    def append(self, fixes: Iterable[Fix]) -> None:
        """Write fixes, and return once they are on disk.

        Raises
        ------
        OutputError
            If they can't be written. Then none of them is in the journal.
        """
        data = b"".join(map(encode_record, fixes))
        if not data:
            return
        with self._turn, as_output_error(self.folder):
            if self._end > _MAX_SEGMENT_BYTES:
                self.rotate()
            file = self._file or self._begin_segment()
            try:
                _write_all(file, data)
                os.fsync(file.fileno())
            except BaseException:
                self._abandon()
                raise
            self._end += len(data)

    def rotate(self) -> None:
        """End the segment; the next fix begins another one."""
        with self._turn:
            if self._file is not None:
                self._file.close()
                self._file = None
            self._end = 0

    def advance(self) -> bool:
        """Begin another segment if this one has fixes, so that others may archive this one.

        Whoever archives leaves the last segment to its writer. Return whether there are segments
        before it.
        """
        with self._turn:
            if self._file is not None and self._end > len(_HEADER):
                self.rotate()
                # On a full disk, the next fix tries again.
                with contextlib.suppress(OSError):
                    self._begin_segment()
        return len(segments(self.folder)) > 1

    def close(self) -> None:
        """End the segment, and let others write to the journal."""
        self.rotate()
        self._lock.release()

    def _begin_segment(self) -> IO[bytes]:
        # Numbers of archived segments are not used again.
        numbers = [archived_until(self.folder), *(int(path.stem) for path in segments(self.folder))]
        path = self.folder / f"{max(numbers) + 1:08}{_SUFFIX}"
        file = path.open("xb", buffering=0)
        try:
            _write_all(file, _HEADER)
            os.fsync(file.fileno())
            _sync_folder(self.folder)
        except BaseException:
            file.close()
            path.unlink(missing_ok=True)
            raise
        self._file, self._end = file, len(_HEADER)
        return file

    def _abandon(self) -> None:
        """Take back what was written of a batch that failed, and begin another segment.

        After a failed flush, nobody knows which pages of the file are on disk.
        """
        file, end = self._file, self._end
        if file is not None:
            with contextlib.suppress(OSError):
                file.truncate(end)
                os.fsync(file.fileno())
        with contextlib.suppress(OSError):
            self.rotate()
        self._file, self._end = None, 0

    def _cut(self, path: Path) -> None:
        """Remove what a killed process left at the end of a segment."""
        tail = Tail()
        for _ in read_segment(path, tail):
            pass
        self.torn = tail.torn
        if tail.torn:
            with path.open("r+b") as file:
                file.truncate(tail.end)
                os.fsync(file.fileno())


def _write_all(file: IO[bytes], data: bytes) -> None:
    """Write all bytes to an unbuffered file: the system may take a part only."""
    left = memoryview(data)
    while left:
        left = left[file.write(left) :]


def archived_until(folder: Path) -> int:
    """Number of the last segment that an archive holds; 0 if there is none."""
    try:
        return int((folder / _ARCHIVED).read_text())
    except (FileNotFoundError, ValueError):
        return 0


def mark_archived(folder: Path, segment: Path) -> None:
    """Note that an archive holds all segments up to one of them, and delete these.

    The note comes first: if the process is killed between the two, they are deleted when the
    journal is opened next.
    """
    from gpszip.files.atomic_write import atomic_write

    with atomic_write(folder / _ARCHIVED) as path:
        path.write_text(f"{int(segment.stem)}\n")
    delete_archived(folder)


def delete_archived(folder: Path) -> Sequence[Path]:
    """Delete the segments that an archive holds; return them."""
    last = archived_until(folder)
    archived = [path for path in segments(folder) if int(path.stem) <= last]
    for path in archived:
        path.unlink(missing_ok=True)
    return archived


def _sync_folder(folder: Path) -> None:
    """Flush the names of a folder to disk; Windows does so by itself."""
    if os.name != "posix":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
