"""Bags of ROS 1 and ROS 2, and MCAP files, behind one interface: topics and their messages.

rosbags reads ROS 1, folders of ROS 2 and SQLite; mcap reads lone MCAP files, which need not be of
ROS. Both read chunk by chunk, so that large bags take little memory.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from gpszip.errors import GPSZipError, InputError, MissingExtraError, UnknownFormatError
from gpszip.io.logs.ros.messages import TRANSFORMS
from gpszip.io.logs.sniff.binary import BAG_MAGIC, MCAP_MAGIC, SQLITE_MAGIC
from gpszip.io.storage.expansion import read_chunk
from gpszip.io.storage.source import Source
from gpszip.io.storage.temporary import disk_errors_as_output_errors, scratch_folder

__all__ = [
    "METADATA",
    "Bag",
    "Message",
    "Topic",
    "kind_of",
    "named_faults",
    "open_bag",
]

#: File by which a folder of ROS 2 is read.
METADATA = "metadata.yaml"

#: Bytes that are copied at a time.
_CHUNK_BYTES = 1 << 20

#: Letters of an error message of a library that are shown.
_MAX_REASON_LETTERS = 160

#: Largest record of an MCAP file: a chunk is a few megabytes.
_MAX_RECORD_BYTES = 1 << 30

#: Types that ROS 1 names in another way.
_OLD_TYPES = {"tf/msg/tfMessage": TRANSFORMS}

#: What to do about damaged files, by their kind.
_REMEDIES = {
    "bag": "'rosbag reindex FILE' repairs a bag that was not closed; else copy it again",
    "mcap": "'mcap recover FILE -o repaired.mcap' repairs a file that was not closed; else copy it "
    "again",
    "sqlite": "'ros2 bag reindex FOLDER' repairs a folder, \"sqlite3 FILE '.recover'\" a file; "
    "else copy it again",
    "folder": "'ros2 bag reindex FOLDER' writes its metadata.yaml anew; else copy it again",
}


class Topic(NamedTuple):
    """A topic of a bag.

    Parameters
    ----------
    name : str
        Its name.
    type : str
        Type of its messages, such as ``nav_msgs/msg/Odometry``.
    messages : int
        Number of its messages.
    """

    name: str
    type: str
    messages: int


class Message(NamedTuple):
    """A message as stored.

    Parameters
    ----------
    topic : str
        Name of its topic.
    type : str
        Its type.
    log_time : int
        Nanoseconds from 1970 when it was recorded.
    decode : callable
        Returns the message: an object with the fields of ROS, or a mapping for JSON.
    """

    topic: str
    type: str
    log_time: int
    decode: Callable[[], Any]


class Bag(Protocol):
    """An open bag."""

    @property
    def topics(self) -> tuple[Topic, ...]:
        """All topics, sorted by their names."""

    def messages(self, names: Collection[str]) -> Iterator[Message]:
        """Yield the messages of some topics in the order in which they were recorded."""


@contextmanager
def open_bag(source: Source) -> Iterator[Bag]:
    """Open a bag until the context ends.

    Parameters
    ----------
    source : Source
        The file, ``metadata.yaml`` of a folder, or a stream, which is copied to a temporary file.

    Raises
    ------
    InputError
        If the bag is damaged; also while its messages are read.
    MissingExtraError
        If rosbags or mcap are not installed.
    """
    kind = kind_of(source)
    if source.path is not None and kind in ("sqlite", "folder"):
        _refuse_open_databases(source, source.path)
    with ExitStack() as stack:
        path = stack.enter_context(_as_file(source, kind))
        with named_faults(source.name, kind):
            bag = _open_mcap(path, stack) if kind == "mcap" else _open_ros(path, kind, stack)
        yield bag


def kind_of(source: Source) -> str:
    """Return what a file is: ``bag``, ``mcap``, ``sqlite`` or ``folder``.

    Raises
    ------
    UnknownFormatError
        If it is none of these.
    """
    head = source.head()
    if head.startswith(MCAP_MAGIC):
        return "mcap"
    if head.startswith(BAG_MAGIC):
        return "bag"
    if head.startswith(SQLITE_MAGIC):
        return "sqlite"
    if source.path is not None and source.path.name == METADATA:
        return "folder"
    # The metadata in a zip archive holds no log; the files beside it are read by themselves.
    raise UnknownFormatError(
        "is no bag of ROS and no MCAP",
        path=source.name,
        remedy="name a .bag, .db3 or .mcap, or a folder with metadata.yaml",
    )


def _refuse_open_databases(source: Source, path: Path) -> None:
    """Refuse databases some of whose messages are still in a file beside them.

    rosbags reads the database alone, and would pass over these messages.
    """
    if path.name == METADATA:
        logs = sorted(path.parent.glob("*.db3-wal"))
    else:
        logs = [path.with_name(f"{path.name}-wal")]
    for log in logs:
        if log.is_file() and log.stat().st_size:
            database = str(log).removesuffix("-wal")
            raise InputError(
                f"was not closed: {log.name} holds messages that are not in it yet",
                path=source.name,
                remedy=f"sqlite3 {database} 'PRAGMA wal_checkpoint(TRUNCATE)' adds them",
            )


@contextmanager
def _as_file(source: Source, kind: str) -> Iterator[Path]:
    """Find the file or folder of a bag; copy a stream or a packed file to a temporary one."""
    # Files and folders that libraries read in place.
    if source.path is not None and kind == "folder":
        yield source.path.parent
        return
    if source.path is not None and not source.is_gzip and kind != "sqlite":
        yield source.path
        return

    # rosbags takes databases by their suffix, and their names as a part of a URI.
    with scratch_folder() as folder:
        path = folder / ("log.db3" if kind == "sqlite" else "log")
        if source.path is not None and not source.is_gzip:
            path.symlink_to(source.path.resolve())
        else:
            with source.open() as stream, disk_errors_as_output_errors(), path.open("wb") as file:
                while chunk := read_chunk(stream, _CHUNK_BYTES):
                    file.write(chunk)
        yield path


@contextmanager
def named_faults(name: str, kind: str) -> Iterator[None]:
    """Turn what libraries raise about a damaged file into errors that name it.

    Parameters
    ----------
    name : str
        Name of the log.
    kind : str
        Kind of file: ``bag``, ``mcap``, ``sqlite`` or ``folder``.
    """
    try:
        yield
    except (GPSZipError, GeneratorExit):
        raise
    except ImportError as error:
        raise MissingExtraError("ros", "reading bags of ROS and MCAP") from error
    # Damaged bytes make the libraries raise nearly anything: struct.error, KeyError, MemoryError.
    except Exception as error:
        reason = (str(error) or type(error).__name__).splitlines()[0][:_MAX_REASON_LETTERS]
        raise InputError(
            f"is damaged or was not closed: {reason}", path=name, remedy=_REMEDIES[kind]
        ) from None


# ROS 1 and ROS 2


class _RosBag:
    """A bag that rosbags reads."""

    def __init__(self, reader: Any, decode: Callable[[bytes, str], Any]) -> None:
        self._reader = reader
        self._decode = decode
        # A topic has a connection for each publisher.
        counts: Counter[tuple[str, str]] = Counter()
        for connection in reader.connections:
            counts[connection.topic, _plain_type(connection.msgtype)] += connection.msgcount
        self.topics = tuple(Topic(*key, count) for key, count in sorted(counts.items()))

    def messages(self, names: Collection[str]) -> Iterator[Message]:
        """Yield the messages of some topics."""
        wanted = [item for item in self._reader.connections if item.topic in names]
        # rosbags reads all topics if none is named.
        if not wanted:
            return
        for connection, log_time, data in self._reader.messages(wanted):
            kind = _plain_type(connection.msgtype)
            yield Message(connection.topic, kind, log_time, _bound(self._decode, data, kind))


def _bound(decode: Callable[[bytes, str], Any], data: bytes, kind: str) -> Callable[[], Any]:
    return lambda: decode(data, kind)


def _plain_type(name: str) -> str:
    """Return a type as ROS 2 names it."""
    package, _, rest = name.partition("/")
    if rest and "/" not in rest:
        name = f"{package}/msg/{rest}"
    return _OLD_TYPES.get(name, name)


def _open_ros(path: Path, kind: str, stack: ExitStack) -> Bag:
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    # Messages of positions are the same in all versions of ROS 2.
    if kind == "bag":
        reader1 = stack.enter_context(Reader1(path))
        return _RosBag(reader1, _ros1_decoder())
    return _RosBag(stack.enter_context(Reader2(path)), _cdr_decoder())


def _ros1_decoder() -> Callable[[bytes, str], Any]:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    # Transforms are no part of the messages that come with ROS 1.
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TRANSFORMS))
    decode: Callable[[bytes, str], Any] = store.deserialize_ros1
    return decode


def _cdr_decoder() -> Callable[[bytes, str], Any]:
    from rosbags.typesys import Stores, get_typestore

    decode: Callable[[bytes, str], Any] = get_typestore(Stores.ROS2_HUMBLE).deserialize_cdr
    return decode


# MCAP


class _McapFile:
    """A file that mcap reads."""

    def __init__(self, file: Any) -> None:
        from mcap.reader import SeekingReader

        self._reader = SeekingReader(file, record_size_limit=_MAX_RECORD_BYTES)
        self._decoders: dict[str, Callable[[bytes, str], Any]] = {}
        self.topics = self._find_topics()

    def _find_topics(self) -> tuple[Topic, ...]:
        """Return the topics that the summary lists, or else those of all messages."""
        summary = self._reader.get_summary()
        counts: Counter[tuple[str, str]] = Counter()
        if summary is not None and summary.statistics is not None:
            numbers = summary.statistics.channel_message_counts
            for channel in summary.channels.values():
                schema = summary.schemas.get(channel.schema_id)
                counts[channel.topic, _schema_type(schema, channel)] += numbers.get(channel.id, 0)
        else:
            for schema, channel, _ in self._reader.iter_messages(log_time_order=False):
                counts[channel.topic, _schema_type(schema, channel)] += 1
        return tuple(Topic(*key, count) for key, count in sorted(counts.items()))

    def messages(self, names: Collection[str]) -> Iterator[Message]:
        """Yield the messages of some topics."""
        # The order of time would need all messages of a file without index in memory.
        for schema, channel, message in self._reader.iter_messages(names, log_time_order=False):
            kind = _schema_type(schema, channel)
            decode = self._decoder(channel.message_encoding)
            yield Message(channel.topic, kind, message.log_time, _bound(decode, message.data, kind))

    def _decoder(self, encoding: str) -> Callable[[bytes, str], Any]:
        if encoding not in self._decoders:
            self._decoders[encoding] = _DECODERS[encoding]()
        return self._decoders[encoding]


def _schema_type(schema: Any, channel: Any) -> str:
    """Return the type of a channel; one that can't be decoded shows its encoding."""
    name = "" if schema is None else _plain_type(schema.name)
    if channel.message_encoding in _DECODERS:
        return name
    return f"{name} as {channel.message_encoding}"


def _decode_json(data: bytes, _kind: str) -> Any:
    return json.loads(data)


#: Functions that make decoders, by the encoding of messages in MCAP.
_DECODERS: dict[str, Callable[[], Callable[[bytes, str], Any]]] = {
    "cdr": _cdr_decoder,
    "ros1": _ros1_decoder,
    "json": lambda: _decode_json,
}


def _open_mcap(path: Path, stack: ExitStack) -> Bag:
    return _McapFile(stack.enter_context(path.open("rb")))
