"""Folders that are one log: the file in them that holds it, or that names the files which do."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

__all__ = ["FolderLog", "find_folder_log"]

#: Places of the positions in the folder of a EuRoC sequence, the preferred ones first.
_EUROC_FILES = (
    "mav0/state_groundtruth_estimate0/data.csv",
    "state_groundtruth_estimate0/data.csv",
    "mav0/mocap0/data.csv",
    "mocap0/data.csv",
)


class FolderLog(NamedTuple):
    """The file by which a log in a folder is read.

    Parameters
    ----------
    path : Path
        The file.
    stored_bytes : int or None
        Size of all files of the log; None if this is the only one.
    """

    path: Path
    stored_bytes: int | None = None


def find_folder_log(folder: Path) -> FolderLog | None:
    """Find the log that a folder is; None if it is none that is known.

    Parameters
    ----------
    folder : Path
        The folder of a EuRoC sequence.
    """
    for name in _EUROC_FILES:
        if (folder / name).is_file():
            return FolderLog(folder / name)
    return None
