"""Formats of other packages, guarded so that their faults are errors that name the package."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, BinaryIO, TypeVar

from gpszip.errors import GPSZipError, InputError, OutputError
from gpszip.io.logs.log_format import LogBatches, LogFormat

if TYPE_CHECKING:
    from gpszip.io.logs.raw import RawLog, Request
    from gpszip.io.logs.track_rows import TrackRows
    from gpszip.io.storage.source import Source

__all__ = ["guard_plugin"]

#: Letters of an exception's message that are shown.
_MAX_REASON_LETTERS = 120

Result = TypeVar("Result")


def guard_plugin(format_: LogFormat) -> LogFormat:
    """Return a format whose unexpected exceptions become errors that name it and its module.

    Errors of GPSZip, errors of the system and lack of memory stay what they are; only the file is
    added to an error that names none.

    Parameters
    ----------
    format_ : LogFormat
        A format that another package registers.
    """
    guard = _Guard(format_)
    return replace(
        format_,
        sniff=guard.sniff,
        read=guard.read,
        read_batches=None if format_.read_batches is None else guard.read_batches,
        write=None if format_.write is None else guard.write,
    )


@dataclass(frozen=True)
class _Guard:
    """The functions of a format, each within :meth:`_named_faults`."""

    format: LogFormat

    def sniff(self, head: bytes) -> bool:
        with self._named_faults(InputError):
            return bool(self.format.sniff(head))

    def read(self, source: Source, request: Request) -> RawLog:
        with self._named_faults(InputError, source.name):
            return _expect_log(self.format.read(source, request))

    def read_batches(self, source: Source, request: Request) -> LogBatches | None:
        assert self.format.read_batches is not None
        with self._named_faults(InputError, source.name):
            opened = self.format.read_batches(source, request)
            if opened is None:
                return None
            batches = self._iterate(_expect(LogBatches, opened), source.name)
            return replace(opened, batches=batches)

    def _iterate(self, opened: LogBatches, path: str) -> Iterator[RawLog]:
        with self._named_faults(InputError, path):
            for batch in opened.batches:
                yield _expect_log(batch)

    def write(self, tracks: Iterable[TrackRows], sink: BinaryIO) -> None:
        assert self.format.write is not None
        with self._named_faults(OutputError):
            self.format.write(tracks, sink)

    @contextmanager
    def _named_faults(self, kind: type[GPSZipError], path: str | None = None) -> Iterator[None]:
        """Turn exceptions that the plugin doesn't raise on purpose into errors of a kind."""
        try:
            yield
        except InputError as error:
            if path is None or error.path is not None:
                raise
            raise error.with_path(path) from error
        except (GPSZipError, OSError, MemoryError):
            raise
        except Exception as error:
            message = (str(error).splitlines() or [""])[0][:_MAX_REASON_LETTERS]
            raise kind(
                f"format {self.format.name!r} of {self.format.read.__module__} failed: "
                f"{type(error).__name__}: {message}",
                path=path,
                remedy="report it to the authors of that package",
            ) from error


def _expect_log(value: object) -> RawLog:
    from gpszip.io.logs.raw import RawLog

    return _expect(RawLog, value)


def _expect(kind: type[Result], value: object) -> Result:
    if not isinstance(value, kind):
        raise TypeError(f"a {kind.__name__} is expected, not {type(value).__name__}")
    return value
