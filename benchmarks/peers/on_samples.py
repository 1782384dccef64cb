"""Keep every sample, rounded as coarsely as the bound allows: quantised columns, and SZ3."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .curves import Curve, Steps, errors, knot_clock, make_curve, round_times
from .files import decode_file, encode_file
from .integers import join, split
from .log import Floats, Log, find_period

#: Coders of quantised columns.
CODERS = ("pco", "bzip2", "zstd")

#: Shares of the bound that rounding may take, tried from the largest until the error is in bounds.
SHARES = (1.0, 0.98, 0.95, 0.9, 0.8, 0.7, 0.5, 0.3)


def compress(log: Log, bound: float, codec: str) -> bytes:
    """The smallest file of SZ3, or of quantised columns that a coder codes, within the bound."""
    if codec == "sz3":
        return compress_sz3(log, bound)
    return compress_quantised(log, bound, codec)


def time_steps(log: Log) -> Iterator[float]:
    """Steps of times: the mean interval of the samples, and the period of all times."""
    durations = log.clock[log.firsts[1:] - 1] - log.clock_starts
    intervals = len(log.clock) - len(log.names)
    yield max(durations.sum() / max(intervals, 1), find_period(log))
    yield find_period(log)


def compress_quantised(log: Log, bound: float, coder: str) -> bytes:
    """The smallest file of samples on a grid, whose positions are coded as differences."""
    files = []
    for time_step in time_steps(log):
        for share in SHARES:
            # A corner of a cell is 0.71 steps from its center.
            steps = Steps(time_step, np.sqrt(2) * bound * share)
            curve = make_curve(log, np.arange(len(log.clock)), steps)
            if errors(log, curve).max() <= bound:
                files.append(encode_file(log, curve, coder))
                break
    return min(files, key=len)


def compress_sz3(log: Log, bound: float) -> bytes:
    """The smallest file whose positions SZ3 codes, and whose times pcodec does."""
    files = []
    for time_step in time_steps(log):
        for share in SHARES:
            # SZ3 bounds the error of each axis.
            data, curve = code_sz3(log, share * bound / np.sqrt(2), time_step)
            if sz3_error(log, data, curve) <= bound:
                files.append(data)
                break
    return min(files, key=len)


def code_sz3(log: Log, bound: float, time_step: float) -> tuple[bytes, Curve]:
    """The file, and the curve whose times it holds; its positions are all zero."""
    from pysz import sz, szConfig, szErrorBoundMode

    # The times, with positions of zero.
    ticks, kept, firsts = round_times(log, np.arange(len(log.clock)), time_step)
    zeros = np.zeros(len(ticks), np.int64)
    curve = Curve(firsts, ticks, zeros, zeros, Steps(time_step, 1.0))

    # The positions.
    config = szConfig()
    config.errorBoundMode = szErrorBoundMode.ABS
    config.absErrorBound = bound
    axes = [sz.compress(np.ascontiguousarray(p[kept]), config)[0].tobytes() for p in (log.x, log.y)]
    return join([encode_file(log, curve, "pco"), *axes]), curve


def decode_axes(data: bytes, count: int) -> list[Floats]:
    """x and y of all samples."""
    from pysz import sz

    blocks = [np.frombuffer(part, np.uint8) for part in split(data, 3)[1:]]
    return [sz.decompress(block, np.float64, (count,))[0] for block in blocks]


def sz3_error(log: Log, data: bytes, curve: Curve) -> float:
    """Largest distance between a sample and the decoded curve."""
    x, y = decode_axes(data, len(curve.ticks))
    clock = knot_clock(log, curve)
    dx, dy = np.interp(log.clock, clock, x) - log.x, np.interp(log.clock, clock, y) - log.y
    return float(np.hypot(dx, dy).max())


def decode_sz3(data: bytes) -> list[tuple[str, Floats, Floats, Floats]]:
    """The knots of all tracks."""
    tracks = decode_file(split(data, 3)[0])
    ends = np.cumsum([len(track[1]) for track in tracks])
    x, y = (np.split(axis, ends[:-1]) for axis in decode_axes(data, int(ends[-1])))
    return [(track[0], track[1], *xy) for track, *xy in zip(tracks, x, y, strict=True)]
