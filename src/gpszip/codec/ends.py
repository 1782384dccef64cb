"""When travel begins and ends in each piece of a walk, to a tick: finer than the knots' time steps.

The first knot of a piece lies at or before its first sample, the last knot at or after its last
sample, each up to a time step away. Nothing is known of the time between. So an archive stores when
each track starts and ends; and when a piece beside a gap does, if the walk goes far in that time.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.end_kinds import ALWAYS, MAX_QUOTIENT, NEVER, SOMETIMES
from gpszip.codec.knots import Knots, concatenate_knots, ends_of_pieces
from gpszip.errors import CorruptArchiveError
from gpszip.model.grid import QuantisationGrid, step_size
from gpszip.model.grid_walks import GridWalks, PieceEnds

__all__ = ["TICKS", "TailCoder", "Tick", "code_tail", "find_piece_ends", "stored_time_ranges"]


class Tick(NamedTuple):
    """Length of a tick as a fraction of seconds."""

    numerator: int
    denominator: int

    @property
    def seconds(self) -> float:
        """The same as a number."""
        return self.numerator / self.denominator


#: Ticks by their index in the payload; index 0 stands for no ends at all.
TICKS = (
    Tick(0, 1),
    *(Tick(seconds, 1) for seconds in (60, 30, 15, 10, 5, 2, 1)),
    *(Tick(1, parts) for parts in (2, 5, 10, 20, 50, 100, 200, 1000)),
)

#: A time counts as a multiple of a tick if it is at most so many seconds off: float64 seconds since
#: 1970 are good to 2.4e-7 s.
_TICK_TOLERANCE = 1e-5

#: Ends may be rounded by less than this share of the time between two samples. Exact ends of sparse
#: tracks would take 5 % of the bytes of 129 short tracks.
_MAX_ROUNDING_SHARE = 0.25

#: Ends may be rounded by less than so many seconds in any case, or by less than the time between
#: two samples if that is shorter. Milliseconds would take 2 % of a log of 100 bytes.
_MAX_ROUNDING = 1.0

#: Space steps that a piece beside a gap may go on after its last sample, or before its first: about
#: twice the error bound.
_MAX_OVERRUN = 2.0

#: Initial counts of zeros and ones of whether a piece beside a gap has an offset.
_OFFSET_COUNTS = (36, 4)

#: Ticks from the epoch within which arithmetic on int64 is safe.
_MAX_TICKS = 2.0**60

#: Seconds by which a piece's first sample may seem to come before its first knot.
_SEARCH_TOLERANCE = 1e-3


class _Pieces(NamedTuple):
    """The gap-free pieces of all walks; P in all.

    Parameters
    ----------
    knots : Knots
        Knots of all walks; K in all.
    is_first, is_last : bool arrays, shape (K,)
        Whether each knot is the first of its piece, and whether it is the last.
    walks : int64 array, shape (P,)
        Walk of each piece.
    counts : int64 array, shape (W,)
        Number of pieces of each walk.
    """

    knots: Knots
    is_first: NDArray[np.bool_]
    is_last: NDArray[np.bool_]
    walks: NDArray[np.int64]
    counts: NDArray[np.int64]


class TailCoder(Protocol):
    """What encodes or decodes the numbers of the tail; a decoder ignores those it is given."""

    def code_uniform(self, value: int, total: int) -> int:
        """Code a number below ``total``, all of which are equally likely."""

    def code_rare(self, happens: bool) -> bool:
        """Code whether something happens that has a probability of 1/64."""

    def code_offsets(
        self,
        offsets: NDArray[np.int64],
        kinds: NDArray[np.int8],
        counts: NDArray[np.int32],
        levels: int,
    ) -> bool:
        """Code offsets in place, see :func:`gpszip.codec.kernels.end_coder.code_end_offsets`."""


def find_piece_ends(
    time_ranges: Sequence[NDArray[np.float64]],
    walks: GridWalks,
    grid: QuantisationGrid,
    step: float = 0.0,
) -> PieceEnds:
    """Find when travel begins and ends in each piece.

    Parameters
    ----------
    time_ranges : sequence of float64 array, shape (n, 2)
        For each walk the times of the first and the last sample of each gap-free piece of its
        track, in seconds and in the order of time.
    walks : GridWalks
        With times. A piece of a walk holds several time ranges where the gaps between them were
        too short for the time steps. A piece without any lasts from its first knot to its last.
    grid : QuantisationGrid
        Epoch and time step.
    step : float, default 0
        Seconds between two samples of the most densely sampled track. Times may be rounded outwards
        by less than a quarter of that, or by less than a second if that is no more than ``step``.

    Returns
    -------
    PieceEnds
        On the coarsest tick of which all times are multiples, or to which they may be rounded.

    Examples
    --------
    >>> from gpszip.model import GridWalk
    >>> walk = GridWalk(np.array([0, 1], np.int32), np.array([0, 1]), np.array([False]))
    >>> walks = GridWalks(np.array([[0], [1]]), (walk,))
    >>> grid = QuantisationGrid((0,), 0, 128, 200)
    >>> ends = find_piece_ends([np.array([[0.0, 90.0]])], walks, grid)
    >>> TICKS[ends.tick].seconds, ends.first.tolist(), ends.last.tolist()
    (30.0, [0], [3])
    """
    # Times of the first and last sample of each piece, and the tick that suits them all.
    pieces = _find_pieces(walks)
    since_epoch = _sample_ranges(time_ranges, walks, pieces, grid)
    max_rounding = max(_MAX_ROUNDING_SHARE * step, min(_MAX_ROUNDING, step))
    tick, first, last = _round_to_ticks(since_epoch, max_rounding)

    # The same of the first and last knot.
    try:
        low, high = _knot_ticks(pieces, grid, tick)
    except CorruptArchiveError:
        return _no_ends()

    # Ends that can't be coded, or make no difference, are those of the knots.
    limit = (MAX_QUOTIENT + 1) * _levels(grid, tick)
    # Speed times the time between knot and sample is how far the walk goes on, in space steps.
    time_steps = np.stack([first - low, high - last], axis=1)
    time_steps = time_steps * (TICKS[tick].seconds / step_size(grid.time))
    speeds = _end_speeds(walks.nodes, pieces)
    matters = (_end_kinds(speeds, pieces) == ALWAYS) | (speeds * time_steps > _MAX_OVERRUN)
    first = np.where(matters[:, 0] & (first >= low) & (first - low < limit), first, low)
    last = np.where(matters[:, 1] & (last <= high) & (high - last < limit), last, high)
    return PieceEnds(tick, first, last)


def stored_time_ranges(
    walks: GridWalks, grid: QuantisationGrid
) -> list[NDArray[np.float64]] | None:
    """Seconds at which travel begins and ends in each piece, or None if that is not stored.

    Parameters
    ----------
    walks : GridWalks
        With times.
    grid : QuantisationGrid
        Epoch and time step.

    Returns
    -------
    list of float64 array, shape (pieces, 2), or None
        One for each walk.
    """
    # Without a tick, the ends of pieces are not stored. Convert ticks to seconds.
    if walks.ends is None or walks.ends.tick == 0:
        return None
    if not walks.walks:
        return []
    numerator, denominator = TICKS[walks.ends.tick]
    ticks = np.stack([walks.ends.first, walks.ends.last], axis=1)
    times = grid.epoch / 1000 + ticks * numerator / denominator

    # No earlier than the first knot, and no later than the last.
    pieces = _find_pieces(walks)
    knots = _knot_ranges(pieces, grid)
    within = np.stack(
        [np.maximum(times[:, 0], knots[:, 0]), np.minimum(times[:, 1], knots[:, 1])], axis=1
    )
    bounds = np.append(0, np.cumsum(pieces.counts)).tolist()
    return [within[first:end] for first, end in pairwise(bounds)]


def code_tail(coder: TailCoder, walks: GridWalks, grid: QuantisationGrid) -> GridWalks:
    """Code what follows the knots of walks with times: tracks without times, and ends of pieces.

    Parameters
    ----------
    coder : TailCoder
        After the knots, in any direction.
    walks : GridWalks
        Those to encode, or the knots that were decoded.
    grid : QuantisationGrid
        Epoch and time step.

    Returns
    -------
    GridWalks
        The walks with what was coded.

    Raises
    ------
    CorruptArchiveError
        If what is read is no end.
    """
    # Tracks without times, and the tick.
    shapes = _code_shapes(coder, walks)
    tick = coder.code_uniform(0 if walks.ends is None else walks.ends.tick, len(TICKS))
    if tick == 0:
        return GridWalks(walks.nodes, walks.walks, walks.timed, _no_ends(), shapes)

    # Offsets of starts and ends from the knots, in turn; tracks without times have none.
    pieces = _find_pieces(walks)
    low, high = _knot_ticks(pieces, grid, tick)
    ends = walks.ends if walks.ends is not None else PieceEnds(tick, low, high)
    is_coded = ~np.isin(pieces.walks, list(shapes))
    offsets = np.stack([ends.first - low, high - ends.last], axis=1)
    coded = offsets[is_coded].reshape(-1)
    kinds = _end_kinds(_end_speeds(walks.nodes, pieces), pieces)[is_coded].reshape(-1)
    counts = np.array([_OFFSET_COUNTS], np.int32)
    is_valid = coder.code_offsets(coded, kinds, counts, _levels(grid, tick))
    offsets[is_coded] = coded.reshape(-1, 2)

    # Move the ends inwards from the knots; those of valid walks do not cross.
    ends = PieceEnds(tick, low + offsets[:, 0], high - offsets[:, 1])
    if not is_valid or (ends.first > ends.last).any():
        raise CorruptArchiveError("a track ends before it starts")
    return GridWalks(walks.nodes, walks.walks, walks.timed, ends, shapes)


def _no_ends() -> PieceEnds:
    """Ends of pieces that last from knot to knot."""
    return PieceEnds(0, *np.zeros((2, 0), np.int64))


def _code_shapes(coder: TailCoder, walks: GridWalks) -> frozenset[int]:
    """Code the numbers of the tracks that have no times."""
    # One decision for most archives; a flag for each track only where any has no times.
    if not coder.code_rare(len(walks.untimed) > 0):
        return frozenset()
    flags = [
        coder.code_uniform(int(number in walks.untimed), 2) for number in range(len(walks.walks))
    ]
    return frozenset(number for number, flag in enumerate(flags) if flag)


def _find_pieces(walks: GridWalks) -> _Pieces:
    """Find the pieces of all walks."""
    # The walk of a piece is the number of walks that have begun before its first knot ends.
    knots = concatenate_knots(walks)
    first, last = ends_of_pieces(knots)
    numbers = np.cumsum(knots.begins == 1)[first] - 1
    counts = np.bincount(numbers, minlength=len(walks.walks)).astype(np.int64)
    return _Pieces(knots, first, last, numbers, counts)


def _end_speeds(nodes: NDArray[np.int64], pieces: _Pieces) -> NDArray[np.float64]:
    """Speed of each piece in its first and its last segment, in space steps by time step.

    Returns an array of shape (pieces, 2).
    """
    # Gaps, and what lies between two walks, are no segments.
    knots = pieces.knots
    positions = nodes[knots.nodes].astype(np.float64)
    lengths = np.sqrt(((positions[1:] - positions[:-1]) ** 2).sum(axis=1))
    speed = lengths / np.maximum(np.diff(knots.time_steps), 1)
    speed = np.where(pieces.is_first[1:], 0.0, speed)

    # A piece of one knot has no segment, so that its speed is 0.
    after, before = np.append(speed, 0.0), np.append(0.0, speed)
    if not len(knots.nodes):
        return np.zeros((0, 2))
    return np.stack([after[pieces.is_first], before[pieces.is_last]], axis=1)


def _end_kinds(speeds: NDArray[np.float64], pieces: _Pieces) -> NDArray[np.int8]:
    """Which starts and ends have an offset, shape (pieces, 2)."""
    # A time step at this speed leads farther than a piece may go on, so that an end may matter.
    kinds = np.where(speeds > _MAX_OVERRUN, SOMETIMES, NEVER).astype(np.int8)
    ends = np.cumsum(pieces.counts, dtype=np.int64)
    kinds[ends - pieces.counts, 0] = ALWAYS
    kinds[ends - 1, 1] = ALWAYS
    return kinds


def _levels(grid: QuantisationGrid, tick: int) -> int:
    """Offsets below this have a quotient of 0: a time step, and a tick for rounding at each end."""
    numerator, denominator = TICKS[tick]
    return int(step_size(grid.time) * denominator / numerator) + 2


def _knot_ticks(
    pieces: _Pieces, grid: QuantisationGrid, tick: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Ticks at or before the first knot of each piece, and at or after its last."""
    time_steps = pieces.knots.time_steps
    first, last = time_steps[pieces.is_first], time_steps[pieces.is_last]

    # The format fixes the order of these operations.
    numerator, denominator = TICKS[tick]
    step = step_size(grid.time)
    low, high = (
        time_steps.astype(np.float64) * step * denominator / numerator
        for time_steps in (first, last)
    )
    if max(np.abs(low).max(initial=0.0), np.abs(high).max(initial=0.0)) >= _MAX_TICKS:
        raise CorruptArchiveError("pieces lie too far from the epoch to tell where they end")
    return np.floor(low).astype(np.int64), np.ceil(high).astype(np.int64)


