"""Write a map in vector formats of GDAL: GeoPackage, FlatGeobuf, Shapefile."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from gpszip.errors import MissingExtraError, OutputError
from gpszip.io.maps.table import MapTable
from gpszip.io.maps.wkb import table_wkb
from gpszip.io.storage.temporary import scratch_folder

__all__ = ["write_map_shapefile", "write_map_vector"]

#: Date of the files in a zip archive: the earliest, so that equal maps are equal files.
_ZIP_DATE = (1980, 1, 1, 0, 0, 0)


def write_map_vector(table: MapTable, path: Path, driver: str) -> None:
    """Write the layer ``edges``, or ``ways`` of a clean map, with the columns as fields.

    Lengths are in metres, speeds in m/s. Lines that cross the antimeridian are cut there.

    Parameters
    ----------
    table : MapTable
        The map.
    path : Path
        The file.
    driver : {"GPKG", "FlatGeobuf"}
        Name of the format in GDAL.

    Raises
    ------
    MissingExtraError
        If pyogrio, which brings GDAL, is not installed.
    """
    # GDAL builds the file in memory: it ignores a full disk when it closes a file.
    file = io.BytesIO()
    _write(table, file, driver)
    path.write_bytes(file.getbuffer())


def write_map_shapefile(table: MapTable, path: Path) -> None:
    """Write a zip archive with the files of a Shapefile.

    Parameters
    ----------
    table : MapTable
        The map.
    path : Path
        The file.

    Raises
    ------
    MissingExtraError
        If pyogrio, which brings GDAL, is not installed.
    OutputError
        If there is no space for temporary files.
    """
    layer = _layer(table)
    with scratch_folder() as folder:
        # GDAL ignores a full disk, which shows when the number of lines is read again.
        _write(table, folder / f"{layer}.shp", "ESRI Shapefile")
        files = sorted(folder.glob(f"{layer}.*"))
        if _count_lines(folder / f"{layer}.shp") != len(table):
            raise OutputError("a Shapefile can't be written to the folder of temporary files")
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for file in files:
                archive.writestr(zipfile.ZipInfo(file.name, _ZIP_DATE), file.read_bytes())


def _layer(table: MapTable) -> str:
    return "ways" if table.has_shapes else "edges"


def _write(table: MapTable, target: io.BytesIO | Path, driver: str) -> None:
    # Without a local coordinate system, programs may take metres for positions on the earth.
    geometry_type = "MultiLineString" if len(table.cuts) else "LineString"
    if table.points.shape[1] == 3:
        geometry_type += " Z"
    _pyogrio(driver).raw.write(
        target,
        geometry=table_wkb(table),
        field_data=list(table.properties.values()),
        fields=np.array(list(table.properties), object),
        layer=_layer(table),
        driver=driver,
        geometry_type=geometry_type,
        crs=table.crs,
    )


def _count_lines(path: Path) -> int:
    return int(_pyogrio("ESRI Shapefile").read_info(path, force_feature_count=True)["features"])


def _pyogrio(driver: str) -> Any:
    """Import pyogrio, which brings GDAL, and comes with an extra."""
    try:
        import pyogrio
    except ImportError as error:
        raise MissingExtraError("gis", f"writing {driver}") from error
    return pyogrio
