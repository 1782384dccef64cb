"""Archives that keep their log byte by byte beside pcodec: all bytes, and speeds.

    PYTHONPATH=src python benchmarks/lossless.py LOG.csv [LOG.csv ...]

A log is a CSV file with a header, plain or gzipped. pcodec gets the columns of plain numbers as
integers (cells without their decimal point), the archive the whole file: its bytes are those of
map, walks and log, of which the walks are listed. Without a bound, one is estimated; --rmse gives
one in metres. Speeds are those of the log's section, walks being decoded, and of the integer
columns alone, without text and walks; in CPU seconds of this process, after a first run that
compiles.
"""

from __future__ import annotations

import argparse
import csv
import gzip
import io
import math
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pcodec

import gpszip
from gpszip.archive import Archive
from gpszip.archive.exact import find_exact_logs, find_trails
from gpszip.container.layout import EXACT_KINDS, Cursor
from gpszip.lossless.logs import write_exact_logs
from gpszip.lossless.tables import decode_table, encode_table

#: Level of pcodec that packs best.
LEVEL = 12


def read_bytes(path: Path) -> bytes:
    """The log, unpacked."""
    data = path.read_bytes()
    return gzip.decompress(data) if path.suffix == ".gz" else data


def read_columns(path: Path) -> list[np.ndarray]:
    """Integers of each column of numbers: cells without their decimal point."""
    rows = list(csv.reader(io.StringIO(read_bytes(path).decode(), newline="")))
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


def without_log(archive: Archive) -> Archive:
    """The archive of the walks alone."""
    extras = [each for each in archive.contents.extras if each.kind not in EXACT_KINDS]
    return replace(archive, contents=replace(archive.contents, extras=tuple(extras)))


def time_section(archive: Archive, log: bytes) -> tuple[float, float]:
    """Seconds to encode and to decode the section of a log, once the walks are decoded."""
    trails = find_trails(archive)
    started = time.process_time()
    write_exact_logs([("log", partial(iter, [log]))], io.BytesIO(), trails)
    encoded = time.process_time()
    logs = find_exact_logs(archive)
    assert logs is not None
    assert b"".join(logs.read(0)) == log
    return encoded - started, time.process_time() - encoded


def time_columns(columns: list[np.ndarray]) -> tuple[float, float]:
    """Seconds to encode and to decode integer columns, without text and walks."""
    started = time.process_time()
    data = encode_table(columns)
    encoded = time.process_time()
    back = decode_table(Cursor(data), len(columns[0]), len(columns))
    seconds = encoded - started, time.process_time() - encoded
    assert all(np.array_equal(a, b) for a, b in zip(columns, back, strict=True))
    return seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("logs", nargs="+", type=Path)
    parser.add_argument("--rmse", type=float)
    arguments = parser.parse_args()

    config = pcodec.ChunkConfig(compression_level=LEVEL)
    logarithms, rows, total = [], 0, np.zeros(4)
    for path in arguments.logs:
        archive = gpszip.compress(path, rmse=arguments.rmse, lossless=True)
        log, columns = read_bytes(path), read_columns(path)
        peer = sum(len(pcodec.standalone.simple_compress(column, config)) for column in columns)

        # The first run compiles, and decodes the walks.
        time_section(archive, log)
        seconds = np.array([*time_section(archive, log), *time_columns(columns)])
        rows, total = rows + len(columns[0]), total + seconds
        speeds = len(columns[0]) / seconds / 1e6
        logarithms.append(math.log(archive.size / peer))
        walks = without_log(archive).size
        print(
            f"{path.name:32} {len(columns[0]):9,} rows {peer:9,} pcodec {archive.size:9,} "
            f"archive {walks:7,} walks {archive.size / peer:.3f}, M rows/s: log {speeds[0]:.2f} "
            f"{speeds[1]:.2f}, columns {speeds[2]:.2f} {speeds[3]:.2f}",
            flush=True,
        )
    mean = math.exp(sum(logarithms) / len(logarithms))
    print(f"geometric mean {mean:.4f}")
    for what, seconds in (("log", total[:2]), ("columns alone", total[2:])):
        encoding, decoding = rows / seconds / 1e6
        print(f"{what}: encoding {encoding:.2f}, decoding {decoding:.2f} M rows/s")


if __name__ == "__main__":
    main()