def _knot_ranges(pieces: _Pieces, grid: QuantisationGrid) -> NDArray[np.float64]:
    """Times of the first and last knot of each piece, shape (pieces, 2), in seconds."""
    time_steps = pieces.knots.time_steps
    ends = np.stack([time_steps[pieces.is_first], time_steps[pieces.is_last]], axis=1)
    return grid.epoch / 1000 + ends.astype(np.float64) * step_size(grid.time)


def _sample_ranges(
    time_ranges: Sequence[NDArray[np.float64]],
    walks: GridWalks,
    pieces: _Pieces,
    grid: QuantisationGrid,
) -> NDArray[np.float64]:
    """Seconds since the epoch of the first and last sample of each piece, shape (pieces, 2).

    Those of its knots if it has no sample.
    """
    # Time ranges of all tracks with times, and the walk of each.
    ranges = _knot_ranges(pieces, grid)
    if not len(ranges):
        return ranges
    counts = [len(of_track) for of_track in time_ranges]
    of_walk = np.repeat(np.arange(len(walks.walks)), counts)
    samples = np.concatenate(list(time_ranges))
    if walks.untimed:
        is_timed = ~np.isin(of_walk, list(walks.untimed))
        of_walk, samples = of_walk[is_timed], samples[is_timed]

    # Take the first and last time in each piece.
    piece = _pieces_of_ranges(samples[:, 0] + _SEARCH_TOLERANCE, of_walk, ranges[:, 0], pieces)
    first, last = np.full(len(ranges), np.inf), np.full(len(ranges), -np.inf)
    np.minimum.at(first, piece, samples[:, 0])
    np.maximum.at(last, piece, samples[:, 1])
    has_samples = first <= last
    ranges[has_samples] = np.stack([first[has_samples], last[has_samples]], axis=1)

    # A walk without times lies at the epoch, which is on every tick.
    if walks.untimed:
        ranges[np.isin(pieces.walks, list(walks.untimed))] = grid.epoch / 1000
    return ranges - grid.epoch / 1000


