"""Rate against error of GPSZip and of what users would pick instead, run on the same logs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from gpszip.drawing.style import FigureType
from gpszip.experiments.curves import Curve, draw_curves
from gpszip.experiments.experiment import Outcome, Picture, Setting
from gpszip.experiments.memory import measured_memory
from gpszip.experiments.peers.coders import missing_coders
from gpszip.experiments.peers.libraries import is_installed
from gpszip.experiments.peers.methods import SIMPLIFIERS, Method
from gpszip.experiments.peers.search import Criterion, Encoded, Search, maximum, root_mean_square
from gpszip.experiments.stages import measured
from gpszip.experiments.table import Column, Table, Value
from gpszip.experiments.without_outliers import without_outliers
from gpszip.geo.gaps import estimate_gap, find_gaps_of_all
from gpszip.mapping.noise import suggest_rmse
from gpszip.model import Options, Track
from gpszip.pipeline.compress import compress
from gpszip.testing import fleet, patrol, person, taxis

__all__ = ["run"]

#: RMSE allowed, relative to that of the log; tables show all, pictures join them to curves.
_FACTORS, _QUICK_FACTORS = (0.5, 1.0, 2.0, 4.0), (1.0, 3.0)

#: Largest error allowed, relative to the RMSE of the log, as where ``compress`` gets no bound.
_MAXIMUM = 4.0

#: Coders of samples on a grid.
_COLUMNS = ("bzip2", "xz", "zstd", "pco")

#: Simplifier whose knots are coded arithmetically, too.
_ARITHMETIC = "bottom-up"

#: Bits of a byte, and bytes of a megabyte.
_BITS, _MEGABYTE = 8, 1e6

#: What pictures show: a simplifier of each kind, and the best coder of samples.
_SHOWN = (
    "GPSZip",
    "bottom-up + arithmetic",
    "TD-TR + pco",
    "SQUISH-E + pco",
    "dead reckoning + pco",
    "Douglas-Peucker + pco",
    "Visvalingam + pco",
    "samples + pco",
)

#: Columns of both tables.
_COLUMNS_OF_TABLES = (
    Column("log", "log"),
    Column("allowed_m", "allowed m", 3),
    Column("method", "method"),
    Column("bytes", "bytes"),
    Column("times_gpszip", "of GPSZip", 2),
    Column("bits_per_point", "bits/point", 3),
    Column("knots", "knots"),
    Column("rmse_m", "RMSE m", 3),
    Column("max_m", "max m", 2),
    Column("points_per_s", "points/s"),
    Column("memory_mb", "memory MB", 1),
)


@dataclass(frozen=True, eq=False)
class _Log:
    """A log, and the RMSE in metres that suits it."""

    name: str
    tracks: tuple[Track, ...]
    rmse: float

    def __len__(self) -> int:
        return sum(map(len, self.tracks))


@dataclass(frozen=True)
class _Result:
    """The file of one method; ``allowed`` is the error that it had to keep."""

    log: str
    points: int
    allowed: float
    method: str
    encoded: Encoded


def run(setting: Setting) -> Outcome:
    """Compress each log with each method within the same RMSE, and within the same maximum."""
    # Lines that were made for one error are there for the others.
    factors = _QUICK_FACTORS if setting.quick else _FACTORS
    by_rmse, by_maximum = [], []
    logs = _logs(setting)
    for log in logs:
        search = Search(log.tracks)
        for factor in factors:
            allowed = factor * log.rmse
            by_rmse += list(_results(log, search, allowed, root_mean_square, quick=setting.quick))
        allowed = _MAXIMUM * log.rmse
        by_maximum += list(_results(log, search, allowed, maximum, quick=setting.quick))

    # Tables, and a picture for each log.
    pictures = tuple(
        Picture(
            log.name,
            f"Bits per point over RMSE of {log.name}, {len(log):,} points.",
            _draw([result for result in by_rmse if result.log == log.name]),
        )
        for log in logs
    )
    tables = (
        _table("rmse", "Files within the same RMSE", by_rmse),
        _table("maximum", "Files within the same maximum error", by_maximum),
    )
    return Outcome(tables, pictures, _notes())


def _logs(setting: Setting) -> list[_Log]:
    """Return the logs: the user's, at the RMSE that ``compress`` would choose, or generated ones.

    Generated logs have the RMSE of table 8.1 or a few times their noise.
    """
    # The user's.
    if setting.logs:
        gaps = find_gaps_of_all(setting.logs, estimate_gap(setting.logs))
        rmse = setting.rmse or suggest_rmse(setting.logs, gaps)
        return [_Log("log", setting.logs, rmse)]

    # Generated ones.
    seed = setting.seed
    if setting.quick:
        return [
            _Log("patrol", (patrol(2_000, seed=seed),), 0.24),
            _Log("taxis", taxis(2, points=200, seed=seed).tracks, 41.0),
        ]
    phone = without_outliers(person(seed=seed).tracks[0])
    return [
        _Log("patrol", (patrol(seed=seed),), 0.24),
        _Log("fleet", fleet(seed=seed).tracks, 10.0),
        _Log("phone", (phone,), 30.0),
        _Log("taxis", taxis(seed=seed).tracks, 41.0),
    ]


def _results(
    log: _Log, search: Search, allowed: float, criterion: Criterion, *, quick: bool
) -> Iterator[_Result]:
    """Yield the file of each method that is installed and holds the error."""
    # GPSZip.
    yield _Result(log.name, len(log), allowed, "GPSZip", _gpszip(log, allowed, criterion, quick))

    # Simplifiers with their coders.
    missing = missing_coders()
    for method in SIMPLIFIERS:
        if not _runs(method, log):
            continue
        for coder in ("arithmetic", "pco") if method.name == _ARITHMETIC else ("pco",):
            if coder not in missing:
                encoded = search.simplified(method, coder, allowed, criterion)
                if encoded is not None:
                    yield _Result(log.name, len(log), allowed, f"{method.name} + {coder}", encoded)

    # All samples.
    for coder in _COLUMNS:
        if coder not in missing:
            encoded = search.on_samples(coder, allowed, criterion)
            if encoded is not None:
                yield _Result(log.name, len(log), allowed, f"samples + {coder}", encoded)


def _gpszip(log: _Log, allowed: float, criterion: Criterion, quick: bool) -> Encoded:
    """Compress with default options, or the least effort, within an RMSE or a maximum."""
    is_maximum = criterion is maximum
    options = Options(max_error=allowed) if is_maximum else Options(rmse=allowed)
    options = replace(options, effort=1) if quick else options
    seconds: dict[str, float] = {}
    with measured_memory() as memory, measured(seconds, "compress"):
        archive, report = compress(log.tracks, options)
    return Encoded(
        bytes=archive.size,
        knots=report.segments + len(log.tracks),
        parameter=None,
        rmse=report.rmse,
        max_error=report.max_error,
        seconds=seconds["compress"],
        memory=memory.bytes,
    )


def _runs(method: Method, log: _Log) -> bool:
    """Whether a method is installed, and ends in reasonable time on a log."""
    is_there = not method.package or is_installed(method.package)
    return is_there and (method.most is None or len(log) <= method.most)


def _notes() -> tuple[str, ...]:
    """Say how rows are made, and name what is not installed."""
    packages = {method.package for method in SIMPLIFIERS if method.package}
    missing = sorted(package for package in packages if not is_installed(package))
    missing += ["pcodec" for _ in missing_coders()]
    notes = [
        "Each row is the smallest file within the error that a search over tolerance and grid "
        "finds; it is decoded and measured at all samples, times included.",
        "Points per CPU second, and memory, are those of making that file once; those of GPSZip "
        "include its own search. Simplifiers without a package are plain NumPy and Python.",
        "A method that holds the error with no parameter that was tried has no row.",
    ]
    if missing:
        notes.append(f"Not installed, and left out: {', '.join(missing)}.")
    return tuple(notes)


def _table(name: str, title: str, results: Sequence[_Result]) -> Table:
    """Return a row for each file, with its size relative to that of GPSZip at the same error."""
    # GPSZip's bytes by log and error.
    own = {
        (each.log, each.allowed): each.encoded.bytes for each in results if each.method == "GPSZip"
    }
    rows = tuple(_row(each, own[each.log, each.allowed]) for each in results)
    return Table(name, title, _COLUMNS_OF_TABLES, rows)


def _row(result: _Result, own: int) -> dict[str, Value]:
    """Return the numbers of one file."""
    # Its size.
    encoded = result.encoded
    row: dict[str, Value] = {
        "log": result.log,
        "allowed_m": result.allowed,
        "method": result.method,
        "bytes": encoded.bytes,
        "times_gpszip": encoded.bytes / own,
        "bits_per_point": _BITS * encoded.bytes / result.points,
        "knots": encoded.knots,
    }

    # Its error, and what it took to make it.
    return row | {
        "rmse_m": encoded.rmse,
        "max_m": encoded.max_error,
        "points_per_s": result.points / max(encoded.seconds, 1e-6),
        "memory_mb": None if encoded.memory is None else encoded.memory / _MEGABYTE,
    }


def _draw(results: Sequence[_Result]) -> FigureType:
    """Draw bits per point over the RMSE reached, a curve for each method that is shown."""
    curves = []
    for method in _SHOWN:
        chosen = [each for each in results if each.method == method]
        if chosen:
            rmses = [each.encoded.rmse for each in chosen]
            bits = [_BITS * each.encoded.bytes / each.points for each in chosen]
            curves.append(Curve(method, rmses, bits))
    return draw_curves(
        curves, "RMSE in metres", "bits per point", log_x=True, log_y=True, beside=True
    )
