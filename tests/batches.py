"""Compress and append logs in batches, however small the logs are."""

from gpszip.pipeline import memory as memory_limits
from gpszip.pipeline.append import append
from gpszip.pipeline.compress import compress
from gpszip.pipeline.open_log import open_log


def force_batches(monkeypatch, *, batch, subsample):
    """Let no log fit in memory, and make batches and the subsample small."""
    monkeypatch.setattr(memory_limits, "_BYTES_IN_MEMORY", 1 << 40)
    monkeypatch.setattr(memory_limits, "MAX_BATCH", batch)
    monkeypatch.setattr(memory_limits, "_MIN_BATCH", batch)
    monkeypatch.setattr(memory_limits, "MAX_SUBSAMPLE", subsample)


def compress_in_batches(source, options, *, memory, map=None, executor=None, **reading):
    """Return the archive, the report and the result of reading the files."""
    plane = None if map is None else map.grid.plane
    with open_log(source, memory=memory, plane=plane, keep=options.keep, **reading) as log:
        archive, report = compress(log, options, memory=memory, map=map, executor=executor)
        return archive, report, log.read_result


def append_in_batches(archive, source, options, *, memory, **reading):
    """Return the longer archive, the report and the result of reading the files."""
    plane = archive.grid.plane
    with open_log(source, memory=memory, plane=plane, keep=options.keep, **reading) as log:
        archive, report = append(archive, log, options, memory=memory)
        return archive, report, log.read_result
