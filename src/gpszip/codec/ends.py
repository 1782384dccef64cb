"""When travel begins and ends in each piece of a walk, to a tick: knots lie on a coarser grid of time.

The first knot of a piece lies at or before its first sample, the last knot at or after its last sample, each up to a time step
away. What the walk does there nobody has seen. So an archive says where each track starts and ends; and where a piece beside a gap
does, if the walk goes far in that step.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.end_coder import ALWAYS, MAX_QUOTIENT, NEVER, SOMETIMES, code_end_offsets
from gpszip.codec.kernels.range_coder import Coder, code_interval, decode_cumulative
from gpszip.errors import CorruptArchiveError
from gpszip.model.grid import QuantisationGrid, step_size
from gpszip.model.grid_walks import GridWalk, GridWalks, PieceEnds

__all__ = ["TICKS", "code_tail", "find_piece_ends", "piece_time_ranges"]

#: Seconds of each tick as a fraction, by its index in the payload; index 0 stands for no ends at all.
TICKS = (
    (0, 1), (60, 1), (30, 1), (15, 1), (10, 1), (5, 1), (2, 1), (1, 1),
    (1, 2), (1, 5), (1, 10), (1, 20), (1, 50), (1, 100), (1, 200), (1, 1000),
)  # fmt: skip

#: A time counts as a multiple of a tick if it is at most so many seconds off: float64 seconds since 1970 are good to 2.4e-7 s.
_ON_TICK = 1e-5

#: Ends may be rounded by less than a quarter of the time between two samples, and by less than a second (or that time) in any case.
#: Exact ends of sparse tracks would take 5 % of the bytes of 129 short tracks, milliseconds 2 % of a log of 100 bytes.
_SHARE_OF_STEP = 0.25
_ROUNDED = 1.0

#: Space steps that a piece beside a gap may go on after its last sample, or before its first: about twice the error kept.
_BESIDE_GAP = 2.0

#: Counts of zeros and ones at first of whether a piece beside a gap is cut.
_CUT_COUNTS = (36, 4)

#: Ticks from the epoch within which arithmetic on int64 is safe.
_FARTHEST = 2.0**60

#: Any track is a shape with this probability, one in so many.
_SHAPES_TOTAL = 64


def find_piece_ends(
    spans: Sequence[NDArray[np.float64]],
    walks: GridWalks,
    grid: QuantisationGrid,
    step: float = 0.0,
) -> PieceEnds:
    """Find where the claim of each piece begins and ends.

    Parameters
    ----------
    spans : sequence of float64 array, shape (n, 2)
        For each walk the times of first and last sample, in seconds, of each run of samples without a gap; in the order of time.
    walks : LatticeWalks
        With times. A piece may hold several runs; one without any is claimed from knot to knot.
    grid : Frame
        Epoch and time step.
    step : float, default 0
        Seconds between two samples, of the track that has the most. Times may be rounded outwards by less than a quarter of that, or
        less than a second if that is no more than ``step``.

    Returns
    -------
    Ends
        On the coarsest tick of which all times are multiples, or to which they may be rounded.

    Examples
    --------
    >>> walk = GridWalk(np.array([0, 1], np.int32), np.array([0, 1]), np.array([False]))
    >>> ends = find_piece_ends([np.array([[0.0, 90.0]])], GridWalks(np.array([[0], [1]]), (walk,)), QuantisationGrid((0,), 0, 128, 200))
    >>> TICKS[ends.tick], ends.first.tolist(), ends.last.tolist()
    ((30, 1), [0], [3])
    """
    windows = [_windows(walk, grid) for walk in walks.walks]
    pieces = [
        # any time on the coarsest tick will do for what has no times
        np.full_like(window, grid.epoch / 1000)
        if number in walks.untimed
        else _claimed(own, window)
        for number, (own, window) in enumerate(zip(spans, windows, strict=True))
    ]
    since = np.concatenate(pieces) - grid.epoch / 1000 if pieces else np.zeros((0, 2))
    tick, first, last = _on_ticks(since, max(_SHARE_OF_STEP * step, min(_ROUNDED, step)))

    # what can't be coded, or makes no difference, is claimed from the knot on
    try:
        low, high = _bounds(walks, grid, tick)
    except CorruptArchiveError:
        return PieceEnds(0, *np.zeros((2, 0), np.int64))
    most = (MAX_QUOTIENT + 1) * _levels(grid, tick)
    top, bottom = TICKS[tick]
    cells = np.stack([first - low, high - last], axis=1) * (top / bottom / step_size(grid.time))
    moves = _moves(walks)
    matters = (_kinds(moves, walks) == ALWAYS) | (moves * cells > _BESIDE_GAP)
    first = np.where(matters[:, 0] & (first >= low) & (first - low < most), first, low)
    last = np.where(matters[:, 1] & (last <= high) & (high - last < most), last, high)
    return PieceEnds(tick, first, last)


def piece_time_ranges(walks: GridWalks, grid: QuantisationGrid) -> list[NDArray[np.float64]] | None:
    """Seconds at which the claim of each piece begins and ends, shape (pieces, 2) for each walk; None where that is not kept."""
    if walks.ends is None or walks.ends.tick == 0:
        return None
    top, bottom = TICKS[walks.ends.tick]
    claimed = (
        grid.epoch / 1000 + np.stack([walks.ends.first, walks.ends.last], axis=1) * top / bottom
    )
    windows = [_windows(walk, grid) for walk in walks.walks]
    if not windows:
        return []
    counts = np.cumsum([len(own) for own in windows])[:-1]
    return [
        np.stack([np.maximum(own[:, 0], window[:, 0]), np.minimum(own[:, 1], window[:, 1])], axis=1)
        for own, window in zip(np.split(claimed, counts), windows, strict=True)
    ]


def code_tail(coder: Coder, walks: GridWalks, grid: QuantisationGrid) -> GridWalks:
    """Code what follows the knots of walks with times: which tracks are shapes, and the ends of pieces.

    Parameters
    ----------
    coder : Coder
        Behind the knots, in either direction.
    walks : LatticeWalks
        Those that are written, or the knots that were read.
    grid : Frame
        Epoch and time step.

    Returns
    -------
    LatticeWalks
        The walks with what was coded.

    Raises
    ------
    CorruptArchiveError
        If what is read is no end.
    """
    shapes = _code_shapes(coder, walks)
    tick = _code_uniform(coder, 0 if walks.ends is None else walks.ends.tick, len(TICKS))
    if tick == 0:
        return GridWalks(
            walks.nodes, walks.walks, walks.timed, PieceEnds(0, *np.zeros((2, 0), np.int64)), shapes
        )
    low, high = _bounds(walks, grid, tick)
    own = walks.ends if walks.ends is not None else PieceEnds(tick, low, high)

    # starts and ends take turns, the pieces of shapes are left out
    pieces = np.array([1 + int(walk.gaps.sum()) for walk in walks.walks], dtype=np.int64)
    owner = np.repeat(np.arange(len(walks.walks)), pieces)
    coded = ~np.isin(owner, list(shapes))
    offsets = np.stack([own.first - low, high - own.last], axis=1)
    row, kinds = offsets[coded].reshape(-1), _kinds(_moves(walks), walks)[coded].reshape(-1)
    sound = code_end_offsets(
        coder, row, kinds, np.array([_CUT_COUNTS], np.int32), _levels(grid, tick)
    )
    offsets[coded] = row.reshape(-1, 2)
    ends = PieceEnds(tick, low + offsets[:, 0], high - offsets[:, 1])
    if not sound or (ends.first > ends.last).any():
        raise CorruptArchiveError("a track ends before it starts")
    return GridWalks(walks.nodes, walks.walks, walks.timed, ends, shapes)


def _code_shapes(coder: Coder, walks: GridWalks) -> frozenset[int]:
    """Code the numbers of the tracks that have no times."""
    reads = coder.cursor[1] == 1
    some = len(walks.untimed) > 0
    if reads:
        some = int(decode_cumulative(coder, _SHAPES_TOTAL)) == _SHAPES_TOTAL - 1
    if not some:
        code_interval(coder, 0, _SHAPES_TOTAL - 1, _SHAPES_TOTAL)
        return frozenset()
    code_interval(coder, _SHAPES_TOTAL - 1, 1, _SHAPES_TOTAL)
    flags = [
        _code_uniform(coder, int(number in walks.untimed), 2) for number in range(len(walks.walks))
    ]
    return frozenset(number for number, flag in enumerate(flags) if flag)


def _code_uniform(coder: Coder, value: int, total: int) -> int:
    if coder.cursor[1] == 1:
        value = int(decode_cumulative(coder, total))
    code_interval(coder, value, 1, total)
    return value


def _moves(walks: GridWalks) -> NDArray[np.float64]:
    """Space steps that each piece goes in a cell of its first part, and of its last; shape (pieces, 2)."""
    moves = []
    for walk in walks.walks:
        places = walks.nodes[walk.nodes].astype(np.float64)
        length = np.sqrt(((places[1:] - places[:-1]) ** 2).sum(axis=1))
        pace = np.where(walk.gaps, 0.0, length / np.maximum(np.diff(walk.time_steps), 1))

        # the part behind the first knot, the part before the last; none in a piece of one knot
        after, before = np.append(pace, 0.0), np.append(0.0, pace)
        moves.append(
            np.stack(
                [after[np.append(True, walk.gaps)], before[np.append(walk.gaps, True)]], axis=1
            )
        )
    return np.concatenate(moves) if moves else np.zeros((0, 2))


def _kinds(moves: NDArray[np.float64], walks: GridWalks) -> NDArray[np.int8]:
    """Which ends have an offset, shape (pieces, 2)."""
    kinds = np.where(moves > _BESIDE_GAP, SOMETIMES, NEVER).astype(np.int8)
    after = np.cumsum([1 + int(walk.gaps.sum()) for walk in walks.walks], dtype=np.int64)
    kinds[np.append(0, after[:-1])[: len(after)], 0] = ALWAYS
    kinds[after - 1, 1] = ALWAYS
    return kinds


def _levels(grid: QuantisationGrid, tick: int) -> int:
    """Offsets below this are coded without a wrap: one step, in ticks, and a tick at either side for rounding."""
    top, bottom = TICKS[tick]
    return int(step_size(grid.time) * bottom / top) + 2


def _bounds(
    walks: GridWalks, grid: QuantisationGrid, tick: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Ticks at or before the first knot of each piece, and at or after its last."""
    top, bottom = TICKS[tick]
    first = np.concatenate(
        [walk.time_steps[np.append(True, walk.gaps)] for walk in walks.walks]
        or [np.zeros(0, np.int64)]
    )
    last = np.concatenate(
        [walk.time_steps[np.append(walk.gaps, True)] for walk in walks.walks]
        or [np.zeros(0, np.int64)]
    )
    step = step_size(grid.time)
    low, high = (cells.astype(np.float64) * step * bottom / top for cells in (first, last))
    if max(np.abs(low).max(initial=0.0), np.abs(high).max(initial=0.0)) >= _FARTHEST:
        raise CorruptArchiveError("pieces lie too far from the epoch to tell where they end")
    return np.floor(low).astype(np.int64), np.ceil(high).astype(np.int64)


