"""Read and clean all files of a log, wherever its rows are kept.

:func:`collect_log` is the one way from files to rows: for logs in memory
(:mod:`gpszip.io.logs.read`), where each file is one batch, and for logs on disk
(:mod:`gpszip.io.large.store`).

1. Read each file batch by batch; drop the rows that can't be used, and find the track of each other
   row (:class:`gpszip.io.logs.file_collector.FileCollector`).
2. Name and join the tracks of all files (:func:`gpszip.io.logs.join.join_tracks`).
3. Sort the rows of each track, and drop those at a time that an earlier row has
   (:func:`gpszip.io.logs.repeats.drop_repeated_rows`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import PurePosixPath

from gpszip.errors import InputError, UnknownTrackError
from gpszip.io.logs.file_collector import CleaningOptions, FileCollector
from gpszip.io.logs.join import JoinedTrack, join_tracks, name_of_unnamed
from gpszip.io.logs.log_file import LogFile, mismatch_error
from gpszip.io.logs.repeats import RepeatedRows, drop_repeated_rows
from gpszip.io.logs.rows import Floats, LogRows, RowStore
from gpszip.model import Track
from gpszip.model.read_result import LeftOut, Loss, OtherFiles, ReadResult, Repair
from gpszip.model.selection import Selection
from gpszip.model.timestamps import format_span

__all__ = ["CollectedLog", "collect_log"]

#: Why most files of an export are left out.
_NO_LOG = "without positions"

#: What stands for the suffix of a file without one.
_NO_SUFFIX = "without a suffix"

#: Names of tracks that an error lists of a log with more.
_MAX_LISTED_TRACKS = 5


@dataclass(eq=False)
class CollectedLog:
    """The tracks of all files, whose rows are in a store.

    Parameters
    ----------
    files : list of FileCollector
        Files that were read.
    errors : list of InputError
        Why other files were left out.
    other_files : tuple of OtherFiles
        Files of folders and archives that hold no log, or one that another file holds, too.
    is_alone : bool
        Whether only one log was named.
    tracks : list of JoinedTrack
        In the order in which the files first name them.
    """

    files: list[FileCollector]
    errors: list[InputError]
    other_files: tuple[OtherFiles, ...]
    is_alone: bool
    tracks: list[JoinedTrack]
    _store: RowStore
    _ends_before: Floats
    _repeated: RepeatedRows
    _repairs: list[Repair] = field(default_factory=list)
    _not_selected: int = 0

    @property
    def geographic(self) -> bool:
        """Whether coordinates are latitude and longitude in degrees."""
        return self.files[0].coordinate_kind.geographic

    @property
    def dimension(self) -> int:
        """Number of coordinates."""
        return self.files[0].coordinate_kind.dimension

    @property
    def code_count(self) -> int:
        """Number above the codes of all tracks."""
        return len(self._ends_before)

    def sorted_rows(self) -> Iterator[LogRows]:
        """Yield the rows of all tracks in blocks, once; see :class:`RowStore`.

        Each track's times strictly increase. The result of reading is complete after the last one.
        """
        codes = [code for track in self.tracks for code in track.codes]
        blocks = self._store.sorted_rows(codes)
        yield from drop_repeated_rows(blocks, self._ends_before, self._repeated)
        if not self._repeated.in_two_files.any():
            return
        for track in self.tracks:
            if count := int(self._repeated.in_two_files[list(track.codes)].sum()):
                what = "points at a time that another file has, too, dropped"
                self._repairs.append(Repair(what, count, track.where))

    def read_result(self, tracks: Sequence[Track], repairs: Iterable[Repair]) -> ReadResult:
        """Return the result of reading.

        Parameters
        ----------
        tracks : sequence of Track
            The tracks, if they are in memory.
        repairs : iterable of Repair
            What was repaired after the rows had been sorted.
        """
        # Collect by file.
        of_files: list[Repair] = []
        losses: list[Loss] = []
        left_out: list[LeftOut] = []
        dropped_columns: dict[str, None] = {}
        for file in self.files:
            of_files += [*file.repairs, *file.repeat_repairs(self._repeated)]
            losses += file.losses(self._repeated, name_of_unnamed(file, is_alone=self.is_alone))
            left_out += file.left_out
            dropped_columns |= file.dropped_columns

        # Add what concerns several files, and files that were left out.
        left_out += [LeftOut(str(error.path), error.detail) for error in self.errors]
        return ReadResult(
            tracks=tuple(tracks),
            points=sum(file.points for file in self.files) - self._not_selected,
            bytes=sum(file.bytes for file in self.files),
            geographic=self.geographic,
            repairs=(*of_files, *self._repairs, *repairs),
            left_out=tuple(left_out),
            dropped_columns=tuple(dropped_columns),
            losses=tuple(losses),
            not_selected=self._not_selected + sum(file.selection.dropped for file in self.files),
            other_files=self.other_files,
        )


def collect_log(
    log_files: Iterable[LogFile], store: RowStore, options: CleaningOptions
) -> CollectedLog:
    """Read and clean all files of a log.

    Parameters
    ----------
    log_files : iterable of LogFile
        The files.
    store : RowStore
        Keeps their rows.
    options : CleaningOptions
        What is done with rows that can't be used as they are.

    Raises
    ------
    InputError
        If a file can't be read or used and may not be left out, logs in degrees and in metres come
        together, or there is no log.
    """
    # Read file by file.
    files: list[FileCollector] = []
    errors: list[InputError] = []
    others = _OtherFiles()
    logs: set[str] = set()
    next_code = 0
    for log_file in log_files:
        logs.add(log_file.log)
        file = FileCollector(log_file, next_code, store, options)
        try:
            for raw in log_file.batches():
                file.add(raw)
            file.finish()
            _check_coordinates(file, files)
            store.end_file()
            files.append(file)
        except InputError as error:
            if not log_file.may_be_left_out:
                raise
            store.drop_file()
            if not others.add(log_file, error):
                errors.append(error.located_at(log_file.name))
        next_code = file.tracks.next_code
    if not files:
        raise _nothing_read_error(errors, others)

    # Join the tracks of all files.
    repairs: list[Repair] = []
    is_alone = len(logs) == 1
    tracks, ends_before = join_tracks(files, is_alone=is_alone, repairs=repairs)
    repeated = RepeatedRows.empty(len(ends_before))

    # Leave out the tracks that nobody asked for.
    selection = options.selection
    chosen, not_selected = _choose_tracks(tracks, files, selection, is_alone=is_alone)
    if not chosen and not selection.is_everything:
        raise _nothing_selected_error(files, selection)
    return CollectedLog(
        files,
        errors,
        others.listed(),
        is_alone,
        chosen,
        store,
        ends_before,
        repeated,
        repairs,
        not_selected,
    )


class _OtherFiles:
    """Counts the files of folders and archives that hold no log, or one that another file has."""

    def __init__(self) -> None:
        self.first_error: InputError | None = None
        self._counts: dict[tuple[str, str], Counter[str]] = {}

    def add(self, file: LogFile, error: InputError) -> bool:
        """Count a file, unless its error means that it is a log that can't be read."""
        if not file.skipped and not file.is_stray(error):
            return False
        self.first_error = self.first_error or error.located_at(file.name)
        suffix = PurePosixPath(file.name.lower().removesuffix(".gz")).suffix
        counts = self._counts.setdefault((file.collection, file.skipped or _NO_LOG), Counter())
        counts[suffix or _NO_SUFFIX] += 1
        return True

    def listed(self) -> tuple[OtherFiles, ...]:
        """Return what was counted, in the order in which it was first met."""
        return tuple(
            OtherFiles(where, why, counts.total(), tuple(counts.most_common()))
            for (where, why), counts in self._counts.items()
        )


