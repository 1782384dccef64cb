"""Folders that are one log: the file in them that holds it, or that names the files which do."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

__all__ = ["FolderLog", "find_folder_log", "folder_remedy", "is_folder_log"]

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

#: Suffixes of those other files.
_ROS_SUFFIXES = (".db3", ".mcap")


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


def folder_remedy(folder: Path, shown: str) -> str:
    """Return what to do about a folder that is no log.

    Parameters
    ----------
    folder : Path
        The folder.
    shown : str
        Its name in messages.
    """
    name = shown.rstrip("/")
    suffixes = {file.suffix for file in folder.iterdir()}
    for suffix in _ROS_SUFFIXES:
        if suffix in suffixes:
            return (
                f"'ros2 bag reindex {name}' writes its {_ROS_METADATA}; "
                f"or name the files in it: '{name}/*{suffix}'"
            )
    return f"name the files in it: '{name}/*.csv'"


def _is_ros_metadata(path: Path) -> bool:
    """Whether a file is the metadata of ROS 2, rather than of another program."""
    try:
        with path.open("rb") as file:
            return file.read(4096).lstrip().startswith(_ROS_KEY)
    except OSError:
        return False
