"""Recognise binary logs by their first bytes.

All formats are asked about each file, so this module imports nothing heavy.
"""

from __future__ import annotations

import re

__all__ = [
    "BAG_MAGIC",
    "DATAFLASH_FMT",
    "DATAFLASH_SYNC",
    "MCAP_MAGIC",
    "NUMPY_MAGIC",
    "SQLITE_MAGIC",
    "is_binary_dataflash",
    "sniff_fit",
    "sniff_flatgeobuf",
    "sniff_gpkg",
    "sniff_hdf5",
    "sniff_npz",
    "sniff_parquet",
    "sniff_ros",
    "sniff_tlog",
    "sniff_ulog",
]

#: First bytes of a database of SQLite.
SQLITE_MAGIC = b"SQLite format 3\0"

#: First bytes of bags of ROS 1, and of MCAP files.
BAG_MAGIC = b"#ROSBAG V"
MCAP_MAGIC = b"\x89MCAP0\r\n"

#: First bytes of an array of NumPy.
NUMPY_MAGIC = b"\x93NUMPY"

#: First bytes of a message of DataFlash, and the kind of messages that describe others.
DATAFLASH_SYNC = b"\xa3\x95"
DATAFLASH_FMT = 128

#: First bytes of Parquet, HDF5 and ULog.
_PARQUET = b"PAR1"
_HDF5 = b"\x89HDF\r\n\x1a\n"
_ULOG = b"ULog\x01\x12\x35"

#: Where a database of SQLite names the application that wrote it.
_APPLICATION = slice(68, 70)

#: First bytes of FlatGeobuf; the bytes between and after them are versions.
_FLATGEOBUF, _VERSION = b"fgb", 4

#: The signature of FIT, and the bytes before it: sizes and versions.
_FIT, _FIT_OFFSET = b".FIT", 8

#: What the metadata of a folder of ROS 2 begins with, and the bytes within which it does.
_ROS_METADATA = b"rosbag2_bagfile_information:"
_ROS_METADATA_START = 1 << 12

#: What the first page of a database says if ROS 2 wrote it.
_ROS_TABLES = (b"CREATE TABLE topics", b"CREATE TABLE messages", b"serialization_format")

#: The first member of an archive of arrays: its header, and its name.
_NPZ = re.compile(rb"PK\x03\x04(?s:.{22})(..)(..)([^\0/]{1,200}?\.npy)", re.DOTALL)

#: Bytes of the time before a frame of MAVLink, and the first bytes of frames.
_TLOG_TIME_BYTES = 8
_MAVLINK_MARKS = (b"\xfd", b"\xfe")


def sniff_parquet(head: bytes) -> bool:
    """Whether a file that starts like this is Parquet."""
    return head.startswith(_PARQUET)


def sniff_gpkg(head: bytes) -> bool:
    r"""Whether a file that starts like this is a GeoPackage.

    Examples
    --------
    >>> sniff_gpkg(b"SQLite format 3\x00" + bytes(52) + b"GPKG")
    True
    """
    # The application is GPKG, or GP10 and GP11 in old files.
    return head.startswith(SQLITE_MAGIC) and head[_APPLICATION] == b"GP"


def sniff_flatgeobuf(head: bytes) -> bool:
    """Whether a file that starts like this is FlatGeobuf."""
    return head.startswith(_FLATGEOBUF) and head.startswith(_FLATGEOBUF, _VERSION)


def sniff_fit(head: bytes) -> bool:
    r"""Whether a file that starts like this is FIT.

    Examples
    --------
    >>> sniff_fit(b"\x0e\x20\x54\x08\x00\x01\x00\x00.FIT"), sniff_fit(b"t,x,y\n0,1,2")
    (True, False)
    """
    return head.startswith(_FIT, _FIT_OFFSET)


def sniff_ros(head: bytes) -> bool:
    """Whether a file that starts like this is a bag, an MCAP file or the metadata of a folder."""
    if head.startswith((BAG_MAGIC, MCAP_MAGIC)):
        return True
    if head.startswith(SQLITE_MAGIC):
        return all(text in head for text in _ROS_TABLES)
    return head[:_ROS_METADATA_START].lstrip().startswith(_ROS_METADATA)


def sniff_npz(head: bytes) -> bool:
    r"""Whether a file that starts like this holds arrays of NumPy.

    Examples
    --------
    >>> sniff_npz(b"\x93NUMPY\x01\x00"), sniff_npz(b"PK\x03\x04")
    (True, False)
    """
    match = _NPZ.match(head)
    is_archive = match is not None and int.from_bytes(match[1], "little") == len(match[3])
    return is_archive or head.startswith(NUMPY_MAGIC)


def sniff_hdf5(head: bytes) -> bool:
    r"""Whether a file that starts like this is HDF5.

    Examples
    --------
    >>> sniff_hdf5(b"\x89HDF\r\n\x1a\n\0"), sniff_hdf5(b"t,x,y")
    (True, False)
    """
    return head.startswith(_HDF5)


def sniff_ulog(head: bytes) -> bool:
    r"""Whether a file that starts like this is ULog.

    Examples
    --------
    >>> sniff_ulog(b"ULog\x01\x12\x35\x01"), sniff_ulog(b"t,x,y")
    (True, False)
    """
    return head.startswith(_ULOG)


def is_binary_dataflash(head: bytes) -> bool:
    r"""Whether a file that starts like this is a binary log of ArduPilot.

    Examples
    --------
    >>> is_binary_dataflash(b"\xa3\x95\x80\x80\x59FMT\0"), is_binary_dataflash(b"FMT, 128, 89")
    (True, False)
    """
    return head.startswith(DATAFLASH_SYNC + bytes([DATAFLASH_FMT]))


def sniff_tlog(head: bytes) -> bool:
    r"""Whether a file that starts like this is a telemetry log.

    Examples
    --------
    >>> frame = (1_700_000_000_000_000).to_bytes(8, "big") + b"\xfe\x00\x00\x01\x01\x00\x00\x00"
    >>> sniff_tlog(3 * frame), sniff_tlog(b"t,x,y\n0,1,2\n")
    (True, False)
    """
    # Few other files have the mark of a frame there, so the reader is seldom imported.
    if not head.startswith(_MAVLINK_MARKS, _TLOG_TIME_BYTES):
        return False

    from gpszip.io.logs.tlog import starts_with_frames

    return starts_with_frames(head)
