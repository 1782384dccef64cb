"""Further columns of a log larger than memory as a section of its archive, which is written piece by piece."""

from __future__ import annotations

import tempfile
import weakref
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from gpszip.container.attributes import write_attributes
from gpszip.container.columns import Column
from gpszip.container.contents import Section, SpooledBytes
from gpszip.container.layout import SectionKind
from gpszip.io.large.store import StoredLog
from gpszip.io.storage.temporary import disk_errors_as_output_errors
from gpszip.model import Options
from gpszip.pipeline.validate import check_names

__all__ = ["Times", "kept_of", "section_of"]

#: Sections up to so many bytes stay in memory.
_SMALL = 1 << 24


@dataclass(frozen=True, eq=False)
class Times:
    """Instants of all samples as a column."""

    log: StoredLog
    kind: str = "f"
    texts: tuple[str, ...] = ()

    def chunks(self, first: int = 0, count: int | None = None) -> Iterator[NDArray[np.float64]]:
        """Yield so many instants from a sample on."""
        return self.log.times(first, count)


def kept_of(log: StoredLog, options: Options) -> tuple[Section, ...]:
    """Sections of what is to be kept of a log besides the walks.

    Raises
    ------
    OptionError
        If a column can't be kept.
    """
    if not (options.keep or options.keep_times):
        return ()
    check_names(options.keep, geographic=log.plane is not None)
    columns = {column.name: column for column in log.columns}
    return (section_of([track.count for track in log.tracks], Times(log), columns),)


def section_of(counts: Sequence[int], times: Column, columns: Mapping[str, Column]) -> Section:
    """Write columns of any length to a section, which stays in a temporary file if it is large."""
    with disk_errors_as_output_errors(), ExitStack() as stack:
        file = cast(
            BinaryIO, stack.enter_context(tempfile.SpooledTemporaryFile(_SMALL, prefix="gpszip-"))
        )
        write_attributes(counts, times, columns, file)
        body = SpooledBytes(file, file.tell())
        if len(body) <= _SMALL:
            return Section(SectionKind.ATTRIBUTES, bytes(body))
        weakref.finalize(body, stack.pop_all().close)
        return Section(SectionKind.ATTRIBUTES, body)
