"""An archive: a road map, the walks of all tracks on it, and the questions that they answer."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gpszip.archive.exact import find_exact_logs, find_kept
from gpszip.archive.facts import count_facts, file_facts
from gpszip.archive.frames import ArchiveFrames
from gpszip.archive.pieces import (
    add_points,
    build_pieces,
    pieces_by_track,
    plain_names,
    time_range_of_piece,
)
from gpszip.archive.track_view import TrackView
from gpszip.container.attributes import KeptColumns
from gpszip.container.catalog import group_heads, stored_size
from gpszip.container.contents import Contents, MapReference
from gpszip.container.layout import CURVE_KINDS
from gpszip.container.map_record import map_hash
from gpszip.container.writer import archive_size, save, to_bytes
from gpszip.errors import CorruptArchiveError, MapError, OptionError, UnknownTrackError
from gpszip.lossless.kept import read_kept, read_kept_names
from gpszip.model.clean_map import CleanMap
from gpszip.model.error_bound import ErrorBound
from gpszip.model.grid import QuantisationGrid, refined_grid, step_size
from gpszip.model.grid_walks import GridWalk, GridWalks, ends_of_walks, refined
from gpszip.model.html import to_html
from gpszip.model.merge_report import MergeReport
from gpszip.model.projection import map_coordinates
from gpszip.model.report import Report
from gpszip.model.road_map import RoadMap
from gpszip.model.selection import make_selection
from gpszip.model.text import axes_text, count_text
from gpszip.model.timestamps import Times, format_span, to_seconds, wrong_unit
from gpszip.model.track import Track
from gpszip.model.walk import Walk, cut_at_gaps

if TYPE_CHECKING:
    from gpszip.codec.curves import CurveColumn
    from gpszip.codec.prior import Prior
    from gpszip.codec.waypoints import Waypoints
    from gpszip.graph.road_graph import RoadGraph

__all__ = ["Archive"]

#: A node this many times the error bound from where a track ends is not drawn as its end.
_TRIM_FACTOR = 2.0

#: Seconds outside of a piece at which it still answers: as in :mod:`gpszip.walks.error`, which is
#: not imported before the first position.
_TIME_SLACK = 1e-3

#: Ids that an error lists of an archive with more tracks.
_MAX_LISTED_IDS = 5


@dataclass(frozen=True, eq=False, repr=False)
class Archive(ArchiveFrames):
    """A road map that was learned from tracks, and one walk on it for each track.

    Get one from :func:`gpszip.compress` or :func:`gpszip.open`. Whatever is asked is decoded when
    it is first asked for, and kept from then on. A large archive comes in groups of tracks;
    questions about one track decode its group alone.

    ``archive["walk-3"]`` is one track, ``len(archive)`` is their number, iterating yields their
    ids, and ``"walk-3" in archive`` says whether there is such a track.

    Parameters
    ----------
    contents : Contents
        What the file holds.
    map : Archive, optional
        The map on which the walks lie, where the file does not hold it.
    report : Report or MergeReport, optional
        What was done and measured when the archive was made; None for one that was opened.

    Examples
    --------
    >>> from gpszip.archive import new_archive
    >>> from gpszip.model import GridWalk
    >>> walk = GridWalk(np.array([0, 1], np.int32), np.array([0, 10]), np.array([False]))
    >>> grid = QuantisationGrid((0, 0), 0, 128, 128)
    >>> archive = new_archive(grid, ["walk-3"], GridWalks(np.array([[0, 0], [5, 0]]), (walk,)))
    >>> archive.ids, archive.position("walk-3", 4.0).tolist()
    (('walk-3',), [2.0, 0.0])
    """

    contents: Contents
    map: Archive | None = None
    report: Report | MergeReport | None = None
    _decoded_groups: dict[int, GridWalks] = field(default_factory=dict)
    _priors: dict[int, Prior] = field(default_factory=dict)

    def __repr__(self) -> str:
        # Nothing is decoded here, nor read from the file.
        facts = [count_text(self.contents.tracks, "track")]
        if self.error_bound is not None:
            facts.append(str(self.error_bound))
        if self.contents.grid is None and self.map is None:
            facts.append("on a known map")
        else:
            facts.append(axes_text(self.grid.dimension, self.grid.plane))
        return f"Archive({', '.join(facts)})"

    def _repr_html_(self) -> str:
        return to_html("show_archive", self)

    def __len__(self) -> int:
        return len(self.ids)

    def __iter__(self) -> Iterator[str]:
        return iter(self.ids)

    def __contains__(self, track: object) -> bool:
        return track in self._number_by_id

    def __getitem__(self, track: str) -> TrackView:
        """One track.

        Raises
        ------
        UnknownTrackError
            If there is no such track; it is a KeyError, too.
        """
        self._track_number(track)
        return TrackView(self, track)

    # What there is.

    @property
    def ids(self) -> tuple[str, ...]:
        """Names of the tracks."""
        # A single track may leave its name to the map: it is that of the map's first track.
        return self._known_map.ids[:1] if self.contents.ids is None else self.contents.ids

    @property
    def grid(self) -> QuantisationGrid:
        """The grid on which nodes and times are kept, and the plane of a log in degrees.

        Raises
        ------
        MapError
            If the archive lies on a map that was not given.
        """
        if self.contents.grid is not None:
            return self.contents.grid
        return refined_grid(self._known_map.grid, self._reference.refinements)

    @property
    def timed(self) -> bool:
        """Whether any track has times."""
        from gpszip.codec.payload_head import has_times

        # All groups are coded with times or all without, so that the first one tells.
        return has_times(self.contents.groups[0].payload)

    @cached_property
    def untimed(self) -> tuple[str, ...]:
        """Names of the tracks without times, of which only the shape is kept."""
        return tuple(walk.id for walk in self.walks if walk.times is None)

    @cached_property
    def time_range(self) -> tuple[float, float] | None:
        """First and last time of all tracks in seconds, to about a step of the grid.

        None for an archive without times.
        """
        # The groups of a large archive have their time ranges in the index.
        if not self.timed:
            return None
        ranges = [self._time_step_range(number) for number in range(len(self.contents.groups))]
        known = [steps for steps in ranges if steps is not None]
        if not known:
            return None

        # From time steps to seconds.
        first, last = min(steps[0] for steps in known), max(steps[1] for steps in known)
        step, epoch = step_size(self.grid.time), self.grid.epoch / 1000
        return epoch + first * step, epoch + last * step

    @property
    def error_bound(self) -> ErrorBound | None:
        """The error that no track exceeds: the bound asked for, or else the error measured."""
        return self.contents.error_bound

    @property
    def sampling(self) -> float | None:
        """About the seconds between two samples of the log; None where that is not kept."""
        return None if self.contents.sampling is None else step_size(self.contents.sampling)

    def info(self, *, decode: bool = False) -> dict[str, Any]:
        """What the archive is, as plain values.

        Parameters
        ----------
        decode : bool, default False
            Decode the walks, too, for the counts of nodes, edges, segments (``parts``) and
            waypoints, and for the span of time.
        """
        facts = file_facts(self)
        return {**facts, **count_facts(self)} if decode else facts

    # The map and the walks.

    @cached_property
    def grid_walks(self) -> GridWalks:
        """Map and walks as integers on ``grid``."""
        from gpszip.walks.quantised import merge_grid_walks

        # Nodes at the same position in several groups become one.
        groups = [self._decode_group(number) for number in range(len(self.contents.groups))]
        return groups[0] if len(groups) == 1 else merge_grid_walks(groups)

    @cached_property
    def road_map(self) -> RoadMap:
        """Nodes and edges that the tracks share, in metres."""
        from gpszip.walks.quantised import dequantise_road_map

        return dequantise_road_map(self.grid_walks, self.grid)

    @cached_property
    def walks(self) -> tuple[Walk, ...]:
        """One walk over the nodes of ``road_map`` for each track, in the order of ``ids``."""
        from gpszip.walks.quantised import dequantise_walks

        return dequantise_walks(self.grid_walks, self.grid, self.ids)

    def walk(self, track: str) -> Walk:
        """Walk of one track over the nodes of ``road_map``.

        Raises
        ------
        UnknownTrackError
            If there is no such track.
        """
        return self.walks[self._track_number(track)]

    def waypoints(self, track: str) -> Waypoints:
        """Fewest nodes from which shortest paths give a track's walk back (thesis, Algorithm 6).

        This is what the thesis would store of the walk, for comparison; the archive codes it in
        fewer bits. :func:`gpszip.codec.waypoints.expand_waypoints` gives the walk back.

        Raises
        ------
        UnknownTrackError
            If there is no such track.
        """
        from gpszip.codec.waypoints import find_waypoints
        from gpszip.graph.route import build_route

        walk = self.walk(track)
        return find_waypoints(self._graph, build_route(self._graph, walk.nodes, walk.gaps))

    def clean_map(self, min_traversals: int = 1) -> CleanMap:
        """One edge for each street between junctions, with how often and how fast it was travelled.

        Parameters
        ----------
        min_traversals : int, default 1
            Leave out edges that were travelled less often, both directions together.
        """
        return self._clean_map if min_traversals <= 1 else self._make_clean_map(min_traversals)

    @cached_property
    def _clean_map(self) -> CleanMap:
        """The clean map of all edges, which matching and histories ask for again and again."""
        return self._make_clean_map(1)

    def _make_clean_map(self, min_traversals: int) -> CleanMap:
        from gpszip.simplification.simplify import clean_map

        # The size of a node's step is the scale of the errors that cleaning removes.
        road_map, walks = self._trimmed
        return clean_map(
            road_map,
            walks,
            step_size(self.grid.space),
            sampling=self.sampling,
            min_traversals=min_traversals,
        )

    @property
    def trimmed_map(self) -> RoadMap:
        """The road map as far as tracks went.

        An edge that leads on beyond the end of its track is cut there, at a node of its own.
        """
        return self._trimmed[0]

    @property
    def trimmed_walks(self) -> tuple[Walk, ...]:
        """Walks over the nodes of :attr:`trimmed_map`."""
        return self._trimmed[1]

    @property
    def off_map_lines(self) -> list[NDArray[np.float64]]:
        """Lines off the known map, in metres: float64 arrays of shape (n, d)."""
        if self._prior is None:
            return []

        # Nodes that the map doesn't have: those whose first copy is among the archive's.
        known, nodes = self._prior.walks.nodes, self.grid_walks.nodes
        _, first, number = np.unique(
            np.concatenate([known, nodes]), axis=0, return_index=True, return_inverse=True
        )
        is_new = first[number.reshape(-1)[len(known) :]] >= len(known)
        return [
            line
            for walk in self.walks
            for line in _off_map_lines(walk, is_new, self.road_map.nodes)
        ]

    # Where tracks were.

    def position(self, track: str, when: Times, *, metres: bool = False) -> NDArray[np.float64]:
        """Where a track was at given times.

        Parameters
        ----------
        track : str
            Name of the track.
        when : array_like of any shape
            ``datetime``, ``numpy.datetime64``, ISO 8601 text, or seconds as the log counts them:
            mostly since 1970. Dates without a time zone are in UTC. In any order.
        metres : bool, default False
            Answer in metres on the plane (:attr:`grid`) also for a log in degrees.

        Returns
        -------
        float64 array, shape (..., d)
            Latitude and longitude for a log in degrees, x, y[, z] for any other. NaN where no
            travel is claimed: before the track, after it, and in gaps.

        Raises
        ------
        UnknownTrackError
            If there is no such track.
        OptionError
            If the track has no times, or ``when`` looks like another unit or another zero than the
            log's: milliseconds, or seconds from the start of a log that counts from 1970.
        """
        # Metres on the plane, one row for each time.
        times = to_seconds(when, name="when")
        positions = self._positions(track, times.reshape(-1))

        # If all of them are NaN, the times may be in a wrong unit.
        if times.size and np.isnan(positions[:, 0]).all():
            self._check_unit(times)
        if not metres:
            positions = map_coordinates(positions, self.grid.plane)
        return positions.reshape(*times.shape, self.grid.dimension)

    def decompress(self, track: str | None = None) -> list[Track]:
        """Tracks of the knots, between which every track is linear in time.

        A track with gaps comes back as its pieces between them, named ``id/0``, ``id/1`` and so on,
        or ``id//0`` and so on where a name is taken; any other keeps its id. Each piece begins at
        its first sample and ends at its last. A track without times comes back as a shape: its
        ``times`` are distances along it in metres, and its ``timed`` is False. Columns within an
        error are attributes; their knots are further points on the lines.

        Parameters
        ----------
        track : str, optional
            Only this track.
        """
        # One track needs its group alone.
        plane = self.grid.plane
        if track is not None:
            walk, positions = self._knots(track)
            pieces = build_pieces(walk, positions, self._named_pieces(walk), plane)
            return self.with_curves(track, pieces, at_knots=True)

        nodes = self.road_map.nodes
        return [
            piece
            for walk in self.walks
            for piece in self.with_curves(
                walk.id, build_pieces(walk, nodes, self._pieces[walk.id], plane), at_knots=True
            )
        ]

    @property
    def pieces(self) -> Mapping[str, str]:
        """Name of the track that each piece belongs to, by the piece names of ``decompress``."""
        return {name: track for track, pieces in self._pieces.items() for name, _ in pieces}

    def select(
        self,
        *,
        tracks: str | Iterable[str] = (),
        since: Times | None = None,
        until: Times | None = None,
        bbox: Sequence[float] | None = None,
    ) -> Archive:
        """An archive of some tracks, of a time range or of an area; nothing is learned anew.

        Parameters
        ----------
        tracks : str or iterable of str
            Names of tracks; all by default.
        since, until : time, optional
            From when and until when travel counts, given as for :meth:`position`. Tracks without
            times are left out.
        bbox : sequence of four floats, optional
            The area: west, south, east, north in degrees, or x from, y from, x to, y to in metres.
            A track that leaves it and comes back has a gap in between.

        Returns
        -------
        Archive
            The same knots. It states the largest error if this archive does: a root mean square
            error need not hold for a part.

        Raises
        ------
        UnknownTrackError
            If there is no such track.
        OptionError
            If nothing is selected, or a value is no time or no area.
        """
        from gpszip.archive.select import select

        return select(self, make_selection(tracks, since, until, bbox))

    def shapes(self) -> list[tuple[str, NDArray[np.float64]]]:
        """Lines of all pieces, without times.

        Returns
        -------
        list of (str, float64 array of shape (n, d))
            Name of each piece, as for :meth:`decompress`, and positions of its knots in metres.
        """
        return [(piece.id, piece.positions) for piece in self.decompress()]

    def sample(
        self, every: float | None = None, *, at: Times | None = None, track: str | None = None
    ) -> list[Track]:
        """Tracks sampled anew.

        Parameters
        ----------
        every : float, optional
            Seconds; samples lie at its multiples.
        at : array_like, shape (n,), optional
            Samples lie at these times, given as for :meth:`position`. Give one of ``every`` and
            ``at``.
        track : str, optional
            Only this track.

        Returns
        -------
        list of Track
            Named as by :meth:`decompress`. Pieces without a sample are left out, and so are tracks
            without times among others that have some.

        Raises
        ------
        UnknownTrackError
            If there is no such track.
        OptionError
            If none or both of ``every`` and ``at`` are given, a value is no time, the times look
            like another unit than the log's, or no track that is asked for has times.
        """
        # Read the times asked for, in seconds; multiples of ``every`` follow for each piece.
        times = _check_times(every, at)

        # One track, or the groups that may have travel at these times.
        if track is not None:
            walk, positions = self._knots(track)
            sampled = self._sample_walk(walk, positions, every, times)
        elif not self.timed:
            raise _no_times(self.ids[0] if self.ids else "")
        else:
            sampled = []
            for number in self._groups_at(None if every is not None else times):
                walks, nodes = self.walks_of_group(number)
                for walk in walks:
                    if walk.times is not None:
                        sampled += self._sample_walk(walk, nodes, every, times)
        if not sampled and len(times):
            self._check_unit(times)
        return sampled

    # The logs themselves.

    @cached_property
    def exact_names(self) -> tuple[str, ...]:
        """Names of the logs that are kept byte by byte, in their order."""
        logs = find_exact_logs(self)
        return () if logs is None else tuple(log.name for log in logs.logs)

    def exact_log(self, name: str, first: int = 0, count: int | None = None) -> bytes:
        """Bytes of a log that is kept exactly.

        Parameters
        ----------
        name : str
            One of :attr:`exact_names`.
        first : int, default 0
            First byte.
        count : int, optional
            Number of bytes; by default all up to the end. Only the blocks that hold them are
            decoded.

        Raises
        ------
        OptionError
            If there is no such log.
        CorruptArchiveError
            If its bytes are damaged.

        Examples
        --------
        >>> import gpszip
        >>> gpszip.compress(gpszip.Track("0", [0, 1], [[0, 0], [1, 1]]), rmse=1).exact_names
        ()
        """
        if name not in self.exact_names:
            raise OptionError(
                f"no log {name!r} is kept exactly", remedy="exact_names lists those that are"
            )
        logs = find_exact_logs(self)
        assert logs is not None
        return b"".join(logs.read(self.exact_names.index(name), first, count))

    def exact_rows(
        self,
        track: str | None = None,
        columns: Sequence[str] | None = None,
        log: str | None = None,
    ) -> Any:
        """Rows of a track, or all, of logs that are kept exactly, and all columns or some.

        Parameters
        ----------
        track : str, optional
            Name of a track; by default rows of all tracks.
        columns : sequence of str, optional
            Names of columns in the log; by default all.
        log : str, optional
            One of :attr:`exact_names`; by default all logs that have the track.

        Returns
        -------
        pyarrow.Table
            Rows in the order of the log. Cells of text are texts, with the digits that the log has;
            columns of Parquet have their own types.

        Raises
        ------
        UnknownTrackError
            If there is no such track.
        OptionError
            If no log is kept exactly, a log has no such rows or columns, logs have different
            columns, or quotes or ends of lines within cells hide where rows and cells end.
        CorruptArchiveError
            If a block is damaged.

        Notes
        -----
        Only blocks of rows that hold the track are decoded, and of these the columns that are asked
        for, the times, and columns that predict them.

        Examples
        --------
        >>> import gpszip
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> rows = [f"{i % 2},{i},{i}.50,1" for i in range(40)]
        >>> with TemporaryDirectory() as folder:
        ...     log = Path(folder, "bus.csv")
        ...     _ = log.write_text(chr(10).join(["id,t,x,y", *rows]))
        ...     archive = gpszip.compress(log, rmse=1, lossless=True)
        >>> archive.exact_rows("1", ["t", "x"])[:2].to_pylist()
        [{'t': '1', 'x': '1.50'}, {'t': '3', 'x': '3.50'}]
        """
        from gpszip.archive.exact_rows import choose_rows

        return choose_rows(self, track, columns, log).table()

    # What was kept of the samples.

    @cached_property
    def kept_columns(self) -> tuple[str, ...] | None:
        """Names of the log's further columns that are kept; None if not even the times are."""
        found = find_kept(self.contents)
        return None if found is None else read_kept_names(*found, len(self.ids))

    def sample_times(self, track: str) -> NDArray[np.float64]:
        """Times of a track's samples in seconds, exactly as they were read.

        Raises
        ------
        UnknownTrackError
            If there is no such track.
        OptionError
            If the archive was written without them.
        """
        return self._kept_samples.times[self._kept_samples.rows(self._track_number(track))]

    def attributes(self, track: str) -> Mapping[str, NDArray[np.generic]]:
        """Further columns of a track, exactly as they were read, in the order of its samples.

        Returns
        -------
        mapping of str to array, shape (n,)
            Integers, floats (NaN where the log had none) or texts, by the names of the columns; one
            value for each of :meth:`sample_times`.

        Raises
        ------
        UnknownTrackError
            If there is no such track.
        OptionError
            If the archive was written without them.
        """
        rows = self._kept_samples.rows(self._track_number(track))
        return {name: values[rows] for name, values in self._kept_samples.columns.items()}

    def samples(self, track: str | None = None) -> list[Track]:
        """Tracks at the times of their samples, with the columns that were kept.

        Parameters
        ----------
        track : str, optional
            Only this track.

        Returns
        -------
        list of Track
            Positions are within the archive's error bound; times and attributes are exact. Tracks
            are not cut at gaps.

        Raises
        ------
        UnknownTrackError
            If there is no such track.
        OptionError
            If the archive was written without the times of samples.
        """
        return [self._track_at_samples(name) for name in (self.ids if track is None else (track,))]

    @cached_property
    def curve_sizes(self) -> Mapping[str, tuple[float, int]]:
        """Columns that are kept within an error: their bounds, and the bytes that they take."""
        section = self._curve_section()
        if section is None:
            return {}
        from gpszip.archive.curves import read_curve_heads

        return read_curve_heads(*section)

    def check_curves(self) -> None:
        """Decode the columns that are kept within an error.

        Raises
        ------
        CorruptArchiveError
            If they are damaged.
        """
        if self.curve_sizes:
            _ = self._curve_columns

    def curve(self, track: str, column: str, when: Times) -> NDArray[np.float64]:
        """Values of a column that is kept within an error, at any times.

        Parameters
        ----------
        track, column : str
            Names of the track and of the column.
        when : array_like of any shape
            As for :meth:`position`.

        Returns
        -------
        float64 array, shape (...)
            Within the column's bound at every sample, linear between knots. NaN before and after
            the track and in holes, where the log had no values.

        Raises
        ------
        UnknownTrackError
            If there is no such track.
        OptionError
            If there is no such column, or ``when`` looks like another unit or another zero than the
            log's, as for :meth:`position`.
        """
        number = self._track_number(track)
        if column not in self.curve_sizes:
            names = ", ".join(self.curve_sizes) or "none"
            raise OptionError(
                f"no column {column!r} is kept within an error", remedy=f"there is {names}"
            )

        # If all of them are NaN, the times may be in a wrong unit.
        times = to_seconds(when, name="when")
        values = self._curve_columns[column].curve(number).at(times)
        if times.size and np.isnan(values).all():
            self._check_unit(times)
        return values

    def with_curves(
        self, track: str, pieces: Sequence[Track], *, at_knots: bool = False
    ) -> list[Track]:
        """Pieces of a track with the values of its curves at their times, as attributes.

        Parameters
        ----------
        track : str
            Name of the track.
        pieces : sequence of Track
            Those without times stay as they are.
        at_knots : bool, default False
            Whether pieces of knots get further points, at the knots of the curves, so that the
            curves, too, are linear from point to point.
        """
        if not self.curve_sizes:
            return list(pieces)
        if at_knots:
            number = self._track_number(track)
            curves = [column.curve(number).times for column in self._curve_columns.values()]
            pieces = [add_points(piece, np.concatenate(curves)) for piece in pieces]
        return [
            replace(piece, attributes={**piece.attributes, **self._curve_values(track, piece)})
            if piece.timed
            else piece
            for piece in pieces
        ]

    # The file.

    @property
    def size(self) -> int:
        """Number of bytes of the file."""
        # Only the size of new contents is not known before they are encoded.
        stored = stored_size(self.contents)
        return archive_size(self.contents) if stored is None else stored

    def to_bytes(self) -> bytes:
        """Bytes of the file."""
        return to_bytes(self.contents)

    def save(self, path: str | os.PathLike[str], *, force: bool = False) -> int:
        """Write the archive to a file, completely or not at all.

        Parameters
        ----------
        path : path
            The file, usually named ``*.gpsz``.
        force : bool, default False
            Replace an existing file.

        Returns
        -------
        int
            Size of the file in bytes.

        Raises
        ------
        OutputError
            If the file exists or can't be written.
        """
        return save(self.contents, path, force=force)

    # The map for others.

    @cached_property
    def hash(self) -> bytes:
        """Four bytes by which other archives name this one as their map."""
        return map_hash(self.contents)

    def prior(self, refinements: int = 0) -> Prior:
        """The archive's walks as the prior of others, on its grid refined ``refinements`` times."""
        from gpszip.codec.prior import Prior

        if refinements not in self._priors:
            self._priors[refinements] = Prior(refined(self.grid_walks, refinements))
        return self._priors[refinements]

    @property
    def _prior(self) -> Prior | None:
        if self.contents.map is None:
            return None
        return self._known_map.prior(self._reference.refinements)

    @property
    def _reference(self) -> MapReference:
        if self.contents.map is None:
            raise OptionError("the archive lies on no other map")
        return self.contents.map

    @property
    def _known_map(self) -> Archive:
        if self.map is None:
            raise MapError(
                f"the archive lies on the map {self._reference.hash.hex()}, kept elsewhere",
                remedy="give it with --map, or map=",
            )
        return self.map

    @cached_property
    def _trimmed(self) -> tuple[RoadMap, tuple[Walk, ...]]:
        from gpszip.walks.counting import build_road_map
        from gpszip.walks.cut_ends import trim_walks

        # Without an error bound, the step of the grid is the best guess of the error.
        error = step_size(self.grid.space) if self.error_bound is None else self.error_bound.metres
        nodes, walks = trim_walks(self.road_map.nodes, self.walks, _TRIM_FACTOR * error)
        return build_road_map(nodes, walks, plane=self.grid.plane), walks

    @cached_property
    def _graph(self) -> RoadGraph:
        """All segments of the walks on the grid, where lengths are exact wherever the log lies."""
        from gpszip.graph.road_graph import build_road_graph
        from gpszip.walks.counting import build_road_map

        # A segment that lies beyond the time range of its piece is part of the walk, but no travel:
        # `road_map` doesn't have it.
        nodes = self.grid_walks.nodes
        return build_road_graph(nodes, build_road_map(nodes, self.grid_walks.walks).edges)

    # Tracks and the groups that hold them.

    @cached_property
    def _number_by_id(self) -> dict[str, int]:
        return {name: number for number, name in enumerate(self.ids)}

    def _track_number(self, track: str) -> int:
        try:
            # Some values, such as lists, are no keys of a dict.
            return self._number_by_id[track]
        except (KeyError, TypeError):
            listed = ", ".join(map(repr, self.ids[:_MAX_LISTED_IDS]))
            more = ", ..." if len(self.ids) > _MAX_LISTED_IDS else ""
            raise UnknownTrackError(
                f"there is no track {track!r} in the archive; it has {listed}{more}"
            ) from None

    def _decode_group(self, number: int) -> GridWalks:
        if number not in self._decoded_groups:
            from gpszip.codec.decode import decode_walks
            from gpszip.codec.numbering import number_by_visit

            # Versions without piece ends don't need the grid to be decoded.
            group, prior = self.contents.groups[number], self._prior
            walks = decode_walks(
                group.payload,
                self.grid.dimension,
                group.tracks,
                prior,
                self.grid if self.contents.has_piece_ends else None,
            )
            # On a known map, the nodes that no walk visits are dropped.
            self._decoded_groups[number] = walks if prior is None else number_by_visit(walks)
        return self._decoded_groups[number]

    def walks_of_group(self, number: int) -> tuple[tuple[Walk, ...], NDArray[np.float64]]:
        """Walks of one group, and the positions in metres of the nodes that they name."""
        from gpszip.walks.quantised import dequantise_walks, node_positions

        # The heads tell which tracks the group holds.
        group, head = self._decode_group(number), group_heads(self.contents)[number]
        ids = self.ids[head.first_track : head.first_track + head.tracks]
        return dequantise_walks(group, self.grid, ids), node_positions(group, self.grid)

    def _knots(self, track: str) -> tuple[Walk, NDArray[np.float64]]:
        """Walk of one track over its own knots, and their positions in metres.

        No more than the group of the track is decoded.
        """
        from gpszip.walks.quantised import dequantise_walks, node_positions

        # The group, and the track's number in it.
        number = self._track_number(track)
        heads = group_heads(self.contents)
        which = next(i for i, head in enumerate(heads) if number < head.first_track + head.tracks)
        group = self._decode_group(which)
        number -= heads[which].first_track

        # The track alone, each knot a node.
        walk = group.walks[number]
        alone = GridWalks(
            group.nodes[walk.nodes],
            (GridWalk(np.arange(len(walk.nodes), dtype=np.int32), walk.time_steps, walk.gaps),),
            group.timed,
            ends_of_walks(group, number, number + 1),
            frozenset({0}) if number in group.untimed else frozenset(),
        )
        return dequantise_walks(alone, self.grid, [track])[0], node_positions(alone, self.grid)

    def _groups_at(self, times: NDArray[np.float64] | None) -> list[int]:
        """Groups that may have travel at one of these times; all where there are none."""
        heads = group_heads(self.contents)
        if times is None or not len(times) or len(heads) == 1:
            return list(range(len(heads)))

        ranges = [self._group_time_range(number) for number in range(len(heads))]
        return [
            number
            for number, (begin, end) in enumerate(ranges)
            if np.any((times >= begin) & (times <= end))
        ]

    def _group_time_range(self, number: int) -> tuple[float, float]:
        """Seconds beyond which a group has no travel; infinite where the index doesn't say it."""
        steps = group_heads(self.contents)[number].time_range
        if steps is None:
            return -math.inf, math.inf
        # A step more on either side than the index says leaves no doubt about rounding.
        step, epoch = step_size(self.grid.time), self.grid.epoch / 1000
        slack = step + _TIME_SLACK
        return epoch + steps[0] * step - slack, epoch + steps[1] * step + slack

    def _time_step_range(self, number: int) -> tuple[int, int] | None:
        """First and last time step of a group; None if none of its tracks has times."""
        head = group_heads(self.contents)[number]
        if head.time_range is not None:
            return head.time_range

        # A single group has no time range: its knots say it.
        group = self._decode_group(number)
        timed = [
            walk.time_steps
            for i, walk in enumerate(group.walks)
            if i not in group.untimed and len(walk.time_steps)
        ]
        if not timed:
            return None
        return min(int(steps[0]) for steps in timed), max(int(steps[-1]) for steps in timed)

    # Positions and pieces.

    def _positions(self, track: str, times: NDArray[np.float64]) -> NDArray[np.float64]:
        from gpszip.walks.error import positions_at

        walk, positions = self._knots(track)
        return positions_at(walk, positions, times)

    def _check_unit(self, times: NDArray[np.float64]) -> None:
        """Refuse times that the archive doesn't have because they are in another unit."""
        span = self.time_range
        mistake = None if span is None else wrong_unit(times, *span)
        if span is not None and mistake is not None:
            raise OptionError(
                f"no track has such times: the archive has {format_span(*span)}", remedy=mistake
            )

    def _sample_walk(
        self,
        walk: Walk,
        nodes: NDArray[np.float64],
        every: float | None,
        times: NDArray[np.float64],
    ) -> list[Track]:
        from gpszip.walks.error import TIME_SLACK, positions_at

        # Sample piece by piece: between them lie gaps, in which no travel is claimed.
        if walk.times is None:
            raise _no_times(walk.id)
        sampled: list[Track] = []
        for number, (name, knots) in enumerate(self._named_pieces(walk)):
            # The times within the piece.
            begin, end = time_range_of_piece(walk, number, knots)
            first, last = begin - TIME_SLACK, end + TIME_SLACK
            if every is not None:
                multiples = np.arange(math.ceil(first / every), math.floor(last / every) + 1)
                times = np.asarray(multiples * every, dtype=np.float64)
            inside = times[(times >= first) & (times <= last)]

            # Rounding may put a time just beyond the slack.
            positions = positions_at(walk, nodes, inside)
            known = ~np.isnan(positions[:, 0])
            if known.any():
                track = Track(name, inside[known], positions[known], plane=self.grid.plane)
                sampled.append(track)
        return self.with_curves(walk.id, sampled)

    @cached_property
    def _pieces(self) -> dict[str, list[tuple[str, slice]]]:
        return pieces_by_track(self.walks)

    def _named_pieces(self, walk: Walk) -> list[tuple[str, slice]]:
        """Pieces of one walk, for whose names the other walks are decoded only where they must."""
        knots = cut_at_gaps(walk)
        names = plain_names(walk.id, len(knots), self._number_by_id)
        if names is None:
            names = [name for name, _ in self._pieces[walk.id]]
        return list(zip(names, knots, strict=True))

    # Kept columns.

    def _curve_section(self) -> tuple[int, bytes] | None:
        """Kind and body of the section of curves; None if there is none."""
        sections = [each for each in self.contents.extras if each.kind in CURVE_KINDS]
        if len(sections) > 1:
            raise CorruptArchiveError("there are two sections of curves")
        return (sections[0].kind, bytes(sections[0].body)) if sections else None

    @cached_property
    def _curve_columns(self) -> Mapping[str, CurveColumn]:
        section = self._curve_section()
        if section is None:
            return {}
        from gpszip.archive.curves import read_curves

        return read_curves(*section, len(self.ids))

    def _curve_values(self, owner: str, piece: Track) -> dict[str, NDArray[np.float64]]:
        number = self._track_number(owner)
        return {
            name: column.curve(number).at(piece.times)
            for name, column in self._curve_columns.items()
        }

    @cached_property
    def _kept_samples(self) -> KeptColumns:
        found = find_kept(self.contents)
        if found is None:
            raise OptionError(
                "the archive keeps neither columns nor the times of samples",
                remedy="compress the log with keep or keep_times",
            )
        return read_kept(*found, len(self.ids))

    def _track_at_samples(self, name: str) -> Track:
        times = self.sample_times(name)
        positions = self._positions(name, times)
        if not len(times) or np.isnan(positions).any():
            raise CorruptArchiveError(f"kept times of track {name!r} lie where it claims no travel")
        track = Track(
            name, times, positions, attributes=self.attributes(name), plane=self.grid.plane
        )
        return self.with_curves(name, [track])[0]


