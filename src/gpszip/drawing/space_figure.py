"""Figures of tracks in x, y and time, seen from above at an angle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from gpszip.drawing.elapsed import time_unit
from gpszip.drawing.map_figure import add_title, from_above
from gpszip.drawing.style import new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

    from gpszip.drawing.style import Layout

__all__ = ["SpaceScale", "draw_space_lines", "space_figure"]

#: Height of the picture relative to its width.
_ASPECT = 0.8

#: Length of the axis of time relative to the longer side of the map.
_TIME_AXIS = 0.9

#: Least length of the shorter side of the map relative to the longer one.
_MIN_SIDE = 0.35

#: Least extent, in place of zero.
_MIN_EXTENT = 1e-3

#: Metres from which the axes count kilometres.
_KILOMETRES = 5_000.0

#: Size of the drawing in a narrow and a wide figure, so that the labels of its axes fit.
_ZOOMS = (0.78, 0.95)

#: Width in millimetres from which a figure is wide.
_WIDE = 130.0

#: A side of the map below this share of the longer one has space for few ticks.
_SHORT = 0.6

#: From where the picture is seen, in degrees above the ground and about the axis of time.
_ELEVATION, _AZIMUTH = 22, -58

#: Line width of tracks, in points.
_WIDTH = 0.9

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SpaceScale:
    """Origin and units of the axes of a figure.

    Parameters
    ----------
    origin : float64 array, shape (3,)
        Least x, y and time, in metres and seconds.
    sizes : float64 array, shape (3,)
        Metres, metres and seconds of the units of the axes.
    reach : float64 array, shape (3,)
        Extent in these units.
    unit : str
        Unit of places.
    time_label : str
        Label of the axis of time.
    """

    origin: Floats
    sizes: Floats
    reach: Floats
    unit: str
    time_label: str

    @classmethod
    def of(cls, positions: Sequence[Floats], times: Sequence[Floats]) -> SpaceScale:
        """Return the scale that shows all positions, from the south-west and the first time.

        Examples
        --------
        >>> scale = SpaceScale.of([np.array([[5.0, 0.0], [8005.0, 0.0]])], [np.array([0.0, 600.0])])
        >>> scale.unit, scale.time_label, scale.reach.tolist()
        ('km', 'minutes since the start', [8.0, 0.0, 10.0])
        """
        points = np.concatenate(
            [
                np.column_stack([from_above(place), time])
                for place, time in zip(positions, times, strict=True)
            ]
        )
        low, high = points.min(axis=0), points.max(axis=0)
        seconds, time_label = time_unit(float(low[2]), float(high[2]))
        is_far = float((high - low)[:2].max()) >= _KILOMETRES
        metres, unit = (1000.0, "km") if is_far else (1.0, "m")
        sizes = np.array([metres, metres, seconds])
        return cls(low, sizes, (high - low) / sizes, unit, time_label)

    def points(self, positions: Floats, times: Floats) -> Floats:
        """Return positions at times in the units of the axes, shape (n, 3)."""
        scaled: Floats = (
            np.column_stack([from_above(positions), times]) - self.origin
        ) / self.sizes
        return scaled


def space_figure(layout: Layout, scale: SpaceScale) -> tuple[Figure, Axes3D]:
    """Return a figure with three axes; x and y have one scale.

    Parameters
    ----------
    layout : Layout
        Width and title of the figure.
    scale : SpaceScale
        Extent and units.
    """
    from matplotlib.ticker import MaxNLocator

    # One scale on the ground, and a height that suits it.
    figure = new_figure(layout.width, layout.width * _ASPECT)
    place = (-0.06, 0.06, 0.99, 0.94)
    axes = cast("Axes3D", figure.add_axes(place, projection="3d", computed_zorder=False))
    reach = scale.reach[:2]
    sides = np.maximum(reach, _MIN_SIDE * max(float(reach.max()), _MIN_EXTENT))
    axes.set_xlim(0, sides[0])
    axes.set_ylim(0, sides[1])
    axes.set_zlim(0, float(scale.reach[2]) or 1.0)
    axes.set_zlabel(scale.time_label)
    axes.set_box_aspect((*sides, _TIME_AXIS * sides.max()), zoom=_ZOOMS[layout.width >= _WIDE])
    axes.set_proj_type("ortho")
    axes.view_init(_ELEVATION, _AZIMUTH)

    # Few ticks, fewer on a short side, and white walls.
    shares = (*(sides / sides.max()), 1.0)
    for axis, share in zip((axes.xaxis, axes.yaxis, axes.zaxis), shares, strict=True):
        axis.set_major_locator(MaxNLocator(4 if share > _SHORT else 2))
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
    axes.tick_params(pad=-1)
    add_title(figure, layout)
    return figure, axes


def draw_space_lines(
    axes: Axes3D,
    lines: Sequence[Floats],
    colors: Any,
    name: str,
    *,
    width: float = _WIDTH,
    order: int = 2,
) -> None:
    """Draw lines of shape (n, 3), those of a higher order on top."""
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    axes.add_collection(
        Line3DCollection(
            lines, colors=colors, linewidths=width, capstyle="round", zorder=order, gid=name
        )
    )
