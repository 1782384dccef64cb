"""Bytes, CPU seconds and the error of one codec on one log."""

from __future__ import annotations

import functools
import json
import statistics
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from peers.files import decode_file
from peers.log import Log, read_log
from peers.on_samples import decode_sz3

import gpszip

from .logs import Case

#: Share of the bound by which rounding in the last digit of a float may exceed it.
SLACK = 1e-9

PROCESS = Path(__file__).parent / "process.py"


class MeasurementError(Exception):
    """A codec failed, or its file is not within the bound."""


def measure(codec: str, level: str, tiny: Path, case: Case) -> dict[str, Any]:
    """Run a codec in a process of its own, and check its file.

    Returns
    -------
    dict
        ``bytes``; ``seconds`` of CPU after the start-up, and those of the ``startup``; the largest
        ``error`` of the decoded samples in metres; ``sizes`` by coder.

    Raises
    ------
    MeasurementError
        If the process fails, or a sample is decoded farther away than the bound.
    """
    # Run it, once all its kernels are compiled.
    compile_kernels(codec, level, tiny)
    out = case.path.with_suffix(".out")
    report = run(codec, level, tiny, case.path, case.bound, out)

    # Decode the file.
    error = find_error(codec, out, read_log(str(case.path)))
    if not error <= case.bound * (1 + SLACK):
        raise MeasurementError(f"a sample is decoded {error:.4g} m away")
    return {
        "bytes": out.stat().st_size,
        "seconds": statistics.median(report["runs"]),
        "startup": report["startup"],
        "error": error,
        "sizes": report["sizes"],
    }


@functools.cache
def compile_kernels(codec: str, level: str, tiny: Path) -> None:
    """Run a codec once that isn't measured, so that all its kernels are compiled."""
    run(codec, level, tiny, tiny, 1.0, tiny.with_suffix(".out"))


def run(codec: str, level: str, tiny: Path, path: Path, bound: float, out: Path) -> dict[str, Any]:
    """Run a codec in a process of its own; return what it prints."""
    arguments = [codec, level, str(tiny), str(path), str(bound), str(out)]
    process = subprocess.run(
        [sys.executable, str(PROCESS), *arguments], capture_output=True, text=True, check=False
    )
    if process.returncode != 0:
        last = (process.stderr.strip().splitlines() or ["no message"])[-1]
        raise MeasurementError(f"exit code {process.returncode}: {last}")
    return json.loads(process.stdout.splitlines()[-1])


def find_error(codec: str, path: Path, log: Log) -> float:
    """Largest distance between a sample and the decoded position at its own time."""
    decode = decode_archive if codec == "gpszip" else decode_peer
    return max(
        float(np.hypot(*(found - wanted).T).max()) for found, wanted in decode(codec, path, log)
    )


def decode_archive(_codec: str, path: Path, log: Log):
    """Decoded and true positions of each track of an archive.

    Where a piece ends up to an interval beside its last sample, that sample is at the last knot.
    """
    archive = gpszip.open(path)
    for name, times, wanted in samples(log):
        found = archive.position(name, times, metres=True)
        beside = np.isnan(found[:, 0])
        if beside.any():
            pieces = archive.decompress(name)
            knots = np.concatenate([piece.times for piece in pieces])
            nearest = np.abs(knots - times[beside, None]).argmin(axis=1)
            found[beside] = np.concatenate([piece.positions for piece in pieces])[nearest]
        yield found, wanted


def decode_peer(codec: str, path: Path, log: Log):
    """Decoded and true positions of each track of a peer's file."""
    decode = decode_sz3 if codec == "sz3" else decode_file
    curves = {name: curve for name, *curve in decode(path.read_bytes())}
    for name, times, wanted in samples(log):
        knots, x, y = curves[name]
        yield np.column_stack([np.interp(times, knots, axis) for axis in (x, y)]), wanted


def samples(log: Log):
    """Name, times and positions of each track."""
    for track, name in enumerate(log.names):
        part = slice(log.firsts[track], log.firsts[track + 1])
        times: NDArray[np.float64] = log.clock[part] - log.clock[part.start] + log.starts[track]
        yield name, times, np.column_stack([log.x[part], log.y[part]])
