"""How far a journal has been read for events: the first line of the state of its monitor.

Whoever archives a journal leaves the segments behind that place, as their events would be lost.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import NamedTuple

from gpszip.errors import InputError

__all__ = ["PlaceRead", "read_place", "state_error", "state_path"]

#: Name of the file with the state, and its version.
_STATE = "monitor"
_VERSION = 2


class _VersionError(ValueError):
    """The state was saved by another version of GPSZip."""


class PlaceRead(NamedTuple):
    """A place in a journal up to which events are found.

    Parameters
    ----------
    segment : int
        Number of the segment that is read; all earlier ones are read.
    offset : int
        Bytes of it that are read.

    Examples
    --------
    >>> PlaceRead.from_json(PlaceRead(3, 700).to_json())
    PlaceRead(segment=3, offset=700)
    """

    segment: int
    offset: int

    def to_json(self) -> str:
        """Return the first line of the state."""
        return json.dumps({"version": _VERSION, **self._asdict()}, separators=(",", ":"))

    @classmethod
    def from_json(cls, line: str) -> PlaceRead:
        """Read the first line of a state; a ValueError, KeyError or TypeError if it is none."""
        row = json.loads(line)
        if row["version"] != _VERSION:
            raise _VersionError(
                f"it has version {row['version']}, and this GPSZip reads {_VERSION}"
            )
        return cls(int(row["segment"]), int(row["offset"]))

    def is_past(self, path: Path) -> bool:
        """Whether all of a segment is read."""
        number = int(path.stem)
        if number == self.segment:
            return self.offset >= path.stat().st_size
        return number < self.segment


def state_path(folder: Path) -> Path:
    """Path of the state in the folder of a journal."""
    return folder / _STATE


def read_place(folder: Path) -> PlaceRead | None:
    """Return the place up to which a journal is read; None if nobody asked for its events.

    Raises
    ------
    InputError
        If the state can't be read, or is one of another version.
    """
    try:
        with state_path(folder).open(encoding="ascii") as file:
            return PlaceRead.from_json(file.readline())
    except FileNotFoundError:
        return None
    except _VersionError as error:
        raise state_error(folder, f": {error}") from error
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise state_error(folder) from error


def state_error(folder: Path, reason: str = "") -> InputError:
    """The error of a state that can't be read."""
    return InputError(
        f"the state of the monitor can't be read{reason}",
        path=state_path(folder),
        remedy="remove the file; the journal is then read from its start",
    )