def _windows(walk: GridWalk, grid: QuantisationGrid) -> NDArray[np.float64]:
    """Times of the first and last knot of each piece, shape (pieces, 2), in seconds."""
    times = grid.epoch / 1000 + walk.time_steps.astype(np.float64) * step_size(grid.time)
    return np.stack([times[np.append(True, walk.gaps)], times[np.append(walk.gaps, True)]], axis=1)


def _claimed(spans: NDArray[np.float64], windows: NDArray[np.float64]) -> NDArray[np.float64]:
    """First and last sample of each window; a window without samples is claimed whole."""
    piece = np.clip(np.searchsorted(windows[:, 0], spans[:, 0] + 1e-3, side="right") - 1, 0, None)
    first, last = np.full(len(windows), np.inf), np.full(len(windows), -np.inf)
    np.minimum.at(first, piece, spans[:, 0])
    np.maximum.at(last, piece, spans[:, 1])
    empty = first > last
    return np.stack(
        [np.where(empty, windows[:, 0], first), np.where(empty, windows[:, 1], last)], axis=1
    )


def _on_ticks(
    since: NDArray[np.float64], rounded: float
) -> tuple[int, NDArray[np.int64], NDArray[np.int64]]:
    """The coarsest tick of which all times are multiples or that is at most ``rounded`` seconds, and the times in ticks."""
    finest = len(TICKS) - 1
    for tick, (top, bottom) in enumerate(TICKS[1:], 1):
        count = np.rint(since * bottom / top)
        exact = (np.abs(count * top / bottom - since) <= _ON_TICK).all()
        if exact or top / bottom <= rounded or tick == finest:
            break
    near = _ON_TICK * bottom / top
    first, last = (
        np.floor(since[:, 0] * bottom / top + near),
        np.ceil(since[:, 1] * bottom / top - near),
    )
    return tick, first.astype(np.int64), last.astype(np.int64)
