"""Leave places out of tracks before they are shared."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.model.track import Track

__all__ = ["hide_places"]

#: Largest distance of the centre of a circle from the place that it hides, as a share of its
#: radius: tracks that all end on a circle around a home would show it.
_MAX_SHIFT = 0.7

#: Seconds, or metres of a shape, below which nothing is left of a piece.
_LEAST = 1e-3

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


def hide_places(
    pieces: Sequence[Track],
    owners: Mapping[str, str],
    places: Floats,
    rng: np.random.Generator,
    *,
    radius: float | None = None,
    ends: float | None = None,
    sampled: bool = False,
) -> tuple[list[Track], dict[str, str]]:
    """Leave out what tracks did around places, and where each track began and ended.

    Parameters
    ----------
    pieces : sequence of Track
        Pieces of tracks between gaps, in the order of time.
    owners : mapping of str to str
        Name of the track of each piece; a piece that is not named is a track.
    places : float64 array, shape (k, d)
        Metres.
    rng : numpy.random.Generator
        Moves the circles, so that no place is at the centre of one.
    radius : float, optional
        Radius of the circle around each place.
    ends : float, optional
        Radius of the circles around the first and the last position of each track, which hide
        positions of this track alone.
    sampled : bool, default False
        Whether positions are samples, of which those in circles are left out. Else lines between
        knots are cut where they enter and leave a circle.

    Returns
    -------
    list of Track
        Pieces, without attributes unless they are sampled.
    dict of str to str
        Name of the track of each piece.

    Examples
    --------
    >>> lane = Track("lane", [0, 100], [[0, 0], [1000, 0]])
    >>> rng = np.random.default_rng(1)
    >>> left, owners = hide_places([lane], {}, np.array([[0.0, 0.0]]), rng, radius=200.0)
    >>> bool(60 < left[0].positions[0, 0] < 340), left[0].times[-1].item(), owners
    (True, 100.0, {'lane': 'lane'})
    """
    # Circles that hide places from all tracks.
    dimension = pieces[0].dimension if pieces else 2
    common = _move(places.reshape(-1, dimension), radius or 0.0, rng) if radius else None
    by_track: dict[str, list[Track]] = {}
    for piece in pieces:
        by_track.setdefault(owners.get(piece.id, piece.id), []).append(piece)

    # What is left of each track.
    left: dict[str, list[Track]] = {}
    for name, own in by_track.items():
        circles = [] if common is None else [(centre, radius or 0.0) for centre in common]
        if ends:
            both = np.stack([own[0].positions[0], own[-1].positions[-1]])
            circles += [(centre, ends) for centre in _move(both, ends, rng)]
        left[name] = [part for piece in own for part in _parts(piece, circles, sampled=sampled)]
    return _name(left)


def _move(positions: Floats, radius: float, rng: np.random.Generator) -> Floats:
    """Return positions that are moved in the plane, evenly within a part of the radius."""
    angle = rng.uniform(0, 2 * np.pi, len(positions))
    distance = _MAX_SHIFT * radius * np.sqrt(rng.uniform(0, 1, len(positions)))
    moved = positions.copy()
    moved[:, 0] += distance * np.cos(angle)
    if positions.shape[1] > 1:
        moved[:, 1] += distance * np.sin(angle)
    return moved


def _parts(
    piece: Track, circles: Sequence[tuple[Floats, float]], *, sampled: bool
) -> Iterator[Track]:
    """Yield what is left of a piece outside of circles."""
    if sampled or len(piece) < 2:
        hidden = np.zeros(len(piece), np.bool_)
        for centre, radius in circles:
            hidden |= ((piece.positions[:, :2] - centre[:2]) ** 2).sum(axis=1) <= radius**2
        for rows in _runs(~hidden):
            attributes = {name: values[rows] for name, values in piece.attributes.items()}
            times, positions = piece.times[rows], piece.positions[rows]
            yield replace(piece, times=times, positions=positions, attributes=attributes)
        return

    # Times between which it is in no circle.
    bounds = _outside(piece, circles)
    for begin, end in bounds:
        inner = piece.times[(piece.times > begin) & (piece.times < end)]
        times = np.concatenate([[begin], inner, [end]])
        line = [np.interp(times, piece.times, axis) for axis in piece.positions.T]
        if not piece.timed:
            times = times - begin
        yield Track(piece.id, times, np.stack(line, axis=1), plane=piece.plane, timed=piece.timed)


def _runs(kept: Bools) -> list[slice]:
    """Runs of rows that are kept."""
    changes = np.diff(np.concatenate([[0], kept.astype(np.int8), [0]]))
    begins, ends = np.flatnonzero(changes > 0), np.flatnonzero(changes < 0)
    return [slice(begin, end) for begin, end in zip(begins.tolist(), ends.tolist(), strict=True)]


def _outside(piece: Track, circles: Sequence[tuple[Floats, float]]) -> list[tuple[float, float]]:
    """Times between which a piece, which is linear between its knots, is in no circle.

    A segment a + s (b - a) is in a circle of radius r around c where |a - c + s (b - a)| <= r:
    between both roots of a quadratic equation in s.
    """
    # Times in circles.
    times, flat = piece.times, piece.positions[:, :2]
    steps, durations = np.diff(flat, axis=0), np.diff(times)
    squares = (steps**2).sum(axis=1)
    hidden = []
    for centre, radius in circles:
        offset = flat[:-1] - centre[:2]
        half = (offset * steps).sum(axis=1)
        rest = (offset**2).sum(axis=1) - radius**2
        moving = squares > 0
        root = np.sqrt(np.maximum(half**2 - squares * rest, 0.0))
        scale = np.where(moving, squares, 1.0)
        first = np.where(moving, (-half - root) / scale, 0.0)
        last = np.where(moving, (-half + root) / scale, 1.0)
        touches = np.where(moving, half**2 >= squares * rest, rest <= 0)
        touches &= (last >= 0) & (first <= 1)
        first, last = np.clip(first, 0, 1)[touches], np.clip(last, 0, 1)[touches]
        starts, spans = times[:-1][touches], durations[touches]
        hidden.append(np.stack([starts + first * spans, starts + last * spans], axis=1))

    # What lies between them.
    ranges = np.concatenate([*hidden, np.zeros((0, 2))])
    ranges = ranges[np.argsort(ranges[:, 0], kind="stable")]
    reached = np.maximum.accumulate(np.append(times[0], ranges[:, 1]))
    begins, ends = reached, np.append(ranges[:, 0], times[-1])
    return [
        (begin, end)
        for begin, end in zip(begins.tolist(), ends.tolist(), strict=True)
        if end - begin > _LEAST
    ]


def _name(left: Mapping[str, Sequence[Track]]) -> tuple[list[Track], dict[str, str]]:
    """Name pieces after their tracks, with as many slashes as make the names unique."""
    taken = {name for name, parts in left.items() if len(parts) == 1}
    pieces: list[Track] = []
    owners: dict[str, str] = {}
    for name, parts in left.items():
        names, slashes = [name], "/"
        if len(parts) != 1:
            while not taken.isdisjoint(
                names := [f"{name}{slashes}{number}" for number in range(len(parts))]
            ):
                slashes += "/"
            taken.update(names)
        pieces += [replace(part, id=own) for part, own in zip(parts, names, strict=True)]
        owners |= dict.fromkeys(names, name)
    return pieces, owners
