"""Writing tracks in any format that can hold them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import BinaryIO

from gpszip.io.formats import format_for_writing
from gpszip.io.sink import writing
from gpszip.model import Track

__all__ = ["write_tracks"]


def write_tracks(tracks: Iterable[Track], sink: str | Path | BinaryIO, format: str | None = None, *, decimals: int = 3) -> None:
    """Write tracks; positions on the earth as latitude and longitude.

    Parameters
    ----------
    tracks : iterable of Track
        All in x and y, or all on the same planes.
    sink : str, Path or binary stream
        The file, which appears whole or not at all and replaces another of its name; ``-`` for standard output.
    format : str, optional
        ``csv``, ``parquet``, ``gpx`` or ``geojson``; told from the name where left out, CSV for a stream.
    decimals : int
        Of metres; degrees have five more.

    Raises
    ------
    OutputError
        If the file can't be written, or the format can't hold the tracks.

    Examples
    --------
    >>> import io
    >>> out = io.BytesIO()
    >>> write_tracks([Track("walk", [0, 0.5], [[0, 0], [1, 2]])], out)
    >>> print(out.getvalue().decode(), end="")
    track_id,t,x,y
    walk,0,0,0
    walk,0.5,1,2
    """
    name = str(sink) if isinstance(sink, (str, Path)) else "-"
    chosen = format_for_writing(name, format)
    with writing(sink) as stream:
        assert chosen.write is not None
        chosen.write(tracks, stream, decimals)
