"""The quantisation grid of an archive: the positions and times it can hold, and its plane."""

from __future__ import annotations

from dataclasses import dataclass, replace

__all__ = [
    "MAX_REFINEMENTS",
    "STEP_SIZES",
    "Plane",
    "QuantisationGrid",
    "refined_grid",
    "step_index",
    "step_size",
]

#: Powers of two in eighths of an octave, the sizes of grid steps. They are literal so that every
#: machine has the same eight numbers.
_EIGHTHS = (
    1.0,
    1.0905077326652577,
    1.189207115002721,
    1.2968395546510096,
    1.4142135623730951,
    1.5422108254079407,
    1.681792830507429,
    1.8340080864093424,
)

#: Number of step sizes that an archive can name (one byte).
STEP_SIZES = 256

#: How often an archive on a known map may halve the steps of the map's grid.
MAX_REFINEMENTS = 3

#: Centres of planes that a repr shows; data over the whole globe has thousands.
_MAX_SHOWN_CENTERS = 2

#: Rounding that the comparison of two step sizes forgives, as a share.
_RELATIVE_TOLERANCE = 1e-12


def step_size(index: int) -> float:
    """Size of the grid step with this index: ``2 ** (index / 8 - 16)`` metres or seconds.

    Examples
    --------
    >>> step_size(128), step_size(136)
    (1.0, 2.0)
    """
    # Eight indices make an octave, which a power of two multiplies without rounding.
    return float(_EIGHTHS[index % 8] * 2.0 ** (index // 8 - 16))


def step_index(size: float) -> int:
    """Index of the largest grid step that is not above ``size``, between 0 and 255.

    Examples
    --------
    >>> step_index(1.0), step_index(1.9), step_index(1e-9)
    (128, 135, 0)
    """
    # Compare with the sizes themselves: a logarithm may be rounded to the next index.
    index = 0
    limit = size * (1 + _RELATIVE_TOLERANCE)
    while index + 1 < STEP_SIZES and step_size(index + 1) <= limit:
        index += 1
    return index


@dataclass(frozen=True, repr=False)
class Plane:
    """One or more transverse Mercator planes on WGS84, side by side.

    Data wider than one plane can carry lies on several: positions on plane i are moved by
    ``i * SPREAD`` metres in x, so that one coordinate system holds them all, and positions on
    different planes are never near each other.

    Parameters
    ----------
    centers : tuple of (int, int)
        Latitude and longitude of each plane's centre in units of 1e-7 degrees.
    """

    centers: tuple[tuple[int, int], ...]

    #: Distance in x between neighbouring planes in metres.
    SPREAD = float(1 << 25)

    def __repr__(self) -> str:
        if len(self.centers) <= _MAX_SHOWN_CENTERS:
            return f"Plane(centers={self.centers!r})"
        return f"Plane({len(self.centers):,} centers, the first {self.centers[0]})"


@dataclass(frozen=True)
class QuantisationGrid:
    """The grid on which an archive keeps its nodes and times.

    A node with integer coordinates c lies at ``origin / 1000 + c * step_size(space)`` metres. Time
    step g is ``epoch / 1000 + g * step_size(time)`` seconds.

    Parameters
    ----------
    origin : tuple of int
        Millimetres, one number for each of the d axes.
    epoch : int
        Milliseconds, counted from the log's zero.
    space, time : int
        Indices of the step sizes, see :func:`step_size`.
    plane : Plane, optional
        The planes of a log in degrees.
    """

    origin: tuple[int, ...]
    epoch: int
    space: int
    time: int
    plane: Plane | None = None

    @property
    def dimension(self) -> int:
        """Number of coordinates d."""
        return len(self.origin)


def refined_grid(grid: QuantisationGrid, times: int) -> QuantisationGrid:
    """Return the grid with the steps of space and time halved ``times`` times."""
    # Eight indices less are half the step. The origin stays, so that old points are grid points.
    return replace(grid, space=grid.space - 8 * times, time=grid.time - 8 * times)
