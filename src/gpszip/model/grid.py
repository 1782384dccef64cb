"""Where and on what lattice positions and times are given."""

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

#: Quanta come in eighths of an octave; literal so that every machine has the same eight numbers.
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

#: Number of quanta that an archive can name (one byte).
STEP_SIZES = 256


#: How often an archive on a map kept elsewhere may halve the map's quanta.
MAX_REFINEMENTS = 3


def step_size(index: int) -> float:
    """Size of the quantum with this index: ``2 ** (index / 8 - 16)`` metres or seconds.

    Examples
    --------
    >>> step_size(128), step_size(136)
    (1.0, 2.0)
    """
    return float(_EIGHTHS[index % 8] * 2.0 ** (index // 8 - 16))


def step_index(size: float) -> int:
    """Index of the largest quantum that is not above ``size``, between 0 and 255.

    Examples
    --------
    >>> step_index(1.0), step_index(1.9), step_index(1e-9)
    (128, 135, 0)
    """
    index = 0
    while index + 1 < STEP_SIZES and step_size(index + 1) <= size * (1 + 1e-12):
        index += 1
    return index


@dataclass(frozen=True)
class Plane:
    """One or more transverse Mercator planes on WGS84, laid side by side.

    Data wider than one plane can carry lies on several: positions on plane i are moved by ``i * SPREAD`` metres in x,
    so that one coordinate system holds them all and places on different planes are never near.

    Parameters
    ----------
    centers : tuple of (int, int)
        Latitude and longitude of each plane's centre in units of 1e-7 degrees.
    """

    centers: tuple[tuple[int, int], ...]

    #: Distance in x between neighbouring planes in metres.
    SPREAD = float(1 << 25)


@dataclass(frozen=True)
class QuantisationGrid:
    """The lattice on which an archive keeps its nodes and times.

    A node with integer coordinates c lies at ``origin / 1000 + c * quantum(space)`` metres,
    cell g is the instant ``epoch / 1000 + g * quantum(time)`` seconds.

    Parameters
    ----------
    origin : tuple of int
        One number of millimetres for each of the d axes.
    epoch : int
        Milliseconds in the log's own zero.
    space, time : int
        Indices of the quanta, see :func:`step_size`.
    plane : Plane, optional
        The planes of a log that came in degrees.
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
    """Return the lattice with both quanta halved so many times."""
    return replace(grid, space=grid.space - 8 * times, time=grid.time - 8 * times)
