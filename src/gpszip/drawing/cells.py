"""Pictures of square cells, coloured by the number of points in each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.drawing.map_figure import add_color_bar, map_figure
from gpszip.drawing.style import COLUMN_WIDTH, INK, FigureType, Layout, style

__all__ = ["draw_cells"]

#: Part of the color map inferno that stands out from white paper, dark for many points.
_SHADES = (0.9, 0.05)

Floats = NDArray[np.float64]


def draw_cells(
    xs: Floats,
    ys: Floats,
    counts: NDArray[np.int64],
    *,
    square: tuple[Floats, Floats] | None = None,
    width: float = COLUMN_WIDTH,
) -> FigureType:
    """Draw the cells that have points, in colours on a logarithmic scale.

    Parameters
    ----------
    xs, ys : float64 arrays, shape (a + 1,) and (b + 1,)
        Borders of the cells in metres.
    counts : int64 array, shape (a, b)
        Points in each cell.
    square : pair of float64 arrays, optional
        x and y whose extent is marked by a frame.
    width : float, default 85
        Millimetres of the picture.
    """
    with style():
        from matplotlib import colormaps
        from matplotlib.colors import ListedColormap, LogNorm
        from matplotlib.patches import Rectangle

        # The cells.
        layout = Layout(width)
        corners = np.array([[xs[0], ys[0]], [xs[-1], ys[-1]]])
        figure, axes = map_figure([corners], layout)
        most = max(int(counts.max()), 2)
        cells = axes.pcolormesh(
            xs,
            ys,
            np.ma.masked_equal(counts, 0).T,
            cmap=ListedColormap(colormaps["inferno"](np.linspace(*_SHADES, 256))),
            norm=LogNorm(1, most),
            rasterized=True,
        )

        # What colours and the frame mean.
        add_color_bar(figure, layout, cells, (1, most), "points in a cell")
        if square is not None:
            corner = (float(square[0][0]), float(square[1][0]))
            sides = (float(np.ptp(square[0])), float(np.ptp(square[1])))
            axes.add_patch(Rectangle(corner, *sides, fill=False, color=INK, linewidth=0.8))
    return figure
