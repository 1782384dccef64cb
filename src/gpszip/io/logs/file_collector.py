"""Clean one file of a log, batch by batch: which rows can be used, and to which tracks they belong.

:class:`FileCollector` drops and counts the rows that can't be used, finds the track of each other
row, and stores these rows. At the end of the file it decides whether the file can be used.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError, NoPositionsError, OptionError
from gpszip.io.logs.clean import (
    add_repair,
    find_usable_rows,
    nothing_usable_error,
    number_shape_points,
    take_rows,
)
from gpszip.io.logs.file_tracks import AssignedRows, FileTracks
from gpszip.io.logs.globe import GlobeCheck
from gpszip.io.logs.log_file import LogFile
from gpszip.io.logs.log_format import CoordinateKind
from gpszip.io.logs.losses import (
    MAX_TINY_LOG_POINTS,
    loss_if_large,
    nearly_lost_error,
    stopped_clock_error,
    time_of_day_error,
)
from gpszip.io.logs.raw import RawLog, UnreadableCell
from gpszip.io.logs.repeats import RepeatedRows
from gpszip.io.logs.row_selection import RowSelection
from gpszip.io.logs.rows import RowStore
from gpszip.io.storage.source import Source
from gpszip.io.values.finite import finite_rows
from gpszip.model.read_result import LeftOut, Loss, Repair
from gpszip.model.selection import EVERYTHING, Selection

__all__ = ["CleaningOptions", "FileCollector"]

#: What at least one row of a file has to have, as messages say it.
_NEEDED = ("time", "position", "time and position")

Rows = NDArray[np.intp]


@dataclass(frozen=True, kw_only=True)
class CleaningOptions:
    """What is done with rows that can't be used as they are.

    Parameters
    ----------
    sort, split, skip_bad, clean : bool
        As for :func:`gpszip.io.logs.read.read_logs`.
    selection : Selection
        Which points are read.

    Raises
    ------
    OptionError
        If points are to be sorted and tracks split, or sorted and selected by area.
    """

    sort: bool = False
    split: bool = False
    skip_bad: bool = False
    clean: bool = False
    selection: Selection = EVERYTHING

    def __post_init__(self) -> None:
        if self.sort and self.split:
            raise OptionError("--sort and --split exclude each other")
        # Where a track leaves the area shows in the order of time only.
        if self.sort and self.selection.bbox is not None:
            raise OptionError(
                "--sort and --bbox exclude each other",
                remedy="compress the whole log, then select from the archive",
            )


class FileCollector:
    """Collects the rows of one file.

    Call :meth:`add` for each batch, then :meth:`finish`. The attributes without an underscore tell
    what the file holds; :meth:`repeat_repairs` and :meth:`losses` complete that when its rows have
    been sorted.

    Parameters
    ----------
    file : LogFile
        The file.
    first_code : int
        Code of its first track.
    store : RowStore
        Gets the rows that can be used.
    options : CleaningOptions
        What is done with the others.
    """

    def __init__(
        self, file: LogFile, first_code: int, store: RowStore, options: CleaningOptions
    ) -> None:
        # What the file holds.
        self.file = file
        self.name = file.name
        self.row_noun = "row"
        self.tracks = FileTracks(first_code)
        self.coordinate_kind = CoordinateKind(geographic=False, dimension=0)
        self.ids_are_titles = False
        self.bytes = 0
        self.rows = 0  # without those that the reader dropped
        self.dropped_by_reader = 0
        self.repairs: list[Repair] = []
        self.left_out: list[LeftOut] = []
        self.dropped_columns: dict[str, None] = {}  # an ordered set
        self.unwanted: set[str] = set()  # names of tracks that are not selected

        # State.
        self._store = store
        self._options = options
        self._reader_repairs: list[Repair] = []
        self._globe = GlobeCheck()
        self.selection = RowSelection(options.selection)
        self._readable: set[str] = set()  # which of _NEEDED some row has
        self._unreadable: tuple[UnreadableCell, ...] = ()
        self._has_times_of_day = False

    @property
    def source(self) -> Source:
        """The file, which was found."""
        assert isinstance(self.file.source, Source)
        return self.file.source

    @property
    def points(self) -> int:
        """Number of points in the file."""
        return self.rows - self.selection.dropped + self.dropped_by_reader

    # Batches

    def add(self, raw: RawLog) -> None:
        """Add a batch of rows.

        Raises
        ------
        InputError
            If time goes back, and points are neither sorted nor tracks split.
        """
        # Find the rows that can be used.
        raw = number_shape_points(raw, self.rows)
        self._describe(raw)
        names = self.tracks.index_names(raw)
        rows = find_usable_rows(raw, self._globe, self.repairs, clean=self._options.clean)
        self._note_readable(raw, rows)

        # Group them by the names of their tracks.
        names = names[rows]
        if (names[1:] < names[:-1]).any():
            order = np.argsort(names, kind="stable")
            rows, names = rows[order], names[order]

        # Keep those that are selected.
        selected, returns = self.selection.find(raw, names, rows)
        if not selected.all():
            self.tracks.forget_rows(names[~selected])
            rows, names, returns = rows[selected], names[selected], returns[selected]

        # Find their tracks, and store them.
        usable = take_rows(raw, rows)
        assigned = self.tracks.assign(names, usable.times, returns, split=self._options.split)
        self._handle_backward_steps(raw, rows, assigned)
        self.tracks.extend(assigned.codes, usable.times, usable.coordinates)
        self._store.add(replace(usable, codes=assigned.codes), raw)

    def _describe(self, raw: RawLog) -> None:
        """Note what a batch says of the file."""
        # What holds for all batches.
        self.name, self.row_noun = raw.name, raw.row_noun
        self.coordinate_kind = CoordinateKind(raw.geographic, raw.coordinates.shape[1])
        self.ids_are_titles = raw.ids_are_titles
        self._has_times_of_day |= raw.time_of_day

        # What adds up.
        self.rows += len(raw.times)
        self.dropped_by_reader += sum(repair.count for repair in raw.repairs if repair.drops)
        self.left_out += raw.left_out
        self.dropped_columns |= dict.fromkeys(raw.dropped_columns)
        for repair in raw.repairs:
            add_repair(self._reader_repairs, repair)

    def _note_readable(self, raw: RawLog, usable: Rows) -> None:
        """Note what rows have, for the error if none can be used."""
        self._unreadable = self._unreadable or raw.unreadable
        # A usable row has all of these. Without one, what some row has is not what the file lacks.
        if len(usable):
            self._readable.update(_NEEDED)
        elif len(self._readable) < len(_NEEDED):
            has_time = np.isfinite(raw.times)
            has_position = finite_rows(raw.coordinates)
            has = (has_time, has_position, has_time & has_position)
            self._readable.update(w for w, rows in zip(_NEEDED, has, strict=True) if rows.any())

    def _handle_backward_steps(self, raw: RawLog, rows: Rows, assigned: AssignedRows) -> None:
        """Record where time goes back, or refuse the file."""
        # Where does it so first?
        goes_back = np.flatnonzero(assigned.steps < 0)
        if not len(goes_back):
            return
        first = goes_back[rows[goes_back].argmin()]
        location = f"{raw.row_noun} {raw.first + int(rows[first])}"

        # Errors of positions come first, as they show that columns were misread.
        self._globe.check(skip_bad=self._options.skip_bad)
        if self._has_times_of_day and not self._options.split:
            raise time_of_day_error(raw.name, location)

        # Tracks are split already; points are put in order when all are read.
        if self._options.sort:
            what = "points put in the order of time"
        elif self._options.split:
            what = "tracks started where time goes back"
        else:
            raise InputError(
                f"time goes back {-assigned.steps[first]:.6g} s",
                path=raw.name,
                location=location,
                remedy="--sort orders the points, --split starts a new track",
            )
        where = f"{raw.name}: {location}"
        add_repair(self.repairs, Repair(what, len(goes_back), where, drops=False))

    # The end of the file

    def finish(self) -> None:
        """Check that the file can be used, and leave out tracks whose clock stood still.

        Raises
        ------
        InputError
            If at most one of several rows can be used, positions are not on the globe, or all
            points of a track have one time.
        """
        # Some row must have a time and a position.
        if not self.rows + self.dropped_by_reader:
            raise NoPositionsError("columns, but no rows", path=self.name)
        for what in _NEEDED:
            if what not in self._readable:
                raise nothing_usable_error(self.name, self.row_noun, what, self._unreadable)
        self._globe.check(skip_bad=self._options.skip_bad)
        self._leave_out_stopped_tracks()

        # A long log of which at most one row is left was likely misread; a tiny one may be short.
        # Rows at one time count as one, since only the first of them would be kept.
        rows, elsewhere = self.tracks.rows_at_only_time()
        if rows and self.rows - self.selection.dropped > MAX_TINY_LOG_POINTS:
            repeats = self._describe_repeats((rows - 1 - elsewhere, 0), (elsewhere, 0))
            causes = [*self.repairs, *repeats]
            raise nearly_lost_error(self.name, self.rows, self.row_noun, causes)

        # What the reader repaired comes first.
        self.bytes = self.source.log_bytes(self.points, self.coordinate_kind.dimension)
        self.repairs = [*self._reader_repairs, *self.repairs]

    def _leave_out_stopped_tracks(self) -> None:
        """Refuse tracks whose points all have the same time, or leave them out."""
        # Describe each of them.
        tracks = self.tracks.stopped_tracks()
        errors = []
        for track in tracks:
            name = self.tracks.names[track["name"]] or ""
            count, time = int(track["rows"]), float(track["first_time"])
            errors.append((name, stopped_clock_error(self.name, name, count, self.row_noun, time)))
            self.repairs.append(Repair(f"points of track {name!r} left out", count, self.name))

        # Raise, unless other tracks remain and bad ones may be left out.
        # They are marked first, so that named_tracks() returns the tracks that remain.
        self.tracks.left_out.update(tracks["name"].tolist())
        if errors and not (self._options.skip_bad and self.tracks.named_tracks()):
            raise errors[0][1]
        for name, error in errors:
            self.left_out.append(LeftOut(f"{self.name}: track {name!r}", error.detail))

    # When the rows have been sorted

    def repeat_repairs(self, repeated: RepeatedRows) -> list[Repair]:
        """Return the repairs for rows of this file at times that other rows have, too."""
        # The codes of a file are consecutive, so its tracks are a slice of all counts.
        own = slice(self.tracks.first_code, self.tracks.next_code)
        at_same = int(repeated.at_same[own].sum()), repeated.first_same[own].min()
        at_other = int(repeated.at_other[own].sum()), repeated.first_other[own].min()
        return self._describe_repeats(at_same, at_other)

    def _describe_repeats(
        self, at_same: tuple[int, float], at_other: tuple[int, float]
    ) -> list[Repair]:
        """Return repairs from counts, each with the number of the first row."""
        noun = self.row_noun
        kinds = (
            (f"repeated {noun}s dropped", *at_same),
            (f"{noun}s at another position, but the same time dropped", *at_other),
        )
        return [
            Repair(what, count, f"{self.name}: {noun} {first:.0f}")
            for what, count, first in kinds
            if count
        ]

    def losses(self, repeated: RepeatedRows, unnamed: str) -> list[Loss]:
        """Return the large losses of this file.

        Parameters
        ----------
        repeated : RepeatedRows
            What was dropped because of its time.
        unnamed : str
            Name of the track if the file names none.
        """
        # Add up the rows of each name.
        tracks, name_count = self.tracks.tracks, len(self.tracks.names)
        own = slice(self.tracks.first_code, self.tracks.next_code)
        # A dropped row that repeats the position as well is no loss; one at another position is.
        at_other = repeated.at_other[own]
        usable = np.bincount(tracks["name"], tracks["rows"] - at_other, minlength=name_count)
        lost = (self.tracks.points - usable).astype(np.int64)
        shared = np.zeros(name_count, np.int64)
        np.maximum.at(shared, tracks["name"], repeated.shared[own])

        # Rows that the reader itself dropped can't be assigned to a track.
        losses = loss_if_large("", self.name, self.dropped_by_reader, self.points)
        left_out = {item.name for item in self.left_out}
        for i in np.flatnonzero(lost).tolist():
            name = self.tracks.names[i]
            if f"{self.name}: track {name!r}" not in left_out:
                track = unnamed if name is None else name
                if track in self.unwanted:
                    continue
                points = int(self.tracks.points[i])
                losses += loss_if_large(track, self.name, int(lost[i]), points, int(shared[i]))
        return losses
