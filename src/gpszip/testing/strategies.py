"""Hypothesis strategies for tracks, for tests of GPSZip and of software that uses it.

Tracks have what real logs have: uneven times, stops, repeated paths, jumps, times in seconds since
1970, and positions in UTM metres.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import MissingExtraError
from gpszip.model import Track

if TYPE_CHECKING:
    from hypothesis.strategies import DrawFn, SearchStrategy

__all__ = ["geographic_logs", "track_lists", "tracks"]

#: Metres in a degree of longitude at the equator.
_METRES_PER_DEGREE = 111_320.0


def tracks(
    *, dimension: int | None = None, min_points: int = 1, max_points: int = 60, far: bool = True
) -> SearchStrategy[Track]:
    """Draw tracks on a plane.

    Parameters
    ----------
    dimension : int, optional
        Number of coordinates; by default 1 to 3.
    min_points, max_points : int
        Bounds on the number of samples.
    far : bool
        Whether tracks may have times since 1970 (1e9 seconds) and UTM positions (1e7 metres)
        instead of small numbers.

    Returns
    -------
    SearchStrategy of Track

    Raises
    ------
    MissingExtraError
        If hypothesis is not installed.
    """
    st = _strategies()

    @st.composite  # type: ignore[untyped-decorator, unused-ignore]
    def draw_track(draw: DrawFn) -> Track:
        count = draw(st.integers(min_points, max_points))
        axes = dimension or draw(st.integers(1, 3))
        times = draw(_times(st, count))
        positions = draw(_positions(st, count, axes))
        shift = draw(st.booleans()) if far else False  # both to large numbers
        return Track(draw(_names(st)), times + shift * 1.7e9, positions + shift * 5e6)

    strategy: SearchStrategy[Track] = draw_track()
    return strategy


def track_lists(
    *, dimension: int = 2, max_tracks: int = 4, max_points: int = 40, far: bool = True
) -> SearchStrategy[list[Track]]:
    """Draw 1 to ``max_tracks`` tracks on one plane, with different names.

    Parameters
    ----------
    dimension : int
        Number of coordinates.
    max_tracks, max_points : int
        Bounds on the numbers of tracks and of samples in each.
    far : bool
        As for :func:`tracks`.

    Returns
    -------
    SearchStrategy of list of Track

    Raises
    ------
    MissingExtraError
        If hypothesis is not installed.
    """
    single = tracks(dimension=dimension, max_points=max_points, far=far)
    strategy: SearchStrategy[list[Track]] = _strategies().lists(
        single, min_size=1, max_size=max_tracks, unique_by=lambda track: track.id
    )
    return strategy


def geographic_logs(
    *, max_points: int = 40
) -> SearchStrategy[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Draw logs in degrees, also across the antimeridian and near the poles.

    Parameters
    ----------
    max_points : int
        Bound on the number of samples.

    Returns
    -------
    SearchStrategy of (float64 array of shape (n,), float64 array of shape (n, 2))
        Seconds, and latitude in [-89, 89] and longitude in [-180, 180).

    Raises
    ------
    MissingExtraError
        If hypothesis is not installed.
    """
    st = _strategies()

    # Draw metres about a place and convert them, so that a log may cross the antimeridian.
    @st.composite  # type: ignore[untyped-decorator, unused-ignore]
    def draw_log(draw: DrawFn) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        count = draw(st.integers(1, max_points))
        times = draw(_times(st, count))

        # Positions in metres about a point on the equator, near a pole or on the antimeridian.
        lat = draw(st.sampled_from([0.0, 48.1, -33.9, 78.2]))
        lon = draw(st.sampled_from([0.0, 11.6, 179.9995, -180.0, 151.2]))
        metres = draw(_positions(st, count, 2))

        # The same in degrees.
        lats = np.clip(lat + metres[:, 1] / _METRES_PER_DEGREE, -89.0, 89.0)
        lons = lon + metres[:, 0] / (_METRES_PER_DEGREE * np.cos(np.radians(lat)))
        return times, np.column_stack([lats, (lons + 180.0) % 360.0 - 180.0])

    # The decorator is untyped where hypothesis is missing: name the type.
    strategy: SearchStrategy[tuple[NDArray[np.float64], NDArray[np.float64]]] = draw_log()
    return strategy


def _strategies() -> Any:
    """The module of hypothesis's strategies."""
    try:
        import hypothesis.strategies
    except ImportError as error:
        raise MissingExtraError("testing", "drawing random tracks") from error
    return hypothesis.strategies


def _names(st: Any) -> Any:
    """Names of tracks: awkward ones, and any letters."""
    awkward = st.sampled_from(["0", "000", "walk 3", "1234567890123456789", "Ümläut", "a/0"])
    letters = st.characters(exclude_categories=("C", "Z"), exclude_characters='/,"')
    return awkward | st.text(letters, min_size=1, max_size=8)


def _times(st: Any, count: int) -> Any:
    """Increasing times in seconds, in whole milliseconds: even, uneven, or with gaps of hours."""
    steps = st.one_of(
        st.integers(1, 60_000).map(lambda step: [step] * (count - 1)),
        st.lists(
            st.integers(1, 5000) | st.integers(1, 50_000_000),
            min_size=count - 1,
            max_size=count - 1,
        ),
    )
    return steps.map(lambda values: np.cumsum([0, *values]) / 1000.0)


def _positions(st: Any, count: int, axes: int) -> Any:
    """Positions in runs: at constant velocity, stops, returns over the last positions, jumps."""
    run = st.tuples(
        st.sampled_from(["go", "stand", "back", "jump"]),
        st.integers(1, 12),
        st.lists(st.integers(-3000, 3000), min_size=axes, max_size=axes),
    )
    return st.lists(run, min_size=1, max_size=12).map(lambda runs: _drive(runs, count, axes))


def _drive(runs: list[tuple[str, int, list[int]]], count: int, axes: int) -> NDArray[np.float64]:
    """Positions in metres of runs, which are repeated until there are enough.

    A run is its kind, its number of positions, and its velocity in centimetres per position.
    """
    # Repeat the runs until there are enough positions.
    positions = [np.zeros(axes)]
    while len(positions) < count:
        for kind, length, velocity in runs:
            last, step = positions[-1], np.array(velocity) / 100.0
            if kind == "go":
                positions += [last + step * (i + 1) for i in range(length)]
            elif kind == "stand":
                positions += [last] * length
            elif kind == "back":
                # The last positions backward, from the one before the last.
                positions += positions[-2 : -length - 2 : -1]
            else:
                positions.append(last + step * 1000.0)

        # Runs back from the first position add nothing.
        if len(positions) == 1:
            positions.append(positions[0])
    return np.array(positions[:count])
