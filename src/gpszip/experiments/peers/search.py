"""The smallest file of a method within an error: a search over its parameter and the grid."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.experiments.memory import measured_memory
from gpszip.experiments.peers.knots import (
    Knots,
    Steps,
    decode_file,
    encode_file,
    errors_of,
    on_grid,
)
from gpszip.experiments.peers.methods import Method
from gpszip.experiments.stages import measured
from gpszip.model import Track

__all__ = ["Criterion", "Encoded", "Search", "maximum", "root_mean_square"]

#: Steps that are tried: of positions as shares of the error allowed, and of times as shares of the
#: time in which the log moves by that error.
_STEPS = ((0.25, 0.5), (0.5, 0.5), (1.0, 0.5), (0.5, 0.1), (0.5, 0.01))

#: Steps of times that are tried where all samples are kept.
_TIME_STEPS = (0.5, 0.1, 0.01)

#: Ratio of two parameters, or of two steps, that are tried.
_RATIO = 1.08

#: Parameters that are tried above the one that bisection finds: errors don't always grow.
_AHEAD = 6

#: Parameters in metres that are tried, as shares of the error allowed.
_TOLERANCES = (1 / 16, 16.0)

#: Parameters in square metres: areas of flat and of long triangles, relative to the error.
_AREAS = (1e-3, 1e4)

#: Steps of a grid on which all samples are kept, as shares of the error allowed.
_GRIDS = (1 / 8, 8.0)

#: Quantile of the speeds of a log that says how far a rounded time moves a knot.
_SPEED = 0.9

#: Times are read to this part of a second when the period of a log is looked for.
_MILLISECONDS = 1_000

Floats = NDArray[np.float64]

#: What is to be within the error: of all distances.
Criterion = Callable[[Floats], float]


def root_mean_square(distances: Floats) -> float:
    """Return the root mean squared distance."""
    return float(np.sqrt((distances**2).mean()))


def maximum(distances: Floats) -> float:
    """Return the largest distance."""
    return float(distances.max())


@dataclass(frozen=True)
class Encoded:
    """The smallest file of a method.

    Parameters
    ----------
    bytes : int
        Its size.
    knots : int
        Knots of all tracks.
    parameter : float or None
        Parameter of the simplifier; None where all samples are kept.
    rmse, max_error : float
        Of the decoded file at all samples, in metres.
    seconds : float
        CPU seconds of making it once, without the search.
    memory : int or None
        Bytes of memory that this takes; None where nothing tells them.
    """

    bytes: int
    knots: int
    parameter: float | None
    rmse: float
    max_error: float
    seconds: float
    memory: int | None


class Search:
    """Searches on one log; lines that were made once are kept for other errors."""

    def __init__(self, tracks: Sequence[Track]) -> None:
        self.tracks = tracks
        self.longest = max(map(len, tracks))
        self.period, self.speed = _period(tracks), _speed(tracks)
        self.lines: dict[tuple[str, int], list[Knots]] = {}
        self.prepared: dict[str, Callable[[float], list[Knots]]] = {}

    def simplified(
        self, method: Method, coder: str, target: float, criterion: Criterion
    ) -> Encoded | None:
        """Return the smallest file of a simplifier, or None if none is within the error.

        Parameters
        ----------
        method : Method
            The simplifier.
        coder : str
            What codes its knots.
        target : float
            Metres.
        criterion : callable
            Root mean square or maximum.
        """
        # The coarsest parameter on each grid.
        low, high = self._range(method, target)
        found = []
        for position, time in _STEPS:
            steps = self._steps(time * target, position * target)

            def error_of(exponent: int, steps: Steps = steps) -> float:
                return criterion(self._errors(self._lines(method, exponent), steps))

            exponent = _last_within(error_of, low, high, target)
            if exponent is not None:
                data = encode_file(self._lines(method, exponent), steps, coder)
                found.append((len(data), exponent, steps))
        if not found:
            return None

        # The smallest one, made once more and measured.
        _, exponent, steps = min(found, key=lambda each: each[0])
        parameter = _RATIO**exponent
        return self._measure(
            lambda: method.prepare(self.tracks)(parameter), steps, coder, parameter
        )

    def on_samples(self, coder: str, target: float, criterion: Criterion) -> Encoded | None:
        """Return the file of all samples on the coarsest grid within the error."""
        # The coarsest steps of positions for each step of times.
        lines = [Knots(track.times, track.positions) for track in self.tracks]
        low, high = _exponents(*(share * target for share in _GRIDS))
        found = []
        for time in _TIME_STEPS:

            def steps_of(exponent: int, time: float = time) -> Steps:
                return self._steps(time * target, _RATIO**exponent)

            def error_of(exponent: int, steps_of: Callable[[int], Steps] = steps_of) -> float:
                return criterion(self._errors(lines, steps_of(exponent)))

            exponent = _last_within(error_of, low, high, target)
            if exponent is not None:
                steps = steps_of(exponent)
                found.append((len(encode_file(lines, steps, coder)), steps))
        if not found:
            return None

        # The smallest one, made once more and measured.
        _, steps = min(found, key=lambda each: each[0])
        return self._measure(lambda: lines, steps, coder, None)

    def _measure(
        self, make: Callable[[], list[Knots]], steps: Steps, coder: str, parameter: float | None
    ) -> Encoded:
        """Make a file with clock and memory measured, decode it, and measure its error."""
        seconds: dict[str, float] = {}
        with measured_memory() as memory, measured(seconds, "all"):
            data = encode_file(make(), steps, coder)
        decoded = decode_file(data, coder)
        errors = errors_of(self.tracks, decoded)
        return Encoded(
            bytes=len(data),
            knots=sum(len(line.times) for line in decoded),
            parameter=parameter,
            rmse=root_mean_square(errors),
            max_error=maximum(errors),
            seconds=seconds["all"],
            memory=memory.bytes,
        )

    def _lines(self, method: Method, exponent: int) -> list[Knots]:
        """Return the lines of a parameter, which are made once."""
        key = method.name, exponent
        if key not in self.lines:
            if method.name not in self.prepared:
                self.prepared[method.name] = method.prepare(self.tracks)
            self.lines[key] = self.prepared[method.name](_RATIO**exponent)
        return self.lines[key]

    def _errors(self, lines: Sequence[Knots], steps: Steps) -> Floats:
        return errors_of(self.tracks, [on_grid(line, steps) for line in lines])

    def _range(self, method: Method, target: float) -> tuple[int, int]:
        """Return the exponents of the finest and the coarsest parameter that are tried."""
        if method.unit == "samples":
            return _exponents(1.0, float(self.longest))
        shares = _AREAS if method.unit == "m2" else _TOLERANCES
        scale = target**2 if method.unit == "m2" else target
        return _exponents(*(share * scale for share in shares))

    def _steps(self, distance: float, position: float) -> Steps:
        """Return a grid: a step of time is a multiple of the log's period that moves so far."""
        longest = distance / self.speed
        return Steps(max(1, int(longest / self.period)) * self.period, position)


