"""The logs to compare on, as CSV files in metres that every codec reads."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import gpszip
from gpszip import Track, testing
from gpszip.io.logs.write import write_tracks

#: Decimals of times and positions in the files: milliseconds and millimetres.
DECIMALS = 3


@dataclass(frozen=True)
class Case:
    """A log and the maximum error allowed.

    Parameters
    ----------
    title : str
        What the log is, for tables and figures.
    path : Path
        The CSV file.
    bound : float
        Metres.
    points, tracks : int
        Size of the log.
    stamp : int
        Checksum of the file, by which earlier results are known to be of the same log.
    """

    title: str
    path: Path
    bound: float
    points: int
    tracks: int
    stamp: int


def town(vehicles: int, period: float, duration: float) -> list[Track]:
    """Drives of a town's vehicles, with a sample in each period."""
    drives = testing.drives(vehicles=vehicles, period=period, duration=duration)
    return [Track(name, *drive) for name, drive in drives.items()]


#: Generated logs: title, tracks, and bound in metres. Noise of the towns is 4 m in each axis, so
#: that a bound of 20 m, 5 times that, lets no sample of noise alone be an outlier.
GENERATED = (
    ("Patrol", lambda: [testing.patrol()], 0.5),
    ("Long patrol", lambda: [testing.patrol(1_000_000)], 0.5),
    ("Town, once a second", lambda: town(20, 1.0, 1200.0), 20.0),
    ("Town, once a minute", lambda: town(50, 60.0, 5400.0), 20.0),
)


def generated_cases(folder: Path) -> list[Case]:
    """Write the generated logs."""
    return [write_case(folder, title, make(), bound) for title, make, bound in GENERATED]


def named_case(folder: Path, argument: str) -> Case:
    """Read a log in any format, named as LOG:BOUND, and write it in metres."""
    path, _, bound = argument.rpartition(":")
    return write_case(folder, Path(path).stem, gpszip.read(path), float(bound.removesuffix("m")))


def write_case(folder: Path, title: str, tracks: Sequence[Track], bound: float) -> Case:
    """Write tracks as a CSV file, with rounded numbers that are the same for every codec."""
    rounded = [round_track(track) for track in tracks]
    path = folder / f"{title.lower().replace(' ', '-').replace(',', '')}.csv"
    write_tracks(rounded, path, decimals=DECIMALS)
    points = sum(map(len, rounded))
    return Case(title, path, bound, points, len(rounded), zlib.crc32(path.read_bytes()))


def round_track(track: Track) -> Track:
    """Round to milliseconds and millimetres; samples whose times become the same are left out."""
    times, positions = track.times.round(DECIMALS), track.positions[:, :2].round(DECIMALS)
    later = np.r_[True, np.diff(times) > 0]
    return Track(track.id, times[later], positions[later])


def write_tiny(folder: Path) -> Path:
    """Write a log of two samples, whose compression is nothing but start-up."""
    path = folder / "tiny.csv"
    write_tracks([Track("0", [0.0, 1.0], [[0.0, 0.0], [1.0, 1.0]])], path)
    return path
