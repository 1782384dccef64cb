"""Writing tracks in any format that can hold them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import BinaryIO

from gpszip.errors import OutputError
from gpszip.io.logs.formats import format_for_writing
from gpszip.io.logs.track_rows import TIME_DECIMALS, TrackRows, densified_rows, track_rows
from gpszip.io.storage.sink import open_sink
from gpszip.model import Track

__all__ = ["write_tracks"]

#: Decimals of seconds of formats whose readers often know no more than these; more are written only where they matter.
_TIME_DECIMALS_BY_FORMAT = {"gpx": 3}


def write_tracks(
    tracks: Iterable[Track],
    sink: str | Path | BinaryIO,
    format: str | None = None,
    *,
    decimals: int = 3,
    pieces: Mapping[str, str] | None = None,
    max_deviation: float | None = None,
) -> int:
    """Write tracks; positions on the earth as latitude and longitude.

    Parameters
    ----------
    tracks : iterable of Track
        All in x and y, or all on the earth.
    sink : str, Path or binary stream
        The file, which appears whole or not at all and replaces another of its name; ``-`` for standard output.
    format : str, optional
        ``csv``, ``parquet``, ``gpx`` or ``geojson``; told from the name where left out, CSV for a stream.
    decimals : int
        Of metres; degrees have five more.
    pieces : mapping of str to str, optional
        For tracks that are pieces between gaps, the name of the whole track. GPX and GeoJSON write pieces of one track that
        follow each other as one track of several lines; other formats, pieces by their own names.
    max_deviation : float, optional
        Metres by which latitude and longitude, read as linear in time, may deviate from the tracks. As many rows are added
        as that takes. Without it, or for tracks with attributes, there is one row for each sample.

    Returns
    -------
    int
        Number of rows written.

    Raises
    ------
    OutputError
        If the file can't be written, or the format can't hold the tracks.

    Examples
    --------
    >>> import io
    >>> out = io.BytesIO()
    >>> write_tracks([Track("walk", [0, 0.5], [[0, 0], [1, 2]])], out)
    2
    >>> print(out.getvalue().decode(), end="")
    track_id,t,x,y
    walk,0,0,0
    walk,0.5,1,2
    """
    name = str(sink) if isinstance(sink, (str, Path)) else "-"
    chosen = format_for_writing(name, format)
    assert chosen.write is not None
    count = 0

    def rows() -> Iterator[TrackRows]:
        nonlocal count
        for track in tracks:
            _check_name(track.id)
            whole = None if pieces is None else pieces.get(track.id)
            if max_deviation is None:
                made = track_rows(track, decimals, whole)
            else:
                made = densified_rows(
                    track,
                    decimals,
                    max_deviation,
                    whole,
                    ticks=_TIME_DECIMALS_BY_FORMAT.get(chosen.name, TIME_DECIMALS),
                )
            count += len(made)
            yield made

    with open_sink(sink) as stream:
        chosen.write(rows(), stream)
    return count


def _check_name(name: str) -> None:
    try:
        name.encode()
    except UnicodeEncodeError:
        raise OutputError(
            f"track {name!r}: its name holds half a letter, which can't be written; give the track another name"
        ) from None
