"""Colours, fonts and sizes of all pictures, and how they are saved. Needs the extra ``plot``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from gpszip.errors import MissingExtraError, OptionError, OutputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "COLUMN_WIDTH",
    "CYCLE",
    "DPI",
    "EDGE_COLOR",
    "GREY",
    "INK",
    "LOG_COLOR",
    "MM_PER_INCH",
    "PAGE_WIDTH",
    "PICTURE_FORMATS",
    "FigureType",
    "Layout",
    "new_figure",
    "picture_format",
    "printable",
    "require_matplotlib",
    "save_figure",
    "size_in_mm",
    "style",
]

#: The type of figures, for annotations where matplotlib is not imported.
FigureType: TypeAlias = "Figure"

#: Formats of pictures by the suffixes of their files; the first is that of standard output.
PICTURE_FORMATS = ("png", "svg", "pdf")

#: Width in millimetres of one column of a paper with two.
COLUMN_WIDTH = 85.0

#: Width in millimetres of both columns.
PAGE_WIDTH = 175.0

#: Resolution of pixels in dots per inch, what journals ask for.
DPI = 300

#: Widths in millimetres that a picture may have: text fits, and a file stays small.
_WIDTHS = (60.0, 1000.0)

#: Resolutions in dots per inch that a picture may have.
_RESOLUTIONS = (50, 1200)

#: Millimetres in an inch, the unit of matplotlib.
MM_PER_INCH = 25.4

# Colours of Okabe and Ito (2008), distinct with any kind of colour vision; blue and orange are
# distinct in grey, too.

#: Color of the map's edges.
EDGE_COLOR = "#0072B2"

#: Color of the log's samples.
LOG_COLOR = "#E69F00"

#: Color of text and the scale bar.
INK = "#222222"

#: Color of what stands behind: grid lines, samples where colours mean something else.
GREY = "#B8BDC2"

#: Colors that tell neighbours apart.
CYCLE = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00")

#: Settings of matplotlib. Fonts are embedded in PDF as TrueType, text in SVG stays text, and the
#: ids of SVG are the same at every run.
_SETTINGS = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 7.0,
    "axes.titlesize": 9.0,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.6,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "grid.color": "#E4E6E8",
    "grid.linewidth": 0.5,
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
    "svg.hashsalt": "gpszip",
}

#: What files say of themselves: without the time at which they were made, the same picture has the
#: same bytes.
_METADATA: dict[str, dict[str, Any]] = {
    "png": {},
    "svg": {"Date": None},
    "pdf": {"CreationDate": None},
}


@dataclass(frozen=True)
class Layout:
    """The width of a picture, and the text about it.

    Parameters
    ----------
    width : float, default 175.0
        Millimetres.
    title : str, optional
        Line above the picture.
    legend : bool, default True
        Whether colours and widths are explained. The scale bar and axes stay without.

    Raises
    ------
    OptionError
        If the width is not between 60 and 1000 mm.
    """

    width: float = PAGE_WIDTH
    title: str | None = None
    legend: bool = True

    def __post_init__(self) -> None:
        low, high = _WIDTHS
        if not low <= self.width <= high:
            raise OptionError(
                f"a picture of {self.width:g} mm can't be drawn",
                remedy=f"give a width from {low:g} to {high:g} mm",
            )


def require_matplotlib() -> None:
    """Check that matplotlib is there before any work.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    try:
        import matplotlib.style  # noqa: F401
    except ImportError as error:
        raise MissingExtraError("plot", "drawing") from error


@contextmanager
def style() -> Iterator[None]:
    """Draw in the style of this package, whatever the user's own settings of matplotlib.

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    """
    require_matplotlib()
    from matplotlib.style import context

    with context(["default", _SETTINGS]):
        yield


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of a size in millimetres, without pyplot's global state."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width / MM_PER_INCH, height / MM_PER_INCH))


def size_in_mm(figure: Figure) -> tuple[float, float]:
    """Return width and height of a figure in millimetres, to a tenth."""
    width, height = (round(float(side) * MM_PER_INCH, 1) for side in figure.get_size_inches())
    return width, height


def picture_format(path: str | Path) -> str:
    """Return the format of a picture from the suffix of its file; PNG for standard output.

    Raises
    ------
    OutputError
        If the suffix is of none of the formats.

    Examples
    --------
    >>> picture_format("map.SVG"), picture_format("-")
    ('svg', 'png')
    """
    if str(path) == "-":
        return PICTURE_FORMATS[0]
    suffix = Path(path).suffix.lower().removeprefix(".")
    if suffix not in PICTURE_FORMATS:
        raise OutputError(
            "can't tell the format of the picture from this name",
            path=path,
            remedy=f"end it with one of {', '.join(f'.{name}' for name in PICTURE_FORMATS)}",
        )
    return suffix


def save_figure(figure: Figure, path: Path, kind: str, dpi: int = DPI) -> None:
    """Write a figure to a file in one of :data:`PICTURE_FORMATS`.

    The label of the figure becomes the title that the file states.

    Raises
    ------
    OptionError
        If the resolution is not between 50 and 1200 dots per inch.
    """
    low, high = _RESOLUTIONS
    if not low <= dpi <= high:
        raise OptionError(
            f"a picture with {dpi} dots per inch can't be written",
            remedy=f"give from {low} to {high}",
        )
    title = figure.get_label()
    metadata = {**_METADATA[kind], **({"Title": title} if title else {})}
    with style():
        figure.savefig(path, format=kind, dpi=dpi, metadata=metadata)


def printable(text: str) -> str:
    r"""Replace characters that neither fonts nor SVG have, such as control characters, by U+FFFD.

    Examples
    --------
    >>> printable("bus 7"), ascii(printable("bus\t7"))
    ('bus 7', "'bus\\ufffd7'")
    """
    return "".join(
        letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in text
    )