def _off_map_lines(
    walk: Walk, is_new: NDArray[np.bool_], nodes: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """Lines along which a walk leaves the known nodes, each from the last known to the next."""
    # A segment leaves the map if it has a new node at either end.
    off = (is_new[walk.nodes[:-1]] | is_new[walk.nodes[1:]]) & ~walk.gaps
    # Runs of such segments begin where the difference is 1 and end where it is -1.
    changes = np.diff(np.concatenate([[0], off.astype(np.int8), [0]]))
    starts, ends = np.flatnonzero(changes > 0), np.flatnonzero(changes < 0)
    return [nodes[walk.nodes[start : end + 1]] for start, end in zip(starts, ends, strict=True)]


def _no_times(track: str) -> OptionError:
    return OptionError(
        f"track {track!r} has no times, so that it can't be sampled in time",
        remedy="decompress() has its shape",
    )


def _check_times(every: float | None, at: Times | None) -> NDArray[np.float64]:
    """Times to sample at, sorted, each once; none where samples lie at multiples."""
    if (every is None) == (at is None):
        raise OptionError("give either every or at")
    if every is not None and not (every > 0 and math.isfinite(every)):
        raise OptionError(f"every is {every:g}", remedy="it must be a positive number of seconds")
    times = np.unique(to_seconds([] if at is None else at, name="at").reshape(-1))
    if not np.isfinite(times).all():
        raise OptionError("at holds values that are no times")
    return times
