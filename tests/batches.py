"""Compressing logs batch by batch, however small they are."""

from gpszip.pipeline import memory as budget
from gpszip.pipeline.append import append
from gpszip.pipeline.compress import compress
from gpszip.pipeline.open_log import open_log


def force_batches(monkeypatch, *, batch, subsample):
    """Let no log fit in memory, and make batches and the subsample small."""
    monkeypatch.setattr(budget, "_BYTES_IN_MEMORY", 1 << 40)
    monkeypatch.setattr(budget, "MAX_BATCH", batch)
    monkeypatch.setattr(budget, "MAX_SUBSAMPLE", subsample)


def compress_in_batches(source, options, *, memory, map=None, executor=None, **reading):
    """Return the archive, the report and what was read of files."""
    plane = None if map is None else map.grid.plane
    with open_log(source, memory=memory, plane=plane, keep=options.keep, **reading) as log:
        archive, report = compress(log, options, memory=memory, map=map, executor=executor)
        return archive, report, log.read_result


def append_in_batches(archive, source, options, *, memory, **reading):
    """Return the archive, the report and what was read of files."""
    with open_log(
        source, memory=memory, plane=archive.grid.plane, keep=options.keep, **reading
    ) as log:
        archive, report = append(archive, log, options, memory=memory)
        return archive, report, log.read_result
