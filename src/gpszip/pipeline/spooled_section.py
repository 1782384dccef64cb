"""Sections of an archive that may be too large for memory."""

from __future__ import annotations

import tempfile
import weakref
from collections.abc import Callable
from contextlib import ExitStack
from typing import BinaryIO, cast

from gpszip.container.contents import Section, SpooledBytes
from gpszip.io.storage.temporary import disk_errors_as_output_errors

__all__ = ["spooled_section"]

#: Bytes up to which a section stays in memory; a larger one goes to a temporary file.
_MAX_IN_MEMORY = 1 << 24


def spooled_section(kind: int, write: Callable[[BinaryIO], None]) -> Section:
    """Return a section whose body ``write`` writes; a large one stays in a temporary file."""
    with disk_errors_as_output_errors(), ExitStack() as stack:
        file = cast(
            BinaryIO,
            stack.enter_context(tempfile.SpooledTemporaryFile(_MAX_IN_MEMORY, prefix="gpszip-")),
        )
        write(file)
        body = SpooledBytes(file, file.tell())
        if len(body) <= _MAX_IN_MEMORY:
            return Section(kind, bytes(body))
        weakref.finalize(body, stack.pop_all().close)
        return Section(kind, body)
