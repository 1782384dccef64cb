"""Lossless columns beside pcodec: bytes for times and coordinates, at each log's own digits.

    PYTHONPATH=src python benchmarks/lossless.py LOG.csv [LOG.csv ...]

A log is a CSV file with a header, plain or gzipped. Columns whose cells are all plain numbers take
part. Both coders get integers; the lossless one divides their grid out itself, and its bytes
include that. Times are CPU seconds of this process, after a first run that compiles.
"""

from __future__ import annotations

import csv
import gzip
import math
import sys
import time
from pathlib import Path

import numpy as np
import pcodec

from gpszip.container.layout import Cursor
from gpszip.lossless.tables import decode_table, encode_table

#: Level of pcodec that packs best.
LEVEL = 12


def read_columns(path: Path) -> list[np.ndarray]:
    """Integers of each column of numbers: cells without their decimal point."""
    opener = gzip.open if path.suffix == ".gz" else open
    with opener(path, "rt", newline="") as file:
        rows = list(csv.reader(file))
    columns = []
    for name, *cells in zip(*rows, strict=True):
        if name == "track_id":
            continue
        decimals = max(len(cell.partition(".")[2]) for cell in cells)
        columns.append(np.array([to_integer(cell, decimals) for cell in cells], np.int64))
    return columns


def to_integer(cell: str, decimals: int) -> int:
    """A decimal number in units of its column's last digit."""
    whole, _, fraction = cell.partition(".")
    return int(whole + fraction.ljust(decimals, "0"))


def measure(path: Path) -> tuple[int, int, int, float, float]:
    """Rows, bytes of both coders, and seconds to encode and to decode."""
    columns = read_columns(path)
    started = time.process_time()
    data = encode_table(columns)
    encoded = time.process_time()
    back = decode_table(Cursor(data), len(columns[0]), len(columns))
    decoded = time.process_time()
    assert all(np.array_equal(a, b) for a, b in zip(columns, back, strict=True))
    config = pcodec.ChunkConfig(compression_level=LEVEL)
    peer = sum(len(pcodec.standalone.simple_compress(column, config)) for column in columns)
    return len(columns[0]), len(data), peer, encoded - started, decoded - encoded


def main() -> None:
    paths = [Path(name) for name in sys.argv[1:]]
    measure(paths[0])
    logarithms, rows, encoding, decoding = [], 0, 0.0, 0.0
    for path in paths:
        count, own, peer, encode_seconds, decode_seconds = measure(path)
        rows, encoding, decoding = (
            rows + count,
            encoding + encode_seconds,
            decoding + decode_seconds,
        )
        logarithms.append(math.log(own / peer))
        print(f"{path.name:40} {count:9,} {own:9,} {peer:9,} {own / peer:.3f}")
    mean = math.exp(sum(logarithms) / len(logarithms))
    print(f"geometric mean {mean:.4f}")
    print(f"encoding {rows / encoding / 1e6:.2f}, decoding {rows / decoding / 1e6:.2f} M samples/s")


if __name__ == "__main__":
    main()
