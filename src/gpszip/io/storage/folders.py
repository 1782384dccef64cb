"""Folders that are one log: the file in them that holds it, or that names the files which do."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from gpszip.io.storage.zip_files import is_hidden

__all__ = ["FolderItem", "FolderLog", "find_folder_log", "is_folder_log", "walk_folder"]

#: Places of the positions in the folder of a EuRoC sequence, the preferred ones first.
_EUROC_FILES = (
    "mav0/state_groundtruth_estimate0/data.csv",
    "state_groundtruth_estimate0/data.csv",
    "mav0/mocap0/data.csv",
    "mocap0/data.csv",
)


#: The file that names the other files of a folder which ROS 2 recorded, and how it begins.
_ROS_METADATA = "metadata.yaml"
_ROS_KEY = b"rosbag2_bagfile_information:"

#: Files that writers of Parquet add to a folder.
_MARKERS = ("_SUCCESS", "_metadata", "_common_metadata")


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
        The folder of a EuRoC sequence, or one that ROS 2 recorded.
    """
    metadata = folder / _ROS_METADATA
    if _is_ros_metadata(metadata):
        sizes = (file.stat().st_size for file in folder.iterdir() if file.is_file())
        return FolderLog(metadata, sum(sizes))
    for name in _EUROC_FILES:
        if (folder / name).is_file():
            return FolderLog(folder / name)
    return None


def is_folder_log(path: Path) -> bool:
    """Whether a file stands for the folder that it is in."""
    return path.name == _ROS_METADATA and _is_ros_metadata(path)


class FolderItem(NamedTuple):
    """A file in a folder, a folder in it that is one log, or what can't be read.

    Parameters
    ----------
    path : Path
        The file or folder.
    log : FolderLog or None
        The log that the folder is; None for a file.
    error : OSError or None
        Why it can't be read.
    """

    path: Path
    log: FolderLog | None = None
    error: OSError | None = None


def walk_folder(folder: Path) -> Iterator[FolderItem]:
    """Find the files of a folder and of all folders in it.

    Files of a folder come before those of the folders in it, each in the order of their names.
    Hidden files are passed over. A folder that is one log, such as a bag of ROS 2, is one item.
    Links are followed, but no folder is entered twice.

    Parameters
    ----------
    folder : Path
        The folder.

    Yields
    ------
    FolderItem
        An error for a folder that can't be listed.
    """
    waiting, entered = [folder], set()
    while waiting:
        # Links may lead back to a folder.
        current = waiting.pop()
        try:
            status = current.stat()
            if (status.st_dev, status.st_ino) in entered:
                continue
            entered.add((status.st_dev, status.st_ino))
            names = sorted(entry.name for entry in current.iterdir())
        except OSError as error:
            yield FolderItem(current, error=error)
            continue

        # A folder that is one log.
        if log := find_folder_log(current):
            yield FolderItem(current, log)
            continue

        # Files now, folders later.
        paths = [current / name for name in names if not _is_passed_over(name)]
        folders = [path for path in paths if path.is_dir()]
        yield from (FolderItem(path) for path in paths if not path.is_dir())
        waiting += reversed(folders)


def _is_passed_over(name: str) -> bool:
    return is_hidden(name) or name in _MARKERS


def _is_ros_metadata(path: Path) -> bool:
    """Whether a file is the metadata of ROS 2, rather than of another program."""
    try:
        with path.open("rb") as file:
            return file.read(4096).lstrip().startswith(_ROS_KEY)
    except OSError:
        return False
