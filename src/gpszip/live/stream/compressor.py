"""Learning a stream batch by batch: the archive grows, and only the ends of walks are learned anew.

The first samples are learned together until there are enough for a map. Then the walks become
fixed: each up to its last knot but one. Samples after that knot are kept, and learned with the next
ones, so that a walk has no knot just because a batch ended. Time and memory for a batch depend on
these samples; only coding the archive anew takes longer as it grows.

The bound holds over all samples. Let S be the squared errors of the n samples of the archive that
stay as they are; then r new ones may have the squared errors R with S + R <= (n + r) rmse^2.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive
from gpszip.errors import BoundError, OptionError
from gpszip.geo.outliers import find_outliers
from gpszip.geo.planes import choose_plane, to_plane
from gpszip.io.logs.raw import unused_name
from gpszip.live.rolling.archives import largest_error, reachable
from gpszip.live.stream.order import Ordered, order_rows, sort_rows
from gpszip.live.stream.rows import StreamRows
from gpszip.model import Options, Plane, Report, Track
from gpszip.pipeline.append import append
from gpszip.pipeline.compress import compress
from gpszip.pipeline.continue_tracks import cut_at_knots, last_fixed_knot, track_end
from gpszip.run.executor import Executor
from gpszip.walks.error import positions_at
from gpszip.walks.quantised import knot_times

__all__ = ["FIRST_SAMPLES", "WINDOW_SAMPLES", "StreamCompressor"]

#: Samples that are learned together before walks become fixed: fewer make a poor map.
FIRST_SAMPLES = 20_000

#: Samples after the fixed walks that are kept at most, of all tracks together.
WINDOW_SAMPLES = 50_000

#: Share of the RMSE below which the samples of a batch are not pressed to hold that of all.
_MIN_SHARE = 0.7

#: Largest error of a sample that an archive holds already, as a multiple of its RMSE, where it
#: states no maximum.
_MAX_PER_RMSE = 4.0

#: Metres and seconds from zero that rows may have, as for all tracks.
_MAX_MAGNITUDE = 1e14

#: Metres from the first rows, as a multiple of the bound, that rows in metres may lie: maps with
#: others can't be learned. At an RMSE of 1 cm this is 2,700 km.
_MAX_DISTANCE = 2.0**28

#: Relative excess up to which an error counts as held: the rounding of the measurement.
_ROUNDING = 1e-9

#: What becomes of rows that are not simply taken.
_FAR = "rows more than 400 km from the map left out"
_HUGE = "rows too far from zero left out"
_APART = "rows too far from the first ones for the bound left out"
_REPEATED = "rows at the time of the one before left out"
_LATE = "rows from before the last one of their track left out; --sort puts them in order"
_SORTED = "rows put in the order of time"
_KNOWN = "rows that the archive holds already"
_OUTLIERS = "outliers dropped"
_STARTED_BOUND = "tracks started where the bound could not be held otherwise"
_STARTED = "tracks started where time goes back"

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Samples:
    """Samples of a track on the plane of the archive, at increasing times."""

    times: Floats
    positions: Floats

    def __len__(self) -> int:
        return len(self.times)

    def after(self, end: float) -> _Samples:
        """Return the samples after a time."""
        first = int(np.searchsorted(self.times, end, side="right"))
        return _Samples(self.times[first:], self.positions[first:])

    def joined(self, other: _Samples) -> _Samples:
        """Return both in the order of time."""
        times = np.concatenate([self.times, other.times])
        positions = np.concatenate([self.positions, other.positions])
        if len(self) and len(other) and other.times[0] < self.times[-1]:
            order = np.argsort(times, kind="stable")
            return _Samples(times[order], positions[order])
        return _Samples(times, positions)


@dataclass(frozen=True)
class _Sum:
    """Errors of some samples: the sum of their squares in square metres, and the largest."""

    squares: float = 0.0
    samples: int = 0
    largest: float = 0.0

    def with_errors(self, errors: Floats) -> _Sum:
        """Return the sum with further samples, by their errors in metres."""
        return _Sum(
            self.squares + float((errors**2).sum()),
            self.samples + len(errors),
            max(self.largest, float(errors.max(initial=0.0))),
        )


class StreamCompressor:
    """An archive that takes batches.

    Parameters
    ----------
    options : Options
        Bound, gap and effort. An archive that is continued keeps its own bound.
    archive : Archive, optional
        What is continued.
    sort, split : bool
        Whether rows that go back are put in order, or begin another track.
    clean : bool
        Whether outliers are left out, as far as a batch shows them.
    first_samples, window_samples : int
        Samples that are learned together at first, and that are kept after the fixed walks.
    executor : Executor, optional
        Where maps are learned.

    Raises
    ------
    OptionError
        If rows are to be sorted and tracks split.

    Attributes
    ----------
    archive : Archive or None
        What was compressed so far; None before the first sample.
    points : int
        Samples that it took.
    counts : dict of str to int
        Rows that it left out or put elsewhere, by what was done.

    Examples
    --------
    >>> compressor = StreamCompressor(Options(max_error=0.1))
    >>> for first in (0, 50):
    ...     times = np.arange(first, first + 50.0)
    ...     rows = StreamRows({"a": (times, np.stack([times, 0 * times], axis=1))}, False)
    ...     _ = compressor.add(rows)
    >>> compressor.archive.ids, len(compressor.archive.walk("a").nodes)
    (('a',), 2)
    """

    #: What is counted of rows that the archive has not.
    LOSSES = (_FAR, _HUGE, _APART, _LATE, _OUTLIERS)

    def __init__(
        self,
        options: Options,
        archive: Archive | None = None,
        *,
        sort: bool = False,
        split: bool = False,
        clean: bool = False,
        first_samples: int = FIRST_SAMPLES,
        window_samples: int = WINDOW_SAMPLES,
        executor: Executor | None = None,
    ) -> None:
        if sort and split:
            raise OptionError("--sort and --split exclude each other")
        self.archive = archive
        self.points = 0
        self.counts: dict[str, int] = {}
        self._options, self._sort, self._split, self._clean = options, sort, split, clean
        self._first_samples, self._window_samples = first_samples, window_samples
        self._executor = executor

        # Samples of tracks after their fixed walks; before any are fixed, all of them.
        self._is_begun = archive is not None
        self._window: dict[str, _Samples] = {}
        self._names: dict[str, str] = {}
        self._resumed = set() if archive is None else set(archive.ids)
        self._fixed = _Sum()
        self._report: Report | None = None

    @property
    def errors(self) -> tuple[float, float]:
        """Root mean square and largest error of the samples that were taken, in metres."""
        total = self._with_window(self._fixed, self._window)
        return math.sqrt(total.squares / max(total.samples, 1)), total.largest

    @property
    def report(self) -> Report | None:
        """What was done for the last batch."""
        return self._report

    def add(self, rows: StreamRows) -> bool:
        """Take the rows of a batch; return whether the archive has changed.

        Raises
        ------
        BoundError
            If they can't be held within the bound; the archive stays as it was.
        """
        if not len(rows):
            return False
        names, resumed, counts = dict(self._names), set(self._resumed), dict(self.counts)
        try:
            return self._add(rows)
        except BoundError:
            # Nothing was taken.
            self._names, self._resumed, self.counts = names, resumed, counts
            raise

    def _add(self, rows: StreamRows) -> bool:
        # On the plane of the archive; where there is none, around the first rows.
        self._check_kind(rows)
        plane = self._plane_of(rows)
        center = self._center_of(rows)
        new: dict[str, _Samples] = {}
        for name, (times, coordinates) in rows.tracks.items():
            self._assign(name, self._on_plane(times, coordinates, plane, center), new)
        if not new:
            return False

        # Learn them.
        taken = sum(map(len, new.values()))
        if self._is_begun:
            self._append(new, plane)
        else:
            self._compress_all(new, plane)
        self.points += taken
        self._limit_window()
        return True

    # Which rows are taken

    def _check_kind(self, rows: StreamRows) -> None:
        """Refuse degrees for an archive in metres, and the other way round."""
        if self.archive is None:
            return
        grid = self.archive.grid
        dimension = next(iter(rows.tracks.values()))[1].shape[1]
        if (grid.plane is not None) != rows.geographic or grid.dimension != dimension:
            raise OptionError(
                "the stream has other coordinates than the archive",
                remedy="name another archive with -o",
            )

    def _plane_of(self, rows: StreamRows) -> Plane | None:
        if self.archive is not None:
            return self.archive.grid.plane
        if not rows.geographic:
            return None
        degrees = np.concatenate([coordinates for _, coordinates in rows.tracks.values()])
        return choose_plane(degrees[:, 0], degrees[:, 1])

    def _center_of(self, rows: StreamRows) -> Floats:
        """Position from which the distance of rows in metres is limited."""
        if self.archive is not None:
            return np.array(self.archive.grid.origin, np.float64) / 1000
        coordinates = np.concatenate([each for _, each in rows.tracks.values()])
        # A median of two numbers is their mean, which must not overflow.
        return np.asarray(np.median(coordinates.clip(-_MAX_MAGNITUDE, _MAX_MAGNITUDE), axis=0))

    @property
    def _largest_distance(self) -> float:
        """Metres that rows may be away from there, on each axis."""
        bound = None if self.archive is None else self.archive.error_bound
        known = [self._options.rmse, self._options.max_error]
        if bound is not None:
            known = [bound.metres]
        return _MAX_DISTANCE * min((each for each in known if each is not None), default=math.inf)

    def _on_plane(
        self, times: Floats, coordinates: Floats, plane: Plane | None, center: Floats
    ) -> _Samples:
        """Return rows as samples; those too far from the map, or from zero, are left out."""
        fits = (np.abs(coordinates) <= _MAX_MAGNITUDE).all(axis=1)
        fits &= np.abs(times) <= _MAX_MAGNITUDE
        self._count(_HUGE, int((~fits).sum()))
        times, coordinates = times[fits], coordinates[fits]
        if plane is None:
            near = (np.abs(coordinates - center) <= self._largest_distance).all(axis=1)
            self._count(_APART, int((~near).sum()))
            return _Samples(times[near], coordinates[near])
        if self.archive is not None:
            near = reachable(self.archive, coordinates)
            self._count(_FAR, len(times) - near.sum())
            times, coordinates = times[near], coordinates[near]
        return _Samples(times, to_plane(coordinates[:, 0], coordinates[:, 1], plane))

    def _assign(self, name: str, samples: _Samples, new: dict[str, _Samples]) -> None:
        """Divide the rows of one name among its tracks."""
        # Rows that the archive holds are no news: where it is continued, a log may come again.
        track = self._track_of(name)
        window = self._window.get(track, _Samples(samples.times[:0], samples.positions[:0]))
        samples = self._unknown(track, samples)
        if not len(samples):
            return
        ordered = self._order(track, samples.times, window)
        self._count(_REPEATED, len(ordered.repeated))
        self._count(_LATE, len(ordered.late))

        # Further runs are further tracks.
        for number, run in enumerate(ordered.runs):
            if not len(run):
                continue
            if number:
                known = () if self.archive is None else self.archive.ids
                track = unused_name(name, {*known, *self._window, *new})
                self._count(_STARTED)
            self._names[name] = track
            self._resumed.discard(track)
            taken = self._cleaned(_Samples(samples.times[run], samples.positions[run]))
            new[track] = new[track].joined(taken) if track in new else taken

    def _cleaned(self, samples: _Samples) -> _Samples:
        """Leave out outliers, if that was asked for."""
        if not self._clean:
            return samples
        outliers = find_outliers(samples.times, samples.positions)
        self._count(_OUTLIERS, int(outliers.sum()))
        return _Samples(samples.times[~outliers], samples.positions[~outliers])

    def _track_of(self, name: str) -> str:
        """Return the track to which the rows of a name belong: the last one of that name."""
        if name not in self._names:
            track, number = name, 2
            while f"{name}-{number}" in self._resumed:
                track, number = f"{name}-{number}", number + 1
            self._names[name] = track
        return self._names[name]

    def _order(self, track: str, times: Floats, window: _Samples) -> Ordered:
        """Find out which rows go on, and which go back."""
        # An archive rounds the ends of tracks up.
        end = -math.inf
        if len(window):
            end = float(window.times[-1])
        elif self.archive is not None and track in self.archive.ids:
            end = track_end(self.archive, track)
        if not self._sort:
            return order_rows(times, end, split=self._split)

        # Samples at hand are learned anew, with others between them.
        first = end if not len(window) else np.nextafter(window.times[0], -math.inf)
        ordered, back = sort_rows(times, window.times, first)
        self._count(_SORTED, back)
        return ordered

    def _unknown(self, track: str, samples: _Samples) -> _Samples:
        """Return the samples that the archive doesn't hold within its bound."""
        archive = self.archive
        if archive is None or track not in self._resumed:
            return samples
        is_past = samples.times <= track_end(archive, track)
        if not is_past.any():
            return samples
        bound = archive.error_bound
        limit = largest_error(bound) or (_MAX_PER_RMSE * bound.metres if bound else math.inf)
        errors = np.full(len(samples), np.inf)
        past = _Samples(samples.times[is_past], samples.positions[is_past])
        errors[is_past] = _errors(archive, track, past)
        held = errors <= limit * (1 + _ROUNDING)
        self._count(_KNOWN, int(held.sum()))
        return _Samples(samples.times[~held], samples.positions[~held])

    def _count(self, what: str, number: int = 1) -> None:
        if number:
            self.counts[what] = self.counts.get(what, 0) + int(number)

    # Learning

    def _compress_all(self, new: Mapping[str, _Samples], plane: Plane | None) -> None:
        """Learn all samples so far together."""
        window = self._joined(new)
        archive, report = compress(_tracks(window, plane), self._options, executor=self._executor)
        self._window, self.archive, self._report = window, archive, report

        # Later batches get the gap and the bound of these.
        if sum(map(len, window.values())) >= self._first_samples:
            self._is_begun = True
            self._options = replace(self._options, gap=report.gap)

    def _joined(self, new: Mapping[str, _Samples]) -> dict[str, _Samples]:
        window = dict(self._window)
        for name, samples in new.items():
            window[name] = window[name].joined(samples) if name in window else samples
        return window

    def _append(self, new: dict[str, _Samples], plane: Plane | None) -> None:
        """Learn new samples with those that are kept; if that fails, by themselves."""
        # With the samples that are kept, walks go on without a knot; else from where they end.
        assert self.archive is not None
        cuts = {name: last_fixed_knot(self.archive, name) for name in new if name in self._window}
        for knots in (cuts, {}) if cuts else ({},):
            with contextlib.suppress(BoundError, OptionError):
                self._append_after(knots, new, plane)
                return

        # As further tracks.
        tracks = {track: name for name, track in self._names.items()}
        known = {*self.archive.ids, *self._window}
        others: dict[str, _Samples] = {}
        for track, samples in new.items():
            name = tracks.get(track, track)
            others[unused_name(name, {*known, *others})] = samples
        self._append_after({}, others, plane)
        for track, other in zip(new, others, strict=True):
            self._names[tracks.get(track, track)] = other
            self._count(_STARTED_BOUND)

    def _append_after(
        self, knots: Mapping[str, int | None], new: Mapping[str, _Samples], plane: Plane | None
    ) -> None:
        """Append samples, with those of their tracks that come after some knots."""
        # Samples up to these knots keep the errors that they have; later ones are learned again.
        archive = self.archive
        assert archive is not None
        fixed, window = self._fixed, dict(self._window)
        for name, knot in knots.items():
            end = -math.inf if knot is None else _knot_time(archive, name, knot)
            window[name] = window[name].after(end)
            before = _before(self._window[name], window[name])
            fixed = fixed.with_errors(_errors(archive, name, before))
        learned = {
            name: window[name].joined(samples) if name in knots else samples
            for name, samples in new.items()
        }

        # Walks up to these knots, and what may be added to their errors.
        base = cut_at_knots(archive, knots) if knots else archive
        tracks = _tracks(learned, plane)
        options = self._options_for(archive, fixed, window, learned) if knots else self._unbounded
        if base is None:
            found, report = compress(tracks, options, executor=self._executor)
        else:
            found, report = append(base, tracks, options, executor=self._executor)

        # Only now is anything taken: learning may have failed.
        self.archive, self._fixed, self._report = found, fixed, report
        self._window = window | {
            name: window[name].joined(samples) if name in window else samples
            for name, samples in new.items()
        }

    @property
    def _unbounded(self) -> Options:
        """Options that leave the bound to the archive."""
        return replace(self._options, rmse=None, max_error=None)

    def _options_for(
        self,
        archive: Archive,
        fixed: _Sum,
        window: Mapping[str, _Samples],
        learned: Mapping[str, _Samples],
    ) -> Options:
        """Return options with the RMSE at which all samples together hold that of the archive."""
        bound = archive.error_bound
        if bound is None or bound.maximum:
            return self._unbounded

        # Samples that are not learned now have the errors that they have.
        rest = {name: samples for name, samples in window.items() if name not in learned}
        others = self._with_window(fixed, rest)
        count = sum(map(len, learned.values()))
        square = bound.metres**2
        allowed = (square * (others.samples + count) - others.squares) / count
        rmse = math.sqrt(max(min(allowed, square), 0.0))
        if rmse < _MIN_SHARE * bound.metres:
            raise BoundError("the samples that stay have too large errors")
        return replace(self._options, rmse=rmse, max_error=bound.max_error)

    def _limit_window(self) -> None:
        """Forget samples where there are too many; their walks then stay as they are."""
        if not self._is_begun:
            return
        size = sum(map(len, self._window.values()))
        while size > self._window_samples and self._window:
            assert self.archive is not None
            # Samples before the last knot but one are fixed in any case.
            name = max(self._window, key=lambda each: len(self._window[each]))
            kept = self._window.pop(name)
            knot = last_fixed_knot(self.archive, name)
            rest = kept.after(-math.inf if knot is None else _knot_time(self.archive, name, knot))
            if len(rest) < len(kept) and size - len(kept) + len(rest) <= self._window_samples:
                self._window[name] = rest
            fixed = _before(kept, self._window.get(name, kept.after(math.inf)))
            self._fixed = self._fixed.with_errors(_errors(self.archive, name, fixed))
            size = sum(map(len, self._window.values()))

    def _with_window(self, total: _Sum, window: Mapping[str, _Samples]) -> _Sum:
        """Add the errors that samples have in the archive."""
        if self.archive is not None:
            for name, samples in window.items():
                total = total.with_errors(_errors(self.archive, name, samples))
        return total


def _tracks(samples: Mapping[str, _Samples], plane: Plane | None) -> list[Track]:
    return [Track(name, each.times, each.positions, plane=plane) for name, each in samples.items()]


def _before(all_samples: _Samples, rest: _Samples) -> _Samples:
    """Return the samples before the last ones."""
    count = len(all_samples) - len(rest)
    return _Samples(all_samples.times[:count], all_samples.positions[:count])


def _knot_time(archive: Archive, name: str, knot: int) -> float:
    time_steps = archive.grid_walks.walks[archive.ids.index(name)].time_steps
    return float(knot_times(time_steps[knot : knot + 1], archive.grid)[0])


def _errors(archive: Archive, name: str, samples: _Samples) -> Floats:
    """Distances in metres between samples and a walk; infinite where it doesn't travel."""
    at = positions_at(archive.walk(name), archive.road_map.nodes, samples.times)
    distances = np.linalg.norm(at - samples.positions, axis=1)
    return np.where(np.isnan(distances), np.inf, distances)