def _choose_tracks(
    tracks: list[JoinedTrack],
    files: Sequence[FileCollector],
    selection: Selection,
    *,
    is_alone: bool,
) -> tuple[list[JoinedTrack], int]:
    """Return the tracks that are asked for, and the number of rows of all others.

    A name stands for all tracks of that name in a file, such as those split where time goes back.
    """
    if not selection.tracks:
        return tracks, 0

    # The name of each code in its file, and how many rows it has.
    names: dict[int, str] = {}
    rows: dict[int, int] = {}
    for file in files:
        unnamed = name_of_unnamed(file, is_alone=is_alone)
        for code in range(file.tracks.first_code, file.tracks.next_code):
            name = file.tracks.base_name(code)
            names[code] = unnamed if name is None else name
            rows[code] = int(file.tracks.tracks["rows"][code - file.tracks.first_code])

    # Refuse names that no track has.
    known = {track.name for track in tracks} | set(names.values())
    for wanted in selection.tracks:
        if wanted not in known:
            listed = ", ".join(repr(track.name) for track in tracks[:_MAX_LISTED_TRACKS])
            more = ", ..." if len(tracks) > _MAX_LISTED_TRACKS else ""
            raise UnknownTrackError(
                f"there is no track {wanted!r} in the log; it has {listed}{more}"
            )

    wanted_names = set(selection.tracks)
    chosen = [
        track
        for track in tracks
        if track.name in wanted_names or names[track.codes[0]] in wanted_names
    ]
    own = {code for track in chosen for code in track.codes}
    others = {code for track in tracks for code in track.codes} - own
    # Nobody asked for what these tracks lost, either.
    for file in files:
        file.unwanted = {
            names[code] for code in others if file.tracks.first_code <= code < file.tracks.next_code
        } - {names[code] for code in own}
    return chosen, sum(rows[code] for code in others)


def _nothing_selected_error(files: Sequence[FileCollector], selection: Selection) -> InputError:
    """Return the error if no row is selected, with the time range of the log."""
    first = min(file.selection.first_time for file in files)
    last = max(file.selection.last_time for file in files)
    has = f"; the log has {format_span(first, last)}" if first <= last else ""
    where = "" if selection.bbox is None else f" in the box {selection.bbox}"
    return InputError(f"no point is selected{where}{has}", remedy="give another selection")


def _check_coordinates(file: FileCollector, before: Sequence[FileCollector]) -> None:
    """Refuse a file whose coordinates are not those of the first one: all share one plane."""
    kind = file.coordinate_kind
    if before and kind != before[0].coordinate_kind:
        raise mismatch_error(file.name, kind, before[0].name, before[0].coordinate_kind)


def _nothing_read_error(errors: Sequence[InputError], others: _OtherFiles) -> InputError:
    """Return the error if no log can be read."""
    # Only files that are no logs: a single one says why itself.
    if not errors and others.first_error is not None:
        listed = others.listed()
        if sum(each.count for each in listed) == 1:
            return others.first_error
        return InputError(
            f"no log in it, only {'; '.join(map(str, listed))}",
            path=listed[0].where,
            remedy="'gpszip formats' lists what can be read",
        )
    if not errors:
        return InputError("no log given", remedy="name a file, a pattern or - for standard input")
    if len(errors) == 1:
        return errors[0]
    return InputError(f"none of {len(errors)} logs can be read; the first: {errors[0]}")
