"""Opening logs: in memory where they fit, else sorted into a temporary file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Unpack

from gpszip.io.logs.log_file import Sources
from gpszip.io.logs.read import ReadOptions, read_logs
from gpszip.model import Listener, Plane, Progress
from gpszip.model.log import Log, MemoryLog
from gpszip.pipeline.memory import check_memory, fits, rows_while_sorting
from gpszip.pipeline.validate import check_thesis_in_memory

__all__ = ["open_log"]


@contextmanager
def open_log(
    sources: Sources,
    *,
    memory: int | None = None,
    plane: Plane | None = None,
    progress: Listener | None = None,
    thesis: bool = False,
    **options: Unpack[ReadOptions],
) -> Iterator[Log]:
    """Read logs, into memory where they fit.

    Parameters
    ----------
    sources : path, stream or iterable of them
        Files, patterns, folders, sources of frames; ``-`` is standard input.
    memory : int, optional
        Bytes that compressing the log may take, at least 400 MiB. A log that would take more is
        sorted by track and time into a temporary file, which goes when the context ends.
    plane : Plane, optional
        Plane of a log on disk, such as that of a map. Chosen for it by default.
    progress : callable, optional
        Called with :class:`~gpszip.model.report.Progress` events.
    thesis : bool, default False
        Whether the log is for the thesis's model (k or m), so that it must fit into memory.
    **options
        As for :func:`gpszip.io.logs.read.read_logs`.

    Yields
    ------
    Log
        With what was read, repaired and dropped in ``read_result``.

    Raises
    ------
    InputError
        If a log can't be read, or holds no track.
    OptionError
        If the memory is too little to work in, or for the thesis's model.
    """
    from gpszip.io.large.store import count_rows
    from gpszip.io.logs.formats import is_bundle
    from gpszip.io.logs.mixed_files import may_be_log
    from gpszip.io.storage.source import spooled

    # Read all into memory where it has no limit.
    if memory is None:
        result = read_logs(sources, **options)
        yield MemoryLog(result.tracks, result)
        return

    # Streams are read twice: to count, and to read.
    with spooled(sources, unzip=is_bundle, wanted=may_be_log) as files:
        rows = count_rows(files, **options)
        if fits(rows, memory):
            result = read_logs(files, **options)
            yield MemoryLog(result.tracks, result)
            return
        check_memory(memory)
        check_thesis_in_memory(thesis=thesis, in_memory=False)
        with _stored(files, memory, plane, progress, options) as log:
            yield log


@contextmanager
def _stored(
    sources: Any,
    memory: int,
    plane: Plane | None,
    progress: Listener | None,
    options: ReadOptions,
) -> Iterator[Log]:
    """Sort a log into a temporary file."""
    from gpszip.io.large.store import store_logs

    # Sort by track and time, as many rows at once as fit the memory.
    report = progress or (lambda _event: None)
    columns = len(options.get("keep", ())) + options.get("heights", False)
    report(Progress("read", 0.0))
    with store_logs(
        sources,
        rows=rows_while_sorting(memory, columns),
        plane=plane,
        **options,
    ) as log:
        report(Progress("read", 1.0))
        yield log
