"""An archive: a road map, the walks of all tracks on it, and the questions that they answer."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.archive.pieces import clip_to_span, measure_shape, pieces_by_track
from gpszip.container.attributes import KeptColumns, read_attributes, read_column_names
from gpszip.container.contents import Contents, MapReference
from gpszip.container.layout import SectionKind
from gpszip.container.map_record import map_hash
from gpszip.container.writer import archive_size, save, to_bytes
from gpszip.errors import CorruptArchiveError, MapError, OptionError
from gpszip.model.clean_map import CleanMap
from gpszip.model.error_bound import ErrorBound
from gpszip.model.grid import QuantisationGrid, refined_grid, step_size
from gpszip.model.grid_walks import GridWalks, ends_of_walks, refined
from gpszip.model.road_map import RoadMap
from gpszip.model.track import Track
from gpszip.model.walk import Walk

if TYPE_CHECKING:
    from gpszip.codec.prior import Prior
    from gpszip.codec.waypoints import Waypoints
    from gpszip.graph.road_graph import RoadGraph

__all__ = ["Archive"]

#: A node this many times the error kept from where a track ends is not drawn as its end.
_TRIM_FACTOR = 2.0


@dataclass(frozen=True, eq=False)
class Archive:
    """What was learned from tracks: a road map and one walk on it for each track.

    Everything is decoded when it is first asked for, and from then on kept. Get one from :func:`gpszip.compress` or
    :func:`gpszip.open`.

    Parameters
    ----------
    contents : Contents
        What the file holds.
    map : Archive, optional
        The map on which the walks lie, where the file does not hold it.

    Examples
    --------
    >>> from gpszip.archive import new_archive
    >>> from gpszip.model import GridWalk
    >>> walk = GridWalk(np.array([0, 1], np.int32), np.array([0, 10]), np.array([False]))
    >>> archive = new_archive(QuantisationGrid((0, 0), 0, 128, 128), ["walk-3"], GridWalks(np.array([[0, 0], [5, 0]]), (walk,)))
    >>> archive.tracks, archive.position("walk-3", 4.0).tolist()
    (('walk-3',), [2.0, 0.0])
    """

    contents: Contents
    map: Archive | None = None
    _decoded_groups: dict[int, GridWalks] = field(default_factory=dict, repr=False)
    _priors: dict[int, Prior] = field(default_factory=dict, repr=False)

    def __repr__(self) -> str:
        return f"<Archive of {len(self.ids)} tracks>"

    @property
    def grid(self) -> QuantisationGrid:
        """The lattice on which nodes and times are kept.

        Raises
        ------
        MapError
            If the archive lies on a map that was not given.
        """
        if self.contents.grid is not None:
            return self.contents.grid
        return refined_grid(self._known_map.grid, self._reference.refinements)

    @property
    def ids(self) -> tuple[str, ...]:
        """Names of the tracks."""
        return self._known_map.ids[:1] if self.contents.ids is None else self.contents.ids

    @property
    def tracks(self) -> tuple[str, ...]:
        """Names of the tracks, the same as ``ids``."""
        return self.ids

    @property
    def timed(self) -> bool:
        """Whether the times of the knots are kept, of any track at all."""
        from gpszip.codec.payload_head import has_times

        return has_times(self.contents.groups[0].payload)

    @cached_property
    def untimed(self) -> tuple[str, ...]:
        """Names of the tracks that have no times: their shapes alone are kept."""
        return tuple(walk.id for walk in self.walks if walk.times is None)

    @cached_property
    def grid_walks(self) -> GridWalks:
        """Map and walks as integers on the lattice of ``frame``."""
        from gpszip.walks.quantised import merge_grid_walks

        groups = [self._decode_group(number) for number in range(len(self.contents.groups))]
        return groups[0] if len(groups) == 1 else merge_grid_walks(groups)

    @cached_property
    def road_map(self) -> RoadMap:
        """Nodes and ways that the tracks share, in metres."""
        from gpszip.walks.quantised import dequantise_road_map

        return dequantise_road_map(self.grid_walks, self.grid)

    @cached_property
    def walks(self) -> tuple[Walk, ...]:
        """One walk over the nodes of ``road_map`` for each track, in the order of ``tracks``."""
        from gpszip.walks.quantised import dequantise_walks

        return dequantise_walks(self.grid_walks, self.grid, self.ids)

    def clean_map(self, min_traversals: int = 1) -> CleanMap:
        """One way for each street, between junctions, with how often and how fast it was travelled.

        Parameters
        ----------
        min_traversals : int, default 1
            Leave out ways that were travelled less often, both directions together.
        """
        from gpszip.simplification.simplify import clean_map

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
        """The road map as far as tracks have gone: a part that leads on beyond the end of its track ends there, at a node of its own."""
        return self._trimmed[0]

    @cached_property
    def _trimmed(self) -> tuple[RoadMap, tuple[Walk, ...]]:
        from gpszip.walks.counting import build_road_map
        from gpszip.walks.cut_ends import trim_walks

        error = step_size(self.grid.space) if self.error_bound is None else self.error_bound.metres
        nodes, walks = trim_walks(self.road_map.nodes, self.walks, _TRIM_FACTOR * error)
        return build_road_map(nodes, walks, plane=self.grid.plane), walks

    def walk(self, track: str) -> Walk:
        """Walk of one track over the nodes of ``road_map``.

        Raises
        ------
        OptionError
            If there is no such track.
        """
        return self.walks[self._track_number(track)]

    def waypoints(self, track: str) -> Waypoints:
        """Fewest nodes of ``road_map`` from which shortest paths give a track's walk back (thesis, Algorithm 6).

        This is what the thesis would store of the walk, for comparison; the archive codes it in fewer bits. :func:`expand`
        of :mod:`gpszip.codec.waypoints` gives the walk back.

        Raises
        ------
        OptionError
            If there is no such track.
        """
        from gpszip.codec.waypoints import find_waypoints
        from gpszip.graph.route import build_route

        walk = self.walk(track)
        return find_waypoints(self._graph, build_route(self._graph, walk.nodes, walk.gaps))

    def position(
        self, track: str, when: ArrayLike, *, geographic: bool = False
    ) -> NDArray[np.float64]:
        """Where a track was at given instants.

        Parameters
        ----------
        track : str
            Name of the track.
        when : array_like, any shape
            Seconds in the log's own zero, in any order.
        geographic : bool, default False
            Answer in degrees, latitude first, instead of metres on the plane.

        Returns
        -------
        float64 array, shape (..., d)
            One position for each instant; NaN where no travel is claimed: before, after and in gaps.

        Raises
        ------
        OptionError
            If there is no such track, the archive keeps no times, or degrees are asked of a log in x and y.
        """
        from gpszip.walks.error import positions_at

        plane = self.grid.plane
        if geographic and plane is None:
            raise OptionError(
                "this archive's log came in x and y, on no known place of the earth; ask without geographic"
            )
        walk, nodes = self._decode_walk(track)
        instants = np.asarray(when, dtype=np.float64)
        found = positions_at(walk, nodes, instants.reshape(-1))
        if geographic and plane is not None:
            from gpszip.geo.planes import to_geographic

            claimed = ~np.isnan(found[:, 0])
            found[claimed] = np.stack(to_geographic(found[claimed], plane), axis=1)
        return found.reshape(*instants.shape, self.grid.dimension)

    def shapes(self) -> list[tuple[str, NDArray[np.float64]]]:
        """Ways without times, the only ones that an archive without times has.

        Returns
        -------
        list of (str, float64 array of shape (n, d))
            Name and positions in metres of the knots of each piece, named as by :meth:`decompress`.
        """
        return [(piece.id, piece.positions) for piece in self.decompress()]

    @property
    def pieces(self) -> Mapping[str, str]:
        """Name of the track to which each piece belongs, by the names that :meth:`decompress` gives to pieces."""
        return {name: track for track, pieces in self._pieces.items() for name, _ in pieces}

    def decompress(self) -> list[Track]:
        """Tracks of the knots, between which every track is linear in time.

        A track with gaps comes back as its pieces between them, named ``id/0``, ``id/1`` and so on, or ``id//0`` and so on where a
        name is taken; any other keeps its id. Each piece begins at its first sample and ends at its last. A track without times
        comes back as a shape: its ``times`` are distances along it in metres, and its ``timed`` is False.
        """
        return [piece for walk in self.walks for piece in self._decompress_walk(walk)]

    def sample(
        self, every: float | None = None, *, at: ArrayLike | None = None, track: str | None = None
    ) -> list[Track]:
        """Tracks sampled anew.

        Parameters
        ----------
        every : float, optional
            Seconds: at each whole multiple of it.
        at : array_like, shape (n,), optional
            At these instants, seconds in the log's own zero. Give one of ``every`` and ``at``.
        track : str, optional
            Only this track.

        Returns
        -------
        list of Track
            Named as by :meth:`decompress`; pieces that none of the instants meets are left out, and so are tracks without times
            among others that have some.

        Raises
        ------
        OptionError
            If none or both of ``every`` and ``at`` are given, a value is no time, or the track that is asked for, or every one, has
            no times.
        """
        instants = _check_times(every, at)
        out: list[Track] = []
        timed = [walk for walk in self.walks if walk.times is not None] or self.walks
        for walk in timed if track is None else (self.walk(track),):
            out += self._sample_walk(walk, every, instants)
        return out

    @property
    def kept_columns(self) -> tuple[str, ...] | None:
        """Names of the log's further columns that are kept; None if not even the times of the samples are."""
        body = self._attribute_section
        return None if body is None else read_column_names(body, len(self.ids))

    def sample_times(self, track: str) -> NDArray[np.float64]:
        """Instants of a track's samples in seconds, exactly as they were read.

        Raises
        ------
        OptionError
            If there is no such track, or the archive was written without them.
        """
        return self._kept_samples.times[self._kept_samples.rows(self._track_number(track))]

    def attributes(self, track: str) -> Mapping[str, NDArray[np.generic]]:
        """Further columns of a track, exactly as they were read, one value for each of :meth:`sample_times`.

        Returns
        -------
        mapping of str to array, shape (n,)
            Integers, floats (NaN where the log had none) or texts, by the names of the columns.

        Raises
        ------
        OptionError
            If there is no such track, or the archive was written without them.
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
            Positions are within the archive's bound; times and attributes are exact. Each track is whole and has its own name.

        Raises
        ------
        OptionError
            If there is no such track, or the archive was written without the times of samples.
        """
        return [self._track_at_samples(name) for name in (self.ids if track is None else (track,))]

    @property
    def error_bound(self) -> ErrorBound | None:
        """The error that the walks keep: the bound that was asked for, or what was reached where none was."""
        return self.contents.error_bound

    @property
    def sampling(self) -> float | None:
        """About the seconds between two samples of the log; None where that is not kept."""
        return None if self.contents.sampling is None else step_size(self.contents.sampling)

    @cached_property
    def hash(self) -> bytes:
        """Four bytes by which other archives name this one as their map."""
        return map_hash(self.contents)

    def prior(self, refinements: int = 0) -> Prior:
        """The archive's walks as others go on from them, on quanta halved so many times."""
        from gpszip.codec.prior import Prior

        if refinements not in self._priors:
            self._priors[refinements] = Prior(refined(self.grid_walks, refinements))
        return self._priors[refinements]

    @property
    def off_map_lines(self) -> list[NDArray[np.float64]]:
        """Stretches that lie off the map kept elsewhere: float64 arrays of shape (n, d), in metres."""
        if self._prior is None:
            return []
        known, own = self._prior.walks.nodes, self.grid_walks.nodes
        _, first, number = np.unique(
            np.concatenate([known, own]), axis=0, return_index=True, return_inverse=True
        )
        fresh = first[number.reshape(-1)[len(known) :]] >= len(known)
        return [
            line for walk in self.walks for line in _off_map_lines(walk, fresh, self.road_map.nodes)
        ]

    def info(self, *, decode: bool = False) -> dict[str, Any]:
        """What the archive is, as plain values.

        Parameters
        ----------
        decode : bool, default False
            Decode the walks, too, for the counts of nodes, edges, parts and waypoints and for the span of time.
        """
        grid = self.grid
        facts: dict[str, Any] = {
            "tracks": len(self.ids),
            "bytes": self.size,
            "groups": len(self.contents.groups),
            "dimension": grid.dimension,
            "geographic": grid.plane is not None,
            "node_quantum_m": step_size(grid.space),
            "time_quantum_s": step_size(grid.time),
            "layer": self.contents.layer,
            "kept": None if self.kept_columns is None else list(self.kept_columns),
            "map": None if self.contents.map is None else self.contents.map.hash.hex(),
            "promise_m": None if self.error_bound is None else self.error_bound.metres,
            "promise_max_m": None if self.error_bound is None else self.error_bound.max_error,
            "promise": None
            if self.error_bound is None
            else ("max_error" if self.error_bound.maximum else "rmse"),
            "sampling_s": self.sampling,
            "timed": self.timed,
        }
        return {**facts, **self._counts()} if decode else facts

    @property
    def size(self) -> int:
        """Number of bytes of the file."""
        return archive_size(self.contents)

    def to_bytes(self) -> bytes:
        """Bytes of the file."""
        return to_bytes(self.contents)

    def save(self, path: str | os.PathLike[str], *, force: bool = False) -> int:
        """Write the archive to a file that is there whole or not at all.

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

    def _decode_group(self, number: int) -> GridWalks:
        if number not in self._decoded_groups:
            from gpszip.codec.walks import decode, number_by_visit

            group, prior = self.contents.groups[number], self._prior
            found = decode(
                group.payload,
                self.grid.dimension,
                group.tracks,
                prior,
                self.grid if self.contents.ends else None,
            )
            self._decoded_groups[number] = found if prior is None else number_by_visit(found)
        return self._decoded_groups[number]

    @property
    def _prior(self) -> Prior | None:
        return (
            None
            if self.contents.map is None
            else self._known_map.prior(self._reference.refinements)
        )

    @property
    def _reference(self) -> MapReference:
        if self.contents.map is None:
            raise OptionError("the archive lies on no other map")
        return self.contents.map

    @property
    def _known_map(self) -> Archive:
        if self.map is None:
            raise MapError(
                f"the archive lies on the map {self._reference.hash.hex()}, kept elsewhere; give it with --map, or map="
            )
        return self.map

    def _track_number(self, track: str) -> int:
        try:
            return self._number_by_id[track]
        except KeyError:
            some = ", ".join(map(repr, self.ids[:5])) + (", ..." if len(self.ids) > 5 else "")
            raise OptionError(
                f"there is no track {track!r} in the archive; it has {some}"
            ) from None

    @cached_property
    def _graph(self) -> RoadGraph:
        """The road map on the lattice, where lengths are exact wherever the log lies."""
        from gpszip.graph.road_graph import build_road_graph

        return build_road_graph(self.grid_walks.nodes, self.road_map.edges)

    @cached_property
    def _number_by_id(self) -> dict[str, int]:
        return {name: number for number, name in enumerate(self.ids)}

    def _decode_walk(self, track: str) -> tuple[Walk, NDArray[np.float64]]:
        """Walk of one track, and the nodes that it goes by, decoding no more than its group."""
        from gpszip.walks.quantised import dequantise_walks, node_positions

        number = self._track_number(track)
        which = next(
            i
            for i, group in enumerate(self.contents.groups)
            if number < group.first_track + group.tracks
        )
        group = self._decode_group(which)
        at = number - self.contents.groups[which].first_track
        untimed = frozenset({0}) if at in group.untimed else frozenset[int]()
        own = GridWalks(
            group.nodes, (group.walks[at],), group.timed, ends_of_walks(group, at, at + 1), untimed
        )
        return dequantise_walks(own, self.grid, [track])[0], node_positions(own, self.grid)

    def _decompress_walk(self, walk: Walk) -> list[Track]:
        nodes, plane = self.road_map.nodes, self.grid.plane
        out: list[Track] = []
        for number, (name, knots) in enumerate(self._pieces[walk.id]):
            positions = nodes[walk.nodes[knots]]
            if walk.times is None:
                out.append(Track(name, *measure_shape(positions), plane=plane, timed=False))
                continue
            times = walk.times[knots]
            first, last = (
                (times[0], times[-1]) if walk.spans is None else walk.spans[number].tolist()
            )
            out.append(Track(name, *clip_to_span(times, positions, first, last), plane=plane))
        return out

    def _sample_walk(
        self, walk: Walk, every: float | None, instants: NDArray[np.float64]
    ) -> list[Track]:
        from gpszip.walks.error import TIME_SLACK, positions_at

        nodes, times = self.road_map.nodes, _require_times(walk)
        out: list[Track] = []
        for number, (name, knots) in enumerate(self._pieces[walk.id]):
            ends = times[knots][[0, -1]] if walk.spans is None else walk.spans[number]
            first, last = float(ends[0]) - TIME_SLACK, float(ends[1]) + TIME_SLACK
            grid = (
                np.arange(math.ceil(first / every), math.floor(last / every) + 1) * every
                if every is not None
                else instants
            )
            when = np.asarray(grid[(grid >= first) & (grid <= last)], dtype=np.float64)
            found = positions_at(walk, nodes, when)
            # rounding may put an instant just beyond the slack
            claimed = ~np.isnan(found[:, 0])
            if claimed.any():
                out.append(Track(name, when[claimed], found[claimed], plane=self.grid.plane))
        return out

    @cached_property
    def _pieces(self) -> dict[str, list[tuple[str, slice]]]:
        return pieces_by_track(self.walks)

    @property
    def _attribute_section(self) -> bytes | None:
        bodies = [
            bytes(extra.body)
            for extra in self.contents.extras
            if extra.kind == SectionKind.ATTRIBUTES
        ]
        if len(bodies) > 1:
            raise CorruptArchiveError("there are two sections of kept columns")
        return bodies[0] if bodies else None

    @cached_property
    def _kept_samples(self) -> KeptColumns:
        body = self._attribute_section
        if body is None:
            raise OptionError(
                "the archive keeps neither columns nor the times of samples; compress the log with keep or keep_times"
            )
        return read_attributes(body, len(self.ids))

    def _track_at_samples(self, name: str) -> Track:
        times = self.sample_times(name)
        positions = self.position(name, times)
        if not len(times) or np.isnan(positions).any():
            raise CorruptArchiveError(f"kept times of track {name!r} lie where it claims no travel")
        return Track(
            name, times, positions, attributes=self.attributes(name), plane=self.grid.plane
        )

    def _counts(self) -> dict[str, Any]:
        timed = [
            walk.times if walk.spans is None else walk.spans.ravel()
            for walk in self.walks
            if walk.times is not None
        ]
        return {
            "nodes": len(self.road_map.nodes),
            "edges": len(self.road_map.edges),
            "parts": sum(len(walk.gaps) for walk in self.walks),
            "waypoints": sum(len(self.waypoints(name)) for name in self.ids),
            "gaps": sum(int(walk.gaps.sum()) for walk in self.walks),
            "untimed": list(self.untimed),
            "t_start": min((float(times[0]) for times in timed), default=None),
            "t_end": max((float(times[-1]) for times in timed), default=None),
        }


def _off_map_lines(
    walk: Walk, fresh: NDArray[np.bool_], places: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """The lines along which a walk leaves the known nodes, each from the last one known to the next."""
    off = (fresh[walk.nodes[:-1]] | fresh[walk.nodes[1:]]) & ~walk.gaps
    edges = np.diff(np.concatenate([[0], off.astype(np.int8), [0]]))
    return [
        places[walk.nodes[a : b + 1]]
        for a, b in zip(np.flatnonzero(edges > 0), np.flatnonzero(edges < 0), strict=True)
    ]


def _require_times(walk: Walk) -> NDArray[np.float64]:
    if walk.times is None:
        raise OptionError(
            f"track {walk.id!r} has no times, so that it can't be sampled in time; decompress() has its shape"
        )
    return walk.times


def _check_times(every: float | None, at: ArrayLike | None) -> NDArray[np.float64]:
    if (every is None) == (at is None):
        raise OptionError("give either every or at")
    if every is not None and not (every > 0 and math.isfinite(every)):
        raise OptionError(f"every is {every:g}; it must be a positive number of seconds")
    instants = np.unique(np.asarray([] if at is None else at, dtype=np.float64).reshape(-1))
    if not np.isfinite(instants).all():
        raise OptionError("at holds values that are no times")
    return instants