def _last_within(
    error_of: Callable[[int], float], low: int, high: int, target: float
) -> int | None:
    """Return the largest number whose error is within the target, if errors grow with numbers.

    Where they don't quite, a few numbers above the one that bisection finds are tried, too.

    Examples
    --------
    >>> _last_within(lambda number: 2.0 * number, 0, 100, 41.0)
    20
    """
    if error_of(low) > target:
        return None

    # Bisection.
    most = high
    while high - low > 0:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if error_of(middle) <= target else (low, middle - 1)

    # Larger ones.
    ahead = range(min(low + _AHEAD, most), low, -1)
    return next((number for number in ahead if error_of(number) <= target), low)


def _exponents(low: float, high: float) -> tuple[int, int]:
    """Return the exponents of the ratio between two parameters."""
    return math.ceil(math.log(low, _RATIO)), math.floor(math.log(high, _RATIO))


def _period(tracks: Sequence[Track]) -> float:
    """Return the largest time of which all times since the starts are multiples, to a millisecond.

    Examples
    --------
    >>> _period([Track("a", [0, 2, 6], [[0, 0]] * 3)])
    2.0
    """
    since = np.concatenate([track.times - track.times[0] for track in tracks])
    ticks = np.round(since * _MILLISECONDS).astype(np.int64)
    return max(int(np.gcd.reduce(ticks)), 1) / _MILLISECONDS


def _speed(tracks: Sequence[Track]) -> float:
    """Return a high quantile of the speeds over a dozen samples, which noise moves little."""
    speeds = []
    for track in tracks:
        times, positions = track.times[::12], track.positions[::12]
        speeds.append(np.linalg.norm(np.diff(positions, axis=0), axis=1) / np.diff(times))
    moving = np.concatenate(speeds)
    moving = moving[moving > 0]
    return float(np.quantile(moving, _SPEED)) if len(moving) else 1.0
