"""Write a map as KML 2.2, for Google Earth and phones."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from gpszip.io.logs.xml.writing import escape_xml
from gpszip.io.maps.table import MapTable

__all__ = ["write_map_kml"]

#: Lines are drawn in an orange that shows on pictures of the earth: alpha, blue, green, red.
_COLOUR = "ff0080ff"

#: Pixels of the width of lines.
_WIDTH = 3

_HEADER = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<kml xmlns="http://www.opengis.net/kml/2.2">\n<Document>\n'
    f'<Style id="street"><LineStyle><color>{_COLOUR}</color><width>{_WIDTH}</width></LineStyle>'
    "</Style>\n"
)


def write_map_kml(table: MapTable, path: Path) -> None:
    """Write a placemark with a LineString for each edge, and its columns as ``Data``.

    An edge that crosses the antimeridian is a MultiGeometry, cut there. Columns that are NaN are
    left out.

    Parameters
    ----------
    table : MapTable
        The map, in degrees.
    path : Path
        The file.
    """
    with path.open("w", encoding="utf-8") as file:
        file.write(_HEADER)
        file.writelines(_iterate_placemarks(table))
        file.write("</Document>\n</kml>\n")


def _iterate_placemarks(table: MapTable) -> Iterator[str]:
    vertices = [",".join(map(repr, point)) for point in table.points.tolist()]
    columns = [column.tolist() for column in table.properties.values()]
    for fragments, values in zip(table.fragments, zip(*columns, strict=True), strict=True):
        # Columns of the edge.
        data = "".join(
            f'<Data name="{escape_xml(name)}"><value>{escape_xml(str(value))}</value></Data>'
            for name, value in zip(table.properties, values, strict=True)
            if not _is_nan(value)
        )

        # Its line, or several that are cut at the antimeridian.
        lines = "".join(
            f"<LineString><coordinates>{' '.join(vertices[fragment])}</coordinates></LineString>"
            for fragment in fragments
        )
        if len(fragments) > 1:
            lines = f"<MultiGeometry>{lines}</MultiGeometry>"
        yield (
            f"<Placemark><styleUrl>#street</styleUrl><ExtendedData>{data}</ExtendedData>"
            f"{lines}</Placemark>\n"
        )


def _is_nan(value: Any) -> bool:
    return isinstance(value, float) and math.isnan(value)
