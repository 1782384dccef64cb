"""Write tracks in any format that can hold them."""

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


def write_tracks(
    tracks: Iterable[Track],
    sink: str | Path | BinaryIO,
    format: str | None = None,
    *,
    decimals: int = 3,
    pieces: Mapping[str, str] | None = None,
    max_deviation: float | None = None,
) -> int:
    """Write tracks; positions on the globe as latitude and longitude.

    Parameters
    ----------
    tracks : iterable of Track
        All in x and y, or all on the globe.
    sink : str, Path or binary stream
        The file, which replaces another of its name once it is complete; ``-`` for standard
        output.
    format : str, optional
        Name of a format that :func:`gpszip.io.logs.formats.log_formats` lists; found from the
        suffix if left out, CSV for a stream.
    decimals : int
        Decimals of metres; degrees have five more.
    pieces : mapping of str to str, optional
        Names of the tracks that pieces between gaps belong to, by the names of the pieces. GPX and
        GeoJSON write successive pieces of one track as one track of several lines; other formats
        write pieces under their own names.
    max_deviation : float, optional
        Metres by which latitude and longitude, read as linear in time, may deviate from the
        tracks. Rows are added as needed, with attributes linear in time. If it is left out, and for
        tracks with attributes that are texts or integers, there is one row for each sample.

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
    # Choose the format, and the decimals of seconds that it writes.
    file_name = str(sink) if isinstance(sink, (str, Path)) else "-"
    chosen = format_for_writing(file_name, format)
    assert chosen.write is not None
    time_decimals = TIME_DECIMALS if chosen.time_decimals is None else chosen.time_decimals
    row_count = 0

    # Round each track only when the format asks for it, as all rows may not fit in memory.
    def rows_of_tracks() -> Iterator[TrackRows]:
        nonlocal row_count
        for track in tracks:
            _check_name(track.id)
            track_name = None if pieces is None else pieces.get(track.id)
            if max_deviation is None:
                rows = track_rows(track, decimals, track_name)
            else:
                rows = densified_rows(
                    track, decimals, max_deviation, track_name, time_decimals=time_decimals
                )
            row_count += len(rows)
            yield rows

    # Write the rows; they are counted as the format takes them.
    with open_sink(sink) as stream:
        chosen.write(rows_of_tracks(), stream)
    return row_count


def _check_name(name: str) -> None:
    """Refuse a name with half a surrogate pair, which no encoding can write."""
    try:
        name.encode()
    except UnicodeEncodeError:
        raise OutputError(
            "its name holds half a letter, which can't be written",
            location=f"track {name!r}",
            remedy="give the track another name",
        ) from None
