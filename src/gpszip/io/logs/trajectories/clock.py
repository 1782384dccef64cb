"""Times of poses that have none of their own: from a file, or from a rate."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.logs.trajectories.layouts import Layout
from gpszip.io.storage.source import expand
from gpszip.io.values.timestamps import times_to_seconds, unit_origin, unit_seconds

__all__ = ["Clock", "clock_of"]


@dataclass(frozen=True, eq=False)
class Clock:
    """The times of poses by their number.

    Parameters
    ----------
    name : str
        Name of the log in messages.
    times : float64 array, shape (n,), or None
        Seconds, from a file.
    times_name : str
        Name of that file.
    rate : float or None
        Poses in a second, from time 0. With neither, poses are a shape without times.
    """

    name: str
    times: NDArray[np.float64] | None = None
    times_name: str = ""
    rate: float | None = None

    def add_times(self, raw: RawLog, first: int) -> RawLog:
        """Return poses with their times.

        Parameters
        ----------
        raw : RawLog
            Poses of a file, or some of them.
        first : int
            Index of the first of them.
        """
        count = len(raw.times)
        if self.rate is not None:
            times = np.arange(first, first + count) / self.rate
        elif self.times is not None:
            times = self.times[first : first + count]
            if len(times) < count:
                raise self._count_error(f"more than {len(self.times):,}")
        else:
            return raw
        return replace(raw, times=times, untimed=frozenset())

    def check_end(self, count: int) -> None:
        """Check that there are as many times as poses.

        Raises
        ------
        InputError
            If there are not.
        """
        if self.times is not None and len(self.times) != count:
            raise self._count_error(f"{count:,}")

    def _count_error(self, poses: str) -> InputError:
        assert self.times is not None
        return InputError(
            f"has {poses} poses, but {self.times_name} {len(self.times):,} times",
            path=self.name,
            remedy="name the file of times of the same log",
        )


def clock_of(layout: Layout, request: Request, where: str) -> Clock | None:
    """Return where the times of a file come from; None if it has its own.

    Raises
    ------
    InputError
        If it has none, and the request names neither a file nor a rate.
    """
    if "t" in layout.roles:
        return None
    if request.rate is not None:
        return Clock(where, rate=request.rate)
    if request.times_file is not None:
        return Clock(where, _read_times(request), request.times_file)
    if not request.times:
        return Clock(where)
    raise InputError(
        f"poses of {layout.format} have no times",
        path=where,
        remedy="--times FILE names a file with a time in each line, --rate 10 states the poses in "
        "a second; --no-times keeps the shape alone",
    )


def _read_times(request: Request) -> NDArray[np.float64]:
    """Read a file with a number or a date in each line."""
    # Only one file has the times of a log.
    assert request.times_file is not None
    source, *others = expand(request.times_file, unzip=False)
    if isinstance(source, InputError):
        raise source
    if others:
        raise InputError("names several files", path=request.times_file, remedy="name one")

    # The first cell of each line. A date has a blank before the time of day.
    lines = source.read().decode("utf-8-sig", "replace").splitlines()
    cells = [line.split(",")[0].strip() for line in lines]
    cells = [cell for cell in cells if cell and not cell.startswith("#")]
    if not cells:
        raise InputError("has no times", path=source.name, remedy="name a file with one a line")
    unit = request.time_unit
    times = times_to_seconds(
        pa.chunked_array([pa.array(cells, pa.string())]),
        None if unit is None else unit_seconds(unit),
        source.name,
        "times",
        origin=0.0 if unit is None else unit_origin(unit),
        dates=request.dates,
    )

    # A time that can't be read would leave a pose without one.
    bad = np.flatnonzero(~np.isfinite(times))
    if len(bad):
        raise InputError(
            f"{cells[bad[0]][:40]!r} is no time",
            path=source.name,
            location=f"time {bad[0] + 1}",
            remedy="write seconds, or a date, in each line",
        )
    return times