def _pieces_of_ranges(
    times: NDArray[np.float64],
    of_walk: NDArray[np.int64],
    starts: NDArray[np.float64],
    pieces: _Pieces,
) -> NDArray[np.int64]:
    """Number of the last piece of a walk that begins before each time, or of its first piece."""
    # In the order of walks and times, with a piece before the times equal to its start, count the
    # pieces so far.
    walk = np.concatenate([pieces.walks, of_walk])
    is_time = np.arange(len(walk)) >= len(starts)
    order = np.lexsort((is_time, np.concatenate([starts, times]), walk))
    so_far = np.empty(len(walk), np.int64)
    so_far[order] = np.cumsum(~is_time[order]) - 1
    first_pieces = np.cumsum(pieces.counts) - pieces.counts
    numbers: NDArray[np.int64] = np.maximum(so_far[len(starts) :], first_pieces[of_walk])
    return numbers


def _round_to_ticks(
    since_epoch: NDArray[np.float64], max_rounding: float
) -> tuple[int, NDArray[np.int64], NDArray[np.int64]]:
    """Find the tick for times, and round these outwards.

    Parameters
    ----------
    since_epoch : float64 array, shape (pieces, 2)
        Seconds since the epoch.
    max_rounding : float
        Ticks of at most so many seconds will do, whether times are multiples of them or not.

    Returns
    -------
    int
        Index of the coarsest tick that will do, or of the finest.
    int64 array, int64 array
        First and second column, in ticks.
    """
    finest = len(TICKS) - 1
    for tick, (numerator, denominator) in enumerate(TICKS[1:], 1):
        counts = np.rint(since_epoch * denominator / numerator)
        errors = np.abs(counts * numerator / denominator - since_epoch)
        is_exact = (errors <= _TICK_TOLERANCE).all()
        if is_exact or numerator / denominator <= max_rounding or tick == finest:
            break

    # A time that counts as a multiple stays on its tick: float noise must not round it to the next.
    tolerance = _TICK_TOLERANCE * denominator / numerator
    first = np.floor(since_epoch[:, 0] * denominator / numerator + tolerance)
    last = np.ceil(since_epoch[:, 1] * denominator / numerator - tolerance)
    return tick, first.astype(np.int64), last.astype(np.int64)
