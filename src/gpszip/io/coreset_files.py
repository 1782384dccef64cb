"""Telling coresets from logs: both are Parquet files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

__all__ = ["CORESET_KEY", "holds_coreset", "is_coreset"]

#: Key of the coreset's data in the metadata of the schema.
CORESET_KEY = b"gpszip.coreset"

#: First bytes of Parquet files.
_PARQUET = b"PAR1"


def holds_coreset(path: str) -> bool:
    """Whether a file is a coreset that :func:`gpszip.io.coresets.write_coreset` wrote."""
    # To look into a pipe would take its first bytes away.
    if not Path(path).is_file():
        return False
    try:
        with Path(path).open("rb") as file:
            # Other files are told without the import of Arrow.
            if file.read(len(_PARQUET)) != _PARQUET:
                return False
            import pyarrow as pa
            import pyarrow.parquet as pq

            try:
                return is_coreset(pq.read_schema(file))
            except pa.ArrowException:
                return False
    except OSError:
        return False


def is_coreset(schema: Any) -> bool:
    """Whether the schema of a Parquet file is that of a coreset; no log has its key."""
    return CORESET_KEY in (schema.metadata or {})
